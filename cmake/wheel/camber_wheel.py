"""The build backend of pyproject.toml (PEP 517): a wheel of the Python module, built by CMake for
the interpreter that runs this and for the shared libraries of the machine (it is no manylinux
wheel).

  pip install --no-build-isolation --no-index .
  pip install --no-build-isolation --no-index --config-settings=build-dir=build/release .

The second goes on with a build that is there. CMAKE_ARGS of the environment are options of CMake.
"""

import base64
import hashlib
import os
import pathlib
import re
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tempfile
import zipfile

SOURCE = pathlib.Path(__file__).resolve().parents[2]
# What the module is made of; the rest is left out.
OFF = ("TOOLS", "VIEWERS", "TESTS", "SAMPLES", "BENCHMARKS")


def version():
    text = (SOURCE / "CMakeLists.txt").read_text(encoding="utf-8")
    return re.search(r"project\(camber VERSION ([0-9.]+)", text).group(1)


def metadata():
    readme = (SOURCE / "README.md").read_text(encoding="utf-8")
    return ("Metadata-Version: 2.1\nName: camber\n"
            f"Version: {version()}\n"
            "Summary: Metric road surfaces and vehicles from one moving camera\n"
            "Requires-Python: >=3.9\nRequires-Dist: numpy\n"
            "Description-Content-Type: text/markdown\n\n" + readme)


def tag():
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{sysconfig.get_platform().replace('-', '_').replace('.', '_')}"


def run(*command):
    done = subprocess.run([str(part) for part in command], check=False)
    if done.returncode != 0:
        raise SystemExit(f"camber: {command[0]} ended with {done.returncode}: the output is above")


def build_module(folder):
    """Configures and builds the module. @return its package's folder."""
    if shutil.which("cmake") is None:
        raise SystemExit("camber: found no cmake; samples/install_packages.sh installs what is "
                         "needed")
    if not (folder / "CMakeCache.txt").exists():
        generator = ["-G", "Ninja"] if shutil.which("ninja") else []
        run("cmake", "-S", SOURCE, "-B", folder, *generator, "-DCMAKE_BUILD_TYPE=Release",
            f"-DPython3_EXECUTABLE={sys.executable}",
            *(f"-DCAMBER_BUILD_{part}=OFF" for part in OFF),
            *shlex.split(os.environ.get("CMAKE_ARGS", "")))
    run("cmake", "--build", folder, "--target", "camber_python", "--parallel",
        str(os.cpu_count() or 1))
    package = folder / "python" / "camber"
    module = package / ("_core" + sysconfig.get_config_var("EXT_SUFFIX"))
    if not module.exists():
        raise SystemExit(f"camber: the build made no {module}: it is of another interpreter, or "
                         "python3-dev, python3-numpy or pybind11-dev is missing")
    return package, module


def record_line(name, data):
    digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
    return f"{name},sha256={digest},{len(data)}\n"


def stripped(module, folder):
    """The module without what only debuggers read."""
    out = pathlib.Path(folder) / module.name
    shutil.copy2(module, out)
    if shutil.which("strip"):
        subprocess.run(["strip", "--strip-unneeded", str(out)], check=False)
    return out.read_bytes()


def write_wheel(target, package, module):
    files = {}
    for path in sorted(package.iterdir()):
        if path.suffix in (".py", ".pyi", ".typed") or path.name == "py.typed":
            files[f"camber/{path.name}"] = path.read_bytes()
    with tempfile.TemporaryDirectory() as folder:
        # What needs GDAL is a module of its own, where GDAL is.
        for part in (module, package / module.name.replace("_core", "_gdal")):
            if part.exists():
                files[f"camber/{part.name}"] = stripped(part, folder)
    info = f"camber-{version()}.dist-info"
    files[f"{info}/METADATA"] = metadata().encode()
    files[f"{info}/WHEEL"] = ("Wheel-Version: 1.0\nGenerator: camber_wheel\n"
                              f"Root-Is-Purelib: false\nTag: {tag()}\n").encode()
    files[f"{info}/LICENSE"] = (SOURCE / "LICENSE").read_bytes()
    record = "".join(record_line(name, data) for name, data in files.items())
    files[f"{info}/RECORD"] = (record + f"{info}/RECORD,,\n").encode()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as wheel:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = (0o755 if name.endswith(".so") else 0o644) << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            wheel.writestr(entry, data)


def get_requires_for_build_wheel(config_settings=None):
    return []


def build_wheel(wheel_directory, config_settings=None, metadata_directory=None):
    given = (config_settings or {}).get("build-dir")
    name = f"camber-{version()}-{tag()}.whl"
    target = pathlib.Path(wheel_directory) / name
    if given:
        write_wheel(target, *build_module(pathlib.Path(given).resolve()))
        return name
    with tempfile.TemporaryDirectory(prefix="camber-wheel-") as folder:
        write_wheel(target, *build_module(pathlib.Path(folder)))
    return name


def get_requires_for_build_sdist(config_settings=None):
    return []


def build_sdist(sdist_directory, config_settings=None):
    """What git has, without what it ignores."""
    name = f"camber-{version()}"
    listed = subprocess.run(["git", "-C", str(SOURCE), "ls-files", "-z"], check=True,
                            capture_output=True).stdout.decode().split("\0")
    target = pathlib.Path(sdist_directory) / f"{name}.tar.gz"
    with tempfile.TemporaryDirectory() as folder, tarfile.open(target, "w:gz") as archive:
        info = pathlib.Path(folder) / "PKG-INFO"
        info.write_text(metadata(), encoding="utf-8")
        archive.add(info, f"{name}/PKG-INFO")
        for path in filter(None, listed):
            archive.add(SOURCE / path, f"{name}/{path}", recursive=False)
    return target.name
