#!/usr/bin/env python3
"""How good whole drives are, on made drives of other makers: `camber drive` against their truth.

Runs `camber drive` over each drive, `camber evaluate` on the result, and on every tenth frame
`camber reconstruct` with that frame as the reference and its own choice of frames, whose vehicles
are compared with the drive's of the same frame. A drive's height is the true one (median over the
frames) with a draw of its height_sigma (0.01 m where it states none). For example:

  drives.py --maker synth --scenes made --numbers 0:39 --odd --out drives
  drives.py --maker steep_scenes --steep-scenes make_drive.py --scenes made --numbers 401,403

Makers: steep_scenes (a script called as `make_drive.py --out FOLDER NUMBERS` by the Python that its
first line names), synth (`camber synth --drive --seed NUMBER`), folder (the scenes that --scenes
holds, numbered in order of their names).

Drives are made once. Every run is a line of OUT/runs.jsonl, under a key of all that defines it (the
program's bytes too), and is not repeated.

Exit code: 0, 1 if a run crashed, 2 for bad input.
"""

import csv
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

import drives_report
from benchmark_json import BadInput, write_document
from trust import Lines, Program, bench_parser, key_of, numbers_of, numbers_words
from trust_scenes import (Scene, edited_manifest, last_line, make_steep_scenes, scenes_of_folder)

FORMAT = 1         # of a run's line: part of each key
TIME_LIMIT = 7200  # s, of one run


