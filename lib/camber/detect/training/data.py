"""Crops that `camber keypoints synthesise` wrote, in random batches, varied."""

from __future__ import annotations

import glob
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from model import CROP, KEYPOINTS

PADDING = 114.0 / 255.0
VISIBLE, HIDDEN_BY_OTHER = 0, 2


class CropSet:
    """Crops of one folder or of several, on the disk until they are read.

    @param side  px of the images; keypoints are in units of crops of 64 px all the same.
    """

    def __init__(self, patterns: list[str], side: int = CROP) -> None:
        self.side = side
        folders = sorted({f for p in patterns for f in glob.glob(p) if Path(f, "images.npy").is_file()})
        if not folders:
            raise SystemExit(f"camber training: no crops (images.npy) in {' '.join(patterns)}")
        self.folders = folders
        self.images = [np.load(Path(f, "images.npy"), mmap_mode="r") for f in folders]
        self.points = np.concatenate([np.load(Path(f, "keypoints.npy")) for f in folders])
        self.visibility = np.concatenate([np.load(Path(f, "visibility.npy")) for f in folders])
        self.ends = np.cumsum([len(i) for i in self.images])
        for folder, images in zip(folders, self.images):
            if images.shape[1:] != (side, side, 3) or images.dtype != np.uint8:
                raise SystemExit(
                    f"camber training: {folder}/images.npy: found {images.dtype} {images.shape}, "
                    f"expected uint8 N x {side} x {side} x 3"
                )
        self.points = (self.points + 0.5) * np.float32(CROP / side) - 0.5
        expected = (len(self), KEYPOINTS)
        if self.points.shape != (*expected, 2) or self.visibility.shape != expected:
            raise SystemExit(
                f"camber training: found keypoints {self.points.shape} and visibility "
                f"{self.visibility.shape}, expected {(*expected, 2)} and {expected}"
            )

    def __len__(self) -> int:
        return int(self.ends[-1])

    def take(self, indices: np.ndarray) -> tuple[Tensor, Tensor, Tensor]:
        """Images (B, 3, side, side) in [0, 1], channels last in memory; points; visibility."""
        images = np.empty((len(indices), self.side, self.side, 3), np.uint8)
        which = np.searchsorted(self.ends, indices, side="right")
        for i, (part, index) in enumerate(zip(which, indices)):
            images[i] = self.images[part][index - (self.ends[part - 1] if part else 0)]
        tensor = torch.from_numpy(images).permute(0, 3, 1, 2).float().div_(255.0)
        points = torch.from_numpy(self.points[indices].astype(np.float32))
        return tensor, points, torch.from_numpy(self.visibility[indices])


def to_input(images: Tensor) -> Tensor:
    """[0, 1] to what the network takes."""
    return images - 0.5


