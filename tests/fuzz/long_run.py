#!/usr/bin/env python3
"""Runs all fuzzers of a tree of the preset fuzz until each has made its share of a number of
executions, and adds up the counts over runs: stopped (Ctrl-C, or after --seconds) and started again,
it goes on.

    tests/fuzz/long_run.py build/fuzz --executions 5e7 --json runs/fuzzing.json

Counts stand in FINDINGS/counts.json, an entry a fuzzer, beside its corpus; they begin anew only where
that file is removed. A fuzzer that found something is not run further at that revision; the input is in its folder.
Exit code: 0, also where executions are left; 1 where something was found; 2 for bad input.
"""

import argparse
import datetime
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import time

SOURCE = pathlib.Path(__file__).resolve().parent.parent.parent

# How many times as many executions as the mean: these take milliseconds (FFmpeg, ROS's library).
SHARES = {"fuzz_video": 0.02, "fuzz_rosbag": 0.1, "fuzz_image": 0.5}


class BadInput(Exception):
    pass


def git(*words):
    run = subprocess.run(["git", "-C", SOURCE, *words], capture_output=True, text=True, check=False)
    return run.stdout.strip() if run.returncode == 0 else "unknown"


def revision():
    return git("rev-parse", "--short=7", "HEAD")


def cpu_model():
    for line in pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return "unknown"


class Counts:
    """Executions, seconds and findings by fuzzer, in a file that is replaced whole."""

    def __init__(self, path):
        self.path = path
        self.by_fuzzer = {}
        if path.exists():
            try:
                self.by_fuzzer = json.loads(path.read_text(encoding="utf-8"))
            except ValueError as error:
                raise BadInput(f"{path}: {error}") from error

    def of(self, name):
        return self.by_fuzzer.setdefault(
            name, {"executions": 0, "cpu_s": 0.0, "features": 0, "corpus": 0, "found": 0,
                   "found_at": "", "revisions": []})

    def save(self):
        part = self.path.with_suffix(".part")
        part.write_text(json.dumps(self.by_fuzzer, indent=1) + "\n", encoding="utf-8")
        part.replace(self.path)


def wanted(programs, executions):
    """Executions by fuzzer: equal but for the slow ones."""
    shares = {p.name: SHARES.get(p.name, 1.0) for p in programs}
    whole = sum(shares.values())
    return {name: round(executions * share / whole) for name, share in shares.items()}


