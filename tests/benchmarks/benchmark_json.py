"""The JSON that the benchmark programs write (report.h), read and checked."""

import json
import pathlib


class BadInput(Exception):
    """What is wrong with an input, in one sentence."""


class Run:
    """One program's run with one seed."""

    def __init__(self, path):
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
    def program(self):
        return self.data["program"]

    @property
    def seed(self):
        return self.data["seed"]

    @property
    def revision(self):
        return self.data["revision"]

    def tables(self):
        """Tables by key."""
        return {table["key"]: table for table in self.data["tables"]}

    def measuring_options(self):
        """The options that change what a figure means."""
        return {k: v for k, v in self.data["options"].items()
                if k not in ("sections", "accuracy_only")}


def read_runs(paths):
    """Runs of all files, and of the .json files of all folders, in order of program and seed."""
    files = []
    for path in map(pathlib.Path, paths):
        files += sorted(path.glob("*.json")) if path.is_dir() else [path]
    if not files:
        raise BadInput(f"{' '.join(map(str, paths))}: no .json files")
    return sorted((Run(file) for file in files), key=lambda run: (run.program, run.seed, run.path))


def labels_of(table, row):
    """What a row is called: its labels, joined."""
    return " | ".join(
        cell for column, cell in zip(table["columns"], row) if column.get("label"))
