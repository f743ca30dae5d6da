"""The keypoint network, what its maps mean, and the loss that it is trained with.

Shapes: B crops, 36 keypoints, 64 x 64 px. Coordinates are px of the crop, (u, v), pixel centres at
whole numbers, as detect/keypoint_crop.h has them. decode() is what keypoint_network.cpp does.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field

import torch
import torch.nn.functional as F
from torch import Tensor, nn

KEYPOINTS = 36
CROP = 64  # px
GRID = 32  # cells of a heatmap along an axis
MAPS_GRID = 16  # cells of the network's output along an axis; 2 x 2 cells of a heatmap in each
CELL = CROP / GRID  # px
# Channels of the output: four heatmap cells (rows, then columns) a keypoint, then the logarithm of
# sigma, then the logit of being visible.
MAPS = 6 * KEYPOINTS
WINDOW = 3  # cells about the peak whose mean is the keypoint
MIN_LOG_SIGMA, MAX_LOG_SIGMA = math.log(0.1), math.log(200.0)  # px


@dataclass
class Widths:
    """Channels and residual blocks at each resolution."""

    stem: int = 24  # 32 x 32 cells
    fine: int = 48  # 16 x 16
    middle: int = 96  # 8 x 8
    coarse: int = 112  # 4 x 4
    fine_blocks: int = 1
    middle_blocks: int = 2
    coarse_blocks: int = 1
    middle_up_blocks: int = 1  # on the way up
    fine_up_blocks: int = 1
    stem_blocks: int = 0
    # Of a convolution from 128 x 128 px to 64 x 64 cells, which the stem reads beside the means of 2 x 2
    # px; 0: none, the input is 64 x 64 px.
    detail: int = 0
    head: int = 0  # channels of a last 3 x 3 convolution before the maps; 0: none


@dataclass
class LossWeights:
    heatmap_sigma: float = 1.0  # cells, of the heatmap's target
    hidden: float = 0.5  # of a hidden keypoint's heatmap, where a visible one's is 1
    coordinates: float = 1.0  # of the log likelihood of the coordinates
    visibility: float = 1.0


def convolution(inputs: int, outputs: int, stride: int = 1, size: int = 3) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv2d(inputs, outputs, size, stride, size // 2, bias=False),
        nn.BatchNorm2d(outputs),
        nn.ReLU(inplace=True),
    )


class Residual(nn.Module):
    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = convolution(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.second(self.first(x)))


def residuals(channels: int, count: int) -> nn.Sequential:
    return nn.Sequential(*[Residual(channels) for _ in range(count)])


class KeypointNetwork(nn.Module):
    """(B, 3, side, side), RGB in [-0.5, 0.5], to maps (B, 216, 16, 16).

    Down to 4 x 4 cells and up again, the way down added to the way up at each resolution (an
    hourglass: Newell, Yang and Deng, "Stacked hourglass networks", ECCV 2016).
    """

    def __init__(self, widths: Widths | None = None) -> None:
        super().__init__()
        w = widths or Widths()
        self.widths = w
        self.side = 2 * CROP if w.detail else CROP  # px of the input
        if w.detail:
            self.detail = convolution(3, w.detail, 2)
        self.stem = convolution(3 + w.detail, w.stem, 2)
        self.stem_more = residuals(w.stem, w.stem_blocks)
        self.to_fine = convolution(w.stem, w.fine, 2)
        self.fine = residuals(w.fine, w.fine_blocks)
        self.to_middle = convolution(w.fine, w.middle, 2)
        self.middle = residuals(w.middle, w.middle_blocks)
        self.to_coarse = convolution(w.middle, w.coarse, 2)
        self.coarse = residuals(w.coarse, w.coarse_blocks)
        self.up_to_middle = convolution(w.coarse, w.middle, size=1)
        self.middle_up = residuals(w.middle, w.middle_up_blocks)
        self.up_to_fine = convolution(w.middle, w.fine, size=1)
        self.fine_up = residuals(w.fine, w.fine_up_blocks)
        self.head = convolution(w.fine, w.head) if w.head else nn.Sequential()
        self.maps = nn.Conv2d(w.head or w.fine, MAPS, 1)
        # How much of log sigma is that of the heatmap's own spread.
        self.spread_weight = nn.Parameter(torch.tensor(0.5))

    def forward(self, image: Tensor) -> Tensor:
        if self.widths.detail:
            image = torch.cat([F.avg_pool2d(image, 2), self.detail(image)], 1)
        fine = self.fine(self.to_fine(self.stem_more(self.stem(image))))
        middle = self.middle(self.to_middle(fine))
        coarse = self.coarse(self.to_coarse(middle))
        middle = self.middle_up(middle + enlarge(self.up_to_middle(coarse)))
        fine = self.fine_up(fine + enlarge(self.up_to_fine(middle)))
        return self.maps(self.head(fine))

    def description(self) -> dict[str, int]:
        return asdict(self.widths)


def enlarge(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2.0, mode="nearest")


@dataclass
class Prediction:
    """The estimates of each keypoint that the maps hold: (B, 36, ...)."""

    points: Tensor  # (B, 36, 2), px of the crop
    log_sigma: Tensor  # (B, 36), px, of one coordinate, before calibration
    visible: Tensor  # (B, 36), logit, before calibration
    heat: Tensor = field(repr=False)  # (B, 36, 32, 32), logarithms of the cells, not normalised
    log_sum: Tensor = field(repr=False)  # (B, 36), of them


def cell_centres() -> Tensor:
    """px of the crop, (32,)"""
    return (torch.arange(GRID, dtype=torch.float32) + 0.5) * CELL - 0.5


def log_spread(heat: Tensor, log_sum: Tensor) -> Tensor:
    """Of the whole heatmap, px, mean of both axes: two peaks far apart are a wide one."""
    probability = (heat - log_sum[..., None, None]).exp()
    centres = cell_centres()
    variance = torch.zeros_like(log_sum)
    for marginal in (probability.sum(2), probability.sum(3)):  # over u and v
        mean = marginal @ centres
        variance = variance + (marginal @ centres**2 - mean**2)
    # A quarter of a pixel squared: what the cells themselves blur.
    return 0.5 * torch.log(0.5 * variance.clamp_min(0.0) + 0.25)


def decode(maps: Tensor, spread_weight: Tensor) -> Prediction:
    """Peak of each heatmap, mean and attributes in the window about it."""
    batch = maps.shape[0]
    maps = maps.float().contiguous()
    heat = F.pixel_shuffle(maps[:, : 4 * KEYPOINTS], 2)
    flat = heat.flatten(2)
    log_sum = flat.logsumexp(-1)

    with torch.no_grad():
        spread = log_spread(heat, log_sum)
        peak = flat.argmax(-1)
        step = torch.arange(-WINDOW, WINDOW + 1)
        rows = torch.div(peak, GRID, rounding_mode="floor")[..., None] + step  # (B, 36, 7)
        columns = (peak % GRID)[..., None] + step
        rows, columns = rows[..., :, None].expand(-1, -1, -1, 7), columns[..., None, :].expand(
            -1, -1, 7, -1
        )
        rows, columns = rows.flatten(2), columns.flatten(2)  # (B, 36, 49)
        inside = ((rows >= 0) & (rows < GRID) & (columns >= 0) & (columns < GRID)).float()
        rows, columns = rows.clamp(0, GRID - 1), columns.clamp(0, GRID - 1)
        centres = cell_centres()
        cells = torch.div(rows, 2, rounding_mode="floor") * MAPS_GRID
        cells = cells + torch.div(columns, 2, rounding_mode="floor")

    window = (flat.gather(-1, rows * GRID + columns) - log_sum[..., None]).exp() * inside
    window = window / window.sum(-1, keepdim=True)
    points = torch.stack(
        [(window * centres[columns]).sum(-1), (window * centres[rows]).sum(-1)], -1
    )
    # Attributes, weighed by the same window of the heatmap (which they don't move).
    weights = window.detach()
    attributes = maps[:, 4 * KEYPOINTS :].reshape(batch, 2, KEYPOINTS, MAPS_GRID * MAPS_GRID)
    log_sigma = (attributes[:, 0].gather(-1, cells) * weights).sum(-1) + spread_weight * spread
    visible = (attributes[:, 1].gather(-1, cells) * weights).sum(-1)
    return Prediction(
        points, log_sigma.clamp(MIN_LOG_SIGMA, MAX_LOG_SIGMA), visible, heat, log_sum
    )


def cross_entropy(prediction: Prediction, points: Tensor, sigma: float) -> Tensor:
    """Of the heatmaps against normal distributions about the points, (B, 36).

    @param sigma  cells.
    """
    centres = cell_centres()
    u, v = [
        torch.softmax(-0.5 * ((points[..., a, None] - centres) / (sigma * CELL)) ** 2, -1)
        for a in range(2)
    ]
    expected = (torch.matmul(prediction.heat, u[..., None])[..., 0] * v).sum(-1)
    return prediction.log_sum - expected


def loss(
    prediction: Prediction, points: Tensor, visibility: Tensor, weights: LossWeights
) -> dict[str, Tensor]:
    """Means over keypoints; their sum is under "loss".

    @param points      (B, 36, 2), px; may lie outside the crop.
    @param visibility  (B, 36): 0 visible, else hidden.
    """
    inside = ((points >= -0.5) & (points <= CROP - 0.5)).all(-1).float()
    visible = (visibility == 0).float()
    weight = inside * (visible + weights.hidden * (1.0 - visible))
    cross = cross_entropy(prediction, points, weights.heatmap_sigma)
    heatmap = (weight * cross).sum() / weight.sum().clamp_min(1.0)

    # A Laplace distribution of each coordinate (errors have long tails) with the standard deviation
    # sigma. A point outside the crop cannot be met: it teaches sigma alone.
    at = torch.where(inside[..., None] > 0, prediction.points, prediction.points.detach())
    scale = prediction.log_sigma - 0.5 * math.log(2.0)
    error = (at - points).abs().clamp_max(4.0 * CROP).sum(-1)
    likelihood = error * torch.exp(-scale) + 2.0 * (scale + math.log(2.0))
    coordinates = likelihood.mean()

    seen = F.binary_cross_entropy_with_logits(prediction.visible, visible)
    total = heatmap + weights.coordinates * coordinates + weights.visibility * seen
    return {"loss": total, "heatmap": heatmap, "coordinates": coordinates, "visibility": seen}
