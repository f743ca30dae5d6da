#!/usr/bin/env bash
# From a bare Debian 12 machine to a reconstructed road: installs what is missing, builds the
# program, runs the main job on the embedded scene and says where to look.
set -euo pipefail

usage() {
  cat <<END
Usage: samples/run.sh [--no-install] [--no-pictures]

Installs missing packages (needs root or sudo, once), builds the program camber into build/release,
telling how far it is, and reconstructs samples/steep_hill into out/steep_hill. A second run installs
and builds nothing.

  --no-install   take the packages as they are
  --no-pictures  leave the pictures out
END
}

install=true
options=()
for argument in "$@"; do
  case "$argument" in
    --no-install) install=false ;;
    --no-pictures) options+=(--no-pictures) ;;
    -h | --help) usage; exit 0 ;;
    *) printf 'run.sh: unknown option %s\n' "$argument" >&2; usage >&2; exit 2 ;;
  esac
done

cd "$(dirname "${BASH_SOURCE[0]}")/.."
if $install; then samples/install_packages.sh; fi

log=$(mktemp)
trap 'rm -f "$log"' EXIT
# Runs a step and shows its output only if it fails.
quietly() {
  local what=$1
  shift
  if ! "$@" >"$log" 2>&1; then
    cat "$log" >&2
    printf 'run.sh: %s failed: the output is above\n' "$what" >&2
    exit 1
  fi
}

# Of the builder's lines "[n/N] ..." keeps one on a terminal, rewritten; elsewhere one each quarter.
show_progress() {
  local line n total quarters=0
  while IFS= read -r line; do
    [[ $line =~ ^\[([0-9]+)/([0-9]+)\] ]] || continue
    n=${BASH_REMATCH[1]} total=${BASH_REMATCH[2]}
    if [ -t 1 ]; then
      printf '\r[%d/%d]' "$n" "$total"
    elif [ $((4 * n / total)) -gt "$quarters" ]; then
      quarters=$((4 * n / total))
      printf '[%d/%d]\n' "$n" "$total"
    fi
  done
  if [ -t 1 ] && [ "${total-0}" -gt 0 ]; then printf '\r\033[K'; fi
}

if [ ! -f build/release/build.ninja ]; then
  echo "Building camber (once; some 12 minutes on two cores) ..."
  quietly "configuring" cmake --preset release -DCAMBER_BUILD_TESTS=OFF \
    -DCAMBER_BUILD_BENCHMARKS=OFF -DCAMBER_BUILD_SAMPLES=OFF
fi
if ! cmake --build --preset release --target camber --parallel "$(nproc)" 2>&1 |
  tee "$log" | show_progress; then
  cat "$log" >&2
  echo 'run.sh: the build failed: the output is above' >&2
  exit 1
fi

build/release/bin/camber reconstruct samples/steep_hill --out out/steep_hill "${options[@]}"

echo
echo "Look at:"
for file in out/steep_hill/*; do
  case "$file" in
    */report.html) what="all of it on one page: open it in a browser" ;;
    */scene.glb) what="the scene for any glTF viewer" ;;
    */scene.png) what="the road and the cars in 3D; truth boxes in red" ;;
    */overlay_*.png) what="a frame with wireframes and distances" ;;
    */bev.png) what="bird's-eye view" ;;
    */road.ply) what="the road cloud" ;;
    */surface.json) what="the road's planar patches" ;;
    */vehicles.json) what="the vehicles" ;;
    */vehicles.csv) what="the vehicles as a table" ;;
    */metrics.json) what="errors against the truth" ;;
    */run.json) what="options, cameras, scale and timings" ;;
    *) what="" ;;
  esac
  printf '  %-40s %s\n' "$file" "$what"
done
