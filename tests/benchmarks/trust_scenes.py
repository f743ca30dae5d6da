"""Scenes of trust.py: made, read, edited by switches and faults, and what their truth shows."""

import copy
import hashlib
import json
import math
import os
import pathlib
import re
import shlex
import subprocess
from concurrent.futures import ThreadPoolExecutor

import png8
from benchmark_json import BadInput

DEFAULT_HEIGHT_SIGMA = 0.01  # m, as camera.height_sigma of scene.json has it
ROAD_LABEL = 7               # of the true labels (Cityscapes)
NEAR_ROAD = 15.0             # m
NEAR_CAR = 30.0              # m
EXPOSURE_JUMP = 1.6          # of the frame that jumps
POSE_FAULT_DEG = 1.0

PLAIN_FAULTS = ("none", "cx0", "fov", "repeat", "other", "exposure", "black", "pose")
FAULT_PATTERN = re.compile(r"(height|focal|speed)([+-]?\d+)$")
FOV_PATTERN = re.compile(r"fov([+-]\d+)$")
FOV_SIGMA_DEG = 5.0          # of a guessed field of view, as `camber import --fov` states it
GUESSED_HEIGHT_SIGMA = 0.03  # m, of the height that goes with it, likewise
CODER_PATTERN = re.compile(r"h26([45]):([1-9]\d*)$")
SPEED_SIGMA = 0.02           # relative, of given speeds
LEAST_SPEED_SIGMA = 0.01     # m/s, also where a car stands


