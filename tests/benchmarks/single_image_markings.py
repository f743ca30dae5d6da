#!/usr/bin/env python3
"""How well one image's markings of known size place themselves and the road under them.

Runs `camber reconstruct --frames ID` with a single frame over made scenes that have a true depth
image, with the camera's height and without it, and compares each marking that run.json lists with
the true depth around it. For example:

  single_image_markings.py --maker steep_scenes --steep-scenes make.py --scenes made \\
      --numbers 0:99 --odd --out single_image_markings.json

A marking's distance is judged at its middle's pixel; the plane is the least-squares plane of the
true points of road under the marking and 1.2 m beside it. Counted: markings whose true distance is
at most 25 m. Needs numpy.

Exit code: 0, 1 if a run crashed, 2 for bad input.
"""

import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import zlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np

import png8
from benchmark_json import BadInput
from trust_scenes import ROAD_LABEL, edited_manifest, make_scenes

REACH = 25.0      # m, of markings that are counted
BESIDE = 1.2      # m to each side of a marking: the plane that is compared
PLAIN = {"masks": True, "detections": True, "markings": True, "poses": False, "fault": "none",
         "frames": "none", "seed": 0}


def pixels_of(path):
    """Samples as an array, rows by columns by channels, of 8 or 16 bits."""
    image = png8.read(path)
    kind = np.dtype(">u2") if image.bits == 16 else np.dtype("u1")
    rows = np.frombuffer(b"".join(image.rows), kind)
    return rows.reshape(image.height, image.width, -1).astype(np.int64)


def true_points(scene, frame):
    """The point at every pixel of road, camera frame, m; NaN where there is none."""
    truth = scene.truth[frame]
    samples = pixels_of(scene.path(truth["depth"]))
    if truth["depth_encoding"] == "synthia":
        code = samples[..., 0] + 256 * samples[..., 1] + 65536 * samples[..., 2]
        depth = 1000.0 * code / (256.0**3 - 1.0)
    else:
        depth = samples[..., 0] / 256.0
    depth = np.where((depth > 0) & (depth < 200), depth, np.nan)
    if "label" in truth:
        depth = np.where(pixels_of(scene.path(truth["label"]))[..., 0] == ROAD_LABEL, depth, np.nan)
    camera = scene.camera
    u, v = np.meshgrid(np.arange(depth.shape[1]), np.arange(depth.shape[0]))
    return np.stack([(u - camera["cx"]) / camera["fx"] * depth,
                     (v - camera["cy"]) / camera["fy"] * depth, depth], axis=-1)


def point_at(points, pixel):
    """The point at a pixel, between those around it; NaN where one is missing."""
    x, y = pixel
    u0 = min(max(int(x), 0), points.shape[1] - 2)
    v0 = min(max(int(y), 0), points.shape[0] - 2)
    a, b = x - u0, y - v0
    # Inverse depths, since those of a plane are linear in the pixel.
    inverse = 1.0 / points[v0:v0 + 2, u0:u0 + 2, 2]
    depth = 1.0 / ((1 - a) * (1 - b) * inverse[0, 0] + a * (1 - b) * inverse[0, 1] +
                   (1 - a) * b * inverse[1, 0] + a * b * inverse[1, 1])
    near = points[v0, u0] / points[v0, u0, 2], points[v0 + 1, u0 + 1] / points[v0 + 1, u0 + 1, 2]
    ray = np.array([(1 - a) * near[0][0] + a * near[1][0], (1 - b) * near[0][1] + b * near[1][1],
                    1.0])
    return depth * ray


def true_marking(points, marking):
    """True point at the marking's middle and the unit normal of the ground around it."""
    here = point_at(points, marking["pixel"])
    if not np.isfinite(here).all():
        return None, None
    half = 2.0
    # Before the plane is known: what lies near in plan and no farther up or down than a slope.
    off = points - here
    near = (np.abs(off[..., 0]) < BESIDE) & (np.abs(off[..., 2]) < half) & (
        np.abs(off[..., 1]) < 0.35 * (np.abs(off[..., 0]) + np.abs(off[..., 2])) + 0.05)
    chosen = points[near]
    if len(chosen) < 30:
        return here, None
    middle = chosen.mean(axis=0)
    normal = np.linalg.svd(chosen - middle, full_matrices=False)[2][2]
    return here, -normal if normal[1] > 0 else normal


