#!/usr/bin/env python3
"""What a keypoint network finds, and what the program makes of it: crops with true keypoints,
labelled cars of KITTI, whole runs, time a crop.

    tests/benchmarks/bench_keypoints.py --camber build/release/bin/camber --json runs/keypoints.json
    tests/benchmarks/bench_keypoints.py crops kitti --keypoints own.onnx
    tests/benchmarks/bench_keypoints.py scenes --scenes dev_01,more_02        (some, not all 22)

crops: `keypoints evaluate` on made validation crops and on the cars of steep-scenes and -more.
kitti: keypoints in labelled boxes against the projection of the labelled 3D box: share with wheels,
roof and bumper corners inside its outline (a margin of 5 % of its height), share with left and right
or front and rear swapped. kitti_localisation: the same cars by `camber vehicles` on a level plane
1.65 m below the camera, known to the program's sigmas of such a plane. scenes: `reconstruct
--frames 1:3` by boxes alone, by boxes with the network, and with the given keypoints. inference: the
network on a batch. Data that is not there is passed over. Even cars and scenes are for choices, odd
ones for reports. Needs numpy. Exit code: 0; 1 where a run failed; 2 for bad input.
"""

import argparse
import copy
import json
import os
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
from typing import Any, Dict, Iterator, List, Optional, Sequence, Tuple

from benchmark_json import ROOT, column, document, write_document
from keypoint_cars import (JUDGED, Car, cars_of, judge_keypoints, judge_vehicle, kitti_scenes,
                           number_halves, shipped_shapes)

MODELS = pathlib.Path(__file__).resolve().parents[2] / "lib/camber/detect/models"
PARTS = ("crops", "kitti", "kitti_localisation", "scenes", "inference")
WAYS = ("boxes alone", "boxes, network", "given keypoints")
NEAR = 25.0  # m


class Failed(Exception):
    """A run of the program that did not end with 0."""


def percent(share: Optional[float]) -> Optional[float]:
    return None if share is None else 100.0 * share


def share_of(flags: Sequence[bool]) -> Optional[float]:
    return 100.0 * sum(flags) / len(flags) if flags else None


def higher(name: str, unit: str = "%") -> Dict[str, Any]:
    return column(name, unit, better="higher")


def lower(name: str, unit: str = "%") -> Dict[str, Any]:
    return column(name, unit, better="lower")


