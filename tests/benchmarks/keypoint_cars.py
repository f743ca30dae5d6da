"""Labelled cars of KITTI for bench_keypoints.py: scenes of them, and keypoints against a labelled
car's box."""

import json
import math
import pathlib
from dataclasses import dataclass, field
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple

import numpy as np
from numpy.typing import NDArray

from benchmark_json import ROOT

LEAST_HEIGHT = 40.0    # px, of the labelled box
MOST_OCCLUSION = 0.5   # between KITTI's states 1 (0.3) and 2 (0.8), as `import kitti` has them
MARGIN = 0.05          # of the box's height, around the projected box
NEAREST = 0.3          # m: what is nearer is cut off before it is projected
CROP_MARGIN = 1.15     # side of the network's crop over the box's larger side
FAR_OFF = 0.5          # of the box's height: a keypoint that is farther off counts as so far off

WHEELS, ROOF, BUMPERS = (0, 1, 18, 19), (13, 14, 31, 32), (10, 17, 28, 35)
JUDGED = WHEELS + ROOF + BUMPERS
SIDES_SWAPPED = np.array([(k + 18) % 36 for k in range(36)])

Array = NDArray[np.float64]
Run = Callable[..., Any]  # words of a command of the program to its JSON


@dataclass
class KittiScene:
    """A scene with the labels' boxes as detections; key: sequence or data set."""
    key: str
    path: pathlib.Path


@dataclass
class Car:
    """A labelled car in one frame."""
    name: str                  # of the car: sequence and track, or frame and row
    frame: str
    camera: Dict[str, float]
    detection: Dict[str, Any]  # box, keypoints
    center: Array         # m
    rotation: Array       # camera from vehicle
    dimensions: Array     # length, height, width, m
    truncation: float
    odd: bool = False
    outside: List[int] = field(default_factory=list)  # judged keypoints beyond the box's outline
    swap: str = ""
    swap_ratio: float = math.nan   # error of the best swap over that of the labelled pose
    center_error: Optional[float] = None
    yaw_error_deg: Optional[float] = None
    inside_95: bool = False

    @property
    def distance(self) -> float:
        return float(np.linalg.norm(self.center))

    @property
    def height(self) -> float:
        box = self.detection["box"]
        return float(box[3] - box[1])


def link_image(image: pathlib.Path, folder: pathlib.Path) -> pathlib.Path:
    """A folder of that image alone, named by its frame number as the importer wants it."""
    folder.mkdir(parents=True)
    (folder / (image.stem.split("_")[-1] + image.suffix)).symlink_to(image)
    return folder


def kitti_scenes(camber: Run, data: pathlib.Path, folder: pathlib.Path) -> Iterator[KittiScene]:
    """Scenes of the frames that are there, made below a folder."""
    labels = data / "kitti-tracking-labels"
    image = data / "kitti-car-keypoints" / "sequence_0003_frame_000013.png"
    clip, more = data / "kitti-tracking-0009-clip", labels / "image_02" / "0016"
    sources: List[Tuple[str, str, List[Any]]] = []
    if image.exists() and labels.is_dir():
        images = link_image(image.resolve(), folder / "image_02" / "0003")
        sources.append(("0003", "all", [images, labels / "calib/0003.txt",
                                        labels / "label_02/0003.txt"]))
    if clip.is_dir():
        sources.append(("0009", "48:53", [clip / "image_02", clip / "calib_0009.txt",
                                          clip / "label_02_0009.txt"]))
    if more.is_dir():
        sources.append(("0016", "all", [more, labels / "calib/0016.txt",
                                        labels / "label_02/0016.txt"]))
    objects = data / "kitti-object-frames"
    for path in sorted((objects / "image_2").glob("*.png")):
        sources.append((f"object {path.stem}", str(int(path.stem)),
                        [objects / "image_2", objects / "calib" / f"{path.stem}.txt",
                         objects / "label_2"]))
    for key, frames, (images, calibration, truth) in sources:
        out = folder / key.replace(" ", "_") / "scene.json"
        selected = [] if frames == "all" else ["--frames", frames]
        camber("import", "kitti", "--images", images, "--calib", calibration, "--labels", truth,
               "--detections-from-labels", "--camera", 2, *selected, "--out", out)
        yield KittiScene(key, out)


