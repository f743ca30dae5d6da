#!/usr/bin/env python3
"""How far Camber's scale and its stated sigma can be trusted, on many made scenes.

Runs `camber reconstruct` over scenes of other makers and reports errors of the scale against what
it states, refusals, warnings and vehicles; with faults put into what it is given, whether each was
refused, warned of or inside three sigma. A scene's height is the true one with a draw of its
height_sigma (0.01 m where it states none). Errors in tables and JSON are logarithms of estimated
over true, as the stated sigma is; the lists of the worst have per cent. For example:

  trust.py --maker synth --scenes made --numbers 0:99 --odd --frames 1:3,0:4,none --out trust
  trust.py --maker steep_scenes --steep-scenes make.py --scenes made --faults none,height+20,repeat

Makers: steep_scenes (a script called as `make.py --out FOLDER NUMBERS` by the Python that its first
line names), synth (`camber synth --random NUMBER`), folder (the scenes that --scenes holds,
numbered in order of their names).
Faults: none; height+20, focal10 (any per cent); cx0; fov: a guessed camera, whose field of view is
off by a draw of 5 degrees and whose height by one of 3 cm, both stated as `camber import` states
them; fov+10, fov-15: off by so many degrees, 5 stated; and in the frame after the reference frame:
repeat (the reference frame's images again), other (another scene's), exposure (1.6 times as
bright), black (the right half), pose (all poses are given, this one 1 degree off). With --speed
also speed+20, speed-20.
--coder h264:300 or h265:300 lets all frames go through a film of so many kbit/s (ffmpeg's libx264,
libx265).

Scenes are made once. Every run is a line of OUT/runs.jsonl, under a key of all that defines it (the
program's bytes too), and is not repeated.

Exit code: 0, 1 if a run crashed, 2 for bad input.
"""

import argparse
import hashlib
import json
import math
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile
import threading
from concurrent.futures import ThreadPoolExecutor

import trust_report
from benchmark_json import BadInput, write_document
from trust_scenes import (CODER_PATTERN, check_fault, coded_images, edited_manifest, facts_of,
                          last_line, make_scenes, turn_deg)

FORMAT = 2          # of a run's line and of what a switch or fault does: part of each key
FACTS_FORMAT = 2    # of a scene's line
TIME_LIMIT = 900    # s, of one run
FRAMES_PATTERN = re.compile(r"none(@\d+)?$|\d+:\d+(:[1-9]\d*)?$|\d+(\+\d+)+$")


class Program:
    """A copy of the camber program and of its plugins, so that it may be built anew meanwhile."""

    def __init__(self, path, folder):
        path = path.resolve()
        if not path.is_file() or not os.access(path, os.X_OK):
            raise BadInput(f"{path}: no program to run")
        root = path.parent.parent  # plugins are found relative to the program
        plugins = {file for folders in ("lib*/camber", "lib/*/camber")
                   for file in root.glob(folders + "/libcamber_*.so")}
        digest = hashlib.sha256()
        for file in [path, *sorted(plugins)]:
            copied = folder / file.relative_to(root)
            copied.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(file, copied)
            digest.update(copied.read_bytes())
        self.path = folder / path.relative_to(root)
        self.hash = digest.hexdigest()[:16]


class Lines:
    """A file of JSON lines, {"key", ...} each, that grows; a line that was cut off is dropped."""

    def __init__(self, path):
        self.path, self.lock, self.by_key = path, threading.Lock(), {}
        whole = True
        if path.exists():
            text = path.read_text(encoding="utf-8")
            whole = not text or text.endswith("\n")
            for line in text.splitlines():
                try:
                    entry = json.loads(line)
                    self.by_key[entry["key"]] = entry
                except (ValueError, KeyError, TypeError):
                    continue
        self.file = open(path, "a", encoding="utf-8")
        if not whole:
            self.file.write("\n")

    def add(self, entry):
        with self.lock:
            self.by_key[entry["key"]] = entry
            self.file.write(json.dumps(entry) + "\n")
            self.file.flush()