class Drive(Scene):
    def true_height(self):
        """m, median over the frames; None: not known."""
        offsets = sorted(frame["ego_plane"]["offset"] for frame in self.truth.values()
                         if "ego_plane" in frame)
        return offsets[len(offsets) // 2] if offsets else None


def parse(words):
    parser = bench_parser(__doc__, "drives", "MAKE_DRIVE.PY", "0:3")
    add = parser.add_argument
    add("--frames", type=int, default=150, help="of a drive that synth makes")
    add("--every", type=int, default=10, metavar="N",
        help="vehicles are compared with those of reconstruct on every Nth frame; 0: not")
    add("--seed", type=int, default=0, help="of heights")
    add("--threads", type=int, default=1)
    add("--keep", type=pathlib.Path, metavar="FOLDER", help="keep the drives' results there")
    arguments = parser.parse_args(words)
    arguments.numbers = numbers_of(arguments)
    for name, least in (("threads", 1), ("every", 0), ("frames", 2)):
        if getattr(arguments, name) < least:
            raise BadInput(f"--{name}: found {getattr(arguments, name)}, expected {least} or more")
    return arguments


def make_drives(arguments, program):
    """The drives of the numbers asked for, by number; those that are not there yet are made."""
    folder = arguments.scenes
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.maker == "folder":
        found = scenes_of_folder(folder, arguments.numbers)
        return {n: Drive(scene.folder, scene.name) for n, scene in found.items()}
    folders = {n: folder / f"drive_{n:06d}" for n in arguments.numbers}
    missing = [n for n in arguments.numbers if not (folders[n] / "scene.json").exists()]
    if arguments.report_only:
        folders = {n: folders[n] for n in arguments.numbers if n not in missing}
    elif missing and arguments.maker == "steep_scenes":
        make_steep_scenes(arguments.steep_scenes, folder, missing)
    else:
        for number in missing:
            done = subprocess.run(
                [str(program), "synth", "--drive", "--seed", str(number), "--frames",
                 str(arguments.frames), "--out", str(folders[number]), "--overwrite", "--quiet",
                 "--threads", str(arguments.threads)], capture_output=True, text=True, check=False)
            if done.returncode:
                raise BadInput(f"camber synth --drive: {last_line(done.stderr)}")
    return {n: Drive(path, path.name) for n, path in folders.items()}


class Bench:
    """The runs that are asked for, and those that are there."""

    def __init__(self, arguments, folder):
        self.arguments = arguments
        self.program = Program(arguments.camber, folder)
        self.drives = make_drives(arguments, self.program.path)
        self.runs = Lines(arguments.out / "runs.jsonl")

    def wanted(self):
        """(number, definition) of all runs; "frames": "none" of a drive, "none@40" of reconstruct about frame 40."""
        every = self.arguments.every
        for number, drive in self.drives.items():
            yield number, self.definition(drive, "none")
            for frame in drive.ids[::every] if every else []:
                if drive.truth.get(frame, {}).get("vehicles"):
                    yield number, self.definition(drive, f"none@{frame}")

    def definition(self, drive, frames):
        a = self.arguments
        return {"format": FORMAT, "scene": drive.name, "manifest": drive.hash, "frames": frames,
                "fault": "none", "masks": not a.no_masks, "detections": True, "poses": False,
                "markings": not a.no_markings, "seed": a.seed, "program": self.program.hash}

    def run_missing(self):
        missing = [(n, d) for n, d in self.wanted() if not self.is_there(key_of(d))]
        for done, (number, definition) in enumerate(missing):
            if sys.stderr.isatty():
                print(f"\r{done} of {len(missing)} runs", end="", file=sys.stderr)
            with tempfile.TemporaryDirectory(dir=self.arguments.out, prefix="run_") as name:
                folder = pathlib.Path(name).resolve()
                result = self.run(self.drives[number], definition, folder)
                self.runs.add({"key": key_of(definition), "number": number,
                               "definition": definition, "result": result})
                if self.arguments.keep and definition["frames"] == "none":
                    kept = self.arguments.keep / f"{definition['scene']}-{key_of(definition)}"
                    shutil.rmtree(kept, ignore_errors=True)
                    shutil.copytree(folder, kept)
        if missing and sys.stderr.isatty():
            print(file=sys.stderr)

    def is_there(self, key):
        """A run that crashed is run again."""
        return (key in self.runs.by_key and
                self.runs.by_key[key]["result"]["exit_code"] in (0, 1, 2))

    def camber(self, folder, *words):
        """None, or the result of a run that gave no answer."""
        command = [str(self.program.path), *map(str, words)]
        if words[0] != "evaluate":
            command += ["--no-pictures"]
        try:
            done = subprocess.run(
                [*command, "--threads", str(self.arguments.threads), "--quiet"],
                capture_output=True, text=True, check=False, timeout=TIME_LIMIT)
        except subprocess.TimeoutExpired:
            return {"exit_code": None, "reason": f"no answer within {TIME_LIMIT} s"}
        if done.returncode:
            reason = last_line(done.stderr).replace(str(folder) + "/", "")
            return {"exit_code": done.returncode, "reason": f"{words[0]}: {reason}"}
        return None

    def run(self, drive, definition, folder):
        manifest, result = folder / "scene.json", folder / "result"
        manifest.write_text(json.dumps(edited_manifest(drive, definition, None, folder)),
                            encoding="utf-8")
        whole = definition["frames"] == "none"
        refused = self.camber(folder, "drive" if whole else "reconstruct", manifest, "--out",
                              result)
        if refused is None and whole:
            refused = self.camber(folder, "evaluate", "--truth", manifest, "--estimate", result,
                                  "--out", folder / "tables")
        if refused is not None:
            return refused
        if whole:
            return drive_result(folder)
        frame = int(definition["frames"].split("@")[1])
        metrics = read_json(result / "metrics.json")
        return {"exit_code": 0, "vehicles": [
            [v.get(key) for key in drives_report.VEHICLE_COLUMNS]
            for v in metrics["vehicles"] if v["frame"] == frame]}

    def entries(self):
        """The runs asked for that are there."""
        return [self.runs.by_key[key] for key in (key_of(d) for _, d in self.wanted())
                if key in self.runs.by_key]


def read_json(path):
    with open(path, encoding="utf-8") as file:
        return json.load(file)


def drive_result(folder):
    """What a report needs of the tables of `evaluate`."""
    tables = read_json(folder / "tables/tables.json")
    vehicles = []
    if (folder / "tables/vehicles.csv").exists():
        with open(folder / "tables/vehicles.csv", encoding="utf-8", newline="") as file:
            vehicles = [[float(row[key]) if row[key] else None
                         for key in drives_report.VEHICLE_COLUMNS] for row in csv.DictReader(file)]
    run = read_json(folder / "result/run.json")
    return {"exit_code": 0, "trajectory": tables["trajectories"][0],
            "road": tables.get("strips", [None])[0], "tracks": tables.get("tracks", [None])[0],
            "vehicles": vehicles, "warnings": [w["text"] for w in run.get("warnings", [])]}


def command_of(arguments):
    """What measures the same, without the folders of this machine."""
    words = ["tests/benchmarks/drives.py", "--maker", arguments.maker,
             *numbers_words(arguments.numbers)]
    for switch in ("no_masks", "no_markings"):
        if getattr(arguments, switch):
            words.append("--" + switch.replace("_", "-"))
    return " ".join(words)


def run_and_report(arguments, bench):
    load_before = os.getloadavg()[0]
    if not arguments.report_only:
        bench.run_missing()
    report = drives_report.report_of(bench.entries(), bench.program.hash, arguments.seed)
    print(drives_report.text_of(report))
    if arguments.json:
        arguments.json.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")
    if arguments.tables:
        of = {"synth": "made drives", "steep_scenes": "steep drives", "folder": "given drives"}
        write_document(arguments.tables, drives_report.document_of(
            report, f"drives.py, {of[arguments.maker]}", command_of(arguments), load_before))
    return 1 if report["crashed"] else 0


def main(words=None):
    try:
        arguments = parse(words)
        arguments.out.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=arguments.out, prefix="program_") as folder:
            return run_and_report(arguments, Bench(arguments, pathlib.Path(folder).resolve()))
    except (BadInput, OSError) as error:
        print(f"drives.py: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