def judge(points, marking):
    """One marking against the truth; None where that has no depth."""
    here, normal = true_marking(points, marking)
    if here is None:
        return None
    distance = float(np.linalg.norm(here))
    out = {"kind": marking["kind"], "true_distance": distance,
           "relative": marking["distance"] / distance - 1.0,
           "sigmas": (marking["distance"] - distance) / marking["sigma_distance"],
           "relative_sigma": marking["sigma_distance"] / marking["distance"],
           "beside": marking["beside_another"]}
    ends = [point_at(points, end) for end in marking["ends"]]
    if all(np.isfinite(end).all() for end in ends):
        out["true_length"] = float(np.linalg.norm(ends[1] - ends[0]))
    if normal is not None and "plane" in marking:
        plane = marking["plane"]
        estimate = np.array(plane["normal"])
        out["angle_deg"] = math.degrees(math.acos(min(1.0, float(estimate @ normal))))
        off = estimate - normal  # along: forward component; across: sideways
        for name, axis in (("along", 2), ("across", 0)):
            error = math.degrees(float(off[axis]))
            out[f"{name}_deg"] = error
            out[f"{name}_sigmas"] = error / max(plane[f"sigma_{name}_deg"], 1e-9)
    return out


def run(program, scene, frame, with_height, folder):
    """The markings of one run, or why it has none."""
    manifest = edited_manifest(scene, dict(PLAIN), None, folder)
    if not with_height:
        manifest["camera"].pop("height_above_road", None)
    path, out = folder / "scene.json", folder / "out"
    path.write_text(json.dumps(manifest), encoding="utf-8")
    done = subprocess.run(
        [str(program), "reconstruct", str(path), "--frames", str(frame), "--out", str(out),
         "--no-pictures", "--quiet", "--threads", "1"], capture_output=True, text=True, check=False)
    if done.returncode == 1:
        return {"refused": done.stderr.strip()}
    if done.returncode != 0:
        return {"crashed": f"{done.returncode}: {done.stderr.strip()}"}
    result = json.loads((out / "run.json").read_text(encoding="utf-8"))
    points = true_points(scene, frame)
    judged = [judge(points, m) for m in result["markings"]["found"]]
    truth = scene.truth[frame].get("ego_plane", {})
    surface = json.loads((out / "surface.json").read_text(encoding="utf-8"))
    height = {}
    if truth:
        ego = next(p for p in surface["patches"] if p["id"] == 0)
        height = {"height": math.log(ego["offset"] / truth["offset"]),
                  "height_sigma": surface["scale_sigma"]}
    warned = [w["text"] for w in result.get("warnings", [])]
    found = result["markings"]
    return {"markings": [m for m in judged if m], "warnings": warned, **height,
            "evidence": found["evidence"], "evidence_of_other": found["evidence_of_other"],
            "ms": sum(result["timings_ms"].values())}


def quantile(values, share):
    return float(np.quantile(values, share)) if len(values) else None


def share_below(values, limit):
    return float(np.mean(np.abs(values) <= limit)) if len(values) else None


