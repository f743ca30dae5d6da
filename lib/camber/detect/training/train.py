#!/usr/bin/env python3
"""Trains the keypoint network on crops that `camber keypoints synthesise` wrote.

Writes to --out: state.pt (everything that going on needs; beside it state_before.pt), log.jsonl (one
line a report), curves.png. Killed or stopped at any time, the same command goes on where the last
state was saved. With --steps the same seed gives the same weights on the same machine; --minutes
bends the schedule to the time that there is.
"""

from __future__ import annotations

import argparse
import copy
import ctypes
import json
import os
import signal
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from data import CropSet, Place, Varier, Variation, batches, learning_rate, to_input, whole_batches
from model import CROP, KeypointNetwork, LossWeights, Widths, decode, loss
from muon import Muon
from start import start_from

FORMAT = "camber-keypoint-training"
# s: what one step counts for at most; a process that was stopped goes on where it was.
LONGEST_STEP = 10.0
# Crops that the batch norms of a network that is started from are fitted on.
START_CROPS = 1024


class Average:
    """Weights averaged over the last steps, exponentially; what is exported."""

    def __init__(self, network: KeypointNetwork, steps: float) -> None:
        self.network = copy.deepcopy(network).eval()
        self.steps = steps

    @torch.no_grad()
    def update(self, network: nn.Module, step: int) -> None:
        # In the beginning over fewer: the first weights are noise.
        share = 1.0 / min(self.steps, 1.0 + 0.2 * step)
        for mine, new in zip(self.network.state_dict().values(), network.state_dict().values()):
            if mine.dtype.is_floating_point:
                mine.lerp_(new, share)
            else:
                mine.copy_(new)


@torch.no_grad()
def measure(network: KeypointNetwork, crops: CropSet, most: int) -> dict[str, float]:
    """Errors on the first `most` crops, keypoints outside the crop left out."""
    sums: dict[str, float] = {}
    counts: dict[str, float] = {}

    def add(name: str, values: Tensor) -> None:
        sums[name] = sums.get(name, 0.0) + float(values.float().sum())
        counts[name] = counts.get(name, 0.0) + values.numel()

    seen = 0
    for images, points, visibility in whole_batches(crops, 256):
        prediction = decode(network(to_input(images)), network.spread_weight)
        for name, value in loss(prediction, points, visibility, LossWeights()).items():
            add(name, value[None])
        inside = ((points >= -0.5) & (points <= CROP - 0.5)).all(-1)
        error = prediction.points - points
        distance = error.norm(dim=-1)
        visible = inside & (visibility == 0)
        add("pck2_visible", distance[visible] <= 2.0)
        add("pck2_all", distance[inside] <= 2.0)
        sigma = prediction.log_sigma.exp()[..., None]
        add("inside_2_sigma_visible", (error.abs() <= 2.0 * sigma)[visible])
        add("inside_2_sigma_hidden", (error.abs() <= 2.0 * sigma)[inside & (visibility != 0)])
        add("visibility_right", (prediction.visible > 0) == (visibility == 0))
        seen += len(images)
        if seen >= most:
            break
    return {name: sums[name] / max(1.0, counts[name]) for name in sums}


