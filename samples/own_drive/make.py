#!/usr/bin/env python3
"""Makes samples/own_drive again: what a person with a dash camera and a detector has.

    samples/own_drive/make.py [CAMBER]      (default: build/release/bin/camber; needs ffmpeg)

A drive that `camber synth` draws through a lens, as a video, with the camera's calibration as
OpenCV writes it and the boxes of the simulated detector as COCO results, both in the pixels of the
video. No truth is kept: tests make it again from the same seed.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
FOCAL, MIDDLE, SIZE = 560.0, (478.5, 250.0), (960, 540)
LENS = [-0.3, 0.1, 0.0004, -0.0003, -0.012]
FRAMES, RATE = 20, 10
SYNTH = ["synth", "--profile", "steep_hill", "--seed", "21", "--frames", str(FRAMES),
         "--hz", str(RATE), "--speed", "8", "--camera-height", "1.4", "--cloud-points", "0",
         "--size", "{}x{}".format(*SIZE),
         "--intrinsics", "{0},{0},{1},{2}".format(FOCAL, *MIDDLE),
         "--distortion", "brown," + ",".join(map(str, LENS))]


def through_lens(x, y, camera):
    """A pixel of the manifest's camera in the image files (Brown's model, forwards)."""
    x, y = (x - camera["cx"]) / camera["fx"], (y - camera["cy"]) / camera["fy"]
    k1, k2, p1, p2, k3 = LENS
    s = x * x + y * y
    ratio = 1 + s * (k1 + s * (k2 + s * k3))
    return (FOCAL * (ratio * x + 2 * p1 * x * y + p2 * (s + 2 * x * x)) + MIDDLE[0],
            FOCAL * (ratio * y + p1 * (s + 2 * y * y) + 2 * p2 * x * y) + MIDDLE[1])


def box_in_files(box, camera):
    """Each side where its middle half is seen: a car meets it there, seldom in a corner."""
    x1, y1, x2, y2 = box
    shares = [0.25 + 0.5 * i / 8 for i in range(9)]
    rows = [y1 + t * (y2 - y1) for t in shares]
    columns = [x1 + t * (x2 - x1) for t in shares]

    def mean(values):
        return sum(values) / len(values)
    left = mean([through_lens(x1, y, camera)[0] for y in rows])
    right = mean([through_lens(x2, y, camera)[0] for y in rows])
    top = mean([through_lens(x, y1, camera)[1] for x in columns])
    bottom = mean([through_lens(x, y2, camera)[1] for x in columns])
    left, right = max(left, 0.0), min(right, SIZE[0] - 1.0)
    top, bottom = max(top, 0.0), min(bottom, SIZE[1] - 1.0)
    return [round(v, 2) for v in (left, top, right - left, bottom - top)]


def write_calibration(path):
    path.write_text("""%YAML:1.0
---
image_width: {0}
image_height: {1}
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ {2}, 0., {3}, 0., {2}, {4}, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ {5} ]
""".format(*SIZE, FOCAL, *MIDDLE, ", ".join(map(str, LENS))))


def write_boxes(scene, path):
    """COCO with images, so that boxes find their frames by number."""
    images, annotations = [], []
    for frame in scene["frames"]:
        images.append({"id": frame["id"], "file_name": "drive_{:06d}.png".format(frame["id"]),
                       "width": SIZE[0], "height": SIZE[1]})
        for vehicle in frame["vehicles"]:
            box = box_in_files(vehicle["box"], scene["camera"])
            annotations.append({"id": len(annotations) + 1, "image_id": frame["id"],
                                "category_id": 1, "bbox": box, "score": vehicle["score"],
                                "area": round(box[2] * box[3], 2), "iscrowd": 0})
    lines = ",\n".join(json.dumps(a) for a in annotations)
    path.write_text('{{"images": {},\n"categories": [{{"id": 1, "name": "car"}}],\n'
                    '"annotations": [\n{}\n]}}\n'.format(json.dumps(images), lines))


def main():
    camber = sys.argv[1] if len(sys.argv) > 1 else str(
        HERE.parent.parent / "build/release/bin/camber")
    with tempfile.TemporaryDirectory() as folder:
        scene = pathlib.Path(folder) / "scene"
        subprocess.run([camber, *SYNTH, "--out", str(scene)], check=True)
        subprocess.run(["ffmpeg", "-loglevel", "error", "-y", "-framerate", str(RATE),
                        "-i", str(scene / "image/%06d.png"), "-c:v", "libx264",
                        "-preset", "veryslow", "-crf", "16", "-pix_fmt", "yuv420p",
                        "-threads", "1", "-map_metadata", "-1", "-fflags", "+bitexact",
                        "-flags:v", "+bitexact", str(HERE / "drive.mp4")], check=True)
        write_boxes(json.loads((scene / "scene.json").read_text()), HERE / "boxes.json")
    write_calibration(HERE / "camera.yaml")


if __name__ == "__main__":
    main()