def bench_parser(description, of, script, numbers):
    """The options that benches over many scenes have alike; of: what a scene is called."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--camber", type=pathlib.Path, default=pathlib.Path("build/release/bin/camber"),
        metavar="PATH", help="default: build/release/bin/camber")
    add("--maker", choices=("steep_scenes", "synth", "folder"), default="synth")
    add("--steep-scenes", type=pathlib.Path, metavar=script, help="the maker's script")
    add("--scenes", type=pathlib.Path, required=True, metavar="FOLDER",
        help=f"where {of} are made and found again")
    add("--numbers", default=numbers, metavar="N|A:B,...", help=f"both ends; default: {numbers}")
    half = parser.add_mutually_exclusive_group()
    half.add_argument("--odd", action="store_true", help="only odd numbers: those to report")
    half.add_argument("--even", action="store_true", help="only even numbers: those to decide on")
    add("--no-masks", action="store_true")
    add("--no-markings", action="store_true", help="their known sizes are not given")
    add("--out", type=pathlib.Path, required=True, metavar="FOLDER", help="has runs.jsonl")
    add("--json", type=pathlib.Path, metavar="FILE", help="the report")
    add("--tables", type=pathlib.Path, metavar="FILE", help="its tables for make_benchmark_md.py")
    add("--report-only", action="store_true", help="of the runs that are there; make and run none")
    return parser


def parse(words):
    parser = bench_parser(__doc__, "scenes", "MAKE.PY", "0:9")
    add = parser.add_argument
    add("--frames", default="1:3", metavar="FRAMES,...",
        help="runs of each scene: 1:3, 0:4:2, 0+2+4, none (the command's own choice), none@40 (that "
             "about frame 40)")
    add("--no-detections", action="store_true")
    add("--poses", action="store_true", help="the true poses are given")
    add("--speed", action="store_true", help="the true speeds are given, with a draw of 2 %%")
    add("--coder", default="", metavar="CODER:KBIT", help="h264:300, h265:300")
    add("--faults", default="none", metavar="FAULT,...", help="a run of each with each")
    add("--seed", type=int, default=0, help="of heights and faults")
    add("--jobs", type=int, default=1, help="runs at a time, one thread each")
    add("--worst", type=pathlib.Path, metavar="FOLDER",
        help="run the worst once more, with pictures, to look at")
    arguments = parser.parse_args(words)
    arguments.numbers = numbers_of(arguments)
    arguments.frames = list(dict.fromkeys(arguments.frames.split(",")))
    arguments.faults = list(dict.fromkeys(arguments.faults.split(",")))
    for frames in arguments.frames:
        if not FRAMES_PATTERN.match(frames):
            raise BadInput(
                f"--frames: found '{frames}', expected 1:3, 0:4:2, 0+2+4, none or none@40")
    for fault in arguments.faults:
        if not check_fault(fault):
            raise BadInput(f"--faults: there is no fault '{fault}'")
        if fault.startswith("speed") and not arguments.speed:
            raise BadInput(f"--faults: {fault} takes --speed")
    if arguments.coder and not CODER_PATTERN.match(arguments.coder):
        raise BadInput(f"--coder: found '{arguments.coder}', expected h264:300 or h265:300")
    if arguments.jobs < 1:
        raise BadInput(f"--jobs: found {arguments.jobs}, expected 1 or more")
    return arguments


def numbers_of(arguments):
    numbers = []
    for text in arguments.numbers.split(","):
        match = re.fullmatch(r"(\d+)(?::(\d+))?", text)
        if not match:
            raise BadInput(f"--numbers: found '{text}', expected a number or FIRST:LAST")
        numbers += range(int(match[1]), int(match[2] or match[1]) + 1)
    if arguments.odd or arguments.even:
        numbers = [n for n in numbers if n % 2 == int(arguments.odd)]
    if not numbers:
        raise BadInput("--numbers: none left")
    return sorted(set(numbers))


class Bench:
    """The runs that are asked for, and those that are there."""

    def __init__(self, arguments, folder):
        self.arguments = arguments
        self.program = Program(arguments.camber, folder)
        self.scenes = make_scenes(arguments, self.program.path)
        self.runs = Lines(arguments.out / "runs.jsonl")
        self.facts = Lines(arguments.out / "scenes.jsonl")

    def wanted(self):
        """(number, definition) of all runs."""
        a = self.arguments
        return [(number, self.definition(number, frames, fault))
                for fault in a.faults for frames in a.frames for number in self.scenes]

    def definition(self, number, frames, fault):
        a, scene = self.arguments, self.scenes[number]
        definition = {
            "format": FORMAT, "maker": a.maker, "scene": scene.name, "manifest": scene.hash,
            "frames": frames, "fault": fault, "masks": not a.no_masks,
            "detections": not a.no_detections, "markings": not a.no_markings,
            "poses": a.poses or fault == "pose", "seed": a.seed, "program": self.program.hash}
        if fault == "other":
            definition["other"] = self.other(number).hash
        if a.speed:
            definition["speed"] = True
        if a.coder:
            definition["coder"] = a.coder
        return definition

    def other(self, number):
        """The next scene."""
        numbers = sorted(self.scenes)
        if len(numbers) < 2:
            raise BadInput("--faults: 'other' takes two scenes or more")
        return self.scenes[numbers[(numbers.index(number) + 1) % len(numbers)]]

    def run_missing(self):
        missing = [(n, d) for n, d in self.wanted() if not self.is_there(key_of(d))]
        known = [n for n in self.scenes if self.facts_key(n) not in self.facts.by_key]
        done, total = 0, len(missing)
        with ThreadPoolExecutor(self.arguments.jobs) as pool:
            try:
                list(pool.map(self.find_facts, known))
                if self.arguments.coder:  # a film serves several runs
                    list(pool.map(self.coded, {n for n, _ in missing}))
                for _ in pool.map(lambda job: self.run(*job), missing):
                    done += 1
                    if sys.stderr.isatty():
                        print(f"\r{done} of {total} runs", end="", file=sys.stderr)
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                raise
        if total and sys.stderr.isatty():
            print(file=sys.stderr)

    def coded(self, number):
        return coded_images(self.scenes[number], self.arguments.coder, self.arguments.scenes)

    def is_there(self, key):
        """A run that crashed is run again."""
        return key in self.runs.by_key and not trust_report.crashed(self.runs.by_key[key])

    def find_facts(self, number):
        scene = self.scenes[number]
        self.facts.add({"key": self.facts_key(number), "scene": scene.name, **facts_of(scene)})

    def facts_key(self, number):
        return f"{self.scenes[number].hash}-{FACTS_FORMAT}"

    def run(self, number, definition):
        with tempfile.TemporaryDirectory(dir=self.arguments.out, prefix="run_") as name:
            folder = pathlib.Path(name).resolve()
            result = self.reconstruct(number, definition, folder, ["--no-pictures"])
            self.runs.add({"key": key_of(definition), "number": number, "definition": definition,
                           "result": result})

    def reconstruct(self, number, definition, folder, options):
        scene = self.scenes[number]
        other = self.other(number) if definition["fault"] == "other" else None
        manifest = folder / "scene.json"
        images = self.coded(number) if "coder" in definition else None
        manifest.write_text(json.dumps(edited_manifest(scene, definition, other, folder, images)),
                            encoding="utf-8")
        command = [str(self.program.path), "reconstruct", str(manifest), "--out",
                   str(folder / "result"), "--threads", "1", "--quiet", *options]
        if not definition["frames"].startswith("none"):
            command += ["--frames", definition["frames"].replace("+", ",")]
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=False,
                                  timeout=TIME_LIMIT)
        except subprocess.TimeoutExpired:
            return {"exit_code": None, "reason": f"no answer within {TIME_LIMIT} s"}
        if done.returncode:
            reason = last_line(done.stderr).replace(str(manifest), "scene.json")
            return {"exit_code": done.returncode, "reason": reason.replace(str(folder) + "/", "")}
        return result_of(scene, folder / "result")

    def entries(self):
        """The runs asked for that are there, each with its scene's facts."""
        found = [self.runs.by_key[key] for key in (key_of(d) for _, d in self.wanted())
                 if key in self.runs.by_key]
        return [{**entry, "facts": self.facts.by_key.get(self.facts_key(entry["number"]), {})}
                for entry in found]

    def look_at(self, entries, folder):
        """Runs once more, with pictures, each into a folder of its own."""
        for entry in entries:
            definition = entry["definition"]
            frames = definition["frames"].replace(":", "_").replace("+", "_")
            into = folder / f"{definition['scene']}-{frames}-{definition['fault']}-{entry['key']}"
            if (into / "result").exists():
                continue
            shutil.rmtree(into, ignore_errors=True)
            into.mkdir(parents=True)
            self.reconstruct(entry["number"], definition, into.resolve(), [])