def summary(runs):
    """The figures of many runs."""
    done = [r for r in runs if "markings" in r]
    near = [m for r in done for m in r["markings"] if m["true_distance"] <= REACH]
    out = {"runs": len(runs), "answered": len(done),
           "refused": sum("refused" in r for r in runs),
           "crashed": sum("crashed" in r for r in runs),
           "warned": sum(bool(r["warnings"]) for r in done)}

    def of(markings):
        planes = [m for m in markings if "angle_deg" in m]
        return {"markings": len(markings),
                "distance_median": quantile([abs(m["relative"]) for m in markings], 0.5),
                "distance_p90": quantile([abs(m["relative"]) for m in markings], 0.9),
                "stated_median": quantile([m["relative_sigma"] for m in markings], 0.5),
                "inside_2_sigma": share_below([m["sigmas"] for m in markings], 2.0),
                "inside_3_sigma": share_below([m["sigmas"] for m in markings], 3.0),
                "angle_deg_median": quantile([m["angle_deg"] for m in planes], 0.5),
                "angle_deg_p90": quantile([m["angle_deg"] for m in planes], 0.9),
                "along_inside_2_sigma": share_below([m["along_sigmas"] for m in planes], 2.0),
                "across_inside_2_sigma": share_below([m["across_sigmas"] for m in planes], 2.0)}

    out["all"] = of(near)
    for kind in ("dash", "crossing"):
        out[kind] = of([m for m in near if m["kind"] == kind])
    out["side_by_side"] = of([m for m in near if m["beside"]])
    heights = [r["height"] / r["height_sigma"] for r in done if "height" in r]
    out["camera_height"] = {
        "median": quantile([abs(r["height"]) for r in done if "height" in r], 0.5),
        "inside_2_sigma": share_below(heights, 2.0), "inside_3_sigma": share_below(heights, 3.0)}
    return out


def measure(arguments, scene):
    """Runs of one scene, by whether the camera's height is given."""
    frames = [i for i in scene.ids if "depth" in scene.truth.get(i, {})]
    if not frames:
        raise BadInput(f"{scene.folder}: no frame with a true depth image")
    frame = frames[0] if arguments.frame == "first" else frames[-1]
    out = {}
    for name, with_height in (("markings_alone", False), ("with_camera_height", True)):
        with tempfile.TemporaryDirectory() as folder:
            out[name] = run(arguments.program, scene, frame, with_height, pathlib.Path(folder))
    return out


def numbers_of(text):
    first, _, last = text.partition(":")
    return list(range(int(first), int(last or first) + 1))


def parse():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=pathlib.Path, default="build/release/bin/camber")
    parser.add_argument("--maker", choices=("steep_scenes", "synth", "folder"), default="folder")
    parser.add_argument("--steep-scenes", help="make.py of that maker")
    parser.add_argument("--scenes", type=pathlib.Path, required=True, help="folder of the scenes")
    parser.add_argument("--numbers", type=numbers_of, default="0:9", help="FIRST:LAST")
    half = parser.add_mutually_exclusive_group()
    half.add_argument("--even", action="store_true", help="of the numbers, the even ones")
    half.add_argument("--odd", action="store_true")
    parser.add_argument("--frame", choices=("first", "last"), default="first",
                        help="of those with a true depth image")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--details", action="store_true", help="also every run")
    parser.add_argument("--out", type=pathlib.Path, help="JSON file; else stdout")
    arguments = parser.parse_args()
    if arguments.even or arguments.odd:
        arguments.numbers = [n for n in arguments.numbers if n % 2 == int(arguments.odd)]
    return arguments


def main():
    arguments = parse()
    try:
        if not arguments.program.is_file():
            raise BadInput(f"{arguments.program}: no program to run")
        scenes = make_scenes(arguments, arguments.program)
        with ThreadPoolExecutor(arguments.jobs) as pool:
            runs = dict(zip(scenes, pool.map(lambda s: measure(arguments, s), scenes.values())))
    except (BadInput, OSError, zlib.error) as error:
        print(f"single_image_markings: {error}", file=sys.stderr)
        return 2
    result = {"benchmark": "single_image_markings", "maker": arguments.maker,
              "numbers": arguments.numbers, "frame": arguments.frame}
    for name in ("markings_alone", "with_camera_height"):
        result[name] = summary([run[name] for run in runs.values()])
    if arguments.details:
        result["runs"] = {str(n): run for n, run in runs.items()}
    text = json.dumps(result, indent=1)
    if arguments.out:
        arguments.out.write_text(text + "\n", encoding="utf-8")
    else:
        print(text)
    crashed = any("crashed" in one for run in runs.values() for one in run.values())
    return 1 if crashed else 0


if __name__ == "__main__":
    sys.exit(main())