class Bench:
    def __init__(self, args: argparse.Namespace, folder: pathlib.Path):
        self.args, self.folder = args, folder
        self.tables: List[Dict[str, Any]] = []
        self.items: Dict[str, Any] = {}
        self.skipped: List[str] = []

    def camber(self, *words: Any) -> Any:
        """Runs the program; its JSON, where it prints some."""
        line = [str(self.args.camber), *map(str, words), "--quiet",
                "--threads", str(self.args.threads)]
        run = subprocess.run(line, capture_output=True, text=True, check=False)
        if run.returncode != 0:
            raise Failed(f"{' '.join(line)}: exit code {run.returncode}: {run.stderr.strip()[-500:]}")
        return json.loads(run.stdout) if run.stdout.startswith("{") else None

    def skip(self, part: str, what: str) -> None:
        self.skipped.append(part)
        print(f"\n{part}: {what} not there, passed over", flush=True)

    def table(self, key: str, name: str, columns: List[Dict[str, Any]],
              rows: List[List[Any]]) -> None:
        command = f"tests/benchmarks/bench_keypoints.py {key}"
        if self.args.keypoints != "shipped":
            command += f" --keypoints {self.args.keypoints.name}"
        self.tables.append({"key": f"keypoints.{key}", "name": name, "command": command,
                            "columns": columns, "rows": rows})
        print(f"\n## {name}\n\n| " + " | ".join(
            f"{c['name']}, {c['unit']}" if "unit" in c else c["name"] for c in columns) + " |")
        print("|" + "|".join("---" if c.get("label") else "---:" for c in columns) + "|")
        for row in rows:
            print("| " + " | ".join(
                cell if isinstance(cell, str) else "-" if cell is None else
                str(cell) if isinstance(cell, int) else f"{cell:.2f}" for cell in row) + " |")
        sys.stdout.flush()

    # --- crops with truth ------------------------------------------------------------------------

    def validation(self) -> pathlib.Path:
        if self.args.crops:
            return pathlib.Path(self.args.crops)
        crops = self.folder / "validation"
        if not crops.exists():
            own = self.args.keypoints
            side = MODELS / "keypoints.json" if own == "shipped" else own.with_suffix(".json")
            size = json.loads(side.read_text(encoding="utf-8"))["input"]["width"]
            self.camber("keypoints", "synthesise", "--split", "validation", "--count",
                        self.args.count, "--seed", self.args.seed, "--size", size, "--out", crops)
        return crops

    def crops(self) -> None:
        inputs: List[Tuple[str, List[pathlib.Path]]] = [
            ("made, validation", [self.validation()])]
        scenes = list(self.scenes_there())
        if scenes:
            inputs.append(("steep-scenes and -more", [path for _, path in scenes]))
        else:
            self.skip("crops", "steep-scenes")
        rows = []
        for name, paths in inputs:
            result = self.camber("keypoints", "evaluate", *paths, "--keypoints",
                                 self.args.keypoints, "--json")["evaluation"]
            whole = result["overall"]
            visible, hidden, every = whole["visible"], whole["hidden"], whole["all"]
            rows.append([name, result["crops"], percent(visible["pck_2px"]),
                         percent(hidden["pck_2px"]), percent(every["pck_2px"]),
                         percent(visible["pck_alpha"]), percent(every["pck_alpha"]),
                         percent(result["mean_apk"]), percent(visible["inside_sigmas"][1]),
                         percent(hidden["inside_sigmas"][1]), *visible["offset_px"]])
        self.table("crops", "Crops with true keypoints", [
            column("crops of", label=True), column("crops"), higher("visible, 2 px of 64"),
            higher("hidden, 2 px"), higher("all, 2 px"), higher("visible, alpha 0.1"),
            higher("all, alpha 0.1"), higher("APK"), column("visible inside 2 sigma", "%"),
            column("hidden inside 2 sigma", "%"), column("offset right, visible", "px"),
            column("offset down, visible", "px")], rows)

    # --- labelled cars ---------------------------------------------------------------------------

    def kitti_cars(self) -> List[Car]:
        """The counted cars with the network's keypoints and with what `camber vehicles` answers."""
        cars: List[Car] = []
        shapes = shipped_shapes()
        with tempfile.TemporaryDirectory(dir=self.folder, prefix="kitti.") as name:
            for scene in kitti_scenes(self.camber, self.args.data, pathlib.Path(name)):
                found = scene.path.with_name("found.json")
                self.camber("detect", scene.path, "--keypoints", self.args.keypoints, "--no-cache",
                            "--out", found)
                placed = found.with_name("vehicles.json")
                self.camber("vehicles", found, "--out", placed)
                estimates = {(f"{frame['id']:06d}", v["id"]): v
                             for frame in json.loads(placed.read_text())["frames"]
                             for v in frame["vehicles"]}
                for car in cars_of(scene, json.loads(found.read_text(encoding="utf-8"))):
                    judge_keypoints(car, shapes)
                    judge_vehicle(car, estimates.get((car.frame, car.detection["id"]), {}))
                    cars.append(car)
        number_halves(cars)
        return cars

    def kitti(self, keypoints: bool, localisation: bool) -> None:
        if not (self.args.data / "kitti-object-frames").is_dir():
            self.skip("kitti", "kitti-object-frames")
            return
        cars = self.kitti_cars()
        halves = [("even", [c for c in cars if not c.odd]), ("odd", [c for c in cars if c.odd]),
                  ("all", cars), ("all, not truncated", [c for c in cars if c.truncation <= 0.0])]
        if keypoints:
            self.table("kitti", "KITTI cars: keypoints against the labelled box", [
                column("cars", label=True), column("different cars"), column("views"),
                higher("views with all inside"), higher("keypoints inside"), lower("swapped"),
                lower("left/right"), lower("turned"), lower("front/rear")],
                [[name, len({c.name for c in half}), len(half),
                  share_of([not c.outside for c in half]),
                  share_of([k not in c.outside for c in half for k in JUDGED]),
                  share_of([bool(c.swap) for c in half]),
                  *(share_of([c.swap == swap for c in half])
                    for swap in ("left/right", "turned", "front/rear"))] for name, half in halves])
            self.items["kitti"] = {
                "columns": [lower("outside", ""), lower("swapped", "")],
                "values": {f"{c.name}/{c.frame}": [len(c.outside), bool(c.swap) * 1]
                           for c in cars}}
        if localisation:
            self.table("kitti_localisation",
                       "KITTI cars placed by label boxes on a flat road, camera about 1.65 m above", [
                           column("cars", label=True), column("distance", label=True),
                           column("views"), lower("unanswered", ""), lower("centre, mean", "m"),
                           lower("centre, median", "m"), lower("yaw, median", "deg"),
                           lower("flipped"), column("inside their 95 %", "%")],
                       [localisation_row(name, reach, half) for name, half in halves
                        for reach in (NEAR, None)])
            self.items["kitti_localisation"] = {
                "columns": [lower("centre", "m"), lower("yaw", "deg")],
                "values": {f"{c.name}/{c.frame}": [c.center_error, c.yaw_error_deg]
                           for c in cars if c.center_error is not None}}
        print_worst(cars, self.args.worst)

    # --- whole runs ------------------------------------------------------------------------------

    def scenes_there(self) -> Iterator[Tuple[str, pathlib.Path]]:
        """(set, folder) of the scenes asked for, in order."""
        for name in ("steep-scenes", "steep-scenes-more"):
            for path in sorted((self.args.data / name).glob("*/scene.json")):
                if not self.args.scenes or path.parent.name in self.args.scenes:
                    yield name, path.parent

    def without_keypoints(self, scene: pathlib.Path) -> pathlib.Path:
        """A copy of the manifest with boxes alone; its paths lead to the scene's own files."""
        manifest = copy.deepcopy(json.loads((scene / "scene.json").read_text(encoding="utf-8")))
        for frame in manifest["frames"]:
            for key in ("image", "segmentation", "road_mask"):
                if key in frame:
                    frame[key] = str((scene / frame[key]).resolve())
            for vehicle in frame.get("vehicles", []):
                vehicle.pop("keypoints", None)
                vehicle.pop("keypoint_sigmas_px", None)
        manifest.pop("truth", None)  # is read from the scene itself, by evaluate
        path = self.folder / "boxes" / scene.name / "scene.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(manifest), encoding="utf-8")
        return path

    def reconstruct(self, way: str, scene: pathlib.Path) -> Optional[pathlib.Path]:
        """The result's folder; None where the run refuses."""
        out = self.folder / "runs" / way.replace(", ", "_").replace(" ", "_") / scene.name
        given = way == WAYS[2]
        network = [] if given else ["--no-cache", "--keypoints",
                                    "none" if way == WAYS[0] else self.args.keypoints]
        try:
            self.camber("reconstruct", scene if given else self.without_keypoints(scene),
                        "--frames", "1:3", "--no-pictures", "--out", out, *network)
        except Failed as error:
            if "exit code 1:" not in str(error):
                raise
            print(f"{scene.name}, {way}: {error}", flush=True)
            return None
        return out

    def scenes(self) -> None:
        scenes = list(self.scenes_there())
        if not scenes:
            self.skip("scenes", "steep-scenes")
            return
        runs: Dict[str, Dict[str, pathlib.Path]] = {}
        for _, scene in scenes:
            done = {way: self.reconstruct(way, scene) for way in WAYS}
            answered = {way: out for way, out in done.items() if out}
            if len(answered) == len(WAYS):  # the same scenes for all
                runs[scene.name] = answered
            print(f"{scene.name}: {len(answered)} of {len(WAYS)} ways answered", flush=True)
        groups = [("steep-scenes", [p for s, p in scenes if s == "steep-scenes"]),
                  ("steep-scenes-more", [p for s, p in scenes if s != "steep-scenes"]),
                  ("even", [p for _, p in scenes if int(p.name[-2:]) % 2 == 0]),
                  ("odd", [p for _, p in scenes if int(p.name[-2:]) % 2 == 1]),
                  ("all", [p for _, p in scenes])]
        rows: List[List[Any]] = []
        for name, members in groups:
            used = [p for p in members if p.name in runs]
            if used:
                rows += self.scene_rows(name, used, len(members) - len(used), runs)
        self.table("scenes", "Whole runs of rendered scenes, frames 1 to 3", [
            column("scenes", label=True), column("vehicles by", label=True), column("runs"),
            lower("refused", ""), column("cars"), lower("missed", ""), lower("centre, mean", "m"),
            lower("centre, median", "m"), column("mean over that of given"),
            column("median over that of given"), column("inside their 95 %", "%")], rows)

    def scene_rows(self, name: str, scenes: List[pathlib.Path], refused: int,
                   runs: Dict[str, Dict[str, pathlib.Path]]) -> List[List[Any]]:
        tables = {way: self.camber("evaluate", "--truth", *scenes, "--estimate",
                                   *(runs[p.name][way] for p in scenes), "--json")["tables"][0]
                  for way in WAYS}
        rows = {way: next(row for row in table["rows"] if row["name"] == "all")
                for way, table in tables.items()}
        given = rows[WAYS[2]]["center_error"]
        return [[name, way, len(scenes), refused, row["matched"], tables[way]["missed"],
                 row["center_error"]["mean"], row["center_error"]["median"],
                 row["center_error"]["mean"] / given["mean"],
                 row["center_error"]["median"] / given["median"],
                 percent(row["center_within_95"])] for way, row in rows.items()]

    # --- time ------------------------------------------------------------------------------------

    def inference(self) -> None:
        crops = self.validation()
        wall, processor = [], []
        for _ in range(self.args.repeats):
            # Loading and checking the network is in both.
            times = [self.time_of(crops, count) for count in (self.args.batch // 10,
                                                              self.args.batch)]
            more = times[1][2] - times[0][2]
            wall.append(times[1][0] / times[1][2])
            processor.append((times[1][1] - times[0][1]) / more)
        timing = {"timing": True, "better": "lower"}
        self.table("inference", "The network on a batch of crops", [
            column("crops", label=True), column("threads", label=True),
            column("a crop, wall", "ms", **timing), column("a crop, processor time", "ms", **timing)],
            [[str(self.args.batch), str(self.args.threads), min(wall), min(processor)]])

    def time_of(self, crops: pathlib.Path, count: int) -> Tuple[float, float, int]:
        """ms of the network, ms of processor time of the whole run, crops."""
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        result = self.camber("keypoints", "run", crops, "--first", count,
                             "--keypoints", self.args.keypoints, "--json")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return result["timings_ms"]["compute"], 1000.0 * seconds, len(result["crops"])


