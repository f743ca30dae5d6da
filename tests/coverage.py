#!/usr/bin/env python3
"""Lines and branches that the tests reached, by module, from a tree of the preset coverage after its
tests ran; and what the seeds of each fuzzer reach of the reader that it is for.

    tests/coverage.py build/coverage [--floor 90] [--json FILE] [--found build/fuzz/findings]
    tests/coverage.py --check-fuzzers NAME...

The second form compares the fuzzers that there are with the lists here, and these with the files.
Branches that only an exception takes do not count. Exit code: 0, 1 where the readers of a module have
less than the floor of their lines, 2 for bad input.
"""

import argparse
import concurrent.futures
import json
import os
import pathlib
import subprocess
import sys
import tempfile

SOURCE = pathlib.Path(__file__).resolve().parent.parent

# What reads files that others made, by module; paths in lib/camber (tools: in tools).
READERS = {
    "image": ["image_io.cpp", "raw_pixels.cpp", "video_frame_name.cpp", "video_reader.cpp"],
    "cloud": ["cloud_io.cpp", "colmap.cpp", "coordinate_system.cpp", "detail/pcd_header.cpp",
              "detail/ply_header.cpp", "detail/e57_pages.cpp", "detail/las_format.cpp",
              "detail/laz/*.cpp",
              "detail/text_columns.cpp", "e57.cpp", "e57_file.cpp", "file_reader.cpp",
              "kitti_bin.cpp", "las.cpp", "las_file.cpp", "lzf.cpp",
              "number_text.cpp", "pcd.cpp", "ply.cpp", "ptx.cpp", "text.cpp"],
    "detect": ["detail/npy_reader.cpp", "detail/onnx_weights.cpp", "keypoint_crops_folder.cpp",
               "network_description.cpp"],
    "vehicle": ["annotated_shapes.cpp", "shape_prior.cpp"],
    "scene": ["json_reader.cpp", "results.cpp", "scene.cpp"],
    "import": ["formats/*.cpp", "formats/detail/*.cpp", "import_kitti.cpp", "kitti_keypoints.cpp",
               "kitti_labels.cpp", "mcap_reader.cpp", "ros_cloud.cpp", "rosbag2.cpp",
               "text_rows.cpp"],
    "export": ["opencrg_reader.cpp", "opendrive_reader.cpp"],
    "tiles": ["tile_plan.cpp"],
    "pipeline": ["kitti_boxes.cpp", "network_file.cpp"],
    "tools": ["config_file.cpp", "plugins/bag_check.cpp", "plugins/bag_reader.cpp"],
}

# Which of them a fuzzer is for.
TARGETS = {
    "annotated_shapes": ["vehicle/annotated_shapes.cpp"],
    "colmap": ["cloud/colmap.cpp"],
    "config": ["tools/config_file.cpp"],
    "copc": ["cloud/detail/laz/copc.cpp"],
    "e57": ["cloud/e57.cpp", "cloud/e57_file.cpp", "cloud/detail/e57_pages.cpp"],
    "image": ["image/image_io.cpp"],
    "kitti_bin": ["cloud/kitti_bin.cpp"],
    "kitti_calibration": ["import/import_kitti.cpp"],
    "kitti_labels": ["import/kitti_labels.cpp", "import/kitti_keypoints.cpp"],
    "las": ["cloud/las.cpp", "cloud/las_file.cpp", "cloud/las_copy.cpp",
            "cloud/coordinate_system.cpp"],
    "laz": ["cloud/detail/laz/*_items.cpp", "cloud/detail/laz/adaptive_model.cpp",
            "cloud/detail/laz/chunk_codec.cpp", "cloud/detail/laz/laz_*.cpp"],
    "network_file": ["pipeline/network_file.cpp"],
    "npy": ["detect/detail/npy_reader.cpp"],
    "onnx_weights": ["detect/detail/onnx_weights.cpp"],
    "opencrg": ["export/opencrg_reader.cpp"],
    "landxml": ["import/formats/landxml.cpp"],
    "map_boxes": ["import/formats/map_boxes.cpp"],
    "opendrive": ["export/opendrive_reader.cpp"],
    "own_calibration": ["import/formats/calibration*.cpp"],
    "own_detections": ["import/formats/detections*.cpp"],
    "own_lists": ["import/formats/class_map.cpp", "import/formats/frame_files.cpp"],
    "own_trajectory": ["import/formats/poses.cpp", "import/formats/geo_log.cpp",
                       "import/formats/detail/subtitle_log.cpp"],
    "pcd": ["cloud/pcd.cpp", "cloud/detail/pcd_header.cpp", "cloud/lzf.cpp"],
    "ply": ["cloud/ply.cpp", "cloud/detail/ply_header.cpp"],
    "prior": ["vehicle/shape_prior.cpp"],
    "ros_messages": ["import/formats/ros_messages.cpp", "import/ros_cloud.cpp",
                     "image/raw_pixels.cpp"],
    "recording": ["import/mcap_reader.cpp", "import/rosbag2.cpp"],
    "rosbag": ["tools/plugins/bag_check.cpp", "tools/plugins/bag_reader.cpp"],
    "drive": ["scene/drive_document.cpp"],
    "run": ["scene/results.cpp"],
    "scene": ["scene/scene.cpp"],
    "surface": ["scene/results.cpp"],
    "tile_plan": ["tiles/tile_plan.cpp"],
    "telemetry": ["import/formats/mp4_film.cpp", "import/formats/gpmf.cpp"],
    "text_cloud": ["cloud/text.cpp", "cloud/detail/text_columns.cpp", "cloud/ptx.cpp"],
    "vehicles": ["scene/results.cpp"],
    "video": ["image/video_reader.cpp"],
}