def run_once(program, folder, seconds, most, entry):
    """One run of one fuzzer; adds to its entry. @return whether it found nothing."""
    corpus, seeds = folder / "corpus", SOURCE / "tests/fuzz/corpus" / program.name[5:]
    corpus.mkdir(parents=True, exist_ok=True)
    words = [program, f"-max_total_time={seconds}", f"-runs={most}", "-rss_limit_mb=2048",
             "-timeout=10", "-print_final_stats=1", f"-artifact_prefix={folder}/", corpus, seeds]
    before = os.times()
    with subprocess.Popen(list(map(str, words)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                          text=True, errors="replace") as child:
        try:
            _, log = child.communicate()
        except KeyboardInterrupt:
            child.send_signal(signal.SIGINT)  # libFuzzer prints its statistics and ends
            _, log = child.communicate()
            add(entry, log, before, corpus)
            raise
    add(entry, log, before, corpus)
    if child.returncode == 0:
        return True
    entry["found"] += 1
    entry["found_at"] = revision()
    (folder / "last.log").write_text(log[-200000:], encoding="utf-8")
    return False


def add(entry, log, before, corpus):
    executions = re.findall(r"^stat::number_of_executed_units: +(\d+)", log, re.M)
    features = re.findall(r"\bft: (\d+)", log)
    now = os.times()
    entry["executions"] += int(executions[-1]) if executions else 0
    entry["cpu_s"] += (now.children_user + now.children_system
                       - before.children_user - before.children_system)
    if features:
        entry["features"] = int(features[-1])
    entry["corpus"] = sum(1 for _ in corpus.iterdir())
    if revision() not in entry["revisions"]:
        entry["revisions"].append(revision())


def report(counts, load_before):
    """The counts as the benchmark programs write their tables."""
    rows = [[name.removeprefix("fuzz_"), entry["executions"], entry["features"], entry["corpus"],
             round(entry["cpu_s"], 1), entry["found"]]
            for name, entry in sorted(counts.by_fuzzer.items())]
    rows.append(["all"] + [sum(row[i] for row in rows) for i in range(1, 6)])
    columns = [{"name": "fuzzer", "label": True}, {"name": "executions"}, {"name": "features"},
               {"name": "inputs kept"}, {"name": "CPU", "unit": "s", "timing": True},
               {"name": "found", "better": "lower"}]
    return {
        "format": "camber-benchmark", "version": 1, "program": "long_run.py", "seed": 0,
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "revision": revision(),
        "library_tree": git("rev-parse", "--short=12", "HEAD:lib"),
        "machine": {"cores": os.cpu_count(), "cpu": cpu_model(),
                    "load_average": {"before": [load_before], "after": [os.getloadavg()[0]]}},
        "options": {"sections": [], "accuracy_only": False}, "items": {},
        "tables": [{"key": "fuzzing", "name": "Executions of the fuzzers",
                    "command": "tests/fuzz/long_run.py build/fuzz", "columns": columns,
                    "rows": rows}]}


def rounds(programs, goals, counts, args):
    """Turns of --turn seconds, one fuzzer after the other, until all goals are met."""
    end = time.monotonic() + args.seconds if args.seconds else float("inf")
    while True:
        left = [p for p in programs if counts.of(p.name)["executions"] < goals[p.name]
                and counts.of(p.name)["found_at"] != revision()]
        if not left or time.monotonic() > end:
            return
        for program in left:
            seconds = int(min(args.turn, end - time.monotonic()))
            if seconds < 1:
                return
            entry = counts.of(program.name)
            most = goals[program.name] - entry["executions"]
            try:
                sound = run_once(program, args.findings / program.name, seconds, most, entry)
            finally:
                counts.save()
            print(f"{program.name}: {entry['executions']} of {goals[program.name]} executions, "
                  f"{entry['features']} features{'' if sound else ', FOUND SOMETHING'}", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path)
    parser.add_argument("--executions", type=float, default=5e7, help="of all fuzzers together")
    parser.add_argument("--seconds", type=float, default=0.0, help="end after so many; 0: never")
    parser.add_argument("--turn", type=float, default=60.0, help="seconds of one fuzzer at a time")
    parser.add_argument("--findings", type=pathlib.Path, help="default: BUILD/findings")
    parser.add_argument("--json", type=pathlib.Path, help="the counts as a benchmark's results")
    args = parser.parse_args()
    args.findings = (args.findings or args.build / "findings").resolve()
    programs = sorted((args.build.resolve() / "bin").glob("fuzz_*"))
    if not programs:
        raise BadInput(f"{args.build}/bin: no fuzzers: cmake --preset fuzz, then "
                       "cmake --build --preset fuzz")
    args.findings.mkdir(parents=True, exist_ok=True)
    load_before = os.getloadavg()[0]
    counts = Counts(args.findings / "counts.json")
    try:
        rounds(programs, wanted(programs, args.executions), counts, args)
    except KeyboardInterrupt:
        print("stopped; the same command goes on", file=sys.stderr)
    if args.json:
        args.json.parent.mkdir(parents=True, exist_ok=True)
        args.json.write_text(json.dumps(report(counts, load_before), indent=1) + "\n",
                             encoding="utf-8")
    found = [name for name, entry in counts.by_fuzzer.items() if entry["found_at"] == revision()]
    for name in found:
        print(f"{name} found something: {args.findings / name}", file=sys.stderr)
    return 1 if found else 0


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        sys.exit(main())
    except BadInput as error:
        print(f"long_run.py: {error}", file=sys.stderr)
        sys.exit(2)
