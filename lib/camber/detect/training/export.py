#!/usr/bin/env python3
"""Writes the trained network as ONNX and its side file (docs/formats.md, task "keypoints").

Batch norms are folded into the convolutions, whose weights are stored in half precision. The sigmas
and the probabilities of being visible are calibrated on the validation crops; the side file holds
values that the network gives here for Camber's check image, so that the program notices where it
computes others.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from data import CropSet, to_input, whole_batches
from model import CROP, GRID, KEYPOINTS, WINDOW, KeypointNetwork, Prediction, Widths, decode
from onnx_weights import store_in_half_precision
from train import FORMAT

# Of a coordinate's errors inside 2 sigma after calibration: a normal distribution's.
INSIDE_2_SIGMA = 0.9545
CHECKED_VALUES, TOLERANCE = 24, 1e-3


def load(file: Path) -> KeypointNetwork:
    try:
        state = torch.load(file, map_location="cpu")
        if state.get("format") != FORMAT:
            raise ValueError(f"no {FORMAT}")
    except Exception as error:
        raise SystemExit(f"camber training: {file}: {error}") from error
    network = KeypointNetwork(Widths(**state["widths"]))
    network.load_state_dict(state["average"])
    return network.eval()


@torch.no_grad()
def fold(network: KeypointNetwork) -> KeypointNetwork:
    """The same function without batch norms, its convolutions' weights rounded to half precision."""
    image = to_input(check_image(network.side))
    before = network(image)
    for module in network.modules():
        if isinstance(module, nn.Sequential) and len(module) >= 2 and isinstance(module[1], nn.BatchNorm2d):
            module[0] = fuse_conv_bn_eval(module[0], module[1])
            module[1] = nn.Identity()
    difference = float((network(image) - before).abs().max() / before.abs().max())
    if not difference < 1e-4:
        raise SystemExit(f"camber training: without batch norms the output is off by {difference}")
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.copy_(module.weight.half().float())
    return network