def key_of(definition):
    text = json.dumps(definition, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def result_of(scene, folder):
    """What a report needs of run.json and metrics.json."""
    with open(folder / "run.json", encoding="utf-8") as file:
        run = json.load(file)
    metrics = {}
    if (folder / "metrics.json").exists():
        with open(folder / "metrics.json", encoding="utf-8") as file:
            metrics = json.load(file)
    error = metrics.get("scale_error")
    markings = next((c for c in run["constraints"] if c["name"] == "lane_markings"), {})
    used = run["options"]["frames"]
    return {
        "exit_code": 0,
        "used_frames": used,
        "turn_deg": turn_deg(scene, used),
        # The relative error as a logarithm; a scale that is not positive is as wrong as can be.
        "error": None if error is None else math.log1p(max(error, -0.999999)),
        "sigma": run["scale_sigma"],
        "status": run["scale_status"],
        "warnings": [[w["code"], w["text"]] for w in run["warnings"]],
        # Seen and measured, whether the scale took them or found them contradicted.
        "markings_seen": bool(markings.get("accepted")) or
                         markings.get("residual_sigma") is not None,
        "dashes": run.get("markings", {}).get("dashes", 0),
        "evidence": run.get("evidence", []),  # for replay_scale.py
        "vehicles": [[v.get(key) for key in trust_report.VEHICLE_COLUMNS]
                     for v in with_along_sigma(metrics.get("vehicles", []), folder)],
    }


def with_along_sigma(vehicles, folder):
    """The vehicles of metrics.json with the stated sigma along the ray to each, m."""
    if not vehicles:
        return []
    with open(folder / "vehicles.json", encoding="utf-8") as file:
        stated = {(frame["id"], vehicle["id"]): vehicle for frame in json.load(file)["frames"]
                  for vehicle in frame["vehicles"]}
    return [{**v, "along_sigma": along_sigma(stated.get((v["frame"], v["estimate_id"])))}
            for v in vehicles]


def along_sigma(vehicle):
    """Of a vehicle of vehicles.json whose covariance is stated."""
    if vehicle is None or None in vehicle.get("covariance", [None]):
        return None
    center, covariance = vehicle["center"], vehicle["covariance"]
    size = math.isqrt(len(covariance))
    variance = sum(center[i] * covariance[size * i + j] * center[j]
                   for i in range(3) for j in range(3)) / sum(x * x for x in center)
    return math.sqrt(max(variance, 0.0))


def main(words=None):
    try:
        arguments = parse(words)
        arguments.out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=arguments.out, prefix="program_") as folder:
            return run_and_report(arguments, Bench(arguments, pathlib.Path(folder).resolve()))
    except (BadInput, OSError) as error:
        print(f"trust.py: {error}", file=sys.stderr)
        return 2


