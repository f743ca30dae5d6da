"""The vehicle detector, its loss, and which cell answers for which box.

Shapes: B images of SIDE x SIDE px, N = 2100 cells of the three strides, row by row. Coordinates are px
of the input, edges of pixels at whole numbers. The output is that of the program's head "yolox"
(docs/formats.md): centre from the cell's corner in cells, logarithm of the size in cells, score.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from model import convolution, residuals

SIDE = 320  # px
STRIDES = (8, 16, 32)  # px
# Square roots of areas of boxes that cells of each stride answer for, px.
SIZES = ((0.0, 40.0), (32.0, 96.0), (80.0, 1e9))
# A cell answers for a box whose centre is as near, in cells; nearer than the second it may.
NEAR, AROUND = 1.5, 2.5


def stage(inputs: int, outputs: int, blocks: int) -> nn.Sequential:
    return nn.Sequential(convolution(inputs, outputs, 2), residuals(outputs, blocks))


class VehicleDetector(nn.Module):
    """(B, 3, 320, 320), RGB in [-0.5, 0.5], to a map (B, 5, rows, columns) for each stride.

    A pyramid of features (Lin et al., "Feature pyramid networks for object detection", CVPR 2017) with
    one head without anchors for all strides (Tian et al., "FCOS", ICCV 2019).
    """

    def __init__(
        self,
        widths: tuple[int, ...] = (16, 24, 48, 96, 128),
        blocks: tuple[int, ...] = (1, 2, 2, 2),
        head: int = 48,
    ) -> None:
        super().__init__()
        self.stem = convolution(3, widths[0], 2)
        self.down = nn.ModuleList(
            [stage(widths[i], widths[i + 1], blocks[i]) for i in range(len(blocks))]
        )
        self.lateral = nn.ModuleList([convolution(w, head, size=1) for w in widths[2:]])
        self.smooth = nn.ModuleList([convolution(head, head) for _ in STRIDES])
        self.head = nn.Sequential(convolution(head, head), convolution(head, head))
        self.out = nn.ModuleList([nn.Conv2d(head, 5, 1) for _ in STRIDES])
        for out in self.out:
            nn.init.normal_(out.weight, std=0.01)
            # The cell's middle, nearly three cells wide, one cell in a hundred.
            out.bias.data.copy_(torch.tensor([0.5, 0.5, 1.0, 1.0, -4.6]))

    def forward(self, image: Tensor) -> list[Tensor]:
        x = self.stem(image)
        features = []
        for down in self.down:
            x = down(x)
            features.append(x)
        levels = [lateral(f) for lateral, f in zip(self.lateral, features[1:])]
        for fine, coarse in ((1, 2), (0, 1)):
            levels[fine] = levels[fine] + F.interpolate(
                levels[coarse], scale_factor=2.0, mode="nearest"
            )
        return [out(self.head(s(x))) for out, s, x in zip(self.out, self.smooth, levels)]


class Exported(nn.Module):
    """The network with one output (B, N, 6): the second score is 1, that of the only class."""

    def __init__(self, network: VehicleDetector) -> None:
        super().__init__()
        self.network = network

    def forward(self, image: Tensor) -> Tensor:
        rows = []
        for found in self.network(image):
            score = torch.sigmoid(found[:, 4:])
            only_class = torch.sigmoid(0.0 * found[:, 4:] + 20.0)
            rows.append(torch.cat([found[:, :4], score, only_class], 1).flatten(2).transpose(1, 2))
        return torch.cat(rows, 1)


def cells() -> tuple[Tensor, Tensor]:
    """Middles (N, 2), px, and strides (N)."""
    middles, strides = [], []
    for stride in STRIDES:
        at = (torch.arange(SIDE // stride) + 0.5) * stride
        v, u = torch.meshgrid(at, at, indexing="ij")
        middles.append(torch.stack([u, v], -1).reshape(-1, 2))
        strides.append(torch.full((len(at) ** 2,), float(stride)))
    return torch.cat(middles), torch.cat(strides)


MIDDLES, CELL = cells()
SMALLEST = torch.cat([torch.full_like(CELL[CELL == s], low) for s, (low, _) in zip(STRIDES, SIZES)])
LARGEST = torch.cat([torch.full_like(CELL[CELL == s], high) for s, (_, high) in zip(STRIDES, SIZES)])


def decode(maps: list[Tensor]) -> Tensor:
    """(B, N, 5): centre, width and height, px, and the logit of the score."""
    flat = torch.cat([m.float().flatten(2).transpose(1, 2) for m in maps], 1)
    corner = MIDDLES - 0.5 * CELL[:, None]
    centre = corner + flat[..., :2] * CELL[:, None]
    size = flat[..., 2:4].clamp(-4.0, 5.0).exp() * CELL[:, None]
    return torch.cat([centre, size, flat[..., 4:]], -1)


def overlaps(a: Tensor, b: Tensor) -> tuple[Tensor, Tensor]:
    """Intersection over union of boxes (centre, size), and the generalised one (Rezatofighi et al.,
    CVPR 2019)."""
    a1, a2 = a[:, :2] - 0.5 * a[:, 2:4], a[:, :2] + 0.5 * a[:, 2:4]
    b1, b2 = b[:, :2] - 0.5 * b[:, 2:4], b[:, :2] + 0.5 * b[:, 2:4]
    common = (torch.minimum(a2, b2) - torch.maximum(a1, b1)).clamp_min(0.0).prod(-1)
    union = a[:, 2:4].prod(-1) + b[:, 2:4].prod(-1) - common
    hull = (torch.maximum(a2, b2) - torch.minimum(a1, b1)).prod(-1).clamp_min(1e-6)
    iou = common / union.clamp_min(1e-6)
    return iou, iou - (hull - union) / hull


def assign(boxes: Tensor, ignored: Tensor) -> Tensor:
    """For each cell the index of its box, -1 for none, -2 where either may be said.

    @param boxes, ignored  (G, 4): left, top, right, bottom, px.
    """
    out = torch.full((len(MIDDLES),), -1, dtype=torch.long)
    if len(ignored):
        inside = (MIDDLES >= ignored[:, None, :2]) & (MIDDLES <= ignored[:, None, 2:])
        out[inside.all(-1).any(0)] = -2
    if not len(boxes):
        return out
    size = (boxes[:, 2:] - boxes[:, :2]).prod(-1).clamp_min(1.0).sqrt()
    half = 0.5 * (boxes[:, 2:] - boxes[:, :2])[:, None]
    distance = (MIDDLES - 0.5 * (boxes[:, :2] + boxes[:, 2:])[:, None]).abs()
    cell = CELL[None, :, None]
    near = (distance <= torch.minimum(half, NEAR * cell)).all(-1)
    near |= (distance <= 0.5 * cell).all(-1)  # a box that is smaller than its cell
    answers = near & (size[:, None] >= SMALLEST) & (size[:, None] <= LARGEST)
    cost = torch.where(answers, distance.sum(-1) / CELL, torch.tensor(1e9)).min(0)
    hit = cost.values < 1e9
    out[hit] = cost.indices[hit]
    around = (distance <= torch.minimum(half, AROUND * cell)).all(-1).any(0)
    out[(out == -1) & around] = -2
    return out


def loss(maps: list[Tensor], truth: list[tuple[Tensor, Tensor]]) -> Tensor:
    """Scores by how well the box fits (quality focal loss: Li et al., NeurIPS 2020), boxes by the
    generalised overlap; a box's cells count alike.

    @param truth  for each image its boxes and those to be ignored, as assign() takes them.
    """
    found = decode(maps)
    quality = torch.zeros(found.shape[:2])
    weight = torch.ones(found.shape[:2])
    boxes_loss, count = torch.zeros(()), 0
    for b, (boxes, ignored) in enumerate(truth):
        index = assign(boxes, ignored)
        weight[b][index == -2] = 0.0
        answers = index >= 0
        if not answers.any():
            continue
        of = boxes[index[answers]]
        of = torch.cat([0.5 * (of[:, :2] + of[:, 2:]), of[:, 2:] - of[:, :2]], -1)
        iou, generalised = overlaps(found[b][answers][:, :4], of)
        boxes_loss = boxes_loss + (1.0 - generalised).sum()
        count += int(answers.sum())
        quality[b][answers] = 0.3 + 0.7 * iou.detach().clamp(0.0, 1.0)
    logit = found[..., 4]
    scores = F.binary_cross_entropy_with_logits(logit, quality, reduction="none")
    scores = (scores * (quality - logit.sigmoid()) ** 2 * weight).sum()
    return (scores + 2.0 * boxes_loss) / max(1, count)
