#!/usr/bin/env python3
"""Makes the files of a survey from the air, as large as wanted, as LAS.

    survey_tiles.py FOLDER --points 1e7 [--density 10] [--files 4] [--only K] [--seed 1]

Hills of some tens of metres with houses, trees, hedges and ponds; 5 cm of noise; a point in 5,000 is
a reflection some metres below. The files are squares side by side on a map in metres. The same
numbers give the same files; what is there already stays.
"""

import argparse
import math
import pathlib
import struct
import sys

import numpy

WEST, SOUTH = 600_000, 6_200_000  # m
SCALE = 0.001  # m
RECORD = numpy.dtype([("x", "<i4"), ("y", "<i4"), ("z", "<i4"), ("intensity", "<u2"),
                      ("returns", "u1"), ("flags", "u1"), ("class", "u1"), ("user", "u1"),
                      ("angle", "<i2"), ("source", "<u2"), ("time", "<f8")])
BLOCK = 1_000_000


def header(count, low, high):
    """LAS 1.4, point format 6, no records: ASPRS, "LAS Specification 1.4 - R15"."""
    out = bytearray(375)
    out[0:4] = b"LASF"
    struct.pack_into("<H", out, 6, 17)  # GPS time is adjusted standard, WKT
    out[24:26] = bytes([1, 4])
    out[26:34] = b"made    "
    out[58:72] = b"survey_tiles.py"[:14]
    struct.pack_into("<HHHII", out, 90, 1, 2020, 375, 375, 0)
    struct.pack_into("<BH", out, 104, 6, RECORD.itemsize)
    struct.pack_into("<3d3d", out, 131, SCALE, SCALE, SCALE, WEST, SOUTH, 0.0)
    for axis in range(3):
        struct.pack_into("<2d", out, 179 + 16 * axis, high[axis], low[axis])
    struct.pack_into("<Q", out, 247, count)
    struct.pack_into("<Q", out, 255, count)
    return bytes(out)


def heights(x, y, random):
    """Of points at x, y, m from the south-western corner, and what they are on."""
    z = 20 * numpy.sin(x / 310) + 12 * numpy.cos(y / 240) + 3 * numpy.sin((x + y) / 47)
    z += 0.05 * random.standard_normal(len(x))
    u, v = x % 53, y % 41
    house = (u < 11) & (v < 9)
    hedge = (u > 22) & (u < 24) & (v > 6) & (v < 36)
    tree = numpy.hypot(u - 38, v - 20) < 4
    leaves = random.random(len(x))
    z += numpy.where(house, 4.5 + 0.4 * numpy.minimum(v, 9 - v), 0)
    z += numpy.where(hedge, 1.5 * leaves, 0)
    z += numpy.where(tree & (leaves < 0.6), 9 * leaves + 2, 0)
    low = random.random(len(x)) < 2e-4
    return z - numpy.where(low, 1 + 5 * random.random(len(x)), 0)


def make_file(path, column, row, side, count, seed):
    random = numpy.random.Generator(numpy.random.PCG64([seed, column, row]))
    low, high = numpy.full(3, math.inf), numpy.full(3, -math.inf)
    part = path.with_suffix(".part")
    with open(part, "wb") as file:
        file.write(bytes(375))
        done = 0
        while done < count:
            # Strips as they are flown: north by north, noisy in time.
            n = min(BLOCK, count - done)
            x = side * (column + random.random(n))
            y = side * (row + (done + n * random.random(n)) / count)
            pond = numpy.hypot(x % 170 - 80, y % 210 - 90) < 15
            x = numpy.where(pond, side * column + (x + 30) % side, x)
            z = heights(x, y, random)
            points = numpy.zeros(n, RECORD)
            for name, value in (("x", x), ("y", y), ("z", z)):
                points[name] = numpy.round(value / SCALE).astype(numpy.int32)
            points["returns"] = 0x11
            points["intensity"] = random.integers(0, 4096, n)
            points["time"] = numpy.sort(random.random(n)) + done / BLOCK
            points.tofile(file)
            for axis, name in enumerate("xyz"):
                offset = (WEST, SOUTH, 0)[axis]
                low[axis] = min(low[axis], points[name].min() * SCALE + offset)
                high[axis] = max(high[axis], points[name].max() * SCALE + offset)
            done += n
        file.seek(0)
        file.write(header(count, low, high))
    part.rename(path)


def make_survey(folder, points, density, files, seed, only=None):
    """Paths of the files, or that of one of them, which are made where they are not there."""
    folder.mkdir(parents=True, exist_ok=True)
    columns = math.ceil(math.sqrt(files))
    count = math.ceil(points / files)
    side = math.sqrt(count / density)
    paths = []
    for k in range(files) if only is None else [only]:
        path = folder / f"made_{k % columns}_{k // columns}.las"
        if not path.exists():
            make_file(path, k % columns, k // columns, side, count, seed)
        paths.append(path)
    return paths


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("--points", type=float, default=1e6)
    parser.add_argument("--density", type=float, default=10.0, help="points a square metre")
    parser.add_argument("--files", type=int, default=1)
    parser.add_argument("--only", type=int, metavar="K", help="file K of them, from 0")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    if args.only is not None and not 0 <= args.only < args.files:
        parser.error(f"--only {args.only}: expected 0 to {args.files - 1}")
    for path in make_survey(args.folder, args.points, args.density, args.files, args.seed,
                            args.only):
        print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
