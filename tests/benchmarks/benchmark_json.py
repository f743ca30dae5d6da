"""The JSON that the benchmark programs write (report.h): read and checked, and made by those in
Python."""

import datetime
import json
import os
import pathlib
import subprocess
from typing import Any, Dict, Iterable, List, Optional, Union

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent


class BadInput(Exception):
    """What is wrong with an input, in one sentence."""


class Run:
    """One program's run with one seed."""

    def __init__(self, path: Union[str, pathlib.Path]) -> None:
        self.path = str(path)
        try:
            with open(path, encoding="utf-8") as file:
                self.data = json.load(file)
        except (OSError, ValueError) as error:
            raise BadInput(f"{path}: {error}") from error
        if not isinstance(self.data, dict) or self.data.get("format") != "camber-benchmark":
            raise BadInput(f"{path}: not the JSON of a benchmark program")
        if self.data.get("version") != 1:
            raise BadInput(f"{path}: version {self.data.get('version')}, expected 1")
        for key, kind in (
            ("program", str), ("seed", int), ("revision", str), ("tables", list), ("items", dict),
            ("options", dict), ("machine", dict), ("date", str),
        ):
            if not isinstance(self.data.get(key), kind):
                raise BadInput(f"{path}: no '{key}'")

    @property
    def program(self) -> Any:
        return self.data["program"]

    @property
    def seed(self) -> Any:
        return self.data["seed"]

    @property
    def revision(self) -> Any:
        return self.data["revision"]

    def tables(self) -> Dict[str, Any]:
        """Tables by key."""
        return {table["key"]: table for table in self.data["tables"]}

    def measuring_options(self) -> Dict[str, Any]:
        """The options that change what a figure means."""
        return {k: v for k, v in self.data["options"].items()
                if k not in ("sections", "accuracy_only")}


def read_runs(paths: Iterable[Union[str, pathlib.Path]]) -> List[Run]:
    """Runs of all files, and of the .json files of all folders, in order of program and seed."""
    files: List[pathlib.Path] = []
    for path in map(pathlib.Path, paths):
        files += sorted(path.glob("*.json")) if path.is_dir() else [path]
    if not files:
        raise BadInput(f"{' '.join(map(str, paths))}: no .json files")
    return sorted((Run(file) for file in files), key=lambda run: (run.program, run.seed, run.path))


def labels_of(table: Dict[str, Any], row: List[Any]) -> str:
    """What a row is called: its labels, joined."""
    return " | ".join(
        cell for column, cell in zip(table["columns"], row) if column.get("label"))


def git(*words: str) -> str:
    run = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True,
                         check=False)
    return run.stdout.strip() if run.returncode == 0 else "unknown"


def machine(load_before: float) -> Dict[str, Any]:
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        cpu = next((line.split(":", 1)[1].strip() for line in file
                    if line.startswith("model name")), "unknown")
    return {"cores": os.cpu_count(), "cpu": cpu,
            "load_average": {"before": [load_before], "after": [os.getloadavg()[0]]}}


def column(name: str, unit: str = "", **more: Any) -> Dict[str, Any]:
    """more: label=True, timing=True, better="lower" or "higher"."""
    return {"name": name, **({"unit": unit} if unit else {}), **more}


def document(program: str, load_before: float, tables: List[Dict[str, Any]], seed: int = 0,
             items: Optional[Dict[str, Any]] = None,
             options: Optional[Dict[str, Any]] = None) -> Dict[str, Any]:
    """What a program writes; options: those that change what a figure means."""
    return {
        "format": "camber-benchmark", "version": 1, "program": program, "seed": seed,
        "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"),
        "revision": git("describe", "--always", "--dirty", "--abbrev=7"),
        "library_tree": git("rev-parse", "--short=12", "HEAD:lib"), "machine": machine(load_before),
        "options": {"sections": [], "accuracy_only": False, **(options or {})},
        "items": items or {}, "tables": tables}


def write_document(path: pathlib.Path, data: Dict[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
