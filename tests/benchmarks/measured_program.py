"""Runs of a program with what they take of the machine."""

import os
import pathlib
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any, Callable, Iterable, NamedTuple

from benchmark_json import ROOT, write_document


class Failed(Exception):
    """A run of a program that did not end with 0."""


class Run(NamedTuple):
    cpu: float  # s, of all threads
    wall: float  # s
    memory: float  # MB, the largest that was resident
    read: float  # MB, by system calls
    written: float  # the same
    text: str  # what it printed


def measured(words: Iterable[Any]) -> Run:
    """What a child is charged for starts with this process's memory: keep that small."""
    words = [str(word) for word in words]
    begin = time.monotonic()
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        process = subprocess.Popen(words, stdout=out, stderr=errors)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        wall = time.monotonic() - begin
        io = dict(line.split(": ") for line in
                  pathlib.Path(f"/proc/{process.pid}/io").read_text(encoding="ascii").splitlines())
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        for file in (out, errors):
            file.seek(0)
        if process.returncode != 0:
            raise Failed(f"{' '.join(words)}: exit code {process.returncode}: "
                         f"{errors.read().decode(errors='replace').strip()[-500:]}")
        return Run(usage.ru_utime + usage.ru_stime, wall, usage.ru_maxrss / 1024.0,
                   int(io["rchar"]) / 1e6, int(io["wchar"]) / 1e6, out.read().decode())


def cpu_of_children() -> float:
    """Seconds of all threads of the children that have ended."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def add_program_arguments(parser) -> None:
    """--camber, --folder and --json of a benchmark that run_measured() runs."""
    parser.add_argument("--camber", type=pathlib.Path, default=ROOT / "build/release/bin/camber")
    parser.add_argument("--folder", type=pathlib.Path, help="for files; default: a temporary one")
    parser.add_argument("--json", type=pathlib.Path)


def run_measured(parser, args, run: Callable[[pathlib.Path], Any],
                 report: Callable[[Any, float], dict]) -> int:
    """Calls `run` with a folder of its own, then writes what `report` makes of its result and of the
    machine's load before. The exit code: 1 where a run of the program failed."""
    args.camber = args.camber.resolve()
    if not args.camber.exists():
        parser.error(f"--camber {args.camber}: no such program")
    before = os.getloadavg()[0]
    script = pathlib.Path(sys.argv[0])
    with tempfile.TemporaryDirectory(dir=args.folder, prefix=script.stem + ".") as name:
        try:
            result = run(pathlib.Path(name))
        except Failed as error:
            print(f"{script.name}: {error}", file=sys.stderr)
            return 1
    if args.json:
        write_document(args.json, report(result, before))
    return 0
