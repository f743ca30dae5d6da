#!/usr/bin/env python3
"""Time, memory and bytes of camber tiles on made surveys of growing size; the speed of two processes
of one thread against one of two, and what is left of kills.

    bench_tiles.py --largest 1e7 [--density 10] [--tile 1000] [--jobs ground]
                   [--parallel 3] [--kills 10] [--folder FOLDER] [--json FILE]

The inputs are LAZ, made by survey_tiles.py and camber convert. 1e8 points need 5 GB of disk.
"""

import argparse
import hashlib
import json
import pathlib
import random
import shutil
import subprocess
import sys
import time

from benchmark_json import column, document
from measured_program import Failed, add_program_arguments, cpu_of_children, measured, run_measured

# A program of its own: what a child of this one is charged for starts with this one's memory.
MAKER = pathlib.Path(__file__).resolve().parent / "survey_tiles.py"


def folder_mb(folder):
    return sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 1e6


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        self.rows, self.parallel, self.kills = [], [], []

    def inputs(self, points):
        folder = self.folder / f"survey_{points:.0e}"
        files = max(1, round(points / 1e7))
        out = []
        for k in range(files):
            made = measured([sys.executable, "-B", MAKER, folder, "--points", points, "--density",
                             self.args.density, "--files", files, "--only", k])
            las = pathlib.Path(made.text.strip())
            laz = las.with_suffix(".laz")
            measured([self.args.camber, "convert", las, "--out", laz, "--quiet"])
            las.unlink()
            out.append(laz)
        return out

    def step(self, points, name, words):
        found = measured([self.args.camber, "tiles", *words])
        self.rows.append([f"{points:.0e}", name, found.cpu, found.wall,
                          1e6 * found.wall / points, found.memory, found.read,
                          found.written])
        print(f"{points:8.0e} {name:<16} {found.cpu:8.1f} s CPU {found.wall:8.1f} s wall "
              f"{1e6 * found.wall / points:7.3f} us/point {found.memory:7.0f} MB "
              f"{found.read:8.0f} MB read {found.written:8.0f} MB written", flush=True)
        return found

    def run(self, points):
        inputs = self.inputs(points)
        plan = self.folder / "plan"
        self.step(points, "plan", ["plan", *inputs, "--out", plan, "--tile", self.args.tile,
                                   "--quiet"])
        print(f"{points:8.0e} inputs {sum(f.stat().st_size for f in inputs) / 1e6:.0f} MB, plan "
              f"{folder_mb(plan / 'tiles'):.0f} MB", flush=True)
        for job in self.args.jobs:
            done = self.step(points, f"run {job}",
                             ["run", plan, "--job", job, "--json", "--quiet"])
            counts = json.loads(done.text)
            share = counts["points_read"] / counts["points_answered"]
            self.step(points, f"join {job}", ["join", plan, "--job", job])
            print(f"{points:8.0e} {job} {folder_mb(plan / job):.0f} MB of {counts['tiles']} tiles; "
                  f"points read {share:.3f} times those answered", flush=True)
        for job in self.args.jobs:
            if job not in ("ground", "patches") or counts["tiles"] < 2:
                continue
            if self.args.parallel:
                self.compare_threads(points, plan, job)
            if self.args.kills:
                self.kill_and_repeat(points, plan, job)
        for file in inputs:
            file.unlink()
        shutil.rmtree(plan)

    def words(self, plan, job, shard, threads):
        return [self.args.camber, "tiles", "run", plan, "--job", job, "--shard", shard,
                "--threads", str(threads), "--quiet"]

    def compare_threads(self, points, plan, job):
        """One process of two threads against two of one, on the same tiles, in turns: the least
        seconds of each."""
        def seconds(shards, threads):
            shutil.rmtree(plan / job)
            begin, before = time.monotonic(), cpu_of_children()
            processes = [
                subprocess.Popen(self.words(plan, job, f"{k + 1}/{shards}", threads),
                                 stdout=subprocess.DEVNULL) for k in range(shards)]
            if any([p.wait() != 0 for p in processes]):
                raise Failed("tiles run --shard")
            return time.monotonic() - begin, cpu_of_children() - before
        runs = [(seconds(1, 2), seconds(2, 1)) for _ in range(self.args.parallel)]
        wall = [min(run[k][0] for run in runs) for k in (0, 1)]
        cpu = [min(run[k][1] for run in runs) for k in (0, 1)]
        self.parallel.append([f"{points:.0e}", job, *wall, wall[0] / wall[1], *cpu])
        print(f"{points:8.0e} {job}: one process of two threads {wall[0]:.1f} s ({cpu[0]:.1f} s of "
              f"CPU), two of one {wall[1]:.1f} s ({cpu[1]:.1f} s): {wall[0] / wall[1]:.2f} of the "
              "speed", flush=True)

    def kill_and_repeat(self, points, plan, job):
        """Kills a run at random moments, each time going on with what is left; the files must be
        those of a run alone."""
        def files():
            return {f.name: hashlib.sha256(f.read_bytes()).digest()
                    for f in (plan / job).iterdir() if f.is_file()}
        words = self.words(plan, job, "1/1", 2)
        shutil.rmtree(plan / job)
        begin = time.monotonic()
        measured(words)
        whole, expected = time.monotonic() - begin, files()
        moments, kills, started = random.Random(1), 0, 0
        shutil.rmtree(plan / job)
        while kills < self.args.kills:
            started += 1
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL)
            try:
                if process.wait(timeout=moments.uniform(0.0, whole / self.args.kills)) != 0:
                    raise Failed("tiles run")
                shutil.rmtree(plan / job)  # it was done: from the start again
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
                kills += 1
        measured(words)
        found = {name: bytes for name, bytes in files().items() if name in expected}
        if found != expected:
            raise Failed(f"{job}: after {kills} kills the files differ")
        self.kills.append([f"{points:.0e}", job, kills, len(expected)])
        print(f"{points:8.0e} {job}: after {kills} kills in {started} runs {len(expected)} equal "
              "files", flush=True)


