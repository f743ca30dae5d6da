#!/usr/bin/env python3
"""Makes BENCHMARK.md from the JSON of benchmark runs: the tables that matter to a user, each with
the command that measures it, and where another library does better.

    build/release/bin/bench_main_job --json runs/main_job.json     (and so on, one file a program)
    tests/benchmarks/make_benchmark_md.py runs --store tests/benchmarks/results \\
        --out tests/benchmarks/BENCHMARK.md

Several seeds of one program are shown as means (timings: medians). Tables that no file holds are
named at the end. Exit code: 0, 2 for bad input.
"""

import argparse
import json
import math
import pathlib
import statistics
import sys

from benchmark_json import BadInput, labels_of, read_runs


class Pick:
    """One table of the page: rows of one table, or of several under a first column of its own."""

    def __init__(self, program, title, sources, columns, rows=None, first="", peers=()):
        self.program, self.title = program, title
        self.sources = sources if isinstance(sources, dict) else {"": sources}
        self.columns = columns  # heading, or (heading, [names of which a table has one])
        self.rows = rows  # substrings of the labels of the rows to show; None: all
        self.first = first  # heading of the column that names the source
        self.peers = peers  # headings in which rows of other libraries are compared with ours


METHODS = ["flat | none", "coplanar | from 3 images", "joint | from 3 images",
           "joint, three views | from 3 images", "joint, five views | from 5 images",
           "joint, five views, no grey values | from 5 images", "joint without planes | none",
           "joint | true", "joint, five views | true"]
METHOD_COLUMNS = ["method", "planes", "cars", "centre, mean", "centre, median", "centre, <= 15 m",
                  "centre, <= 30 m", "centre, > 30 m", "yaw, median", "centres inside their 95 %"]
PAPER_COLUMNS = ["row", "cars", "centre, mean", "centre, median", "centre, <= 15 m",
                 "centre, 15 to 30 m", "centre, > 30 m", "inside their 95 %"]
STEEP = {"three": "steep3", "five": "steep5", "three, masks not read": "nomasks",
         "three, planes jointly, without the graph": "joint_planes"}

