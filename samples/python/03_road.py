"""A cloud as planar patches, and a road's profile with its standard deviation.

  camber reconstruct samples/steep_hill --out out/steep_hill
  03_road.py out/steep_hill [PICTURE.png]
"""

import math
import pathlib
import sys

try:
    import matplotlib
    import numpy
except ImportError as error:
    sys.exit(f"{error}: apt install python3-matplotlib python3-numpy")

import camber

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402


def main() -> None:
    folder = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "out/steep_hill")
    fit = camber.fit_road_surface(camber.read_cloud(folder / "road.ply"))
    print(fit)
    for patch in sorted(fit.surface.patches, key=lambda p: -p.inliers)[:3]:
        print(f"  patch {patch.id}: {patch.inliers} points, "
              f"grade {math.degrees(patch.grade):+.1f} degrees")

    surface = camber.read_surface(folder / "surface.json")
    line = numpy.column_stack([numpy.zeros(41), numpy.zeros(41), numpy.arange(5, 46)])
    profile = camber.road_profile(surface, line, step=1.0, reach=1.0)
    known = [p for p in profile if p.status != "failed"]
    station = numpy.array([p.station for p in known])
    height = numpy.array([p.height for p in known])
    sigma = numpy.array([p.sigma_height for p in known])
    print(f"{len(known)} of {len(profile)} stations, the road climbs {height[-1] - height[0]:.1f} m")
    if len(sys.argv) > 2:
        figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
        axes.fill_between(station, height - 2 * sigma, height + 2 * sigma, alpha=0.3,
                          label="2 standard deviations")
        axes.plot(station, height, label="road")
        axes.set_xlabel("along the line, m")
        axes.set_ylabel("height, m")
        axes.legend()
        figure.savefig(sys.argv[2])
        plt.close(figure)


if __name__ == "__main__":
    main()