class Training:
    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        torch.manual_seed(options.seed)
        self.network = KeypointNetwork(Widths(**json.loads(options.widths)))
        self.network = self.network.to(memory_format=torch.channels_last)
        self.average = Average(self.network, options.average)
        self.optimizers = self.make_optimizers()
        self.generator = torch.Generator().manual_seed(options.seed)
        self.place = Place()
        self.step = 0
        self.cycle = 0
        self.cycle_step = 0
        self.cycle_seconds = 0.0
        self.history: list[dict[str, Any]] = []  # one entry a cycle: how it was asked for
        self.stopped = False

    def make_optimizers(self) -> list[torch.optim.Optimizer]:
        o = self.options
        decayed = [p for p in self.network.parameters() if p.ndim > 1]
        others = [p for p in self.network.parameters() if p.ndim <= 1]
        hidden: list[nn.Parameter] = []
        if o.muon:
            # Convolutions between hidden maps: not what reads the image or gives the maps.
            reading = self.network.detail if self.network.widths.detail else self.network.stem
            outer = (reading[0].weight, self.network.maps.weight)
            hidden = [p for p in decayed if all(p is not q for q in outer)]
            decayed = list(outer)
        optimizers: list[torch.optim.Optimizer] = [
            torch.optim.AdamW(
                [{"params": decayed, "weight_decay": o.decay}, {"params": others, "weight_decay": 0.0}],
                lr=o.rate,
            )
        ]
        if hidden:
            precision = torch.bfloat16 if o.bf16 else torch.float32
            optimizers.append(Muon(hidden, o.rate, weight_decay=o.decay, precision=precision))
        return optimizers

    # What was saved and what is gone on with.

    def state(self) -> dict[str, Any]:
        return {
            "format": FORMAT,
            "widths": self.network.description(),
            "network": self.network.state_dict(),
            "average": self.average.network.state_dict(),
            "optimizers": [optimizer.state_dict() for optimizer in self.optimizers],
            "generator": self.generator.get_state(),
            "place": asdict(self.place),
            "step": self.step,
            "cycle": self.cycle,
            "cycle_step": self.cycle_step,
            "cycle_seconds": self.cycle_seconds,
            "history": self.history,
        }

    def save(self) -> None:
        file = self.options.out / "state.pt"
        temporary = file.with_suffix(".part")
        torch.save(self.state(), temporary)
        with open(temporary, "rb") as written:
            os.fsync(written.fileno())
        if file.exists():
            os.replace(file, self.options.out / "state_before.pt")
        os.replace(temporary, file)

    def load(self, file: Path) -> None:
        try:
            state = torch.load(file, map_location="cpu")
            if state.get("format") != FORMAT:
                raise ValueError(f"no {FORMAT}")
            if state["widths"] != self.network.description():
                raise ValueError(f"has widths {state['widths']}, not {self.network.description()}")
            if len(state["optimizers"]) != len(self.optimizers):
                raise ValueError("has another optimizer: begun with or without --muon")
        except Exception as error:
            raise SystemExit(f"camber training: {file}: {error}") from error
        self.network.load_state_dict(state["network"])
        self.average.network.load_state_dict(state["average"])
        for optimizer, saved in zip(self.optimizers, state["optimizers"]):
            optimizer.load_state_dict(saved)
        self.generator.set_state(state["generator"])
        self.place = Place(**state["place"])
        for name in ("step", "cycle", "cycle_step", "cycle_seconds", "history"):
            setattr(self, name, state[name])

    def start(self, file: Path) -> None:
        """From an exported network's weights in place of random ones."""
        crops = CropSet(self.options.train, self.network.side)
        chosen = torch.randperm(len(crops), generator=self.generator)[:START_CROPS].sort().values
        images, _, _ = crops.take(chosen.numpy())
        start_from(self.network, file, to_input(images))
        self.average = Average(self.network, self.options.average)

    def begin_cycle(self) -> None:
        """A new rise and fall of the learning rate, from the averaged weights on."""
        if self.step:
            self.network.load_state_dict(self.average.network.state_dict())
            self.cycle += 1
        self.cycle_step, self.cycle_seconds = 0, 0.0
        o = self.options
        self.history.append(
            {"from_step": self.step, "steps": o.steps, "minutes": o.minutes, "rate": o.rate,
             "batch": o.batch, "muon": o.muon, "seed": o.seed, "train": o.train,
             "start": str(o.start) if o.start else None}
        )  # fmt: skip

    # The training itself.

    def progress(self) -> float:
        if self.options.steps:
            return self.cycle_step / self.options.steps
        return self.cycle_seconds / (60.0 * self.options.minutes)

    def one_step(self, images: Tensor, points: Tensor, visibility: Tensor) -> dict[str, Tensor]:
        rate = learning_rate(self.progress(), self.options.rate, self.options.warm_up)
        for optimizer in self.optimizers:
            for group in optimizer.param_groups:
                group["lr"] = rate
        images = to_input(images).contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16, enabled=self.options.bf16):
            maps = self.network(images)
        parts = loss(decode(maps, self.network.spread_weight), points, visibility, LossWeights())
        self.network.zero_grad(set_to_none=True)
        parts["loss"].backward()
        nn.utils.clip_grad_norm_(self.network.parameters(), self.options.clip)
        for optimizer in self.optimizers:
            optimizer.step()
        self.step += 1
        self.cycle_step += 1
        self.average.update(self.network, self.step)
        return parts

    def report(self, sums: dict[str, float], steps: int, seconds: float, crops: CropSet | None) -> None:
        line: dict[str, Any] = {
            "step": self.step, "cycle": self.cycle, "progress": round(self.progress(), 4),
            "crops": self.step * self.options.batch, "pass": self.place.passed,
            "rate": self.optimizers[0].param_groups[0]["lr"],
            "crops_per_s": round(steps * self.options.batch / max(seconds, 1e-9), 1),
            "train": {k: round(v / max(1, steps), 5) for k, v in sums.items()},
        }  # fmt: skip
        if crops:
            of = measure(self.average.network, crops, self.options.validation_crops)
            line["validation"] = {k: round(v, 5) for k, v in of.items()}
        with open(self.options.out / "log.jsonl", "a", encoding="utf-8") as log:
            log.write(json.dumps(line) + "\n")
        if not self.options.quiet:
            print(json.dumps(line), file=sys.stderr, flush=True)

    def run(self) -> None:
        options = self.options
        validation = CropSet(options.validation, self.network.side) if options.validation else None
        vary = Varier(Variation(), self.generator)
        stream = batches(options.train, self.network.side, options.batch, options.seed, self.place)
        self.network.train()
        sums: dict[str, float] = {}
        steps, seconds, unsaved = 0, 0.0, 0.0
        while self.progress() < 1.0 and not self.stopped:
            begin = time.monotonic()
            parts = self.one_step(*vary(*next(stream)))
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + float(value.detach())
            if not torch.isfinite(parts["loss"]):
                raise SystemExit(f"camber training: the loss is no number at step {self.step}")
            took = min(LONGEST_STEP, time.monotonic() - begin)
            self.cycle_seconds += took
            steps, seconds, unsaved = steps + 1, seconds + took, unsaved + took
            if steps % options.report == 0 or self.progress() >= 1.0:
                begin = time.monotonic()
                self.report(sums, steps, seconds, validation)
                sums, steps, seconds = {}, 0, 0.0
                draw_curves(options.out)
                self.cycle_seconds += min(LONGEST_STEP, time.monotonic() - begin)
            if unsaved > options.save_seconds:
                self.save()
                unsaved = 0.0
        self.save()