def localisation_row(name: str, reach: Optional[float], cars: List[Car]) -> List[Any]:
    counted = [c for c in cars if reach is None or c.distance <= reach]
    centers = [c.center_error for c in counted if c.center_error is not None]
    yaws = [c.yaw_error_deg for c in counted if c.yaw_error_deg is not None]
    return [name, "any" if reach is None else f"<= {reach:.0f} m", len(counted),
            len(counted) - len(centers), statistics.fmean(centers) if centers else None,
            statistics.median(centers) if centers else None,
            statistics.median(yaws) if yaws else None, share_of([yaw > 90.0 for yaw in yaws]),
            share_of([c.inside_95 for c in counted if c.center_error is not None])]


def print_worst(cars: List[Car], count: int) -> None:
    """Those with a swap, then those with most keypoints outside, then those farthest off."""
    cars = sorted(cars, key=lambda c: (not c.swap, -len(c.outside), -(c.center_error or 0.0)))
    print(f"\n{min(count, len(cars))} worst of {len(cars)} views:")
    for c in cars[:count]:
        placed = "no answer" if c.center_error is None or c.yaw_error_deg is None else (
            f"centre {c.center_error:.2f} m, yaw {c.yaw_error_deg:.1f} deg")
        print(f"  {c.name} frame {c.frame} ({'odd' if c.odd else 'even'}): {c.distance:.1f} m, "
              f"{c.height:.0f} px, truncated {c.truncation:.2f}; outside {c.outside}; "
              f"{c.swap or 'not swapped'} (error {c.swap_ratio:.2f} of the labelled pose's); {placed}")
    sys.stdout.flush()