PAGE = [
    ("Main job: `camber reconstruct`", [
        Pick("bench_main_job", "Ten rendered steep scenes: ground under the cars of the middle frame",
             {name: key + ".distance" for name, key in STEEP.items()},
             ["distance", "cars", "height error, median", "height error, 90 %",
              "centre error, mean"], first="frames"),
        Pick("bench_main_job", "The same: scale, motion, coverage",
             {name: key + ".scenes" for name, key in STEEP.items()},
             ["normals, median", "heights inside their 95 %", "covered within 40 m", "of",
              "scale error, median", "scale error, 90 %", "scales inside their 95 %", "scenes",
              "direction of travel, median"], first="frames"),
        Pick("bench_main_job", "KITTI raw drive 0052 against the laser, no masks", "crawling",
             ["frames", "surface, median", "surface, 95 %", "ego plane, height",
              "ego plane, normal", "road points inside their 95 %", "length", "direction"],
             rows=["chosen", "0,5,10 |", "2,6,10 |", "0,2,4,", "0,1,2,"]),
        Pick("bench_main_job", "KITTI odometry 06, 29 triplets, no masks", "odometry",
             ["direction, median", "direction, 90 %", "length, median", "length, 90 %"]),
        Pick("bench_main_job", "KITTI tracking 0009, label boxes, no masks: ground under vehicles",
             {"three": "tracking.3", "five": "tracking.5"},
             ["height error below 25 m, mean", "below 35 m"], first="frames"),
        Pick("bench_main_job", "Computing time of a triplet, pictures left out, wall", "time",
             ["input", "stage", "time"], rows=["| all"]),
    ]),
    ("Scale and vehicles on scenes that decided nothing", [
        *(Pick(f"trust.py, {of}", f"{of.capitalize()}: {title}", key, columns)
          for of in ("steep scenes", "made scenes")
          for title, key, columns in (
              ("scales and what is stated of them", "trust.scale",
               ["frames", "runs", "refused", "weak", "error, median", "error, 90 %",
                "error, worst", "sigma, median", "sigma, 90 %", "inside 2 sigma",
                "beyond 4 sigma", "largest z"]),
              ("vehicles of all frames", "trust.vehicles",
               ["frames", "vehicles", "centre error, mean", "centre error, median",
                "centres inside their 95 %", "heights inside their 95 %"]),
              ("faults put into what is given", "trust.faults",
               ["fault", "runs", "refused", "warned", "inside 3 sigma", "wrong", "contradicted",
                "good of those contradicted"]))),
    ]),
    ("Whole drives: `camber drive`", [
        *(Pick(f"drives.py, {of}", f"{of.capitalize()}: {title}", key, columns)
          for of in ("steep drives", "made drives")
          for title, key, columns in (
              ("trajectory, road and tracks", "drives.summary",
               ["measure", "value", "worst drive"]),
              ("vehicles beside `reconstruct` about the same frame", "drives.vehicles",
               ["distance", "vehicles", "reconstruct, mean", "reconstruct, median", "drive, mean",
                "drive, median", "inside their 95 %"]))),
    ]),
    ("Lens distortion", [
        Pick("bench_lens", "Ten made drives without and through a lens: mean errors",
             {"brown, k1 = -0.35": "lens.brown", "fisheye, 120 degrees": "lens.fisheye"},
             ["error", "values", "without, mean", "through, mean", "ratio",
              "standard error of the ratio"], first="lens"),
    ]),
    ("Networks that a user brings (public ones, not part of the project)", [
        Pick("bench_networks", "KITTI object frames (19), vehicles of at least 25 px", "detectors",
             ["network", "tiles", "vehicles", "found", "detections", "false", "false share",
              "lower side, rms", "a frame, two threads",
              "processor time of a frame"]),
        Pick("bench_networks", "KITTI stereo 2015: road masks against the laser, alone",
             "segmenters",
             ["network", "ground found", "beyond 20 m", "road off by 0.2 m",
              "vehicles called road", "an image"]),
        Pick("bench_networks", "KITTI raw drive 0052: mask fused with geometry, laser to 25 m",
             "fused",
             ["frames", "network alone: road off by 0.2 m", "fused: road off by 0.2 m",
              "network alone: ground found", "fused: ground found"]),
        Pick("bench_networks", "Rendered steep scenes: masks fused with geometry, to 25 m",
             "fused_steep",
             ["scene", "mask alone: road off by 0.2 m", "fused: road off by 0.2 m",
              "mask alone: ground found", "fused: ground found"],
             rows=["dev_04", "dev_06", "dev_07", "dev_08"]),
        Pick("bench_networks", "KITTI tracking 0009 from images alone", "tracking",
             ["masks", "frames", "labelled cars nearer than 35 m", "found",
              "vehicles below 25 m", "height error, mean"], rows=["| all"]),
    ]),
    ("Vehicles", [
        Pick("bench_steep_roads", "Ten rendered steep scenes: centre error by method", "steep",
             METHOD_COLUMNS, rows=METHODS),
        Pick("bench_steep_roads", "Eight scenes of `camber synth`: centre error by method", "synth",
             METHOD_COLUMNS, rows=METHODS),
        Pick("bench_steep_roads", "Real network keypoints on four KITTI cars, flat road assumed",
             "real", ["centre, mean", "centre, median", "yaw, median", "inside their 95 %",
                      "cars"]),
        Pick("bench_lift", "`camber lift`: label boxes of KITTI tracking 0009 moved along their rays",
             {"48 to 50": "lift.48-50", "48 to 53": "lift.48-53"},
             ["noise", "distance", "rows", "centre error unlifted, mean", "lifted, mean",
              "on the surface", "inside their 95 % along the ray"],
             rows=["8 % | odd", "8 %, heights 5 %, sides 2 px | odd"], first="surface of"),
        Pick("bench_joint_fit", "Joint problem (Ceres) of ten vehicles with their planes", "joint",
             ["derivatives", "time"]),
    ]),
    ("The keypoint network that ships", [
        Pick("bench_keypoints", "Crops with true keypoints: made ones that no training sees, and"
             " rendered steep scenes (another renderer)", "keypoints.crops",
             ["crops of", "crops", "visible, 2 px of 64", "hidden, 2 px", "all, 2 px",
              "visible, alpha 0.1", "APK", "visible inside 2 sigma"]),
        Pick("bench_keypoints", "KITTI cars: wheels, roof and bumper corners inside the labelled"
             " box's outline; left and right or front and rear swapped", "keypoints.kitti",
             ["cars", "different cars", "views", "views with all inside", "keypoints inside",
              "swapped"]),
        Pick("bench_keypoints", "The same cars placed by label boxes on a flat road",
             "keypoints.kitti_localisation",
             ["cars", "distance", "views", "centre, mean", "centre, median", "yaw, median",
              "flipped", "inside their 95 %"]),
        Pick("bench_keypoints", "Twenty-two rendered steep scenes, whole runs", "keypoints.scenes",
             ["scenes", "vehicles by", "runs", "refused", "cars", "centre, mean", "centre, median",
              "mean over that of given", "median over that of given", "inside their 95 %"]),
        Pick("bench_keypoints", "Time of the network", "keypoints.inference",
             ["crops", "threads", "a crop, wall", "a crop, processor time"]),
    ]),
    ("The paper's method: `--preset paper`", [
        Pick("bench_paper", "True local planes given, one image",
             {"ten steep scenes": "given.steep-scenes", "twelve more": "given.steep-scenes-more"},
             PAPER_COLUMNS + ["farther off than their start"],
             rows=["starts", "meant terms", "printed terms, CGNR", "meant, 14", "pose and shape"],
             first="scenes"),
        Pick("bench_paper", "From images, planes by RANSAC in the expanded box",
             {"ten steep scenes": "images.steep-scenes", "twelve more": "images.steep-scenes-more"},
             PAPER_COLUMNS + ["plane height, median", "scenes refused"], first="scenes"),
    ]),
    ("Road clouds", [
        Pick("bench_road_clouds", "One plane, 30 % outliers", "plane",
             ["library", "points", "with", "CPU", "normal, mean", "normal, worst", "height, mean"],
             rows=["| 1e5 |", "| 1e6 |"], peers=["CPU", "normal, mean", "height, mean"]),
        Pick("bench_road_clouds", "Largest of six planes, 30 % outliers", "largest",
             ["library", "points", "with", "CPU", "normal, mean", "normal, worst", "height, mean",
              "largest plane", "of"],
             rows=["| 1e5 |"], peers=["CPU", "normal, mean", "height, mean"]),
        Pick("bench_road_clouds", "Wall time on one thread and on all", "threads",
             ["job", "one thread", "all threads", "times as fast", "peer",
              "peer's time over that of all threads"]),
        Pick("bench_road_clouds", "Multi-plane patches, 1e5 points", "patches",
             ["library", "planes", "with", "CPU", "planes found", "of planes", "IoU, mean",
              "normal, mean", "height, mean"],
             rows=["| 3 | 1e5 |", "| 6 | 1e5 |", "| 12 | 1e5 |"],
             peers=["CPU", "IoU, mean", "normal, mean", "height, mean"]),
        Pick("bench_road_clouds", "Truths inside the stated 95 % regions", "coverage",
             ["planes", "normal", "offset", "both together", "of"],
             rows=["one plane, 1e4", "000, x y z, joined", "000, sigmas, joined"]),
        Pick("bench_road_clouds", "als-forest-road: grade over 10 m along the centreline", "forest",
             ["points", "with", "covered", "grade, mean", "grade, 95 %", "height, mean",
              "height, 95 %"]),
        Pick("bench_road_clouds", "Stations of profiles inside their stated 95 % bands", "bands",
             ["cloud", "height", "grade", "cross slope", "half width, height",
              "error, height, 95 %", "stations"]),
        Pick("bench_road_clouds", "argoverse2-ground: one sweep against the measured ground",
             "sweep", ["within", "covered", "height, median", "height, 95 %"],
             rows=["any patch"]),
    ]),
    ("Cloud toolkit", [
        Pick("bench_cloud_toolkit", "Ground of made 64-beam scans", "ground.scans",
             ["hills", "F1, mean", "F1, worst", "CPU"]),
        Pick("bench_cloud_toolkit", "Ground, ISPRS filter test: mean total error of seven samples",
             "ground.isprs.mean", ["camber", "PCL"]),
        Pick("bench_cloud_toolkit", "1e6 points, one thread (outliers: 1e5), other libraries beside",
             {"cloud to cloud": "compare.cloud", "cloud to mesh": "compare.mesh",
              "normals": "filters.normals", "voxel grid": "filters.voxels",
              "statistical outliers": "filters.outliers"},
             ["library", "CPU",
              ("off by, m, deg or points", ["largest difference to brute force or camber",
                                            "error, median", "decided otherwise than camber"])],
             first="job", peers=["CPU", "off by, m, deg or points"]),
        Pick("bench_cloud_toolkit", "Reading 1e7 points", "read.binary",
             ["file", "size", "camber", "cat", "ratio"]),
        Pick("bench_cloud_toolkit", "Points of `camber reconstruct` against dense truth",
             {"samples/steep_hill": "results.steep_hill.heights",
              "KITTI drive 0052": "results.drive_0052.heights"},
             ["distance", "points", "mean, up is positive", "median, absolute", "rms"],
             first="scene"),
    ]),
    ("Pictures", [
        Pick("bench_pictures", "`camber render` of 1e6 points, no display, no GPU", "render",
             ["picture", "wall", "CPU"]),
        Pick("bench_pictures", "Overlay of 1242x375 with ten vehicles", "overlay",
             ["overlay", "CPU"]),
    ]),
    ("Growth", [
        Pick("bench_growth", "Exponents b of time and memory as size^b", "growth.exponents",
             ["job", "size of", "time, all sizes", "time, last step", "memory, all sizes",
              "memory, last step"]),
        Pick("bench_growth", "Time and memory by size", "growth.runs",
             ["job", "size of", "size", "CPU", "wall", "memory"]),
    ]),
    ("Fuzzing", [
        Pick("long_run.py", "Executions of each reader's fuzzer, under the sanitizers", "fuzzing",
             ["fuzzer", "executions", "features", "inputs kept", "found"]),
    ]),
]