class Scene:
    """A scene's folder and manifest; hash: of the manifest's bytes."""

    def __init__(self, folder, name):
        self.folder, self.name = pathlib.Path(folder).resolve(), name
        path = self.folder / "scene.json"
        try:
            data = path.read_bytes()
            self.manifest = json.loads(data)
            self.ids = [frame["id"] for frame in self.manifest["frames"]]
            self.camera = self.manifest["camera"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise BadInput(f"{path}: no scene's manifest ({error})") from error
        self.hash = hashlib.sha256(data).hexdigest()[:16]
        truth = self.manifest.get("truth", {}).get("frames", [])
        self.truth = {frame["id"]: frame for frame in truth}

    def path(self, name):
        return str(self.folder / name)

    def reference(self, used):
        """Id of the reference frame of a run over these frames."""
        given = self.manifest.get("reference_frame")
        return given if given in used else used[len(used) // 2]

    def true_height(self):
        """m, of the camera over the ego plane in the reference frame; None: not known."""
        frame = self.truth.get(self.reference(self.ids), {})
        return frame.get("ego_plane", {}).get("offset")


# --- made scenes ---------------------------------------------------------------------------------

def make_scenes(arguments, program):
    """The scenes of the numbers asked for, by number; those that are not there yet are made."""
    folder = arguments.scenes
    folder.mkdir(parents=True, exist_ok=True)
    if arguments.maker == "folder":
        return scenes_of_folder(folder, arguments.numbers)
    pattern = {"steep_scenes": "scene_{:06d}", "synth": "synth_{:06d}"}[arguments.maker]
    folders = {n: folder / pattern.format(n) for n in arguments.numbers}
    missing = [n for n in arguments.numbers if not (folders[n] / "scene.json").exists()]
    if missing and arguments.maker == "steep_scenes":
        make_steep_scenes(arguments.steep_scenes, folder, missing)
    elif missing:
        with ThreadPoolExecutor(arguments.jobs) as pool:
            list(pool.map(lambda n: make_synth_scene(program, n, folders[n]), missing))
    return {n: Scene(folders[n], folders[n].name) for n in arguments.numbers}


def scenes_of_folder(folder, numbers):
    """The folders with a scene.json in it, numbered in order of their names."""
    found = sorted(path.parent for path in folder.glob("*/scene.json"))
    if not found:
        raise BadInput(f"{folder}: no folders with a scene.json")
    return {n: Scene(found[n], found[n].name) for n in numbers if n < len(found)}


def make_steep_scenes(script, folder, numbers):
    if script is None:
        raise BadInput(f"--steep-scenes: not given, and {len(numbers)} scenes are to be made")
    try:
        with open(script, encoding="utf-8") as file:
            first = file.readline()
    except OSError as error:
        raise BadInput(f"{script}: {error.strerror}") from error
    interpreter = shlex.split(first[2:]) if first.startswith("#!") else ["python3"]
    done = subprocess.run([*interpreter, str(script), "--out", str(folder), *map(str, numbers)],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise BadInput(f"{script}: ended with {done.returncode}: {last_line(done.stderr)}")


def make_synth_scene(program, number, folder):
    part = folder.with_name(folder.name + ".part")
    done = subprocess.run(
        [str(program), "synth", "--random", str(number), "--out", str(part), "--overwrite",
         "--threads", "1", "--quiet"], capture_output=True, text=True, check=False)
    if done.returncode:
        raise BadInput(f"camber synth --random {number}: {last_line(done.stderr)}")
    os.replace(part, folder)


def last_line(text):
    lines = text.strip().splitlines()
    return lines[-1] if lines else "nothing printed"


# --- edited manifests ----------------------------------------------------------------------------

def check_fault(name):
    """Whether a fault's name is one; height, focal and speed carry their per cent, fov degrees."""
    match, fov = FAULT_PATTERN.match(name), FOV_PATTERN.match(name)
    return (name in PLAIN_FAULTS or bool(match and -90 <= int(match[2]) <= 900) or
            bool(fov and abs(int(fov[1])) <= 60))


def used_frames(scene, frames):
    """Ids of a run over '1:3', '0:4:2' or '0+2+4'; None for the command's own choice."""
    if frames.startswith("none"):
        return None
    if "+" in frames:
        used = [int(text) for text in frames.split("+")]
    else:
        first, last, *step = map(int, frames.split(":"))
        used = list(range(first, last + 1, *step))
    return used


def standard_normal(*key):
    """A draw that depends on its key alone: Box and Muller over a hash."""
    digest = hashlib.sha256("/".join(map(str, key)).encode()).digest()
    u, v = (int.from_bytes(digest[i:i + 8], "big") for i in (0, 8))
    return math.sqrt(-2.0 * math.log((u + 1) / 2.0**64)) * math.cos(2.0 * math.pi * v / 2.0**64)


def edited_manifest(scene, definition, other, folder, coded=None):
    """The manifest of a run, with absolute paths; changed images go to the folder.

    coded: images in place of the scene's, by frame."""
    manifest = copy.deepcopy(scene.manifest)
    frames = manifest["frames"]
    if "@" in definition["frames"]:
        manifest["reference_frame"] = int(definition["frames"].split("@")[1])
    for frame in frames:
        for key in ("image", "segmentation", "road_mask"):
            if key in frame:
                frame[key] = scene.path(frame[key])
        if not definition["masks"]:
            frame.pop("segmentation", None)
            frame.pop("road_mask", None)
        if not definition["detections"]:
            frame["vehicles"] = []
    truth = manifest.get("truth", {})
    if "cloud" in truth:
        truth["cloud"] = scene.path(truth["cloud"])
    for frame in truth.get("frames", []):
        for key in ("label", "depth"):
            if key in frame:
                frame[key] = scene.path(frame[key])
    for frame in frames if coded else []:
        frame["image"] = coded[frame["id"]]
    if not definition["markings"]:
        manifest.pop("markings_m", None)
    if definition.get("speed"):
        give_speeds(scene, manifest, definition["seed"])
    if definition["fault"].startswith("fov"):
        manifest["camera"]["height_sigma"] = GUESSED_HEIGHT_SIGMA
    draw_height(scene, manifest["camera"], definition["seed"])
    inject(scene, manifest, definition, other, folder)
    return manifest


def draw_height(scene, camera, seed):
    """The true height with an error of the stated sigma; without truth as it is given."""
    truth = scene.true_height()
    if truth is not None and "height_above_road" in camera:
        sigma = camera.get("height_sigma", DEFAULT_HEIGHT_SIGMA)
        camera["height_above_road"] = truth + sigma * standard_normal("height", scene.name, seed)


def inject(scene, manifest, definition, other, folder):
    """The fault, into the camera or into the frame after the reference frame."""
    fault, camera = definition["fault"], manifest["camera"]
    match = FAULT_PATTERN.match(fault)
    if match:
        factor = 1.0 + int(match[2]) / 100.0
        if match[1] == "speed":
            for frame in manifest["frames"]:
                if "speed" in frame:
                    frame["speed"] *= factor
        else:
            for key in ("height_above_road",) if match[1] == "height" else ("fx", "fy"):
                camera[key] *= factor
    elif fault == "cx0":
        camera["cx"] = 0.0
    elif fault.startswith("fov"):
        guess_field_of_view(scene, camera, fault, definition["seed"])
    used = used_frames(scene, definition["frames"]) or scene.ids
    used = [frame for frame in used if frame in scene.ids]
    if not used:
        return  # the command names the frames that are not there
    at = used.index(scene.reference(used))
    by_id = {frame["id"]: frame for frame in manifest["frames"]}
    wrong = by_id[used[at + 1 if at + 1 < len(used) else at - 1]]
    if fault == "repeat":
        take_images(wrong, by_id[used[at]])
    elif fault == "other":
        take_images(wrong, fitted_frame(other, camera, folder))
    elif fault in ("exposure", "black"):
        image = png8.read(wrong["image"])
        image = png8.brightened(image, EXPOSURE_JUMP) if fault == "exposure" else (
            png8.half_black(image))
        wrong["image"] = str(folder / "image.png")
        png8.write(wrong["image"], image)
    if definition["poses"]:
        give_poses(scene, manifest)
    if fault == "pose":
        turn(wrong, scene, definition["seed"])


def guess_field_of_view(scene, camera, fault, seed):
    """A focal length by a field of view that is off by the fault's degrees, or by a draw of
    FOV_SIGMA_DEG; FOV_SIGMA_DEG is stated of it, the principal point stays."""
    wrong = FOV_PATTERN.match(fault)
    off = float(wrong[1]) if wrong else FOV_SIGMA_DEG * standard_normal("fov", scene.name, seed)
    true = 2.0 * math.atan(0.5 * camera["width"] / camera["fx"])
    guessed = min(max(true + math.radians(off), math.radians(5.0)), math.radians(170.0))
    factor = math.tan(0.5 * true) / math.tan(0.5 * guessed)
    camera["fx"] *= factor
    camera["fy"] *= factor
    camera["focal_sigma"] = math.radians(FOV_SIGMA_DEG) / math.sin(guessed)


def take_images(frame, source):
    """All that was seen in another frame, at this one's time."""
    for key in ("image", "segmentation", "road_mask", "vehicles"):
        frame.pop(key, None)
        if key in source:
            frame[key] = source[key]


def fitted_frame(scene, camera, folder):
    """The reference frame of a scene with its images and detections in another camera's size."""
    frame = copy.deepcopy(next(f for f in scene.manifest["frames"]
                               if f["id"] == scene.reference(scene.ids)))
    width, height = camera["width"], camera["height"]
    for key in ("image", "segmentation", "road_mask"):
        if key not in frame:
            continue
        source = scene.path(frame[key])
        frame[key] = source
        if png8.size_of(source) != (width, height):
            frame[key] = str(folder / f"{key}.png")
            png8.write(frame[key], png8.resized(png8.read(source), width, height))
    du, dv = width / scene.camera["width"], height / scene.camera["height"]
    for vehicle in frame.get("vehicles", []):
        vehicle["box"] = [x * s for x, s in zip(vehicle["box"], (du, dv, du, dv))]
        if "keypoints" in vehicle:
            vehicle["keypoints"] = [[p[0] * du, p[1] * dv, *p[2:]] for p in vehicle["keypoints"]]
    return frame


def give_poses(scene, manifest):
    """The true poses as known ones."""
    for frame in manifest["frames"]:
        pose = scene.truth.get(frame["id"], {}).get("world_from_camera")
        if pose is None:
            raise BadInput(f"{scene.folder}: frame {frame['id']} has no true pose to be given")
        frame["world_from_camera"] = list(pose)


def give_speeds(scene, manifest, seed):
    """The speeds of the true poses, times one draw of their sigma."""
    frames = [f for f in manifest["frames"] if "world_from_camera" in scene.truth.get(f["id"], {})]
    places = [scene.truth[f["id"]]["world_from_camera"][3:12:4] for f in frames]
    times = times_of(manifest)
    factor = 1.0 + SPEED_SIGMA * standard_normal("speed", scene.name, seed)
    for k, frame in enumerate(frames):
        a, b = max(k - 1, 0), min(k + 1, len(frames) - 1)
        way = math.dist(places[a], places[k]) + math.dist(places[k], places[b])
        elapsed = times[frames[b]["id"]] - times[frames[a]["id"]]
        if not elapsed > 0.0:
            raise BadInput(f"{scene.folder}: no times for speeds")
        frame["speed"] = factor * way / elapsed
        frame["speed_sigma"] = max(SPEED_SIGMA * frame["speed"], LEAST_SPEED_SIGMA)


def times_of(manifest):
    """Times of the frames, s, by id."""
    rate = manifest.get("frame_rate", 10.0)
    return {f["id"]: f.get("time_s", f["id"] / rate) for f in manifest["frames"]}


def coded_images(scene, coder, folder):
    """The scene's images as a film shows them, by frame; each film is made once."""
    into = folder / "coded" / f"{scene.name}-{scene.hash}-{coder.replace(':', '-')}"
    images = {frame: str((into / f"{k + 1:06d}.png").resolve())
              for k, frame in enumerate(scene.ids)}
    if into.exists():
        return images
    kind, rate = CODER_PATTERN.match(coder).groups()
    times = sorted(times_of(scene.manifest).values())
    fps = (len(times) - 1) / (times[-1] - times[0]) if times[-1] > times[0] else 10.0
    part = into.with_name(into.name + ".part")
    (part / "in").mkdir(parents=True, exist_ok=True)
    for k, frame in enumerate(scene.manifest["frames"]):
        link = part / "in" / f"{k + 1:06d}{pathlib.Path(frame['image']).suffix}"
        link.unlink(missing_ok=True)
        link.symlink_to(scene.path(frame["image"]))
    suffix = pathlib.Path(scene.manifest["frames"][0]["image"]).suffix
    film, size = part / "film.mp4", f"{scene.camera['width']}:{scene.camera['height']}"
    for words in (["-framerate", f"{fps:.6f}", "-i", str(part / "in" / f"%06d{suffix}"),
                   "-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-c:v",
                   f"libx26{kind}", "-b:v", f"{rate}k", "-threads", "1", str(film)],
                  ["-i", str(film), "-vf", f"crop={size}:0:0", str(part / "%06d.png")]):
        try:
            done = subprocess.run(["ffmpeg", "-loglevel", "error", "-y", *words],
                                  capture_output=True, text=True, check=False)
        except OSError as error:
            raise BadInput(f"ffmpeg: {error.strerror}") from error
        if done.returncode:
            raise BadInput(f"ffmpeg: {last_line(done.stderr)}")
    os.replace(part, into)
    return images


def turn(frame, scene, seed):
    """The known pose of a frame, turned about an axis drawn at random."""
    axis = [standard_normal("axis", i, scene.name, seed) for i in range(3)]
    length = math.sqrt(sum(x * x for x in axis))
    x, y, z = (a / length for a in axis)
    s = math.sin(math.radians(POSE_FAULT_DEG))
    c = 1.0 - math.cos(math.radians(POSE_FAULT_DEG))
    rotation = [[1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
                [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
                [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)]]
    pose = frame["world_from_camera"]
    turned = [[sum(pose[4 * i + k] * rotation[k][j] for k in range(3)) for j in range(3)]
              for i in range(3)]
    for i in range(3):
        pose[4 * i:4 * i + 3] = turned[i]


# --- what the truth shows ------------------------------------------------------------------------

def facts_of(scene):
    """What decides whether a scene's scale can be known, from its truth.

    motion: camera heights a frame (median); near_road: the smaller number of pixels of road nearer
    than 15 m in the first and last frames that have depth; cars: number nearer than 30 m in the
    reference frame; oblique: those of them seen at 20 to 70 degrees to their length; turn_deg:
    between the first and the last frame. None: not known."""
    height = scene.true_height() or scene.camera.get("height_above_road")
    poses = [scene.truth[i]["world_from_camera"] for i in scene.ids
             if "world_from_camera" in scene.truth.get(i, {})]
    motion = None
    if len(poses) == len(scene.ids) > 1 and height:
        steps = sorted(math.dist(a[3:12:4], b[3:12:4]) for a, b in zip(poses, poses[1:]))
        motion = steps[len(steps) // 2] / height
    measured = [frame for frame in scene.truth.values() if "depth" in frame and "label" in frame]
    near = [near_road_pixels(scene, measured[i]) for i in (0, -1)] if len(measured) > 1 else [None]
    cars = scene.truth.get(scene.reference(scene.ids), {}).get("vehicles", [])
    near_cars = [car for car in cars if math.hypot(*car["bottom_center"]) < NEAR_CAR]
    return {"motion": motion, "near_road": None if None in near else min(near),
            "cars": len(near_cars), "turn_deg": turn_deg(scene, scene.ids),
            "oblique": sum(20.0 < viewing_angle_deg(car) < 70.0 for car in near_cars)}


def near_road_pixels(scene, frame):
    label, depth = (png8.read(scene.path(frame[key])) for key in ("label", "depth"))
    if label.bits != 8 or depth.bits != 16 or frame["depth_encoding"] != "kitti":
        return None
    limit = int(256.0 * NEAR_ROAD)  # KITTI's encoding: metres times 256, 0: no depth
    return sum(kind == ROAD_LABEL and 0 < metres < limit
               for v in range(label.height)
               for kind, metres in zip(png8.samples(label, v), png8.samples(depth, v)))


def viewing_angle_deg(car):
    """Between the ray to a car and its length, in the ground, 0 to 90 degrees."""
    if "rotation" in car:
        x, z = car["rotation"][0], car["rotation"][6]
    else:
        x, z = math.cos(car["rotation_y"]), -math.sin(car["rotation_y"])
    u, _, w = car["bottom_center"]
    along = abs(x * u + z * w) / max(math.hypot(x, z) * math.hypot(u, w), 1e-12)
    return math.degrees(math.acos(min(1.0, along)))


def turn_deg(scene, used):
    """Between the first and the last of these frames; None: not known."""
    poses = [scene.truth.get(i, {}).get("world_from_camera") for i in (used[0], used[-1])]
    if None in poses:
        return None
    trace = sum(poses[0][4 * i + k] * poses[1][4 * i + k] for i in range(3) for k in range(3))
    return math.degrees(math.acos(max(-1.0, min(1.0, (trace - 1.0) / 2.0))))
