#!/usr/bin/env python3
"""From nothing to a keypoint network by one command: crops, training, export, evaluation.

    make_network.py --out FOLDER [--camber PROGRAM] [--minutes 145] [--crops 100000] [--seed 1]

FOLDER gets validation/, train_00/ ..., run/ (state.pt, log.jsonl, curves.png), keypoints.onnx with its
side file, and evaluation.json. It may be stopped at any time: the same command passes over the crops
that are whole and goes on with the training. Exit codes are those of what it runs; 2: bad options.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SET = 20000  # crops of a folder
# Those of the network that ships (../models/README.md).
WIDTHS = {
    "middle": 80, "coarse": 96, "fine_blocks": 3, "middle_blocks": 3, "coarse_blocks": 3,
    "middle_up_blocks": 2, "fine_up_blocks": 3, "stem_blocks": 1, "head": 128, "detail": 16,
}  # fmt: skip


def run(*command: object) -> None:
    """Ends with the command's exit code where that is not 0; a signal is handed on to it."""
    words = [str(word) for word in command]
    print(" ".join(words), flush=True)
    child = subprocess.Popen(words)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: child.terminate())
    code = child.wait()
    if code != 0:
        sys.exit(code if code > 0 else 128 - code)


def script(name: str, *arguments: object) -> None:
    run(sys.executable, "-B", HERE / name, *arguments)


def synthesise(
    camber: str, folder: Path, count: int, first: int, seed: int, split: str, size: int
) -> None:
    if not folder.exists():  # it is exchanged in one step: what is there is whole
        run(camber, "keypoints", "synthesise", "--count", count, "--first", first, "--seed", seed,
            "--split", split, "--size", size, "--out", folder)  # fmt: skip


def positive(text: str) -> int:
    value = int(text)
    if value <= 0:
        raise argparse.ArgumentTypeError(f"found {value}, expected a positive number")
    return value


def arguments_of() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--camber", default="camber", help="the program")
    parser.add_argument("--minutes", type=float, default=145.0, help="of the training's schedule")
    parser.add_argument("--steps", type=positive, help="of the schedule, in place of --minutes")
    parser.add_argument("--crops", type=positive, default=100000, help="of the training")
    parser.add_argument("--validation-crops", type=positive, default=4000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--threads", type=int, default=0, help="of the training; 0: all")
    parser.add_argument("--widths", default=json.dumps(WIDTHS), help="JSON (model.py)")
    return parser.parse_args()


def main() -> None:
    args = arguments_of()
    os.nice(10)
    args.out.mkdir(parents=True, exist_ok=True)
    validation = args.out / "validation"
    size = 128 if json.loads(args.widths).get("detail") else 64
    synthesise(args.camber, validation, args.validation_crops, 0, args.seed, "validation", size)
    for first in range(0, args.crops, SET):
        count = min(SET, args.crops - first)
        folder = args.out / f"train_{first // SET:02d}"
        synthesise(args.camber, folder, count, first, args.seed, "training", size)
    length = ("--steps", args.steps) if args.steps else ("--minutes", args.minutes)
    script("train.py", "--train", args.out / "train_*", "--validation", validation,
           "--out", args.out / "run", *length, "--batch", 32, "--rate", 2e-3, "--muon", "--bf16",
           "--seed", args.seed, "--threads", args.threads, "--validation-crops", 2048,
           "--widths", args.widths)  # fmt: skip
    network = args.out / "keypoints.onnx"
    script("export.py", args.out / "run/state.pt", "--validation", validation, "--out", network)
    run(args.camber, "keypoints", "evaluate", validation, "--keypoints", network,
        "--out", args.out / "evaluation.json")  # fmt: skip
    print(network)


if __name__ == "__main__":
    main()
