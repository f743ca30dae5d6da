#!/usr/bin/env bash
# Installs the Debian 12 packages that Camber needs and that are not there yet. The lists below are
# the only ones in the project.
set -euo pipefail

# To build and to run the program. Mesa's EGL and its software driver draw without a display. The
# interactive viewer's packages, qtbase5-dev and libvtk9-qt-dev, are among those that libpcl-dev needs.
program_packages=(
  cmake g++ ninja-build
  libavcodec-dev libavformat-dev libavutil-dev libceres-dev libcli11-dev libeigen3-dev libembree-dev libfmt-dev libgdal-dev libjpeg-dev liblzf-dev
  libopencv-dev libopenmpi-dev libpcl-dev libpng-dev libproj-dev libpugixml-dev liblz4-dev librosbag-storage-dev libsqlite3-dev libswscale-dev libtbb-dev libtomlplusplus-dev libvtk9-dev libxxhash-dev libyaml-cpp-dev libzstd-dev zlib1g-dev
  nlohmann-json3-dev pybind11-dev python3-dev python3-numpy
  libegl-dev libgl-dev libegl1 libegl-mesa0 libgl1-mesa-dri
)
# Besides, to build and to run the tests and the benchmarks; Chromium opens the report, the viewer
# opens on a display in memory, Python compares benchmarks and runs the samples, whose types mypy checks.
test_packages=(
  chromium doxygen dpkg-dev gdal-bin libbenchmark-dev libflann-dev libgmock-dev libgtest-dev mypy python3 python3-matplotlib python3-pip python3-venv xdotool xvfb
)
# Besides, for the fuzzers and to check the format and the code: tests/run.sh --fuzz, the targets
# format, format_check and tidy.
clang_packages=(clang clang-format clang-tidy libclang-rt-dev)
# Besides, to train the keypoint network (lib/camber/detect/training).
training_packages=(python3-matplotlib python3-numpy python3-onnx python3-opencv python3-torch)

usage() {
  cat <<END
Usage: samples/install_packages.sh [--tests] [--clang] [--training] [--list]

Installs what is missing of the packages that build and run Camber on Debian 12.

  --tests     also those of the tests and benchmarks
  --clang     also those of the fuzzers, the format check and clang-tidy
  --training  also those that train the keypoint network
  --list      print the names, one a line, and install nothing
END
}

say() { printf '%s\n' "install_packages: $*" >&2; }

wanted=("${program_packages[@]}")
list=false
for argument in "$@"; do
  case "$argument" in
    --tests) wanted+=("${test_packages[@]}") ;;
    --clang) wanted+=("${clang_packages[@]}") ;;
    --training) wanted+=("${training_packages[@]}") ;;
    --list) list=true ;;
    -h | --help) usage; exit 0 ;;
    *) say "unknown option $argument"; usage >&2; exit 2 ;;
  esac
done

if $list; then
  printf '%s\n' "${wanted[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  say "this system has no dpkg and apt; install the like of these, then use --no-install:" \
    "${wanted[*]}"
  exit 1
fi

# dpkg-query fails for a name that it has never heard of and still prints the others.
installed=$(dpkg-query -W -f '${db:Status-Abbrev} ${Package}\n' "${wanted[@]}" 2>/dev/null |
  awk '$1 ~ /^.i$/ { print $2 }' || true)
missing=()
for package in "${wanted[@]}"; do
  grep -qxF -- "$package" <<<"$installed" || missing+=("$package")
done
[ ${#missing[@]} -gt 0 ] || exit 0

as_root=()
if [ "$(id -u)" -ne 0 ]; then
  if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
    as_root=(sudo)
  else
    say "packages are missing and only root may install them; as root, run:" \
      "apt-get install --no-install-recommends ${missing[*]}"
    exit 1
  fi
fi

log=$(mktemp)
trap 'rm -f "$log"' EXIT
apt() {
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o DPkg::Lock::Timeout=300 "$@" \
    </dev/null >>"$log" 2>&1
}
install() { apt install --no-install-recommends "${missing[@]}"; }

say "installing ${#missing[@]} missing packages and what they need (no output until it is done)"
# Package lists that are absent or older than the mirror's content make the first try fail.
if ! { apt-cache show "${missing[@]}" >/dev/null 2>&1 && install; }; then
  if ! { apt update && install; }; then
    tail -n 40 "$log" >&2
    say "apt-get could not install ${missing[*]}: the reason is above"
    exit 1
  fi
fi
