#!/usr/bin/env bash
# wheel.sh BUILD SOURCE WORK PYTHON: pip installs the Python module from the source, without the
# network, into an environment of its own, where it is imported and runs the main job.
# Minutes long where the build has no module yet: only with CAMBER_LONG_TESTS=1 (tests/run.sh --long).
set -euo pipefail
build=$1 source=$2 work=$3 python=$4

skip() { echo "skipped: $*"; exit 0; }
fail() { echo "wheel: $*" >&2; exit 1; }
[ "${CAMBER_LONG_TESTS:-0}" = 1 ] || skip "long, for tests/run.sh --long"
"$python" -c "import venv, ensurepip" 2>/dev/null || skip "python3-venv is not installed"

rm -rf "$work"
mkdir -p "$work"
"$python" -m venv --system-site-packages "$work/venv"
cd "$work"
"$work/venv/bin/python" -m pip install --quiet --no-build-isolation --no-index --no-deps \
  --config-settings=build-dir="$build" "$source"
"$work/venv/bin/python" - "$source" <<'END'
import pathlib
import sys
import camber
assert "venv" in camber.__file__, camber.__file__
scene = camber.read_scene(pathlib.Path(sys.argv[1]) / "samples/steep_hill")
result = camber.reconstruct(scene)
assert len(result.cloud) > 1000, result
print(camber.__version__, result)
END
"$work/venv/bin/python" -m pip uninstall --quiet --yes camber
[ ! -e "$work"/venv/lib/python3*/site-packages/camber ] || fail "files of the module are left behind"
echo "wheel: installed, imported, run and removed"
