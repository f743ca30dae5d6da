#!/usr/bin/env bash
# The figures of the paper, made from the embedded scene by the program's own commands.
set -euo pipefail

usage() {
  cat <<END
Usage: samples/figures.sh [--out DIR] [--series N] [--camber PROGRAM]

Draws the figures of the paper into DIR (default out/figures), by the default and, where that has
them, by --preset paper (NAME_paper.png) beside it: overlay with distances, wireframes with road
points and true boxes, one car by keypoints alone and with the road (what reprojection leaves free),
bird's-eye view, the road over its dense ground truth, one car as flat, coplanar and joint place it,
error histograms, depth over time, profile of the road.

  --series N       depth over time of a made drive of N frames (default 12; a minute or two),
                   of its first three by the paper;
                   0: of the three frames of the embedded scene
  --camber PROGRAM default: build/release/bin/camber, which samples/run.sh builds
END
}

out=out/figures
series=12
camber=build/release/bin/camber
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
start=$PWD
while [ $# -gt 0 ]; do
  case "$1" in
    --out | --series | --camber)
      if [ $# -lt 2 ]; then printf 'figures.sh: %s needs a value\n' "$1" >&2; exit 2; fi
      case "$1" in
        --out) out=$2; [[ $out = /* ]] || out=$start/$out ;;
        --series) series=$2 ;;
        --camber) camber=$2; [[ $camber = /* ]] || camber=$start/$camber ;;
      esac
      shift 2 ;;
    -h | --help) usage; exit 0 ;;
    *) printf 'figures.sh: unknown option %s\n' "$1" >&2; usage >&2; exit 2 ;;
  esac
done
if ! [[ $series =~ ^[0-9]+$ ]] || [ "$series" -eq 1 ]; then
  printf "figures.sh: --series: found '%s', expected 0 or a number of frames from 2 on\n" \
    "$series" >&2
  exit 2
fi

cd "$here"
if ! [ -x "$camber" ]; then
  printf 'figures.sh: there is no program %s: run samples/run.sh first, or name it by --camber\n' \
    "$camber" >&2
  exit 2
fi
scene=samples/steep_hill
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$out"

for method in joint coplanar flat reprojection; do
  "$camber" reconstruct "$scene" --method "$method" --no-pictures --quiet --out "$work/$method"
done
for method in joint coplanar flat; do
  "$camber" reconstruct "$scene" --preset paper --method "$method" --no-pictures --quiet \
    --out "$work/paper_$method"
done
render() { "$camber" render "$work/joint" --scene "$scene" "$@"; }
paper() { "$camber" render "$work/paper_joint" --scene "$scene" "$@"; }
# Frame 0 sees all five cars.
render --view overlay --frame 0 --out "$out/1_overlay.png"
paper --view overlay --frame 0 --out "$out/1_overlay_paper.png"
render --view overlay --frame 0 --show grade,ellipses --hide planes --upscale 1.5 \
  --out "$out/1_overlay_road.png"
render --view overlay --frames all --sheet --out "$out/1_overlays.png"
render --view oblique --frame 0 --out "$out/2_wireframes.png"
paper --view oblique --frame 0 --out "$out/2_wireframes_paper.png"
render --beside "$work/reprojection" --frame 1 --vehicle 2 --out "$out/3_reprojection_alone.png"
paper --beside "$work/reprojection" --frame 1 --vehicle 2 --out "$out/3_reprojection_alone_paper.png"
render --view bev --frame 0 --out "$out/3_birds_eye.png"
render --view both --frame 0 --truth scene --hide patches --out "$out/4_dense_truth.png"
render --view oblique --frame 0 --truth scene --color error --hide patches,truth-cloud \
  --out "$out/4_height_error.png"
render --beside "$work/coplanar" "$work/flat" --frame 1 --vehicle 2 --out "$out/5_methods.png"
paper --beside "$work/paper_coplanar" "$work/paper_flat" "$work/joint" --frame 1 --vehicle 2 \
  --out "$out/5_methods_paper.png"
"$camber" profile "$work/joint" --quiet --plot "$out/8_profile.png"
printf '%s\n' "$out/8_profile.png"

"$camber" evaluate --truth "$scene" --estimate "$work/joint" "$work/coplanar" "$work/flat" \
  "$work/paper_joint" "$work/paper_coplanar" "$work/paper_flat" --out "$work/tables" >/dev/null
depth=$work/tables/depth_over_time.png
if [ "$series" -gt 0 ]; then
  echo "Making a drive of $series frames ..."
  "$camber" synth --profile steep_hill --frames "$series" --seed 3 --supersampling 2 --quiet \
    --name "steep hill, $series frames" --out "$work/drive"
  "$camber" reconstruct "$work/drive" --frames all --no-pictures --quiet --out "$work/drive_joint"
  "$camber" reconstruct "$work/drive" --preset paper --frames 0:2 --no-pictures --quiet \
    --out "$work/drive_paper"
  "$camber" evaluate --truth "$work/drive" --estimate "$work/drive_joint" "$work/drive_paper" \
    --out "$work/drive_tables" >/dev/null
  depth=$work/drive_tables/depth_over_time.png
fi
copy() { cp "$1" "$2" && printf '%s\n' "$2"; }
copy "$work/tables/error_histogram.png" "$out/6_error_histogram.png"
copy "$work/tables/height_histogram.png" "$out/6_height_histogram.png"
copy "$depth" "$out/7_depth_over_time.png"
