"""Trains a tiny keypoint network on drawn crops: its loss falls, a stopped training goes on to the
same weights, the program gives what PyTorch gives for the exported file, a larger network starts from
it as the same function, and one that takes twice the pixels, Muon trains one as well, --bf16 is used where the processor has it, and one
command goes from nothing to a file.

Usage: keypoint_training_test.py CAMBER TRAINING_FOLDER SCRATCH
"""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

CAMBER, TRAINING, SCRATCH = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
WIDTHS = '{"stem": 8, "fine": 16, "middle": 24, "coarse": 24, "middle_blocks": 1}'
STEPS = 60


def draw_crops(folder: Path, count: int, seed: int, side: int = 64) -> None:
    """A block whose two halves differ; keypoints stand at fixed shares of it."""
    px = side / 64
    random = np.random.default_rng(seed)
    shares = np.random.default_rng(5).random((18, 2))
    images = np.empty((count, side, side, 3), np.uint8)
    points = np.empty((count, 36, 2), np.float32)
    y, x = np.mgrid[0:side, 0:side]
    for i in range(count):
        left, top = px * random.uniform(4, 20, 2)
        width, height = px * random.uniform(24, 40, 2)
        inside = (x >= left) & (x <= left + width) & (y >= top) & (y <= top + height)
        image = random.normal(random.uniform(30, 220), 12, (side, side, 3))
        image[inside] = random.uniform(0, 110, 3)
        image[inside & (x < left + 0.5 * width) & (y < top + 0.5 * height)] = 240
        images[i] = np.clip(image, 0, 255)
        points[i, :18] = np.stack([left + 0.5 * width * shares[:, 0], top + height * shares[:, 1]], 1)
        points[i, 18:] = points[i, :18]
        points[i, 18:, 0] = 2 * left + width - points[i, :18, 0]
    folder.mkdir(parents=True)
    np.save(folder / "images.npy", images)
    np.save(folder / "keypoints.npy", points)
    np.save(folder / "visibility.npy", (points[..., 1] > 36 * px).astype(np.uint8))
    np.save(folder / "boxes.npy", np.tile(np.float32(px * np.array([4, 4, 60, 60])), (count, 1)))
    np.save(folder / "heading.npy", np.zeros((count, 3), np.float32))


def train_command(out: Path) -> list[str]:
    return [
        sys.executable, "-B", str(TRAINING / "train.py"), "--train", str(SCRATCH / "training"),
        "--validation", str(SCRATCH / "validation"), "--out", str(out), "--steps", str(STEPS),
        "--batch", "32", "--rate", "4e-3", "--widths", WIDTHS, "--threads", "1", "--report", "20",
        "--save-seconds", "0", "--quiet",
    ]  # fmt: skip


def log_of(out: Path) -> list[dict]:
    return [json.loads(line) for line in (out / "log.jsonl").read_text().splitlines()]


def camber(*arguments: object) -> subprocess.CompletedProcess:
    return subprocess.run([CAMBER, *map(str, arguments)], capture_output=True, text=True)


def weights_of(out: Path) -> dict:
    import torch

    return torch.load(out / "state.pt")["average"]


def check_training() -> Path:
    out = SCRATCH / "whole"
    subprocess.run(train_command(out), check=True)
    losses = [line["train"]["loss"] for line in log_of(out)]
    assert losses[-1] < 0.75 * losses[0], losses
    assert (out / "curves.png").stat().st_size > 1000 or not has("matplotlib")
    return out


def check_going_on(whole: Path) -> None:
    """Stopped after its first report and started again, by the same command."""
    out = SCRATCH / "stopped"
    first = subprocess.Popen(train_command(out))
    while not (out / "log.jsonl").exists() and first.poll() is None:
        time.sleep(0.02)
    first.send_signal(signal.SIGTERM)
    assert first.wait() == 130, "it was to stop before its end"
    assert log_of(out)[-1]["step"] < STEPS
    subprocess.run(train_command(out), check=True)
    assert log_of(out)[-1]["step"] == STEPS
    expected = weights_of(whole)
    for name, value in weights_of(out).items():
        assert (value == expected[name]).all(), name


