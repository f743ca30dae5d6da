#!/usr/bin/env python3
"""Whether metres are believed that come of poses which belong to other moments.

    shifted_poses.py --data FOLDER [--windows 40] [--least 10] [--most 100] [--odd | --even]
                     [--height 1.65] [--camber PATH] [--json FILE] [--keep FOLDER]

Real drives with poses (--data, a folder with kitti-odometry-03, ...) are imported with each image's
pose taken from SHIFT rows later or earlier; `camber reconstruct` then runs on windows of five
successive frames. A window counts as wrong where its scale is "ok" and more than three of its own
sigmas from the true path. The same windows with their own poses stand beside it. Windows are drawn
by their numbers; --odd and --even take half of them.

Exit code: 0, 1 if a window is wrong or a run crashed, 2 for bad input.
"""

import argparse
import json
import math
import pathlib
import random
import shutil
import subprocess
import sys
import tempfile

from benchmark_json import BadInput

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
FRAMES = 5
TIME_LIMIT = 600  # s, of one run


class Drive:
    """A folder of images with as many poses, KITTI's form."""

    def __init__(self, folder, images, poses, calibration, camera):
        self.name, self.calibration, self.camera = folder.name, folder / calibration, camera
        self.images = sorted((folder / images).iterdir())
        lines = (folder / poses).read_text(encoding="ascii").split("\n")
        self.rows = [line for line in lines if line.strip()]
        if len(self.images) > len(self.rows):
            self.images = self.images[:len(self.rows)]
        self.places = [[float(row.split()[k]) for k in (3, 7, 11)] for row in self.rows]

    def length(self, first):
        """m, of the true path from the first to the last frame of a window."""
        return math.dist(self.places[first], self.places[first + FRAMES - 1])

    def steps(self, first):
        return [math.dist(self.places[i], self.places[i + 1])
                for i in range(first, first + FRAMES - 1)]


def drives_of(data):
    found = []
    for name, parts in (("kitti-odometry-03", ("image_0", "poses.txt", "calib.txt", "P0")),
                        ("kitti-raw-0095", ("image_02", "poses.txt", "calib.txt", "P2"))):
        for folder in (data / name, data / "drives" / name):
            if folder.is_dir():
                found.append(Drive(folder, *parts))
                break
    if not found:
        raise BadInput(f"{data}: found none of the drives with poses")
    return found


def camber(arguments, words):
    return subprocess.run([arguments.camber, *map(str, words)], capture_output=True, text=True,
                          timeout=TIME_LIMIT, check=False)


def import_shifted(arguments, drive, shift, folder):
    """The drive's frames that have a pose of `shift` rows on. @return the first of them"""
    first = max(0, -shift)
    last = min(len(drive.images), len(drive.rows) - max(0, shift))
    poses = folder / "poses.txt"
    poses.write_text("\n".join(drive.rows[i + shift] for i in range(first, last)) + "\n",
                     encoding="ascii")
    held = folder / "images"
    held.mkdir()
    for i in range(first, last):
        (held / drive.images[i].name).symlink_to(drive.images[i].resolve())
    words = ["import", "images", held, "--calib", drive.calibration, "--camera",
             drive.camera, "--rectified", "--rate", "10", "--poses", poses, "--out",
             folder / "scene"]
    if arguments.height:
        words += ["--height", str(arguments.height)]
    done = camber(arguments, words)
    if done.returncode != 0:
        raise BadInput(f"{drive.name}: import ended with {done.returncode}: {done.stderr.strip()}")
    ids = [f["id"] for f in json.loads((folder / "scene/scene.json").read_text())["frames"]]
    return first, ids, done.stderr


