#!/usr/bin/env python3
"""Makes the inputs of bench_growth.py.

    growth_inputs.py cloud FILE.ply COUNT SEED
    growth_inputs.py crowd SCENE OUT VEHICLES
"""

import copy
import json
import math
import pathlib
import sys

DENSITY = 400.0  # points a square metre


def make_cloud(path, count, seed):
    """Ground with 1 cm of noise as a binary PLY, z up: one half level, the other rolling."""
    import numpy  # only here: a crowd needs none

    random = numpy.random.Generator(numpy.random.PCG64(seed))
    side = math.sqrt(count / DENSITY)
    with open(path, "wb") as file:
        file.write(b"ply\nformat binary_little_endian 1.0\ncomment camber frame z-up\n"
                   + f"element vertex {count}\n".encode()
                   + b"property float x\nproperty float y\nproperty float z\nend_header\n")
        for begin in range(0, count, 1_000_000):
            n = min(1_000_000, count - begin)
            points = numpy.empty((n, 3), numpy.float32)
            points[:, :2] = random.random((n, 2)) * side
            beyond = numpy.maximum(points[:, 0] - 0.5 * side, 0.0)
            points[:, 2] = (numpy.sin(beyond / 40.0) * (1.5 + numpy.sin(points[:, 1] / 55.0))
                            + 0.01 * random.standard_normal(n))
            points.tofile(file)


def crowd(scene, out, vehicles):
    """The same scene with so many vehicles in each frame: copies, moved by pixels."""
    manifest = json.loads((scene / "scene.json").read_text(encoding="utf-8"))
    manifest.pop("truth", None)
    for frame in manifest["frames"]:
        for key in ("image", "segmentation", "road_mask"):
            if key in frame:
                frame[key] = str((scene / frame[key]).resolve())
        originals = frame.get("vehicles", [])
        if not originals:
            sys.exit(f"growth_inputs.py: {scene}: a frame without vehicles")
        frame["vehicles"] = []
        for i in range(vehicles):
            vehicle = copy.deepcopy(originals[i % len(originals)])
            copies = i // len(originals)
            du, dv = 0.37 * (copies % 41 - 20), 0.11 * (copies % 7 - 3)
            vehicle["id"] = i + 1
            if "track" in vehicle:
                vehicle["track"] = vehicle["track"] + 1000 * copies
            x1, y1, x2, y2 = vehicle["box"]
            vehicle["box"] = [x1 + du, y1 + dv, x2 + du, y2 + dv]
            vehicle["keypoints"] = [[p[0] + du, p[1] + dv, p[2]] if p[0] is not None else p
                                    for p in vehicle.get("keypoints", [])]
            frame["vehicles"].append(vehicle)
    out.mkdir(exist_ok=True)
    (out / "scene.json").write_text(json.dumps(manifest), encoding="utf-8")


def main(words):
    if len(words) == 4 and words[0] == "cloud":
        make_cloud(words[1], int(words[2]), int(words[3]))
    elif len(words) == 4 and words[0] == "crowd":
        crowd(pathlib.Path(words[1]), pathlib.Path(words[2]), int(words[3]))
    else:
        sys.exit(__doc__)


if __name__ == "__main__":
    main(sys.argv[1:])