def rotation_of(vehicle: Dict[str, Any]) -> Array:
    """Camera from vehicle: columns forward, up, right."""
    if "rotation" in vehicle:
        return np.array(vehicle["rotation"], float).reshape(3, 3)
    yaw = vehicle["rotation_y"]
    forward, up = np.array([math.cos(yaw), 0.0, -math.sin(yaw)]), np.array([0.0, -1.0, 0.0])
    return np.stack([forward, up, np.cross(forward, up)], axis=1)


def cars_of(scene: KittiScene, manifest: Dict[str, Any]) -> Iterator[Car]:
    """The counted cars of a manifest with detections and truth, in order of frames and ids."""
    detections = {(frame["id"], vehicle["id"]): vehicle for frame in manifest["frames"]
                  for vehicle in frame.get("vehicles", [])}
    for frame in manifest["truth"]["frames"]:
        for truth in sorted(frame.get("vehicles", []), key=lambda v: int(v["id"])):
            box = truth["box"]
            if (truth.get("class", "car") != "car" or truth.get("occlusion", 0.0) > MOST_OCCLUSION
                    or box[3] - box[1] < LEAST_HEIGHT):
                continue
            size = truth["dimensions"]
            rotation = rotation_of(truth)
            center = np.array(truth["bottom_center"]) + 0.5 * size["height"] * rotation[:, 1]
            yield Car(name=f"{scene.key}/{truth['id']}", frame=f"{frame['id']:06d}",
                      camera=manifest["camera"], detection=detections[frame["id"], truth["id"]],
                      center=center, rotation=rotation,
                      dimensions=np.array([size["length"], size["height"], size["width"]]),
                      truncation=truth.get("truncation", 0.0))


def number_halves(cars: List[Car]) -> None:
    """Cars are counted in the order of their names; all frames of one car are in one half."""
    names = sorted({car.name for car in cars})
    for car in cars:
        car.odd = names.index(car.name) % 2 == 1


# --- projections ---------------------------------------------------------------------------------

def project(camera: Dict[str, float], points: Array) -> Array:
    return np.stack([camera["fx"] * points[:, 0] / points[:, 2] + camera["cx"],
                     camera["fy"] * points[:, 1] / points[:, 2] + camera["cy"]], axis=1)


def box_outline(car: Car) -> Array:
    """Convex hull of the labelled box's projection, px, in order."""
    signs = np.array([[a, b, c] for a in (-0.5, 0.5) for b in (-0.5, 0.5) for c in (-0.5, 0.5)])
    corners = car.center + (signs * car.dimensions) @ car.rotation.T
    points = [corner for corner in corners if corner[2] >= NEAREST]
    for i in range(8):
        for k in range(i):
            a, b = corners[i], corners[k]
            edge = np.count_nonzero(signs[i] != signs[k]) == 1
            if edge and (a[2] < NEAREST) != (b[2] < NEAREST):
                points.append(a + (NEAREST - a[2]) / (b[2] - a[2]) * (b - a))
    return convex_hull(project(car.camera, np.array(points)))