def check_image(side: int) -> Tensor:
    """As network.h's, (1, 3, side, side) in [0, 1]."""
    y, x = np.mgrid[0:side, 0:side]
    channels = [(x + 2 * y + 40 * c + 64 * ((x // 32 + y // 32) % 2)) % 256 for c in range(3)]
    return torch.from_numpy(np.stack(channels)[None].astype(np.float32)) / 255.0


def mirrored_channels() -> list[int]:
    """The channel of a mirrored crop's maps that is each of the crop's."""
    def side(keypoint: int) -> int:
        return (keypoint + KEYPOINTS // 2) % KEYPOINTS

    # Of a keypoint's four cells the lowest bit is the column.
    heat = [4 * side(k) + (cell ^ 1) for k in range(KEYPOINTS) for cell in range(4)]
    return heat + [c * KEYPOINTS + side(k) for c in (4, 5) for k in range(KEYPOINTS)]


@torch.no_grad()
def predict(
    network: KeypointNetwork, crops: CropSet, mirrored: bool
) -> tuple[Prediction, Tensor, Tensor]:
    """Of all crops; points and visibility beside them.

    @param mirrored  by the means of the maps of each crop and of its mirror image.
    """
    parts = []
    for images, points, visibility in whole_batches(crops, 256):
        maps = network(to_input(images))
        if mirrored:
            other = network(to_input(images.flip(3)))[:, mirrored_channels()].flip(3)
            maps = 0.5 * (maps + other)
        p = decode(maps, network.spread_weight)
        parts.append((p.points, p.log_sigma, p.visible, points, visibility))
    joined = [torch.cat(column) for column in zip(*parts)]
    return Prediction(*joined[:3], torch.empty(0), torch.empty(0)), joined[3], joined[4]


def fit_visibility(logit: Tensor, visible: Tensor) -> tuple[float, float]:
    """Scale and offset of the logits that maximise the likelihood (Platt's scaling), by Newton."""
    x = torch.stack([logit, torch.ones_like(logit)], 1).double()
    y = visible.double()
    at = torch.tensor([1.0, 0.0], dtype=torch.float64)
    for _ in range(30):
        p = torch.sigmoid(x @ at)
        gradient = x.T @ (y - p)
        curvature = (x * (p * (1.0 - p))[:, None]).T @ x + 1e-6 * torch.eye(2)
        at = at + torch.linalg.solve(curvature, gradient)
    return float(at[0]), float(at[1])


def calibrate(network: KeypointNetwork, patterns: list[str], mirrored: bool) -> dict[str, object]:
    prediction, points, visibility = predict(network, CropSet(patterns, network.side), mirrored)
    scale, offset = fit_visibility(prediction.visible.flatten(), (visibility == 0).flatten())
    inside = ((points >= -0.5) & (points <= CROP - 0.5)).all(-1)
    ratio = (prediction.points - points).abs() / (2.0 * prediction.log_sigma.exp()[..., None])
    # By what the network takes for visible: the truth is not known where it is used.
    taken_visible = scale * prediction.visible + offset > 0.0
    sigma_scale = {}
    for name, which in (("visible", taken_visible), ("hidden", ~taken_visible)):
        of = ratio[which & inside].flatten().numpy()
        sigma_scale[name] = float(np.quantile(of, INSIDE_2_SIGMA)) if len(of) else 1.0
    return {
        "sigma_scale": sigma_scale,
        "visibility": {"scale": scale, "offset": offset},
        "mirrored": mirrored,
    }


def check_values(maps: Tensor) -> list[dict[str, object]]:
    """Some of the output's values, spread over it, largest magnitudes among them."""
    flat = maps.flatten()
    spread = torch.linspace(0, len(flat) - 1, CHECKED_VALUES // 2).long()
    largest = flat.abs().topk(CHECKED_VALUES - len(spread)).indices
    values = []
    for at in torch.cat([spread, largest]).tolist():
        index = [int(i) for i in np.unravel_index(at, tuple(maps.shape))]
        values.append({"index": index, "value": float(flat[at])})
    return values


@torch.no_grad()
def write(network: KeypointNetwork, file: Path, name: str, calibration: dict[str, object]) -> None:
    image = to_input(check_image(network.side))
    maps = network(image)
    description = {
        "format": "camber-network",
        "version": 1,
        "task": "keypoints",
        "name": name,
        "input": {"width": network.side, "height": network.side, "fit": "stretch", "colors": "rgb", "range": [-0.5, 0.5]},
        "head": "hourglass",
        "spread_weight": float(network.spread_weight),
        **calibration,
        "check": {"values": check_values(maps), "tolerance": TOLERANCE * float(maps.abs().max())},
    }  # fmt: skip
    temporary = file.with_suffix(".part")
    torch.onnx.export(
        network, image, str(temporary), input_names=["image"], output_names=["maps"],
        dynamic_axes={"image": {0: "crops"}, "maps": {0: "crops"}}, opset_version=11,
    )  # fmt: skip
    store_in_half_precision(temporary)
    os.replace(temporary, file)
    side = file.with_suffix(".json")
    side.with_suffix(".json.part").write_text(json.dumps(description, indent=1) + "\n")
    os.replace(side.with_suffix(".json.part"), side)


def write_predictions(
    network: KeypointNetwork, patterns: list[str], mirrored: bool, file: Path
) -> None:
    """What decode() gives for each crop, uncalibrated: for tests of the program's own."""
    p, _, _ = predict(network, CropSet(patterns, network.side), mirrored)
    columns = [p.points, p.log_sigma[..., None], p.visible[..., None]]
    np.save(file, torch.cat(columns, -1).numpy())


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("state", type=Path, help="state.pt of train.py")
    p.add_argument("--validation", nargs="+", required=True, help="folders of crops; may hold * and ?")
    p.add_argument("--out", type=Path, required=True, help="FILE.onnx; FILE.json is written beside it")
    p.add_argument(
        "--no-mirror", action="store_true", help="each crop alone, not averaged with its mirror image"
    )
    p.add_argument("--name", default="Camber's keypoint network", help="for people")
    p.add_argument("--predictions", type=Path, help="also a .npy (N, 36, 4): u, v, log sigma, logit")
    options = p.parse_args()
    if options.out.suffix != ".onnx":
        p.error("--out: expected a name that ends in .onnx")
    network = fold(load(options.state))
    mirrored = not options.no_mirror
    calibration = calibrate(network, options.validation, mirrored)
    if options.predictions:
        write_predictions(network, options.validation, mirrored, options.predictions)
    write(network, options.out, options.name, calibration)
    print(json.dumps(calibration), file=sys.stderr)
    return 0


assert (KEYPOINTS, GRID, WINDOW) == (36, 32, 3)  # what head "hourglass" means to the program

if __name__ == "__main__":
    sys.exit(main())
