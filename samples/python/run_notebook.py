"""Runs a notebook's code cells in order, in the notebook's folder, without Jupyter.

  run_notebook.py samples/python/steep_hill.ipynb           runs them and compares the text outputs
  run_notebook.py --write samples/python/steep_hill.ipynb   writes text and pictures into it
"""

import argparse
import ast
import base64
import contextlib
import io
import json
import os
import pathlib
import sys
from typing import Any, Dict, List

try:
    import matplotlib
except ImportError as error:
    sys.exit(f"{error}: apt install python3-matplotlib")

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def lines(text: str) -> List[str]:
    return text.splitlines(keepends=True)


def run_cell(source: str, names: Dict[str, Any], count: int) -> List[Dict[str, Any]]:
    """A cell's outputs as notebooks have them: what it prints, its last expression, its figures."""
    tree = ast.parse(source)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed = io.StringIO()
    value = None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, f"cell {count}", "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), f"cell {count}", "eval"), names)
    outputs: List[Dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream",
                        "text": lines(printed.getvalue())})
    if value is not None and not source.rstrip().endswith(";"):
        outputs.append({"data": {"text/plain": lines(repr(value))}, "execution_count": count,
                        "metadata": {}, "output_type": "execute_result"})
    for number in plt.get_fignums():
        picture = io.BytesIO()
        plt.figure(number).savefig(picture, format="png", metadata={"Software": None})
        outputs.append({"data": {"image/png": base64.b64encode(picture.getvalue()).decode() + "\n"},
                        "metadata": {}, "output_type": "display_data"})
    plt.close("all")
    return outputs


def texts(outputs: List[Dict[str, Any]]) -> List[str]:
    """What is to be equal from run to run: text, and how many pictures there are."""
    return ["".join(o.get("text") or o["data"].get("text/plain", "picture")) for o in outputs]


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("notebook", type=pathlib.Path)
    parser.add_argument("--write", action="store_true", help="write the outputs into the notebook")
    arguments = parser.parse_args()
    notebook = json.loads(arguments.notebook.read_text())
    path = arguments.notebook.resolve()
    os.chdir(path.parent)
    names: Dict[str, Any] = {"__name__": "__main__"}
    plt.close("all")
    count = different = 0
    for cell in notebook["cells"]:
        if cell["cell_type"] != "code":
            continue
        count += 1
        outputs = run_cell("".join(cell["source"]), names, count)
        if texts(outputs) != texts(cell["outputs"]):
            different += 1
            if not arguments.write:
                print(f"cell {count} gave\n{texts(outputs)}\nexpected\n{texts(cell['outputs'])}",
                      file=sys.stderr)
        cell["outputs"], cell["execution_count"] = outputs, count
    if arguments.write:
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False, sort_keys=True) + "\n")
        return 0
    print(f"{count} cells ran, {different} of them differ from the notebook")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