def number(value):
    """Three figures, never in powers of ten where a person would not write them."""
    if value is None:
        return "-"
    if value == round(value) and abs(value) < 1e7:
        return str(int(value))
    if 0.0 < abs(value) < 1e-4:
        return f"{value:.1e}"
    digits = max(0, min(4, 2 - math.floor(math.log10(abs(value))))) if value else 0
    return f"{value:.{digits}f}"


def far_end(label):
    """"50 to inf m" as a person writes it."""
    return f"> {label.split(' to ')[0]} m" if label.endswith(" to inf m") else label


class Shown:
    """One table of all seeds of a program: mean values, medians of timings."""

    def __init__(self, tables):
        self.columns = tables[0]["columns"]
        self.command = tables[0]["command"].split(" --seed ")[0]
        if len(tables) > 1:
            self.command += " --seeds A:B"
        cells = {}
        for table in tables:
            for row in table["rows"]:
                cells.setdefault(labels_of(table, row), []).append(row)
        self.rows = {label: self.combine(rows) for label, rows in cells.items()}

    def combine(self, rows):
        out = []
        for i, column in enumerate(self.columns):
            values = [row[i] for row in rows if row[i] is not None]
            if column.get("label"):
                out.append(values[0])
            elif not values:
                out.append(None)
            else:
                out.append(statistics.median(values) if column.get("timing")
                           else statistics.fmean(values))
        return out

    def index(self, names):
        for i, column in enumerate(self.columns):
            if column["name"] in names:
                return i
        return None