def check_program(state: Path, name: str, validation: Path) -> None:
    network, predictions = SCRATCH / name, SCRATCH / "predictions.npy"
    subprocess.run(
        [sys.executable, "-B", str(TRAINING / "export.py"), str(state / "state.pt"), "--validation",
         str(validation), "--out", str(network), "--predictions", str(predictions)],
        check=True,
    )  # fmt: skip
    ran = camber("keypoints", "run", validation, "--keypoints", network, "--json")
    assert ran.returncode == 0, ran.stderr
    crops = json.loads(ran.stdout)["crops"]
    side = json.loads(network.with_suffix(".json").read_text())
    found = np.array([crop["keypoints"] for crop in crops])
    sigmas = np.array([crop["keypoint_sigmas_px"] for crop in crops])
    px = side["input"]["width"] / 64  # pixels of the crop; the network's points are of 64
    found[..., :2] = (found[..., :2] + 0.5) / px - 0.5
    expected = np.load(predictions).astype(float)
    logit = side["visibility"]["scale"] * expected[..., 3] + side["visibility"]["offset"]
    scale = np.where(logit > 0, side["sigma_scale"]["visible"], side["sigma_scale"]["hidden"])
    # Peaks of equal height may differ by rounding: nearly all keypoints, not each one.
    near = np.abs(found[..., :2] - expected[..., :2]).max(-1) < 1e-3
    assert near.mean() > 0.999, near.mean()
    np.testing.assert_allclose(found[..., 2][near], 1 / (1 + np.exp(-logit))[near], atol=1e-3)
    np.testing.assert_allclose(sigmas[near] / px, (scale * np.exp(expected[..., 2]))[near], rtol=1e-2)

    judged = camber("keypoints", "evaluate", validation, "--keypoints", network, "--json")
    assert judged.returncode == 0, judged.stderr
    overall = json.loads(judged.stdout)["evaluation"]["overall"]
    truth = (np.load(validation / "keypoints.npy") + 0.5) / px - 0.5
    off = np.hypot(*np.moveaxis(found[..., :2] - truth, -1, 0))
    assert abs(overall["all"]["pck_2px"] - (off <= 2).mean()) < 2e-3, overall
    # Calibrated on the same crops: 95.45 % of the coordinates.
    assert abs(overall["visible"]["inside_sigmas"][1] - 0.9545) < 0.02, overall

    damaged = SCRATCH / "damaged.onnx"
    shutil.copy(network.with_suffix(".json"), damaged.with_suffix(".json"))
    whole = network.read_bytes()
    middle = len(whole) // 2
    for content in (whole[:middle], whole[:middle] + b"\x7f" * 4000 + whole[middle + 4000 :]):
        damaged.write_bytes(content)
        for verb in ("run", "evaluate"):
            ran = camber("keypoints", verb, validation, "--keypoints", damaged, "--json")
            assert ran.returncode == 2, (verb, ran)
            assert ran.stdout == "" and ran.stderr.count("\n") == 1, ran
            assert str(damaged) in ran.stderr, ran


def check_start() -> None:
    """From the file that check_program() exported; a network of other widths is refused."""
    import torch

    sys.path.insert(0, str(TRAINING))
    sys.dont_write_bytecode = True
    from data import CropSet, to_input
    from export import load
    from model import KeypointNetwork, Widths
    from start import start_from

    images, _, _ = CropSet([str(SCRATCH / "validation")]).take(np.arange(96))
    images = to_input(images)
    with torch.no_grad():
        small = load(SCRATCH / "whole" / "state.pt")
        expected = small(images)
        more = {"stem_blocks": 1, "fine_blocks": 2, "coarse_blocks": 3, "middle_up_blocks": 2, "head": 24}
        widths = Widths(**{**json.loads(WIDTHS), **more})
        larger = KeypointNetwork(widths)
        start_from(larger, SCRATCH / "tiny.onnx", images)
        bound = 1e-3 * float(expected.abs().max())
        for as_trained in (False, True):
            difference = float((larger.train(as_trained)(images) - expected).abs().max())
            assert difference < bound, (as_trained, difference, bound)
        assert float(larger.spread_weight) == float(small.spread_weight)
    wider = train_command(SCRATCH / "wider")
    wider[wider.index("--widths") + 1] = WIDTHS.replace('"fine": 16', '"fine": 20')
    ran = subprocess.run(
        [*wider, "--start", str(SCRATCH / "tiny.onnx")], capture_output=True, text=True
    )
    assert ran.returncode == 1 and "has no place" in ran.stderr.splitlines()[-1], ran


