#!/usr/bin/env python3
"""Time, memory and bytes of camber tiles on made surveys of growing size, and the speed of two
processes of one thread against one of two.

    bench_tiles.py --largest 1e7 [--density 10] [--tile 1000] [--jobs ground]
                   [--folder FOLDER] [--json FILE]

The inputs are LAZ, made by survey_tiles.py and camber convert. 1e8 points need 12 GB of disk.
"""

import argparse
import json
import pathlib
import shutil
import subprocess
import sys
import time

from benchmark_json import column, document
from measured_program import Failed, add_program_arguments, measured, run_measured

# A program of its own: what a child of this one is charged for starts with this one's memory.
MAKER = pathlib.Path(__file__).resolve().parent / "survey_tiles.py"


def folder_mb(folder):
    return sum(f.stat().st_size for f in folder.rglob("*") if f.is_file()) / 1e6


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        self.rows, self.parallel = [], []

    def inputs(self, points):
        folder = self.folder / f"survey_{points:.0e}"
        files = max(1, round(points / 1e7))
        out = []
        made = measured([sys.executable, "-B", MAKER, folder, "--points", points, "--density",
                         self.args.density, "--files", files])
        for line in made.text.splitlines():
            las = pathlib.Path(line)
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
        if self.args.parallel and "ground" in self.args.jobs and counts["tiles"] >= 4:
            self.compare_threads(points, plan)
        for file in inputs:
            file.unlink()
        shutil.rmtree(plan)

    def compare_threads(self, points, plan):
        """One process of two threads against two of one, on the same tiles."""
        def seconds(shards, threads):
            shutil.rmtree(plan / "ground")
            begin = time.monotonic()
            processes = [
                subprocess.Popen([self.args.camber, "tiles", "run", plan, "--job", "ground",
                                  "--shard", f"{k + 1}/{shards}", "--threads", str(threads),
                                  "--quiet"], stdout=subprocess.DEVNULL) for k in range(shards)]
            if any(p.wait() != 0 for p in processes):
                raise Failed("tiles run --shard")
            return time.monotonic() - begin
        one, two, single = seconds(1, 2), seconds(2, 1), seconds(1, 1)
        self.parallel.append([f"{points:.0e}", single, one, two, one / two])
        print(f"{points:8.0e} one thread {single:.1f} s, one process of two {one:.1f} s, two of one "
              f"{two:.1f} s", flush=True)


def report(bench, before):
    timing = {"timing": True, "better": "lower"}
    columns = [column("points", label=True), column("step", label=True),
               column("CPU", "s", **timing), column("wall", "s", **timing),
               column("a point", "us", **timing), column("memory", "MB", better="lower"),
               column("read", "MB", better="lower"), column("written", "MB", better="lower")]
    parallel = [column("points", label=True), column("one thread", "s", **timing),
                column("one process, two threads", "s", **timing),
                column("two processes, one thread", "s", **timing), column("speed, two to one")]
    command = "tests/benchmarks/bench_tiles.py"
    return document("bench_tiles", before, [
        {"key": "tiles.steps", "name": "Steps of tiles by size", "command": command,
         "columns": columns, "rows": bench.rows},
        {"key": "tiles.parallel", "name": "Threads and processes", "command": command,
         "columns": parallel, "rows": bench.parallel}])


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
    parser.add_argument("--parallel", action="store_true", help="also threads against processes")
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