def draw_curves(folder: Path) -> None:
    """The log as a picture; nothing without matplotlib."""
    try:
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot
    except ImportError:
        return
    lines = [json.loads(l) for l in (folder / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    crops = [l["crops"] for l in lines]
    figure, (left, right) = pyplot.subplots(1, 2, figsize=(11, 4))
    for name in ("loss", "heatmap", "coordinates", "visibility"):
        (drawn,) = left.plot(crops, [l["train"][name] for l in lines], label=name)
        if all("validation" in l for l in lines):
            left.plot(
                crops, [l["validation"][name] for l in lines], "--", color=drawn.get_color()
            )
    left.set(xlabel="crops", title="loss (dashed: validation, averaged weights)")
    if all("validation" in l for l in lines):
        for name in ("pck2_visible", "pck2_all", "visibility_right", "inside_2_sigma_visible"):
            right.plot(crops, [l["validation"][name] for l in lines], label=name.replace("_", " "))
        right.set(xlabel="crops", ylim=(0, 1), title="validation")
        right.legend()
        right.grid(alpha=0.3)
    left.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncol=4, frameon=False)
    left.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(folder / "curves.part.png", dpi=90)
    pyplot.close(figure)
    os.replace(folder / "curves.part.png", folder / "curves.png")


def keep_freed_memory() -> None:
    """Without it glibc hands every large tensor back and gets it again page by page, zeroed: 1.3 times
    the time of a step. Does nothing where the C library has no mallopt()."""
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError):
        return
    m_trim_threshold, m_mmap_max = -1, -4  # <malloc.h>
    mallopt(m_mmap_max, 0)
    mallopt(m_trim_threshold, 2**31 - 1)