def heading_and_names(column):
    return column if isinstance(column, tuple) else (column, [column])


def unit_of(shown, names):
    units = {table.columns[table.index(names)].get("unit", "")
             for table in shown.values() if table.index(names) is not None}
    return units.pop() if len(units) == 1 else ""


def is_ours(library):
    return library.lower() == "camber"


def losses(pick, lines, better):
    """Sentences on every group of rows in which another library is better than ours. `lines` are
    (label of the group, library, {heading: value})."""
    out = []
    for group in dict.fromkeys(line[0] for line in lines):
        ours = [line for line in lines if line[0] == group and is_ours(line[1])]
        others = [line for line in lines if line[0] == group and not is_ours(line[1])]
        for heading in pick.peers if ours and others else ():
            mine = ours[0][2].get(heading)
            sign = 1.0 if better.get((group, heading)) == "lower" else -1.0
            values = [(sign * line[2][heading], line) for line in others
                      if line[2].get(heading) is not None]
            if mine is None or not values or (group, heading) not in better:
                continue
            best, line = min(values, key=lambda pair: pair[0])
            if best < sign * mine:
                out.append(f"Camber loses, {group + ', ' if group else ''}{heading}: {line[1]} "
                           f"{number(line[2][heading])}, Camber {number(mine)}.")
    return out


