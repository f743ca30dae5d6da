#!/usr/bin/env python3
"""Trains the vehicle detector on made pictures, and writes it as ONNX with its side file.

Writes to --out: state.pt (the averaged weights), log.jsonl (one line a report), vehicles.onnx and
vehicles.json (docs/formats.md, task "detector"). Pictures are a function of the seed and their number.
"""

from __future__ import annotations

import argparse
import copy
import json
import os
import sys
import time
from pathlib import Path
from typing import Iterator

import cv2
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from data import learning_rate
from detector_data import Pictures
from detector_model import SIDE, STRIDES, Exported, VehicleDetector, loss
from muon import Muon
from onnx_weights import store_in_half_precision
from train import has_bfloat16, keep_freed_memory

WARM_UP = 0.05
CHECKED_VALUES, TOLERANCE = 16, 1e-3
BOX_SIGMA = 5.0  # px, of the sides of boxes on photographs (../models/README.md)
Batch = tuple[Tensor, list[tuple[Tensor, Tensor]]]


class Batches(torch.utils.data.IterableDataset):
    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options

    def __iter__(self) -> Iterator[Batch]:
        o = self.options
        cv2.setNumThreads(1)
        pictures = Pictures(o.scenes, o.crops, validation=False)
        number = 0
        while True:
            samples = []
            for _ in range(o.batch):
                samples.append(pictures.sample(np.random.default_rng([o.seed, number])))
                number += 1
            images = torch.from_numpy(np.stack([s[0] for s in samples])).permute(0, 3, 1, 2)
            yield images, [(torch.from_numpy(s[1]), torch.from_numpy(s[2])) for s in samples]


def to_input(images: Tensor) -> Tensor:
    return images.float() / 255.0 - 0.5


def make_optimizers(network: VehicleDetector, rate: float) -> list[torch.optim.Optimizer]:
    outer = [network.stem[0].weight] + [out.weight for out in network.out]
    others = [p for p in network.parameters() if p.ndim <= 1]
    hidden = [p for p in network.parameters() if p.ndim > 1 and all(p is not q for q in outer)]
    groups = [{"params": outer, "weight_decay": 0.01}, {"params": others, "weight_decay": 0.0}]
    precision = torch.bfloat16 if has_bfloat16() else torch.float32
    return [
        torch.optim.AdamW(groups, lr=rate),
        Muon(hidden, rate, weight_decay=0.01, precision=precision),
    ]


@torch.no_grad()
def average(mine: nn.Module, new: nn.Module, step: int) -> None:
    share = 1.0 / min(300.0, 1.0 + 0.2 * step)
    for a, b in zip(mine.state_dict().values(), new.state_dict().values()):
        if a.dtype.is_floating_point:
            a.lerp_(b, share)
        else:
            a.copy_(b)


def train(o: argparse.Namespace) -> VehicleDetector:
    """@return the averaged weights."""
    torch.manual_seed(o.seed)
    network = VehicleDetector().to(memory_format=torch.channels_last)
    if o.start:
        network.load_state_dict(torch.load(o.start, map_location="cpu"))
    averaged = copy.deepcopy(network).eval()
    optimizers = make_optimizers(network, o.rate)
    stream = iter(torch.utils.data.DataLoader(Batches(o), batch_size=None, num_workers=1))
    network.train()
    begin, sum_of_losses = time.monotonic(), 0.0
    for step in range(1, o.steps + 1):
        rate = learning_rate((step - 1) / o.steps, o.rate, WARM_UP)
        for optimizer in optimizers:
            for group in optimizer.param_groups:
                group["lr"] = rate
        images, truth = next(stream)
        images = to_input(images).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16, enabled=has_bfloat16()):
            maps = network(images)
        value = loss(maps, truth)
        network.zero_grad(set_to_none=True)
        value.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 10.0)
        for optimizer in optimizers:
            optimizer.step()
        average(averaged, network, step)
        sum_of_losses += float(value)
        if step % o.report == 0 or step == o.steps:
            count = (step - 1) % o.report + 1
            line = {"step": step, "pictures": step * o.batch, "rate": rate,
                    "loss": round(sum_of_losses / count, 5),
                    "pictures_per_s": round(step * o.batch / (time.monotonic() - begin), 1)}  # fmt: skip
            with open(o.out / "log.jsonl", "a", encoding="utf-8") as log:
                log.write(json.dumps(line) + "\n")
            print(json.dumps(line), file=sys.stderr, flush=True)
            sum_of_losses = 0.0
            torch.save(averaged.state_dict(), o.out / "state.part")
            os.replace(o.out / "state.part", o.out / "state.pt")
    return averaged


def check_image() -> Tensor:
    """As network.h's, (1, 3, SIDE, SIDE), what the network takes."""
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    channels = [(x + 2 * y + 40 * c + 64 * ((x // 32 + y // 32) % 2)) % 256 for c in range(3)]
    return to_input(torch.from_numpy(np.stack(channels)[None].astype(np.float32)))


@torch.no_grad()
def export(network: VehicleDetector, file: Path) -> None:
    """Batch norms folded into the convolutions, whose weights are stored in half precision."""
    network = copy.deepcopy(network).eval()
    for module in network.modules():
        if isinstance(module, nn.Sequential) and len(module) >= 2 and isinstance(module[1], nn.BatchNorm2d):
            module[0] = fuse_conv_bn_eval(module[0], module[1])
            module[1] = nn.Identity()
    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.weight.copy_(module.weight.half().float())
    exported, image = Exported(network), check_image()
    output = exported(image)
    flat = output.flatten()
    values = []
    for at in torch.linspace(0, len(flat) - 1, CHECKED_VALUES).long().tolist():
        index = [int(i) for i in np.unravel_index(at, tuple(output.shape))]
        values.append({"index": index, "value": float(flat[at])})
    description = {
        "format": "camber-network", "version": 1, "task": "detector",
        "name": "Camber's vehicle detector",
        "input": {"width": SIDE, "height": SIDE, "fit": "letterbox", "align": "top_left",
                  "padding": 114, "colors": "rgb", "range": [-0.5, 0.5]},
        "head": "yolox", "strides": list(STRIDES), "classes": ["car"], "score": 0.5,
        "box_sigma_px": BOX_SIGMA,
        "check": {"values": values, "tolerance": TOLERANCE * float(output.abs().max())},
    }  # fmt: skip
    temporary = file.with_suffix(".part")
    torch.onnx.export(
        exported, image, str(temporary), input_names=["image"], output_names=["boxes"],
        opset_version=11,
    )  # fmt: skip
    store_in_half_precision(temporary)
    os.replace(temporary, file)
    file.with_suffix(".json").write_text(json.dumps(description, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--scenes", type=Path, required=True, help="folder of scenes of camber synth")
    p.add_argument("--crops", type=Path, help="folder of camber keypoints synthesise")
    p.add_argument("--out", type=Path, required=True)
    p.add_argument("--steps", type=int, default=3400, help="0: the weights of --start are written")
    p.add_argument("--batch", type=int, default=16)
    p.add_argument("--rate", type=float, default=1.5e-3, help="highest learning rate")
    p.add_argument("--report", type=int, default=100, help="steps")
    p.add_argument("--start", type=Path, help="state.pt of another training to go on from")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--threads", type=int, default=1)
    options = p.parse_args()
    torch.set_num_threads(options.threads)
    keep_freed_memory()
    options.out.mkdir(parents=True, exist_ok=True)
    network = train(options)
    export(network, options.out / "vehicles.onnx")
    return 0


if __name__ == "__main__":
    sys.exit(main())