def convex_hull(points: Array) -> Array:
    """Andrew's monotone chain."""
    ordered = sorted((float(x), float(y)) for x, y in points)

    def chain(points: List[Tuple[float, float]]) -> List[Tuple[float, float]]:
        out: List[Tuple[float, float]] = []
        for p in points:
            while len(out) > 1 and ((out[-1][0] - out[-2][0]) * (p[1] - out[-2][1])
                                    <= (out[-1][1] - out[-2][1]) * (p[0] - out[-2][0])):
                out.pop()
            out.append(p)
        return out[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def distance_outside(hull: Array, point: Array) -> float:
    """px from a convex outline; 0 inside."""
    ends = np.roll(hull, -1, axis=0)
    along = ends - hull
    off = point - hull
    if np.all(along[:, 0] * off[:, 1] - along[:, 1] * off[:, 0] >= 0.0):
        return 0.0
    share = np.clip((off * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    return float(np.min(np.linalg.norm(off - share[:, None] * along, axis=1)))


# --- keypoints against the label -----------------------------------------------------------------

def shipped_shapes() -> List[Array]:
    """Mean keypoints of the shipped prior, 36 x 3, over length, height and width."""
    path = ROOT / "lib/camber/vehicle/shipped_prior.json"
    out = []
    for shape in json.loads(path.read_text(encoding="utf-8"))["shapes"]:
        left = np.array(shape["mean"]).reshape(18, 3)
        out.append(np.concatenate([left, left * [1.0, 1.0, -1.0]]))
    return out


def judge_keypoints(car: Car, shapes: List[Array]) -> None:
    """What lies outside the box's outline, and whether left and right or front and rear are swapped:
    the labelled pose and the same turned by 180 degrees, each also with the numbers of left and right
    exchanged, with a mean shape of the labelled size."""
    found = np.array([row[:2] for row in car.detection["keypoints"]], float)
    hull = box_outline(car)
    car.outside = [k for k in JUDGED
                   if not distance_outside(hull, found[k]) <= MARGIN * car.height]
    bottom = car.center - 0.5 * car.dimensions[1] * car.rotation[:, 1]

    def error(turned: bool, sides_swapped: bool) -> float:
        rotation = car.rotation * ([-1.0, 1.0, -1.0] if turned else [1.0, 1.0, 1.0])
        best = math.inf
        for shape in shapes:
            points = bottom + (shape * car.dimensions) @ rotation.T
            points[:, 2] = np.maximum(points[:, 2], NEAREST)
            expected = project(car.camera, points)
            if sides_swapped:
                expected = expected[SIDES_SWAPPED]
            off = np.linalg.norm(found - expected, axis=1) / car.height
            counted = inside_crop(car, expected)
            if counted.any():
                best = min(best, float(np.minimum(off, FAR_OFF)[counted].mean()))
        return best

    swaps = {"left/right": error(False, True), "turned": error(True, False),
             "front/rear": error(True, True)}
    name = min(swaps, key=lambda n: swaps[n])
    car.swap_ratio = swaps[name] / max(error(False, False), 1e-9)
    car.swap = name if car.swap_ratio < 1.0 else ""


def inside_crop(car: Car, points: Array) -> NDArray[np.bool_]:
    x1, y1, x2, y2 = car.detection["box"]
    reach = 0.5 * CROP_MARGIN * max(x2 - x1, y2 - y1)
    inside: NDArray[np.bool_] = np.all(
        np.abs(points - [0.5 * (x1 + x2), 0.5 * (y1 + y2)]) <= reach, axis=1)
    return inside


def judge_vehicle(car: Car, estimate: Dict[str, Any]) -> None:
    """Centre and yaw of an estimate against the label."""
    if estimate.get("center") is None or estimate.get("rotation") is None:
        return
    off = np.array(estimate["center"], float) - car.center
    forward = np.array(estimate["rotation"], float).reshape(3, 3)[:, 0]
    true = car.rotation[:, 0]
    yaw = math.atan2(-forward[2], forward[0]) - math.atan2(-true[2], true[0])
    car.center_error = float(np.linalg.norm(off))
    car.yaw_error_deg = abs(math.degrees(math.remainder(yaw, 2.0 * math.pi)))
    if estimate.get("covariance"):
        covariance = np.array(estimate["covariance"], float).reshape(9, 9)[:3, :3]
        car.inside_95 = float(off @ np.linalg.solve(covariance, off)) <= 7.815  # chi-square, 3
