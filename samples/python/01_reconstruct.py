"""The main job from arrays: images, masks and detections in memory to a road with vehicles on it.

  01_reconstruct.py samples/steep_hill [PICTURE.png]
"""

import json
import pathlib
import sys

try:
    import matplotlib
    import numpy
    from PIL import Image
except ImportError as error:
    sys.exit(f"{error}: apt install python3-matplotlib python3-numpy python3-pil")

import camber

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def scene_of_arrays(folder: pathlib.Path) -> camber.Scene:
    """The scene as a program would make it that has its own images and detector."""
    manifest = json.loads((folder / "scene.json").read_text())
    given = manifest["camera"]
    camera = camber.PinholeCamera(given["width"], given["height"], fx=given["fx"], fy=given["fy"],
                                  cx=given["cx"], cy=given["cy"])
    scene = camber.Scene(camera, height_above_road=given["height_above_road"],
                         frame_rate=manifest["frame_rate"],
                         reference_frame=manifest["reference_frame"],
                         detections_source=manifest["detections_source"],
                         markings_m=manifest["markings_m"],
                         segmentation_classes=manifest["segmentation_classes"])
    for frame in manifest["frames"]:
        scene.add_frame(
            numpy.asarray(Image.open(folder / frame["image"])),
            segmentation=numpy.asarray(Image.open(folder / frame["segmentation"])),
            time_s=frame["time_s"],
            vehicles=[camber.VehicleDetection(v["box"], id=v["id"], keypoints=v["keypoints"],
                                              score=v.get("score", 1.0), track=v.get("track", -1))
                      for v in frame["vehicles"]])
    return scene


def picture(result: camber.Reconstruction, camera: camber.PinholeCamera, path: str) -> None:
    """The reference image with the road's points, coloured by how well their place is known."""
    points = result.cloud.points[result.cloud.points[:, 2] > 1]
    sigmas = result.cloud.sigmas[result.cloud.points[:, 2] > 1]
    pixels = points @ camera.matrix().T
    figure, axes = plt.subplots(figsize=(10, 3.6), layout="constrained")
    axes.imshow(result.images[result.frame_ids.index(result.reference_frame)])
    drawn = axes.scatter(pixels[:, 0] / pixels[:, 2], pixels[:, 1] / pixels[:, 2], s=1, c=sigmas,
                         cmap="cividis", norm=matplotlib.colors.LogNorm())
    figure.colorbar(drawn, label="standard deviation along the ray, m")
    axes.set_axis_off()
    figure.savefig(path)
    plt.close(figure)


def main() -> None:
    folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "samples/steep_hill")
    scene = scene_of_arrays(folder)
    print(scene)

    def progress(stage: str, share: float) -> None:
        if sys.stderr.isatty():
            print(f"\r{share:4.0%} {stage:20}", end="", file=sys.stderr)

    result = camber.reconstruct(scene, progress=progress)
    print(result)
    for frame in result.vehicles.frames:
        for vehicle in frame.vehicles:
            x, y, z = vehicle.pose.center
            print(f"frame {frame.id}, {vehicle.vehicle_class} {vehicle.id}: {z:.1f} m ahead, "
                  f"{y:.2f} m down, {vehicle.status}")
    road = result.surface.query([0, 0, 20])
    print(f"20 m ahead the road is {road.point[1]:.2f} +- {road.sigma_height:.2f} m below the camera")
    if len(sys.argv) > 2:
        picture(result, scene.camera, sys.argv[2])


if __name__ == "__main__":
    main()