def check_detail() -> None:
    """From the same file: what it gives for the means of 2 x 2 px, and then by its own pixels."""
    import torch

    from data import CropSet, to_input
    from export import load
    from model import KeypointNetwork, Widths
    from start import start_from

    for name, count, seed in (("training", 256, 3), ("validation", 96, 4)):
        draw_crops(SCRATCH / "fine" / name, count, seed, 128)
    images, points, _ = CropSet([str(SCRATCH / "fine" / "validation")], 128).take(np.arange(96))
    assert 0 < float(points.median()) < 64, points.median()
    images = to_input(images)
    with torch.no_grad():
        small = load(SCRATCH / "whole" / "state.pt")
        expected = small(torch.nn.functional.avg_pool2d(images, 2))
        fine = KeypointNetwork(Widths(**json.loads(WIDTHS), detail=8)).eval()
        start_from(fine, SCRATCH / "tiny.onnx", images)
        difference = float((fine(images) - expected).abs().max())
        assert difference < 1e-3 * float(expected.abs().max()), difference
    command = train_command(SCRATCH / "detail")
    command[command.index("--steps") + 1] = "10"
    command[command.index("--widths") + 1] = WIDTHS[:-1] + ', "detail": 8}'
    for at, name in (("--train", "training"), ("--validation", "validation")):
        command[command.index(at) + 1] = str(SCRATCH / "fine" / name)
    command += ["--muon", "--start", str(SCRATCH / "tiny.onnx")]
    subprocess.run(command, check=True)
    check_program(SCRATCH / "detail", "fine.onnx", SCRATCH / "fine" / "validation")
    ran = camber("keypoints", "evaluate", SCRATCH / "validation", "--keypoints", SCRATCH / "fine.onnx")
    assert ran.returncode == 0, ran  # of 64 px: resampled


def check_muon() -> None:
    """Singular values come near 1; the loss falls; its states are not AdamW's."""
    import torch

    from muon import orthogonalised

    matrices = torch.randn(2, 20, 50, generator=torch.Generator().manual_seed(1))
    for matrix in (matrices[0], matrices[1].T):
        for precision in (torch.float32, torch.bfloat16):
            values = torch.linalg.svdvals(orthogonalised(matrix, precision))
            assert 0.6 < float(values.min()) and float(values.max()) < 1.3, values
    out = SCRATCH / "muon"
    command = [*train_command(out), "--muon"]
    subprocess.run(command, check=True)
    losses = [line["train"]["loss"] for line in log_of(out)]
    assert losses[-1] < 0.75 * losses[0], losses
    ran = subprocess.run(command[:-1], capture_output=True, text=True)
    assert ran.returncode == 1 and "--muon" in ran.stderr.splitlines()[-1], ran


def check_precision() -> None:
    """--bf16 where the processor has it; else it is passed over, and that is said."""
    sys.path.insert(0, str(TRAINING))
    from train import has_bfloat16

    info = SCRATCH / "cpuinfo"
    for flags, expected in (("fpu avx2 avx512f", False), ("fpu avx512_bf16", True), ("amx_bf16", True)):
        info.write_text(f"flags\t\t: {flags}\n")
        assert has_bfloat16(info) == expected, flags
    assert not has_bfloat16(SCRATCH / "not there")
    command = [*train_command(SCRATCH / "bf16"), "--bf16"]
    command[command.index("--steps") + 1] = "2"
    ran = subprocess.run(command, capture_output=True, text=True, check=True)
    assert ("single precision" in ran.stderr) != has_bfloat16(), ran.stderr


def check_one_command() -> None:
    """Twice: the second passes over what is there."""
    out = SCRATCH / "one_command"
    command = [
        sys.executable, "-B", str(TRAINING / "make_network.py"), "--out", str(out), "--camber", CAMBER,
        "--steps", "4", "--crops", "48", "--validation-crops", "24", "--threads", "1", "--widths", WIDTHS,
    ]  # fmt: skip
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    evaluation = json.loads((out / "evaluation.json").read_text())
    assert evaluation["evaluation"]["crops"] == 24, evaluation["evaluation"]["crops"]
    whole = {f: f.stat().st_mtime_ns for f in out.glob("*/*.npy")}
    weights = weights_of(out / "run")
    ran = subprocess.run(command, check=True, capture_output=True, text=True)
    assert "is trained" in ran.stderr + ran.stdout, ran
    assert whole == {f: f.stat().st_mtime_ns for f in out.glob("*/*.npy")} and len(whole) > 4
    for name, value in weights_of(out / "run").items():
        assert (value == weights[name]).all(), name


def has(module: str) -> bool:
    try:
        __import__(module)
    except ImportError:
        return False
    return True


def main() -> None:
    for module in ("torch", "onnx"):
        if not has(module):
            print(f"skipped: python3-{module} is not there")
            return
    shutil.rmtree(SCRATCH, ignore_errors=True)
    draw_crops(SCRATCH / "training", 512, 1)
    draw_crops(SCRATCH / "validation", 96, 2)
    whole = check_training()
    check_going_on(whole)
    check_program(whole, "tiny.onnx", SCRATCH / "validation")
    check_start()
    check_detail()
    check_muon()
    check_precision()
    check_one_command()


main()
