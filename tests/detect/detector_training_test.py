"""Trains the vehicle detector for some steps on made scenes: what a cell answers for, the loss of what
is right against that of what is not, the same weights again, and the program on the exported file, which
it refuses where its own outputs differ from those of PyTorch.

Usage: detector_training_test.py CAMBER TRAINING_FOLDER SCRATCH
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path

CAMBER, TRAINING, SCRATCH = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])


def run(*words: object) -> str:
    done = subprocess.run([str(w) for w in words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{words}: {done.stderr}"
    return done.stdout


def make_inputs() -> None:
    for number in range(3):
        run(CAMBER, "synth", "--seed", number, "--size", "320x120", "--frames", 1, "--cars", 4,
            "--nearest", 6, "--cloud-points", 1000, "--supersampling", 1,
            "--out", SCRATCH / f"scenes/{number}")  # fmt: skip
    run(CAMBER, "keypoints", "synthesise", "--count", 40, "--out", SCRATCH / "crops")


def train(name: str) -> Path:
    out = SCRATCH / name
    run(sys.executable, "-B", TRAINING / "train_detector.py", "--scenes", SCRATCH / "scenes",
        "--crops", SCRATCH / "crops", "--out", out, "--steps", 3, "--batch", 2)  # fmt: skip
    return out


def check_cells(torch, model) -> None:
    boxes = torch.tensor([[100.0, 100.0, 130.0, 124.0], [20.0, 40.0, 260.0, 220.0]])
    ignored = torch.tensor([[290.0, 10.0, 310.0, 30.0]])
    index = model.assign(boxes, ignored)
    for box, stride in ((0, 8.0), (1, 32.0)):
        cells = index == box
        assert 1 <= int(cells.sum()) <= 16 and set(model.CELL[cells].tolist()) == {stride}
        assert (model.MIDDLES[cells] >= boxes[box, :2]).all()
        assert (model.MIDDLES[cells] <= boxes[box, 2:]).all()
    inside = (model.MIDDLES >= ignored[0, :2]).all(-1) & (model.MIDDLES <= ignored[0, 2:]).all(-1)
    assert (index[inside] == -2).all()

    # Maps that say the first box at its cells and nothing elsewhere, and the same moved by ten px.
    def maps(shift: float) -> list:
        out = []
        for stride in model.STRIDES:
            here = index[model.CELL == stride]
            side = model.SIDE // stride
            corner = (model.MIDDLES - 0.5 * model.CELL[:, None])[model.CELL == stride]
            box = boxes[here.clamp_min(0)]
            centre = 0.5 * (box[:, :2] + box[:, 2:]) + shift
            size = (box[:, 2:] - box[:, :2]) / stride
            score = torch.where(here >= 0, 8.0, -8.0)[:, None]
            rows = torch.cat([(centre - corner) / stride, size.log(), score], 1)
            out.append(rows.T.reshape(1, 5, side, side))
        return out

    truth = [(boxes, ignored)]
    right, moved = float(model.loss(maps(0.0), truth)), float(model.loss(maps(10.0), truth))
    assert right < 0.01 < 0.3 < moved, (right, moved)


def main() -> None:
    try:
        import cv2  # noqa: F401
        import onnx  # noqa: F401
        import torch
    except ImportError as error:
        print(f"skipped: {error}")
        return
    sys.path.insert(0, str(TRAINING))
    import detector_model

    check_cells(torch, detector_model)
    shutil.rmtree(SCRATCH, ignore_errors=True)
    make_inputs()
    first, again = train("first"), train("again")
    states = [torch.load(folder / "state.pt") for folder in (first, again)]
    assert all(torch.equal(a, b) for a, b in zip(states[0].values(), states[1].values()))
    assert len((first / "log.jsonl").read_text().splitlines()) == 1
    network = first / "vehicles.onnx"
    assert network.stat().st_size < 4e6
    found = json.loads(run(CAMBER, "detect", SCRATCH / "scenes/0", "--detector", network, "--keypoints",
                           "none", "--no-cache", "--out", SCRATCH / "found", "--json"))  # fmt: skip
    assert found["networks"]["detector"]["computed"] == 1


if __name__ == "__main__":
    main()