def show(pick, runs):
    """Lines of Markdown, or None where no run has the table."""
    shown = {}
    for source, key in pick.sources.items():
        tables = [run.tables()[key] for run in runs
                  if run.program == pick.program and key in run.tables()]
        if tables and any(table["rows"] for table in tables):
            shown[source] = Shown(tables)
    if not shown:
        return None
    columns = [heading_and_names(column) for column in pick.columns]
    heads, align = ([pick.first], ["---"]) if pick.first else ([], [])
    for heading, names in columns:
        unit = unit_of(shown, names)
        heads.append(f"{heading}, {unit}" if unit else heading)
        labels = [t.columns[t.index(names)].get("label") for t in shown.values()
                  if t.index(names) is not None]
        align.append("---" if any(labels) else "---:")
    out, peers, better = [], [], {}
    for source, table in shown.items():
        for label, row in table.rows.items():
            if pick.rows is not None and not any(part in f"{label} |" for part in pick.rows):
                continue
            cells, values = ([source] if pick.first else []), {}
            library, group = None, [source] if source else []
            for heading, names in columns:
                i = table.index(names)
                value = None if i is None else row[i]
                if isinstance(value, str):
                    cells.append(far_end(value))
                    if heading == "library":
                        library = value
                    else:
                        group.append(value)
                    continue
                cells.append(number(value))
                values[heading] = value
                if i is not None and "better" in table.columns[i]:
                    better[", ".join(group), heading] = table.columns[i]["better"]
            out.append("| " + " | ".join(cells) + " |")
            peers.append((", ".join(group), library or "", values))
    return ([f"**{pick.title}**: `{joined([table.command for table in shown.values()])}`", "",
             "| " + " | ".join(heads) + " |", "|" + "|".join(align) + "|"] + out + [""]
            + [line for loss in losses(pick, peers, better) for line in (loss, "")])


def joined(commands):
    """The first command, with the sections of all of them."""
    sections = []
    for command in commands:
        words = command.split()
        options = next((i for i, word in enumerate(words) if word.startswith("--")), len(words))
        sections += words[1:options]
    words = commands[0].split()
    options = next((i for i, word in enumerate(words) if word.startswith("--")), len(words))
    return " ".join(words[:1] + list(dict.fromkeys(sections)) + words[options:])


def span(values):
    return number(min(values)) if min(values) == max(values) else (
        f"{number(min(values))} to {number(max(values))}")