class BadInput(Exception):
    pass


class Coverage:
    """Executions of lines, and of the branches of lines, by file."""

    def __init__(self):
        self.lines = {}  # file: {line: count}
        self.branches = {}  # file: {(line, place): count}

    def add(self, file, lines):
        own_lines = self.lines.setdefault(file, {})
        own_branches = self.branches.setdefault(file, {})
        for line in lines:
            number = line["line_number"]
            own_lines[number] = own_lines.get(number, 0) + line["count"]
            taken = [b for b in line["branches"] if not b["throw"]]
            for place, branch in enumerate(taken):
                key = (number, place)
                own_branches[key] = own_branches.get(key, 0) + branch["count"]

    def shares(self, files):
        """(lines reached, lines, branches taken, branches)."""
        lines = [n for f in files for n in self.lines.get(f, {}).values()]
        branches = [n for f in files for n in self.branches.get(f, {}).values()]
        return (sum(n > 0 for n in lines), len(lines), sum(n > 0 for n in branches), len(branches))


def gcov(data):
    """gcov's account of one data file."""
    run = subprocess.run(["gcov", "--json-format", "--stdout", "--branch-probabilities", data],
                         capture_output=True, text=True, check=False, cwd=data.parent)
    if run.returncode != 0:
        raise BadInput(f"gcov failed for {data}: {run.stderr.strip()}")
    return [json.loads(text) for text in run.stdout.splitlines() if text.strip()]


def read(folder):
    """The coverage of the project's own files by all data files under a folder."""
    out = Coverage()
    data = sorted(folder.rglob("*.gcda"))
    with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
        for documents in pool.map(gcov, data):
            for document in documents:
                base = pathlib.Path(document["current_working_directory"])
                for file in document["files"]:
                    path = pathlib.Path(os.path.normpath(base / file["file"]))
                    if path.is_relative_to(SOURCE):
                        out.add(str(path.relative_to(SOURCE)), file["lines"])
    return out


def files_of(module, patterns):
    """Paths from the project's root."""
    root = SOURCE / "tools" if module == "tools" else SOURCE / "lib/camber" / module
    out = []
    for pattern in patterns:
        found = sorted(root.glob(pattern))
        if not found:
            raise BadInput(f"{__file__}: no file {root / pattern}: the list of readers is old")
        out += [str(path.relative_to(SOURCE)) for path in found]
    return out


def modules(coverage):
    out = {}
    for file in coverage.lines:
        parts = pathlib.Path(file).parts
        if parts[:2] == ("lib", "camber"):
            out.setdefault(parts[2], []).append(file)
        elif parts[0] in ("tools", "viewers"):
            out.setdefault(parts[0], []).append(file)
    return out


def per_cent(part, whole):
    return 100.0 * part / whole if whole else 0.0


def row(name, shares):
    lines, all_lines, branches, all_branches = shares
    return [name, all_lines, per_cent(lines, all_lines), all_branches,
            per_cent(branches, all_branches)]


