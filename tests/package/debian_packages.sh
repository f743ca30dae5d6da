#!/usr/bin/env bash
# Makes the Debian packages twice, looks into them, and, where this machine can, installs them into
# a fresh system without a compiler and runs the main job there.
#   debian_packages.sh BUILD_FOLDER SOURCE_FOLDER WORK_FOLDER
# Minutes long: only with CAMBER_LONG_TESTS=1 (tests/run.sh --long).
set -euo pipefail
build=$1 source=$2 work=$3

skip() { printf 'skipped: %s\n' "$1"; exit 0; }
fail() { printf 'debian_packages.sh: %s\n' "$*" >&2; exit 1; }

[ "${CAMBER_LONG_TESTS:-0}" = 1 ] || skip "long, for tests/run.sh --long"
command -v dpkg-shlibdeps >/dev/null || skip "dpkg-dev is not installed"
rm -rf "$work"
mkdir -p "$work"
trap 'rm -rf "$work"' EXIT

export DEBFULLNAME="Camber tests" DEBEMAIL=packager@debian.org
pack() { # FOLDER
  (cd "$build" && cpack --config CPackConfig.cmake -B "$1") >"$work/log" 2>&1 ||
    { cat "$work/log" >&2; fail "cpack failed"; }
}
pack "$work/first"
packages=("$work"/first/*.deb)
[ ${#packages[@]} -ge 2 ] || fail "found the packages ${packages[*]}"

# A build again gives equal files.
pack "$work/second"
for package in "${packages[@]}"; do
  cmp "$package" "$work/second/${package##*/}" || fail "$package differs from build to build"
done
rm -rf "$work/second"

# The program's: a man page for each verb, completions, copyright, right dependencies.
program=$(ls "$work"/first/camber_*.deb)
dpkg-deb --contents "$program" | awk '{ print $6 }' >"$work/files"
has() { grep -qx "./usr/$1" "$work/files" || fail "camber does not hold /usr/$1"; }
verbs=$("$build/bin/camber" --help | awk '/^Subcommands:/ { on = 1; next } /^$/ { on = 0 } on { print $1 }')
[ -n "$verbs" ] || fail "camber --help names no command"
for verb in $verbs; do has "share/man/man1/camber-$verb.1.gz"; done
for file in bin/camber share/man/man1/camber.1.gz share/doc/camber/copyright \
  share/doc/camber/changelog.gz share/bash-completion/completions/camber \
  share/zsh/vendor-completions/_camber share/fish/vendor_completions.d/camber.fish; do
  has "$file"
done
depends=$(dpkg-deb --field "$program" Depends)
for library in libc6 libopencv-core libvtk9 libpcl-common libegl-mesa0; do
  [[ $depends == *$library* ]] || fail "camber does not depend on $library: $depends"
done
[[ $depends != *-dev* ]] || fail "camber depends on development packages: $depends"

if command -v lintian >/dev/null; then
  lintian --fail-on error "${packages[@]}" >"$work/lintian" 2>&1 ||
    { cat "$work/lintian" >&2; fail "lintian found errors"; }
else
  echo "no lintian here"
fi

# A fresh system.
done_without() { printf 'packages are right; not installed: %s\n' "$1"; exit 0; }
[ "$(id -u)" -eq 0 ] || done_without "only root can make a system"
command -v mmdebstrap >/dev/null || done_without "no mmdebstrap"
mirror=${CAMBER_DEBIAN_MIRROR:-http://deb.debian.org/debian}
suite=$(. /etc/os-release && echo "${VERSION_CODENAME:-bookworm}")
root=$work/root
if ! mmdebstrap --variant=minbase --mode=root "$suite" "$root" "$mirror" >"$work/log" 2>&1; then
  tail -n 5 "$work/log"
  done_without "no system from $mirror"
fi
unmount() { umount "$root/proc" 2>/dev/null || true; }
trap 'unmount; rm -rf "$work"' EXIT
mount -t proc proc "$root/proc" || done_without "no /proc can be mounted"
[ ! -e /etc/resolv.conf ] || cp /etc/resolv.conf "$root/etc/resolv.conf"
mkdir "$root/packages"
cp "$program" "$work"/first/python3-camber_*.deb "$root/packages"
cp -r "$source/samples/steep_hill" "$root/scene"
inside() { chroot "$root" env DEBIAN_FRONTEND=noninteractive LANG=C "$@"; }
inside sh -c 'apt-get -qq update && apt-get -qq -y --no-install-recommends install /packages/camber_*.deb' \
  >"$work/log" 2>&1 || { tail -n 20 "$work/log" >&2; fail "camber cannot be installed"; }
! inside sh -c 'command -v cc || command -v c++' || fail "the system has a compiler"
started=$(date +%s)
inside camber reconstruct /scene --out /result --quiet >/dev/null || fail "the main job failed"
echo "main job with pictures: $(($(date +%s) - started)) s"
for file in road.ply surface.json scene.png bev.png report.html; do
  [ -s "$root/result/$file" ] || fail "the main job wrote no $file"
done
# The numbers are those of the build.
"$build/bin/camber" reconstruct "$source/samples/steep_hill" --out "$work/result" --no-pictures --quiet
for file in road.ply surface.json vehicles.json; do
  cmp "$root/result/$file" "$work/result/$file" || fail "$file is not as here"
done
inside sh -c 'apt-get -qq -y --no-install-recommends install /packages/python3-camber_*.deb' \
  >"$work/log" 2>&1 || { tail -n 20 "$work/log" >&2; fail "python3-camber cannot be installed"; }
inside python3 -c 'import camber
print(camber.reconstruct(camber.read_scene("/scene"), [0, 1, 2]))' || fail "the Python module failed"
echo "packages are right, installed and run"