def arguments_of(parser: argparse.ArgumentParser) -> argparse.Namespace:
    parser.add_argument("parts", nargs="*", metavar="PART",
                        help=f"of {', '.join(PARTS)}; default: all")
    parser.add_argument("--camber", type=pathlib.Path, default=ROOT / "build/release/bin/camber")
    parser.add_argument("--keypoints", default="shipped", help="shipped, or an ONNX file")
    parser.add_argument("--data", type=pathlib.Path, help="default: $CAMBER_DATA or ../shared/data",
                        default=os.environ.get("CAMBER_DATA") or ROOT.parent / "shared/data")
    parser.add_argument("--crops", type=pathlib.Path, help="made validation crops; default: made anew")
    parser.add_argument("--count", type=int, default=4000, help="of validation crops made anew")
    parser.add_argument("--seed", type=int, default=2, help="of them; 1 calibrates shipped networks")
    parser.add_argument("--scenes", type=lambda text: text.split(","), metavar="NAME,...",
                        help="of steep-scenes and -more; default: all")
    parser.add_argument("--worst", type=int, default=10, help="KITTI cars to list")
    parser.add_argument("--batch", type=int, default=1000, help="crops of a timing")
    parser.add_argument("--repeats", type=int, default=3, help="of a timing")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--folder", type=pathlib.Path,
                        help="for inputs and results, kept; default: a temporary one")
    parser.add_argument("--json", type=pathlib.Path)
    args = parser.parse_args()
    for part in args.parts:
        if part not in PARTS:
            parser.error(f"part '{part}': expected one of {', '.join(PARTS)}")
    args.parts = args.parts or list(PARTS)
    args.camber, args.data = args.camber.resolve(), args.data.resolve()
    if not args.camber.exists():
        parser.error(f"--camber {args.camber}: no such program")
    if args.keypoints != "shipped":
        args.keypoints = pathlib.Path(args.keypoints).resolve()
        if not args.keypoints.exists():
            parser.error(f"--keypoints {args.keypoints}: no such file")
    if args.batch < 20 or args.count < args.batch:
        parser.error(f"--batch {args.batch}: expected 20 to --count {args.count}")
    if args.crops and not (args.crops / "images.npy").exists():
        parser.error(f"--crops {args.crops}: no folder of `camber keypoints synthesise`")
    return args


def measure(args: argparse.Namespace, folder: pathlib.Path) -> Bench:
    bench = Bench(args, folder)
    if "crops" in args.parts:
        bench.crops()
    if "kitti" in args.parts or "kitti_localisation" in args.parts:
        bench.kitti("kitti" in args.parts, "kitti_localisation" in args.parts)
    if "scenes" in args.parts:
        bench.scenes()
    if "inference" in args.parts:
        bench.inference()
    return bench


def main() -> int:
    args = arguments_of(argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter))
    before = os.getloadavg()[0]
    try:
        if args.folder:
            args.folder.mkdir(parents=True, exist_ok=True)
            bench = measure(args, args.folder.resolve())
        else:
            with tempfile.TemporaryDirectory(prefix="bench_keypoints.") as name:
                bench = measure(args, pathlib.Path(name))
    except Failed as error:
        print(f"bench_keypoints.py: {error}", file=sys.stderr)
        return 1
    if args.json:
        write_document(args.json, document("bench_keypoints", before, bench.tables, args.seed,
                                           bench.items, {"keypoints": pathlib.Path(args.keypoints).name,
                                                         "scenes": args.scenes or "all"}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
