#!/usr/bin/env python3
"""Makes the type stubs of the Python module, camber/_core.pyi, from the signatures that
pybind11 writes into the docstring of each function of the built module.

  PYTHONPATH=build/release/python generate/make_stubs.py --out lib/python/camber/_core.pyi
  PYTHONPATH=build/release/python generate/make_stubs.py --check lib/python/camber/_core.pyi

(mypy's stubgen takes the first words of an attribute's description for its type.)
"""

import argparse
import ast
import difflib
import inspect
import re
import sys

import camber
from camber import _core

HEADER = '''# Made by lib/python/generate/make_stubs.py.
import os
import pathlib
from typing import Any, Callable, Dict, List, Optional, Tuple, Union

import numpy
from numpy.typing import ArrayLike, NDArray

CloudLike = Union["RoadCloud", ArrayLike]
PathLike = Union[str, "os.PathLike[str]"]
Progress = Callable[[str, float], Any]

__version__: str
'''
# What pybind11 knows of a parameter by its name alone.
PARAMETERS = {"cloud": "CloudLike", "estimate": "CloudLike", "truth": "CloudLike",
              "progress": "Optional[Progress]", "points": "ArrayLike", "result": "Any",
              "source": "Any", "along": "Optional[Union[ArrayLike, PathLike]]",
              "truth_cloud": "Optional[Union[CloudLike, PathLike]]"}
# ... and of what a function returns.
RETURNS = {"to_dict": "Dict[str, Any]", "road_mask": "Optional[NDArray[numpy.uint8]]",
           "images": "List[NDArray[numpy.uint8]]", "labels": "Dict[str, NDArray[numpy.int32]]",
           "scalars": "Dict[str, NDArray[numpy.float32]]", "timings": "Dict[str, float]",
           "export": "Dict[str, Any]", "calibrate": "Dict[str, Any]", "drive": "Dict[str, Any]",
           "plan_tiles": "Dict[str, Any]", "run_tiles": "Dict[str, Any]",
           "join_tiles": "Dict[str, Any]",
           "offsets": "NDArray[numpy.float64]", "heights": "NDArray[numpy.float64]"}


def split(text):
    """Parts between commas that stand in no bracket."""
    parts, depth, part = [], 0, ""
    for sign in text:
        depth += (sign in "([{") - (sign in ")]}")
        if sign == "," and depth == 0:
            parts.append(part.strip())
            part = ""
        else:
            part += sign
    return parts + [part.strip()] if part.strip() else parts


def typed(text, argument):
    """A type of a docstring as the stubs have it."""
    array = "ArrayLike" if argument else r"NDArray[numpy.\1]"
    text = re.sub(r"numpy\.ndarray\[numpy\.(\w+)(\[[^\]]*\])?\]", array, text)
    text = re.sub(r"\bnumpy\.ndarray\b(?!\[)", "ArrayLike" if argument else "NDArray[Any]", text)
    text = text.replace("os.PathLike", "PathLike" if argument else "pathlib.Path")
    text = re.sub(r"\bdict\b", "Dict[Any, Any]", text)
    text = re.sub(r"\blist\b", "List[Any]", text)
    return text.replace("camber.", "")


def parameter(text, owner):
    name, _, rest = text.partition(":")
    if not rest or name == "self":
        return name
    kind, equals, default = rest.partition(" = ")
    kind = typed(kind.strip(), True)
    if kind in ("object", "Dict[Any, Any]") or name in ("progress", "points"):
        kind = PARAMETERS.get(name, kind)
    if owner and name == "cloud" and kind == "object":
        kind = "RoadCloud"
    if not equals:
        return f"{name}: {kind}"
    try:
        value = ast.literal_eval(default)
        default = repr(value) if not isinstance(value, (dict, list, tuple)) else "..."
    except (ValueError, SyntaxError):
        default = "..."
    return f"{name}: {kind} = {default}"


def signature(name, function, owner=None):
    """"def name(...) -> ...: ..." of a function of pybind11."""
    text = function.__doc__.splitlines()[0]
    parameters, _, returned = text[text.index("(") + 1 :].rpartition(") -> ")
    listed = ", ".join(parameter(p, owner) for p in split(parameters))
    answer = RETURNS.get(name) if returned in ("object", "dict", "list") else None
    return f"def {name}({listed}) -> {answer or typed(returned, False)}: ..."


def property_lines(name, value):
    returned = value.fget.__doc__.splitlines()[0].rpartition(" -> ")[2]
    kind = typed(returned, False)
    if returned in ("object", "dict", "list"):
        kind = RETURNS[name]
    lines = ["    @property", f"    def {name}(self) -> {kind}: ..."]
    if value.fset:
        argument = "Any" if kind.startswith("NDArray") else kind
        lines += [f"    @{name}.setter", f"    def {name}(self, value: {argument}) -> None: ..."]
    return lines


def class_lines(name, made):
    if issubclass(made, BaseException):
        bases = ", ".join(base.__name__ for base in made.__bases__)
        lines = [f"class {name}({bases}):"]
        return lines + (["    exit_code: int"] if made is camber.Error else ["    ..."])
    base = made.__bases__[0]
    derived = f"({base.__name__})" if base.__module__.startswith("camber") else ""
    lines = [f"class {name}{derived}:"]
    for key, value in sorted(vars(made).items()):
        if isinstance(value, property):
            lines += property_lines(key, value)
        elif key in ("__init__", "__len__") or not key.startswith("_"):
            if "Initialize self" not in (value.__doc__ or ""):
                lines.append("    " + signature(key, value, made))
    return lines if len(lines) > 1 else lines + ["    ..."]


def stubs():
    out = [HEADER]
    members = sorted(vars(_core).items())
    classes = [(n, v) for n, v in members if inspect.isclass(v)]
    # An exception's base goes before it.
    for name, made in sorted(classes, key=lambda c: (len(c[1].__mro__) if issubclass(
            c[1], BaseException) else 100, c[0])):
        out.append("\n".join(class_lines(name, made)) + "\n")
    for name, value in members:
        if inspect.isbuiltin(value):
            out.append(signature(name, value))
    return "\n".join(out) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", help="file to write")
    parser.add_argument("--check", help="file that must be as it would be written")
    arguments = parser.parse_args()
    text = stubs()
    if arguments.out:
        with open(arguments.out, "w", encoding="utf-8") as file:
            file.write(text)
    if arguments.check:
        with open(arguments.check, encoding="utf-8") as file:
            old = file.read()
        if old != text:
            sys.stderr.writelines(difflib.unified_diff(
                old.splitlines(True), text.splitlines(True), arguments.check, "the module"))
            sys.exit(1)


if __name__ == "__main__":
    main()