def mirror_points(points: Tensor) -> Tensor:
    """Of the mirrored crop: row i is the mirror of row i + 18."""
    swapped = torch.roll(points, KEYPOINTS // 2, 1).clone()
    swapped[..., 0] = CROP - 1 - swapped[..., 0]
    return swapped


@dataclass
class Variation:
    """How crops are varied beside what the renderer varies. Shares of the crops, and ranges."""

    mirrored: float = 0.5
    moved: float = 0.5
    shift: float = 3.0  # px
    scale: float = 0.1  # logarithm
    turn: float = 0.12  # rad
    coloured: float = 0.7
    grey: float = 0.05
    coarse: float = 0.15  # made smaller and larger again
    noisy: float = 0.3
    noise: float = 0.04  # of the full range, at most
    erased: float = 0.2


class Varier:
    """Varies batches in place of the caller's; all its randomness is the generator's."""

    def __init__(self, variation: Variation, generator: torch.Generator) -> None:
        self.v = variation
        self.generator = generator

    def uniform(self, *shape: int, low: float = 0.0, high: float = 1.0) -> Tensor:
        return torch.rand(*shape, generator=self.generator) * (high - low) + low

    def some(self, share: float, count: int) -> Tensor:
        """Indices of a random share of the crops."""
        return (self.uniform(count) < share).nonzero()[:, 0]

    def __call__(
        self, images: Tensor, points: Tensor, visibility: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        images, points, visibility = images.clone(), points.clone(), visibility.clone()
        self.mirror(images, points, visibility)
        self.move(images, points)
        self.erase(images, points, visibility)
        self.color(images)
        self.degrade(images)
        return images, points, visibility

    def mirror(self, images: Tensor, points: Tensor, visibility: Tensor) -> None:
        which = self.some(self.v.mirrored, len(images))
        images[which] = images[which].flip(3)
        points[which] = mirror_points(points[which])
        visibility[which] = torch.roll(visibility[which], KEYPOINTS // 2, 1)

    def move(self, images: Tensor, points: Tensor) -> None:
        which = self.some(self.v.moved, len(images))
        count = len(which)
        if count == 0:
            return
        factor = torch.exp(self.uniform(count, low=-self.v.scale, high=self.v.scale))
        angle = self.uniform(count, low=-self.v.turn, high=self.v.turn)
        shift = self.uniform(count, 2, low=-self.v.shift, high=self.v.shift)
        turn = torch.stack(
            [torch.cos(angle), -torch.sin(angle), torch.sin(angle), torch.cos(angle)], -1
        ).view(count, 2, 2)
        # new = factor * turn * (old - middle) + middle + shift
        middle = 0.5 * (CROP - 1)
        forward = turn * factor[:, None, None]
        moved = torch.einsum("bij,bkj->bki", forward, points[which] - middle)
        points[which] = moved + middle + shift[:, None, :]
        # grid_sample asks for the old point of each new one, in units of half the crop.
        back = torch.linalg.inv(forward)
        half = 0.5 * CROP
        offset = -torch.einsum("bij,bj->bi", back, shift) / half
        grid = F.affine_grid(
            torch.cat([back, offset[..., None]], -1), [count, *images.shape[1:]], align_corners=False
        )
        images[which] = PADDING + F.grid_sample(
            images[which] - PADDING, grid, align_corners=False
        )

    def erase(self, images: Tensor, points: Tensor, visibility: Tensor) -> None:
        """A rectangle of another crop's pixels, or of one colour, over a part of the crop."""
        side = images.shape[-1]
        px = side / CROP
        for i in self.some(self.v.erased, len(images)).tolist():
            width, height = (px * self.uniform(2, low=6.0, high=28.0)).int().tolist()
            left = int(self.uniform(1) * (side - width))
            top = int(self.uniform(1) * (side - height))
            part = images[i, :, top : top + height, left : left + width]
            if self.uniform(1) < 0.5:
                part[:] = self.uniform(3, 1, 1)
            else:
                other = int(self.uniform(1) * len(images))
                x, y = (self.uniform(2) * torch.tensor([side - width, side - height])).int().tolist()
                part[:] = images[other, :, y : y + height, x : x + width].clone()
            u, v = ((points[i] + 0.5) * px - 0.5).unbind(-1)
            below = (u > left - 0.5) & (u < left + width - 0.5)
            below &= (v > top - 0.5) & (v < top + height - 0.5)
            visibility[i, below & (visibility[i] == VISIBLE)] = HIDDEN_BY_OTHER

    def color(self, images: Tensor) -> None:
        which = self.some(self.v.coloured, len(images))
        count = len(which)
        if count:
            part = images[which]
            gamma = torch.exp(self.uniform(count, 1, 1, 1, low=-0.4, high=0.4))
            gain = torch.exp(self.uniform(count, 3, 1, 1, low=-0.12, high=0.12))
            contrast = torch.exp(self.uniform(count, 1, 1, 1, low=-0.35, high=0.35))
            offset = self.uniform(count, 1, 1, 1, low=-0.15, high=0.15)
            grey = part.mean(1, keepdim=True)
            saturation = self.uniform(count, 1, 1, 1, low=0.3, high=1.5)
            part = grey + saturation * (part - grey)
            part = part.clamp(0.0, 1.0).pow(gamma) * gain
            mean = part.mean((1, 2, 3), keepdim=True)
            images[which] = ((part - mean) * contrast + mean + offset).clamp(0.0, 1.0)
        which = self.some(self.v.grey, len(images))
        images[which] = images[which].mean(1, keepdim=True).expand(-1, 3, -1, -1)

    def degrade(self, images: Tensor) -> None:
        which = self.some(self.v.coarse, len(images))
        if len(which):
            size = int(images.shape[-1] / CROP * self.uniform(1, low=20.0, high=50.0))
            small = F.interpolate(images[which], size=(size, size), mode="area")
            images[which] = F.interpolate(
                small, size=images.shape[-2:], mode="bilinear", align_corners=False
            )
        which = self.some(self.v.noisy, len(images))
        if len(which):
            sigma = self.uniform(len(which), 1, 1, 1, high=self.v.noise)
            noise = torch.randn(len(which), *images.shape[1:], generator=self.generator)
            images[which] = (images[which] + sigma * noise).clamp(0.0, 1.0)


@dataclass
class Place:
    """Where in the passes over the crops a training is."""

    passed: int = 0
    offset: int = 0


def batches(
    patterns: list[str], side: int, size: int, seed: int, place: Place
) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """Endless; every pass takes all crops that are there when it begins, in an order of its own."""
    while True:
        crops = CropSet(patterns, side)
        if len(crops) < size:
            raise SystemExit(f"camber training: {len(crops)} crops, fewer than a batch of {size}")
        order = np.random.default_rng([seed, place.passed]).permutation(len(crops))
        while place.offset + size <= len(order):
            chosen = np.sort(order[place.offset : place.offset + size])
            place.offset += size
            yield crops.take(chosen)
        place.passed, place.offset = place.passed + 1, 0


def whole_batches(crops: CropSet, size: int) -> Iterator[tuple[Tensor, Tensor, Tensor]]:
    """All crops once, in their order."""
    for start in range(0, len(crops), size):
        yield crops.take(np.arange(start, min(start + size, len(crops))))


def learning_rate(progress: float, peak: float, warm_up: float) -> float:
    """One cycle: rises in a line, falls as a cosine to a hundredth of the peak.

    @param progress, warm_up  shares of the whole, in [0, 1].
    """
    if progress < warm_up:
        return peak * (0.05 + 0.95 * progress / warm_up)
    down = min(1.0, (progress - warm_up) / (1.0 - warm_up))
    return peak * (0.01 + 0.99 * 0.5 * (1.0 + math.cos(math.pi * down)))