def numbers_words(numbers):
    step = 2 if len({n % 2 for n in numbers}) == 1 else 1
    whole = numbers == list(range(numbers[0], numbers[-1] + 1, step))
    words = ["--numbers", f"{numbers[0]}:{numbers[-1]}" if whole else ",".join(map(str, numbers))]
    if step == 2 and whole and len(numbers) > 1:
        words.append("--odd" if numbers[0] % 2 else "--even")
    return words


def command_of(arguments):
    """What measures the same, without the folders of this machine."""
    words = ["tests/benchmarks/trust.py", "--maker", arguments.maker, "--frames",
             ",".join(arguments.frames), "--faults", ",".join(arguments.faults)]
    words += numbers_words(arguments.numbers)
    for switch in ("no_masks", "no_detections", "no_markings", "poses", "speed"):
        if getattr(arguments, switch):
            words.append("--" + switch.replace("_", "-"))
    if arguments.coder:
        words += ["--coder", arguments.coder]
    return " ".join(words)


def run_and_report(arguments, bench):
    load_before = os.getloadavg()[0]
    if not arguments.report_only:
        bench.run_missing()
    report = trust_report.report_of(bench.entries(), vars(arguments), bench.program.hash)
    print(trust_report.text_of(report))
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    if arguments.tables:
        of = {"synth": "made scenes", "steep_scenes": "steep scenes", "folder": "given scenes"}
        write_document(arguments.tables, trust_report.document_of(
            report, f"trust.py, {of[arguments.maker]}", command_of(arguments), load_before))
    if arguments.worst:
        bench.look_at(trust_report.worst_entries(bench.entries()), arguments.worst)
    return 1 if report["crashed"] else 0


if __name__ == "__main__":
    sys.exit(main())