def has_bfloat16(cpu_info: Path = Path("/proc/cpuinfo")) -> bool:
    """Whether the processor multiplies in bfloat16; without that it takes some ten times as long."""
    try:
        flags = set(cpu_info.read_text(encoding="utf-8").split())
    except OSError:
        return False
    return bool(flags & {"avx512_bf16", "amx_bf16"})


def parse() -> argparse.Namespace:
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    p.add_argument("--train", nargs="+", required=True, help="folders of crops; may hold * and ?")
    p.add_argument("--validation", nargs="*", default=[], help="likewise")
    p.add_argument("--out", type=Path, required=True)
    p.add_argument(
        "--start", type=Path, help="FILE.onnx of a network of the same or fewer blocks to go on from"
    )
    p.add_argument("--steps", type=int, default=0, help="of the schedule")
    p.add_argument("--minutes", type=float, default=0.0, help="of the schedule, in place of --steps")
    p.add_argument("--more", action="store_true", help="another cycle after a finished one")
    p.add_argument("--batch", type=int, default=64)
    p.add_argument("--rate", type=float, default=2e-3, help="highest learning rate")
    p.add_argument("--muon", action="store_true", help="Muon for hidden convolutions (muon.py)")
    p.add_argument("--warm-up", type=float, default=0.05, help="share of the schedule")
    p.add_argument("--decay", type=float, default=0.02)
    p.add_argument("--clip", type=float, default=5.0, help="most of the gradient's norm")
    p.add_argument("--average", type=float, default=1000.0, help="steps of the averaged weights")
    p.add_argument("--widths", default="{}", help="JSON of the network's widths (model.py)")
    p.add_argument("--bf16", action="store_true", help="bfloat16 where the processor has it")
    p.add_argument("--seed", type=int, default=1)
    p.add_argument("--threads", type=int, default=0, help="0: all")
    p.add_argument("--report", type=int, default=500, help="steps between reports")
    p.add_argument("--validation-crops", type=int, default=4096, help="of a report, at most")
    p.add_argument("--save-seconds", type=float, default=120.0)
    p.add_argument("--quiet", action="store_true")
    options = p.parse_args()
    if (options.steps > 0) == (options.minutes > 0.0):
        p.error("expected --steps or --minutes, above 0")
    return options


def main() -> int:
    options = parse()
    keep_freed_memory()
    if options.bf16 and not has_bfloat16():
        print("camber training: --bf16: this processor has none, single precision", file=sys.stderr)
        options.bf16 = False
    if options.threads > 0:
        torch.set_num_threads(options.threads)
    options.out.mkdir(parents=True, exist_ok=True)
    training = Training(options)
    state = options.out / "state.pt"
    if not state.exists() and (options.out / "state_before.pt").exists():
        state = options.out / "state_before.pt"
    if state.exists():
        training.load(state)
    elif options.start:
        training.start(options.start)
    finished = training.history and training.progress() >= 1.0
    if not training.history or (finished and options.more):
        training.begin_cycle()
    elif finished:
        print(f"camber training: {state} is trained; --more goes on", file=sys.stderr)
        return 0

    def stop(*_: object) -> None:
        training.stopped = True

    signal.signal(signal.SIGTERM, stop)
    signal.signal(signal.SIGINT, stop)
    training.run()
    return 0 if not training.stopped else 130


if __name__ == "__main__":
    sys.exit(main())