def run_window(arguments, drive, shift, first, kept):
    """One window with poses of `shift` rows on. @return what it says against the truth"""
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        begin, ids, _ = import_shifted(arguments, drive, shift, folder)
        frames = ",".join(str(ids[first - begin + i]) for i in range(FRAMES))
        done = camber(arguments, ["reconstruct", folder / "scene", "--frames", frames, "--detector",
                                  "none", "--no-pictures", "--out", folder / "out"])
        line = {"drive": drive.name, "first": first, "shift": shift, "exit": done.returncode,
                "true": drive.length(first)}
        if done.returncode == 0:
            run = json.loads((folder / "out/run.json").read_text(encoding="utf-8"))
            places = [[c["reference_from_camera"][k] for k in (3, 7, 11)] for c in run["cameras"]]
            line |= {"status": run["scale_status"], "metric": run["metric"],
                     "sigma": run["scale_sigma"],
                     "error": math.log(math.dist(places[0], places[-1]) / line["true"]),
                     "warnings": [w["code"] for w in run["warnings"]]}
            line["wrong"] = (line["metric"] and line["status"] == "ok"
                             and abs(line["error"]) > 3.0 * line["sigma"])
        elif done.returncode != 1:
            line["message"] = done.stderr.strip()[-300:]
        if kept:
            target = kept / f"{drive.name}_{first}_{shift}"
            shutil.copytree(folder, target, symlinks=True, dirs_exist_ok=True)
        return line


def windows_of(arguments, drives):
    """Windows that move, each with a shift: those of its number, whatever others are drawn."""
    out = []
    for number in range(arguments.windows):
        if arguments.half is not None and number % 2 != arguments.half:
            continue
        draw = random.Random(number)
        while True:
            drive = draw.choice(drives)
            shift = draw.choice((-1, 1)) * draw.randint(arguments.least, arguments.most)
            low = max(0, -shift)
            high = min(len(drive.images), len(drive.rows) - max(0, shift)) - FRAMES
            if high < low:
                continue
            first = draw.randint(low, high)
            # A window that stands has no parallax, with any poses.
            if min(drive.steps(first)) > 0.2:
                break
        out.append((drive, shift, first))
    return out


def summary(lines, title):
    answered = [line for line in lines if line["exit"] == 0]
    metric = [line for line in answered if line["metric"]]
    ok = [line for line in metric if line["status"] == "ok"]
    wrong = [line for line in ok if line["wrong"]]
    print(f"{title}: {len(lines)} windows, {len(lines) - len(answered)} without an answer, "
          f"{len(answered) - len(metric)} up to scale, {len(metric) - len(ok)} with metres but not "
          f"ok, {len(ok)} ok, {len(wrong)} of them beyond 3 sigma")
    for line in wrong:
        print(f"  {line['drive']} {line['first']} shift {line['shift']}: "
              f"{100.0 * (math.exp(line['error']) - 1.0):+.1f} %, stated "
              f"{100.0 * line['sigma']:.1f} %")
    return len(wrong)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--data", type=pathlib.Path, default=ROOT.parent / "shared/data", metavar="FOLDER")
    add("--camber", type=pathlib.Path, default=ROOT / "build/release/bin/camber", metavar="PATH")
    add("--windows", type=int, default=40)
    add("--least", type=int, default=10, help="rows")
    add("--most", type=int, default=100, help="rows")
    add("--height", type=float, help="m, of the camera, is given, too")
    add("--own", action="store_true", help="the same windows with their own poses, too")
    add("--json", type=pathlib.Path, metavar="FILE")
    add("--keep", type=pathlib.Path, metavar="FOLDER", help="of scenes and results")
    half = parser.add_mutually_exclusive_group()
    half.add_argument("--even", dest="half", action="store_const", const=0)
    half.add_argument("--odd", dest="half", action="store_const", const=1)
    arguments = parser.parse_args()
    lines, own = [], []
    for drive, shift, first in windows_of(arguments, drives_of(arguments.data)):
        lines.append(run_window(arguments, drive, shift, first, arguments.keep))
        if arguments.own:
            own.append(run_window(arguments, drive, 0, first, None))
        print(json.dumps(lines[-1]), file=sys.stderr, flush=True)
    wrong = summary(lines, "shifted poses")
    if own:
        summary(own, "their own poses")
    if arguments.json:
        arguments.json.write_text(json.dumps({"shifted": lines, "own": own}, indent=1) + "\n",
                                  encoding="utf-8")
    crashed = [line for line in lines + own if line["exit"] not in (0, 1)]
    for line in crashed:
        print(f"{line['drive']} {line['first']} shift {line['shift']}: exit code {line['exit']}: "
              f"{line['message']}", file=sys.stderr)
    return 1 if wrong or crashed else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except BadInput as error:
        print(f"shifted_poses.py: {error}", file=sys.stderr)
        sys.exit(2)
