#!/usr/bin/env python3
"""What calling the main job from Python costs: the same run by the program and by the module.

  PYTHONPATH=build/release/python python_overhead.py build/release/bin/camber samples/steep_hill

Each run is a process of its own, program and module by turns; the stages' own times (run.json) are
those of both. Prints two ratios: the whole call from arrays over its own stages (the cost of the
border: arrays in, results out), and the module's stages over the program's.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile

STAGES = ("correspondences", "motion", "triangulation", "ground", "scale", "surface", "vehicles")
CHILD = """
import json, sys, time, importlib.util
spec = importlib.util.spec_from_file_location("sample", sys.argv[1])
sample = importlib.util.module_from_spec(spec)
spec.loader.exec_module(sample)
import camber, pathlib
scene = sample.scene_of_arrays(pathlib.Path(sys.argv[2]))
start = time.perf_counter()
result = camber.reconstruct(scene, [0, 1, 2])
points = result.cloud.points
wall = time.perf_counter() - start
print(json.dumps({"wall": 1e3 * wall, "timings": result.run.timings}))
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("camber")
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    sample = pathlib.Path(__file__).resolve().parents[2] / "samples/python/01_reconstruct.py"
    program, module, border = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(arguments.runs):
            out = subprocess.run(
                [arguments.camber, "reconstruct", arguments.scene, "--frames", "0:2", "--out",
                 folder + "/out", "--no-pictures", "--quiet", "--json"],
                check=True, capture_output=True, text=True).stdout
            timings = json.loads(out)["timings_ms"]
            program.append(sum(timings[stage] for stage in STAGES))
            out = subprocess.run([sys.executable, "-c", CHILD, sample, arguments.scene], check=True,
                                 capture_output=True, text=True).stdout
            found = json.loads(out)
            module.append(sum(found["timings"][stage] for stage in STAGES))
            border.append(found["wall"] / sum(found["timings"].values()))
    for name, ms in (("program", program), ("module", module)):
        print(f"stages of the {name}: median {statistics.median(ms):.0f} ms, best {min(ms):.0f} ms "
              f"of {arguments.runs}")
    print(f"the call from arrays over its own stages: {statistics.median(border):.4f}")
    print(f"the module's stages over the program's: medians "
          f"{statistics.median(module) / statistics.median(program):.4f}, "
          f"best {min(module) / min(program):.4f}")


if __name__ == "__main__":
    main()