def show(title, first, rows):
    print(f"\n{title}\n{first:<20} {'lines':>7} {'reached':>8} {'branches':>9} {'taken':>7}")
    for name, lines, reached, branches, taken in rows:
        print(f"{name:<20} {lines:>7} {reached:>6.1f} % {branches:>9} {taken:>5.1f} %")


def replayed(program, build, inputs):
    """The coverage of one fuzzer's function over folders of inputs, as they are and mutated."""
    with tempfile.TemporaryDirectory() as name:
        run = subprocess.run([program, *map(str, inputs)], capture_output=True, text=True,
                             check=False, env={**os.environ, "GCOV_PREFIX": name})
        if run.returncode != 0:
            raise BadInput(f"{program} failed: {run.stdout[-2000:]}{run.stderr[-2000:]}")
        # gcov wants the notes of the compiler beside the data.
        for data in list(pathlib.Path(name).rglob("*.gcda")):
            notes = pathlib.Path("/") / data.relative_to(name).with_suffix(".gcno")
            data.with_suffix(".gcno").symlink_to(notes)
        return read(pathlib.Path(name))


def read_by(target):
    """The files that a fuzzer is for."""
    if target not in TARGETS:
        raise BadInput(f"{__file__}: fuzz_{target} is not in the list of fuzzers")
    files = []
    for path in TARGETS[target]:
        module, _, pattern = path.partition("/")
        files += files_of(module, [pattern])
    return files


def fuzzers(build, found):
    rows = []
    for program in sorted((build / "bin").glob("replay_*")):
        target = program.name.removeprefix("replay_")
        inputs = [SOURCE / "tests/fuzz/corpus" / target]
        if found and (found / f"fuzz_{target}/corpus").is_dir():
            inputs.append(found / f"fuzz_{target}/corpus")
        files = read_by(target)
        rows.append(row(target, replayed(program, build, inputs).shares(files)))
    return rows


def check_lists(names):
    """@raise BadInput: for a fuzzer that is not in the lists, and for files of theirs that are gone."""
    for name in names:
        read_by(name)
    for module, patterns in READERS.items():
        files_of(module, patterns)


def main():
    parser = argparse.ArgumentParser(description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("build", type=pathlib.Path, nargs="?")
    parser.add_argument("--check-fuzzers", nargs="+", metavar="NAME", help="the lists alone")
    parser.add_argument("--floor", type=float, default=90.0, help="per cent of a reader's lines")
    parser.add_argument("--json", type=pathlib.Path, help="write the tables there, too")
    parser.add_argument("--found", type=pathlib.Path, help="inputs that fuzzers found, a folder each")
    args = parser.parse_args()
    if args.check_fuzzers:
        check_lists(args.check_fuzzers)
        return 0
    if not args.build:
        parser.error("expected the folder of a build")
    coverage = read(args.build.resolve())
    if not coverage.lines:
        raise BadInput(f"{args.build}: no coverage data: build the preset coverage and run its tests")
    all_files = modules(coverage)
    module_rows = [row(m, coverage.shares(files)) for m, files in sorted(all_files.items())]
    module_rows.append(row("all", coverage.shares(sum(all_files.values(), []))))
    show("All that the tests reach", "module", module_rows)
    reader_rows, below = [], []
    for module, patterns in READERS.items():
        files = files_of(module, patterns)
        reader_rows.append(row(module, coverage.shares(files)))
        # A file without any data is in no program that ran.
        if reader_rows[-1][2] < args.floor or any(f not in coverage.lines for f in files):
            below.append((module, files))
    show("Readers of files", "module", reader_rows)
    target_rows = fuzzers(args.build.resolve(), args.found and args.found.resolve())
    show("What a fuzzer's inputs reach of its reader", "fuzzer", target_rows)
    if args.json:
        args.json.write_text(json.dumps({"modules": module_rows, "readers": reader_rows,
                                         "fuzzers": target_rows}, indent=1) + "\n")
    for module, files in below:
        print(f"\nreaders of {module}: below the floor of {args.floor:g} % of lines, or not run")
        for file in files:
            lines, total, _, _ = coverage.shares([file])
            missed = sorted(n for n, count in coverage.lines.get(file, {}).items() if count == 0)
            what = f"{per_cent(lines, total):.1f} %, lines {', '.join(map(str, missed))}"
            print(f"  {file}: {what if total else 'in no program that ran'}")
    return 1 if below else 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except BadInput as error:
        print(f"coverage.py: {error}", file=sys.stderr)
        sys.exit(2)
