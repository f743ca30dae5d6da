#!/usr/bin/env python3
"""How time and memory of the program grow with its input: CPU time and largest resident memory of each
run, and the exponents b of size^b between them.

    tests/benchmarks/bench_growth.py --camber build/release/bin/camber --json runs/growth.json
    tests/benchmarks/bench_growth.py plane patches --largest 1e8 ...   (some jobs; more points)

Clouds are made with one density (400 points a square metre of ground, half level, half rolling), so that their
extent grows with their number; scenes of many vehicles are a made scene's, repeated with their boxes
and keypoints moved by pixels. Each size runs --repeats times, once where a run took more than 20 s; the
least CPU time and the largest memory count. Inputs are made by a program of their own
(growth_inputs.py): what a child of this one is charged for starts with this one's memory. Exit code: 0; 1 where a run failed; 2 for bad input.
"""

import argparse
import math
import pathlib
import subprocess
import sys

from benchmark_json import column, document
from measured_program import Failed, add_program_arguments, measured, run_measured

INPUTS = pathlib.Path(__file__).resolve().parent / "growth_inputs.py"


def best_of(words, repeats):
    runs = [measured(words)]
    while len(runs) < repeats and runs[0].wall < 20.0:
        runs.append(measured(words))
    return (min(r.cpu for r in runs), min(r.wall for r in runs), max(r.memory for r in runs))


def make(*words):
    run = subprocess.run([sys.executable, "-B", INPUTS, *map(str, words)], check=False,
                         stderr=subprocess.PIPE, text=True)
    if run.returncode != 0:
        raise Failed(run.stderr.strip())


def make_scene(camber, folder, frames):
    """A made drive of so many frames."""
    scene = folder / f"drive_{frames}"
    if not scene.exists():
        measured([camber, "synth", "--profile", "steep_hill", "--frames", frames, "--seed", 7,
                  "--cars", 5, "--out", scene, "--quiet"])
    return scene


class Bench:
    def __init__(self, args, folder):
        self.args, self.folder = args, folder
        self.rows, self.fits = [], []

    def cloud(self, count, seed=1):
        path = self.folder / f"cloud_{count}_{seed}.ply"
        if not path.exists():
            make("cloud", path, count, seed)
        return path

    def words(self, job, size):
        """What is run for a job at a size."""
        camber, out = self.args.camber, self.folder
        cloud_jobs = {
            "plane": ["--json"],
            "patches": ["--out", out / "patches"],
            "ground": ["--out", out / "ground.ply"],
            "filter": ["--voxel", "0.2", "--out", out / "voxels.ply"],
            "convert": ["--out", out / "converted.pcd"],
            "normals": ["--normals", "20", "--out", out / "normals.ply"],
        }
        if job in cloud_jobs:
            verb = "filter" if job == "normals" else job
            return [camber, verb, self.cloud(size), *cloud_jobs[job], "--quiet"]
        if job == "compare":
            return [camber, "compare", self.cloud(size, 1), self.cloud(size, 2), "--json",
                    "--quiet"]
        if job == "frames":
            return [camber, "reconstruct", make_scene(camber, out, 24), "--frames", f"0:{size - 1}",
                    "--no-pictures", "--out", out / "run", "--quiet"]
        scene = out / f"crowd_{size}"
        make("crowd", make_scene(camber, out, 3), scene, size)
        if job == "vehicles":
            return [camber, "vehicles", scene, "--out", out / "vehicles.json", "--quiet"]
        return [camber, "reconstruct", scene, "--no-pictures", "--out", out / "run", "--quiet"]

    def run(self, job, what, sizes):
        done = []
        for size in sizes:
            words = self.words(job, size)
            cpu, wall, memory = best_of(words, self.args.repeats)
            done.append((size, cpu, wall, memory))
            self.rows.append([job, what, f"{size:.0e}" if what == "points" else str(size), cpu,
                              wall, memory])
            print(f"{job:<12} {size:>10} {what:<9} {cpu:9.2f} s CPU {wall:9.2f} s {memory:9.0f} MB",
                  flush=True)
            for path in self.folder.glob("cloud_*"):  # disk: one size at a time
                if f"cloud_{size}_" not in path.name:
                    path.unlink()
        if len(done) < 2:
            return
        fit = [job, what, *exponents(done, 1), *exponents(done, 3)]
        self.fits.append(fit)
        print(f"{job:<12} time: exponent {fit[2]:.2f}, last step {fit[3]:.2f}; "
              f"memory: {fit[4]:.2f}, {fit[5]:.2f}", flush=True)


def exponents(done, column):
    """Of all sizes (least squares on logarithms), and of the last step."""
    x = [math.log(d[0]) for d in done]
    y = [math.log(max(d[column], 1e-3)) for d in done]
    mx, my = sum(x) / len(x), sum(y) / len(y)
    slope = sum((a - mx) * (b - my) for a, b in zip(x, y)) / sum((a - mx) ** 2 for a in x)
    return slope, (y[-1] - y[-2]) / (x[-1] - x[-2])


def report(bench, before):
    timing = {"timing": True, "better": "lower"}
    runs = [column("job", label=True), column("size of", label=True), column("size", label=True),
            column("CPU", "s", **timing), column("wall", "s", **timing),
            column("memory", "MB", better="lower")]
    fits = [column("job", label=True), column("size of", label=True),
            column("time, all sizes", **timing), column("time, last step", **timing),
            column("memory, all sizes", better="lower"), column("memory, last step", better="lower")]
    command = "tests/benchmarks/bench_growth.py"
    return document("bench_growth", before, [
        {"key": "growth.exponents", "name": "Exponents of growth", "command": command,
         "columns": fits, "rows": bench.fits},
        {"key": "growth.runs", "name": "Time and memory by size", "command": command,
         "columns": runs, "rows": bench.rows}])


def decades(first, last):
    """First, three times it, ten times it, ... up to last."""
    out, size = [], first
    while size <= last * 1.001:
        out.append(round(size))
        size *= 3.0 if str(round(size))[0] == "1" else 10.0 / 3.0
    return out


def main():
    points = ["plane", "patches", "ground", "filter", "convert"]
    nearest = ["compare", "normals"]
    jobs = points + nearest + ["vehicles", "reconstruct", "frames"]
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("jobs", nargs="*", metavar="JOB", help=f"of {', '.join(jobs)}; default: all")
    add_program_arguments(parser)
    parser.add_argument("--smallest", type=float, default=1e5, help="points")
    parser.add_argument("--largest", type=float, default=1e7, help="points; 1e8 needs 12 GB of disk")
    parser.add_argument("--vehicles", type=int, default=1000, help="most vehicles a frame")
    parser.add_argument("--frames", type=int, default=24, help="most frames, to 24")
    parser.add_argument("--repeats", type=int, default=3)
    args = parser.parse_args()
    for job in args.jobs:
        if job not in jobs:
            parser.error(f"job '{job}': expected one of {', '.join(jobs)}")

    def run(folder):
        bench = Bench(args, folder)
        for job in args.jobs or jobs:
            if job in points:
                bench.run(job, "points", decades(args.smallest, args.largest))
            elif job in nearest:
                bench.run(job, "points", decades(args.smallest, min(args.largest, 1e7)))
            elif job == "frames":
                bench.run(job, "frames", [n for n in (3, 6, 12, 24) if n <= args.frames])
            else:
                bench.run(job, "vehicles",
                          [n for n in (10, 30, 100, 300, 1000) if n <= args.vehicles])
        return bench

    return run_measured(parser, args, run, report)


if __name__ == "__main__":
    sys.exit(main())
