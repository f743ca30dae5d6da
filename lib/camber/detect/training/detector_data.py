"""Pictures for the vehicle detector: parts of scenes of `camber synth`, with cars of `camber keypoints
synthesise` and clutter drawn over them, and the boxes in them.

Nothing but made pictures: what keeps the network from taking other things for cars is clutter of every
texture, shape and size, shadows, and pieces of the scenes themselves, turned and scaled.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from detector_model import SIDE

Array = np.ndarray
Random = np.random.Generator

PADDING = 114
LEAST_HEIGHT, LEAST_WIDTH = 11.0, 8.0  # px; smaller ones may be found or not
LEAST_SEEN = 0.3  # share of a vehicle that is seen; of less likewise
VEHICLE = "vehicle"  # name of the class in the manifests' masks


class Truth:
    """A box in a picture, px, and the share of its vehicle that is seen."""

    def __init__(self, box: list[float], seen: float) -> None:
        self.box, self.seen = box, seen

    def cover(self, mask: Array) -> None:
        left, top, right, bottom = (int(round(max(0.0, v))) for v in self.box)
        part = mask[top:bottom, left:right]
        if part.size:
            self.seen *= 1.0 - min(1.0, 1.2 * float((part > 0.5).mean()))

    def counts(self) -> bool:
        left, top, right, bottom = self.box
        large = bottom - top >= LEAST_HEIGHT and right - left >= LEAST_WIDTH
        return large and self.seen >= LEAST_SEEN


class Pictures:
    """@param scenes  folder of scenes of `camber synth`.
    @param crops   folder of crops of `camber keypoints synthesise`; none: scenes alone.
    @param validation  every tenth scene in place of the others.
    """

    def __init__(self, scenes: Path, crops: Path | None, validation: bool) -> None:
        self.frames: list[tuple[Path, Path, int, list[dict[str, Any]]]] = []
        for number, manifest in enumerate(sorted(scenes.glob("*/scene.json"))):
            if (number % 10 == 9) == validation:
                self.add_scene(manifest)
        if not self.frames:
            raise SystemExit(f"camber training: no scenes (*/scene.json) in {scenes}")
        self.read: dict[int, tuple[Array, Array]] = {}
        self.crops: list[Array] = []
        if crops:
            names = ("images", "keypoints", "visibility", "true_boxes")
            self.crops = [np.load(crops / f"{name}.npy", mmap_mode="r") for name in names]
            # Most of the car seen, or hidden by itself alone.
            self.whole = np.flatnonzero((np.asarray(self.crops[2]) <= 1).mean(1) >= 0.7)

    def add_scene(self, manifest: Path) -> None:
        scene = json.loads(manifest.read_text(encoding="utf-8"))
        label = scene["segmentation_classes"][VEHICLE][0]
        for frame, truth in zip(scene["frames"], scene["truth"]["frames"]):
            paths = manifest.parent / frame["image"], manifest.parent / frame["segmentation"]
            self.frames.append((*paths, label, truth.get("vehicles", [])))

    def frame(self, number: int) -> tuple[Array, Array]:
        """Colours, red first, and where vehicles are."""
        if number not in self.read:
            image, mask, label, _ = self.frames[number]
            colors = cv2.cvtColor(cv2.imread(str(image)), cv2.COLOR_BGR2RGB)
            labels = cv2.imread(str(mask), cv2.IMREAD_UNCHANGED)
            self.read[number] = colors, (labels == label).astype(np.uint8)
        return self.read[number]

    def sample(self, r: Random, varied: bool = True) -> tuple[Array, Array, Array]:
        """A picture (SIDE, SIDE, 3), its boxes (G, 4) and those to be ignored."""
        picture, truth = self.part_of_scene(r)
        if varied and self.crops:
            if r.random() < 0.12:
                picture[:] = self.texture(r, SIDE, SIDE).clip(0, 255)
                truth.clear()
            for _ in range(r.choice([0, 2, 5, 10], p=[0.2, 0.3, 0.3, 0.2])):
                self.draw_clutter(r, picture, truth)
            for _ in range(r.choice([0, 1, 2, 3], p=[0.3, 0.3, 0.25, 0.15])):
                self.draw_car(r, picture, truth)
            for _ in range(r.choice([0, 1, 2, 4], p=[0.5, 0.2, 0.2, 0.1])):
                self.draw_clutter(r, picture, truth)
        if r.random() < 0.5:
            picture = picture[:, ::-1]
            for t in truth:
                t.box = [SIDE - t.box[2], t.box[1], SIDE - t.box[0], t.box[3]]
        if varied:
            picture = vary_colors(r, picture)
        boxes = [[t.box for t in truth if t.counts() == counts] for counts in (True, False)]
        arrays = [np.array(b, np.float32).reshape(-1, 4) for b in boxes]
        return np.ascontiguousarray(picture), arrays[0], arrays[1]

    def part_of_scene(self, r: Random) -> tuple[Array, list[Truth]]:
        number = int(r.integers(len(self.frames)))
        colors, _ = self.frame(number)
        height, width = colors.shape[:2]
        scale = np.exp(r.uniform(np.log(0.7), np.log(2.6)))
        aspect = np.exp(r.normal(0.0, 0.06))
        fx, fy = scale * aspect, scale / aspect
        seen_width, seen_height = SIDE / fx, SIDE / fy
        # A tenth may lie beyond the image; where it is lower than the part, more.
        left = r.uniform(
            -0.1 * seen_width, max(width - 0.9 * seen_width, 1.0 - 0.1 * seen_width)
        )
        room = height - seen_height
        top = r.uniform(min(0.0, room) - 0.1 * seen_height, max(room, 0.0) + 0.1 * seen_height)
        if scale < 1.0 and r.random() < 0.25:
            left, top = 0.0, 0.5 * room
        to_part = np.array(
            [[fx, 0.0, (0.5 - left) * fx - 0.5], [0.0, fy, (0.5 - top) * fy - 0.5]]
        )
        picture = cv2.warpAffine(colors, to_part, (SIDE, SIDE), borderValue=(PADDING,) * 3)
        truth = []
        for vehicle in self.frames[number][3]:
            b = vehicle["box"]
            whole = [(b[0] + 0.5 - left) * fx, (b[1] + 0.5 - top) * fy,
                     (b[2] + 0.5 - left) * fx, (b[3] + 0.5 - top) * fy]  # fmt: skip
            box = [max(whole[0], 0.0, -left * fx), max(whole[1], 0.0, -top * fy),
                   min(whole[2], SIDE, (width - left) * fx), min(whole[3], SIDE, (height - top) * fy)]  # fmt: skip
            if box[2] - box[0] >= 3.0 and box[3] - box[1] >= 3.0:
                inside = area(box) / max(1e-6, area(whole))
                truth.append(Truth(box, (1.0 - vehicle["occlusion"]) * inside))
        return picture, truth

    def draw_car(self, r: Random, picture: Array, truth: list[Truth]) -> None:
        """A crop's car, cut out along the hull of its keypoints."""
        which = int(self.whole[r.integers(len(self.whole))])
        image, keypoints, _, true_boxes = (np.asarray(array[which]) for array in self.crops)
        side = image.shape[0]
        hull = cv2.convexHull(keypoints.astype(np.float32))
        mask = np.zeros((side, side), np.uint8)
        cv2.fillConvexPoly(mask, np.round(8.0 * hull).astype(np.int32), 255, shift=3)
        mask = cv2.dilate(mask, np.ones((3, 3)))
        if r.random() < 0.3:
            mask = cv2.dilate(mask, np.ones((7, 7)))
        b = true_boxes
        scale = np.exp(r.uniform(np.log(14.0), np.log(130.0))) / max(4.0, b[3] - b[1])
        across = scale * np.exp(r.normal(0.0, 0.05))
        at = np.array([r.uniform(0.0, SIDE), 0.5 * SIDE + r.normal(0.0, 60.0)])
        middle = 0.5 * (b[:2] + b[2:])
        factors = np.array([across, scale])
        to_picture = np.column_stack([np.diag(factors), at - factors * middle])
        if scale < 0.6:  # made coarser first, so that nothing aliases
            small = max(8, round(side * scale))
            image, mask = (cv2.resize(x, (small, small), interpolation=cv2.INTER_AREA) for x in (image, mask))
            f = side / small
            to_picture = to_picture @ np.array([[f, 0, 0.5 * f - 0.5], [0, f, 0.5 * f - 0.5], [0, 0, 1]])
        car = cv2.warpAffine(image, to_picture, (SIDE, SIDE))
        alpha = cv2.warpAffine(mask, to_picture, (SIDE, SIDE)).astype(np.float32) / 255.0
        alpha = cv2.GaussianBlur(alpha, (0, 0), 0.7)
        picture[:] = picture * (1.0 - alpha[..., None]) + car * alpha[..., None]
        low = at + factors * (np.maximum(b[:2], -0.5) - middle) + 0.5
        high = at + factors * (np.minimum(b[2:], side - 0.5) - middle) + 0.5
        box = [*np.clip(low, 0.0, SIDE), *np.clip(high, 0.0, SIDE)]
        if box[2] - box[0] < 2.0 or box[3] - box[1] < 2.0:
            return
        for t in truth:
            t.cover(alpha)
        truth.append(Truth(box, area(box) / (area(b) * across * scale)))

    def texture(self, r: Random, height: int, width: int) -> Array:
        kind = r.integers(6)
        if kind == 0:
            return np.ones((height, width, 3), np.float32) * color(r)
        if kind == 1:
            v, u = np.mgrid[0:height, 0:width].astype(np.float32)
            angle = r.uniform(0.0, np.pi)
            wave = u * np.cos(angle) + v * np.sin(angle)
            share = np.sin(2.0 * np.pi * wave / r.uniform(2.5, 40.0) + r.uniform(0.0, 6.0))
            if r.random() < 0.6:
                share = np.sign(share - r.uniform(-0.7, 0.7))
            share = 0.5 + 0.5 * share
        elif kind == 2:
            columns = int(r.integers(2, 24))
            rows = min(60, max(2, int(columns * height / width * r.uniform(0.5, 2.0))))
            blocks = r.uniform(0.0, 1.0, (rows, columns)).astype(np.float32)
            share = cv2.resize(blocks, (width, height), interpolation=cv2.INTER_NEAREST)
        elif kind in (3, 4):
            share = noise(r, height, width)
        else:
            piece = self.piece_of_scene(r, height, width)
            return piece if piece is not None else np.ones((height, width, 3), np.float32) * color(r)
        return share[..., None] * color(r) + (1.0 - share[..., None]) * color(r)

    def piece_of_scene(self, r: Random, height: int, width: int) -> Array | None:
        """Turned and scaled, without vehicles; none where three tries show some."""
        for _ in range(3):
            colors, vehicles = self.frame(int(r.integers(len(self.frames))))
            scale = np.exp(r.uniform(-0.9, 0.9))
            angle = r.normal(0.0, 0.25) if r.random() < 0.6 else r.uniform(-np.pi, np.pi)
            turn = scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
            rows, columns = colors.shape[:2]
            at = np.array([r.uniform(20, columns - 20), r.uniform(20, rows - 20)])
            warp = np.column_stack([turn, np.array([0.5 * width, 0.5 * height]) - turn @ at])
            if cv2.warpAffine(vehicles, warp, (width, height)).mean() < 0.01:
                piece = cv2.warpAffine(colors, warp, (width, height), borderMode=cv2.BORDER_REFLECT)
                return piece.astype(np.float32)
        return None

    def draw_clutter(self, r: Random, picture: Array, truth: list[Truth]) -> None:
        width = int(np.exp(r.uniform(np.log(8.0), np.log(200.0))))
        height = int(np.exp(r.uniform(np.log(6.0), np.log(140.0))))
        x = int(r.integers(-(width // 2), SIDE - width // 2))
        y = int(r.integers(-(height // 2), SIDE - height // 2))
        left, top, right, bottom = max(0, x), max(0, y), min(SIDE, x + width), min(SIDE, y + height)
        if right - left < 3 or bottom - top < 3:
            return
        inside = slice(top - y, bottom - y), slice(left - x, right - x)
        mask = cv2.GaussianBlur(shape(r, height, width), (0, 0), r.uniform(0.3, 1.5))[inside]
        part = picture[top:bottom, left:right].astype(np.float32)
        if r.random() < 0.25:  # a shadow, or light
            factor = r.uniform(0.1, 0.7) if r.random() < 0.8 else r.uniform(1.2, 2.0)
            part *= 1.0 - mask[..., None] * (1.0 - factor)
        else:
            alpha = mask * (1.0 if r.random() < 0.7 else r.uniform(0.4, 1.0))
            part += alpha[..., None] * (self.texture(r, height, width)[inside] - part)
            covered = np.zeros((SIDE, SIDE), np.float32)
            covered[top:bottom, left:right] = alpha
            for t in truth:
                t.cover(covered)
        picture[top:bottom, left:right] = part.clip(0.0, 255.0)


def area(box: Any) -> float:
    return float((box[2] - box[0]) * (box[3] - box[1]))


def color(r: Random) -> Array:
    grey = r.uniform(0.0, 255.0) + r.normal(0.0, 18.0, 3)
    return (r.uniform(0.0, 255.0, 3) if r.random() < 0.4 else grey.clip(0, 255)).astype(np.float32)


def noise(r: Random, height: int, width: int) -> Array:
    """Of many wavelengths, in [0, 1]."""
    out, amplitude, longest = np.zeros((height, width), np.float32), 1.0, max(height, width)
    for cells in (4, 8, 16, 32, 64, 128):
        if cells > 2 * longest:
            break
        grid = r.normal(0, 1, (max(2, cells * height // longest), max(2, cells * width // longest)))
        out += amplitude * cv2.resize(
            grid.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC
        )
        amplitude *= r.uniform(0.45, 0.95)
    return 1.0 / (1.0 + np.exp(-2.5 * r.uniform(0.3, 1.2) * out / max(1e-3, out.std())))


def shape(r: Random, height: int, width: int) -> Array:
    mask = np.zeros((height, width), np.float32)
    kind = r.integers(5)
    if kind == 0:
        mask[:] = 1.0
    elif kind == 1:
        axes = max(1, width // 2 - 1), max(1, height // 2 - 1)
        cv2.ellipse(mask, (width // 2, height // 2), axes, 0, 0, 360, 1.0, -1)
    elif kind == 2:
        ends = [(int(r.integers(width)), int(r.integers(height))) for _ in range(2)]
        cv2.line(mask, ends[0], ends[1], 1.0, int(r.integers(1, 9)))
    else:
        corners = np.stack([r.uniform(0, width, 6), r.uniform(0, height, 6)], -1).astype(np.int32)
        cv2.fillPoly(mask, [cv2.convexHull(corners) if kind == 3 else corners], 1.0)
    return mask


def vary_colors(r: Random, picture: Array) -> Array:
    x = picture.astype(np.float32) / 255.0
    if r.random() < 0.8:
        grey = x.mean(2, keepdims=True)
        x = (grey + r.uniform(0.3, 1.5) * (x - grey)).clip(0.0, 1.0)
        x = x ** np.exp(r.uniform(-0.6, 0.7)) * np.exp(r.uniform(-0.12, 0.12, 3))
        mean = x.mean()
        x = (x - mean) * np.exp(r.uniform(-0.4, 0.7)) + mean + r.uniform(-0.12, 0.12)
    if r.random() < 0.1:
        x = np.repeat(x.mean(2, keepdims=True), 3, 2)
    if r.random() < 0.3:
        x = cv2.GaussianBlur(x, (0, 0), r.uniform(0.3, 1.2))
    elif r.random() < 0.3:
        x = (x + r.uniform(0.3, 1.5) * (x - cv2.GaussianBlur(x, (0, 0), 1.0))).clip(0.0, 1.0)
    if r.random() < 0.15:  # lighter to one side
        along = np.linspace(-1.0, 1.0, SIDE)
        x = x * (1.0 + r.uniform(-0.4, 0.4) * along[None, :, None] + r.uniform(-0.4, 0.4) * along[:, None, None])
    if r.random() < 0.4:
        x = x + r.normal(0.0, r.uniform(0.0, 0.05), x.shape)
    out = (255.0 * x.clip(0.0, 1.0)).astype(np.uint8)
    if r.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(r.integers(30, 90))]
        out = cv2.imdecode(cv2.imencode(".jpg", out, quality)[1], cv2.IMREAD_COLOR)
    return out