def provenance(runs):
    """One row a program: what was measured, when and where."""
    out = ["| program | revision | date | seeds | machine | load |", "|---|---|---|---|---|---|"]
    for program in dict.fromkeys(run.program for run in runs):
        mine = [run for run in runs if run.program == program]
        machine = mine[0].data["machine"]
        loads = [load for run in mine for side in run.data["machine"]["load_average"].values()
                 for load in side]
        out.append("| {} | {} | {} | {} | {}, {} cores | {} |".format(
            program, ", ".join(dict.fromkeys(run.revision for run in mine)),
            max(run.data["date"] for run in mine)[:10],
            ", ".join(str(run.seed) for run in mine), machine["cpu"], machine["cores"],
            span(loads) if loads else "-"))
    return out


def make_page(runs):
    lines = [
        "# Benchmarks", "",
        "Made by `tests/benchmarks/make_benchmark_md.py` from the runs in `tests/benchmarks/results`;"
        " not to be edited. Accuracy is against truth that no estimate sees. Times are CPU times of"
        " one thread, the least of several runs, unless a row says wall; the load is the machine's"
        " average of processes while it ran (above the number of cores it was shared, and times are"
        " upper bounds). Data that is not part of the project comes from the folder `$CAMBER_DATA`,"
        " by default `../shared/data`. Two revisions are compared item by item by"
        " `tests/benchmarks/compare_revisions.py`; what was tried and what it gave is in"
        " [docs/notes](../../docs/notes).", ""]
    lines += provenance(runs) + [""]
    absent = []
    for section, picks in PAGE:
        shown = [(pick, show(pick, runs)) for pick in picks]
        absent += [f"{pick.title} ({pick.program})" for pick, found in shown if found is None]
        if any(found is not None for _, found in shown):
            lines += [f"## {section}", ""]
            for _, found in shown:
                lines += found or []
    if absent:
        lines += ["Not measured: " + "; ".join(absent) + ".", ""]
    return "\n".join(lines).rstrip() + "\n"


def store(runs, folder):
    """The runs' tables without their raw values, six figures a number, one file a run."""
    def rounded(cell):
        return float(f"{cell:.6g}") if isinstance(cell, float) else cell

    folder.mkdir(parents=True, exist_ok=True)
    for run in runs:
        data = dict(run.data, items={})
        data["tables"] = [dict(table, rows=[[rounded(cell) for cell in row]
                                            for row in table["rows"]]) for table in data["tables"]]
        name = pathlib.Path(run.path).name
        (folder / name).write_text(pretty(data) + "\n", encoding="utf-8")


def pretty(data):
    """JSON with a row of a table a line."""
    tables = []
    for table in data["tables"]:
        head = json.dumps({k: v for k, v in table.items() if k != "rows"})
        rows = ",\n".join("    " + json.dumps(row) for row in table["rows"])
        tables.append(f'  {head[:-1]}, "rows": [\n{rows}\n  ]}}')
    rest = ",\n".join(f" {json.dumps(k)}: {json.dumps(v)}"
                      for k, v in data.items() if k != "tables")
    return "{\n" + rest + ',\n "tables": [\n' + ",\n".join(tables) + "\n ]\n}"


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", metavar="FILE|DIR")
    parser.add_argument("--out", type=pathlib.Path, metavar="FILE", help="default: stdout")
    parser.add_argument("--store", type=pathlib.Path, metavar="DIR",
                        help="keep the tables of the runs here, and make the page from them")
    arguments = parser.parse_args()
    try:
        runs = read_runs(arguments.runs)
        if arguments.store:
            store(runs, arguments.store)
            runs = read_runs([arguments.store])
        page = make_page(runs)
    except BadInput as error:
        print(f"make_benchmark_md.py: {error}", file=sys.stderr)
        return 2
    if arguments.out:
        arguments.out.write_text(page, encoding="utf-8")
    else:
        sys.stdout.write(page)
    return 0


if __name__ == "__main__":
    sys.exit(main())