def report(bench, before):
    timing = {"timing": True, "better": "lower"}
    columns = [column("points", label=True), column("step", label=True),
               column("CPU", "s", **timing), column("wall", "s", **timing),
               column("a point", "us", **timing), column("memory", "MB", better="lower"),
               column("read", "MB", better="lower"), column("written", "MB", better="lower")]
    parallel = [column("points", label=True), column("job", label=True),
                column("one process, two threads", "s", **timing),
                column("two processes, one thread", "s", **timing), column("speed, two to one"),
                column("CPU of one", "s", **timing), column("CPU of two", "s", **timing)]
    kills = [column("points", label=True), column("job", label=True), column("kills"),
             column("equal files")]
    command = "tests/benchmarks/bench_tiles.py"
    return document("bench_tiles", before, [
        {"key": "tiles.steps", "name": "Steps of tiles by size", "command": command,
         "columns": columns, "rows": bench.rows},
        {"key": "tiles.parallel", "name": "Threads and processes", "command": command,
         "columns": parallel, "rows": bench.parallel},
        {"key": "tiles.kills", "name": "Killed and repeated", "command": command,
         "columns": kills, "rows": bench.kills}])


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    add_program_arguments(parser)
    parser.add_argument("--smallest", type=float, default=1e6, help="points")
    parser.add_argument("--largest", type=float, default=1e7, help="points")
    parser.add_argument("--density", type=float, default=10.0, help="points a square metre")
    parser.add_argument("--tile", type=float, default=0.0, help="side of a tile, m")
    parser.add_argument("--jobs", nargs="+", default=["ground", "patches", "labels", "export"],
                        choices=["ground", "patches", "labels", "export"],
                        help="in this order: labels after patches, export after ground")
    parser.add_argument("--parallel", type=int, default=0, metavar="TURNS",
                        help="also threads against processes, of ground and patches")
    parser.add_argument("--kills", type=int, default=0,
                        help="also so many kills at random moments, of ground and patches")
    args = parser.parse_args()

    def run(folder):
        bench = Bench(args, folder)
        points = args.smallest
        while points <= 1.001 * args.largest:
            bench.run(points)
            points *= 10
        return bench

    return run_measured(parser, args, run, report)


if __name__ == "__main__":
    sys.exit(main())
