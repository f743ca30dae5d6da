"""A reconstructed cloud measured against the truth, which is in the camera of frame 0.

  camber reconstruct samples/steep_hill --out out/steep_hill
  04_compare.py out/steep_hill samples/steep_hill/truth/road.ply [PICTURE.png]
"""

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
    if len(sys.argv) < 3:
        sys.exit(str(__doc__))
    folder = pathlib.Path(sys.argv[1])
    estimate, truth = camber.read_cloud(folder / "road.ply"), camber.read_cloud(sys.argv[2])
    reference_from_first = camber.read_run(folder / "run.json").cameras[0]
    found = camber.compare(estimate, truth, estimate_from_truth=reference_from_first,
                           thresholds=[0.05, 0.1, 0.2], along=[0, 0, 1])
    print(found)
    print(f"half of the points are within {1000 * found.accuracy.summary.median:.0f} mm")
    if len(sys.argv) > 3:
        height = found.map.error
        limit = float(numpy.nanquantile(numpy.abs(height), 0.95))
        extent = (found.map.u, found.map.u + height.shape[1] * found.map.cell,
                  found.map.v, found.map.v + height.shape[0] * found.map.cell)
        figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
        drawn = axes.imshow(height, origin="lower", extent=extent, cmap="RdBu", vmin=-limit,
                            vmax=limit)
        figure.colorbar(drawn, label="height error, m")
        axes.set_xlabel("along the road, m")
        axes.set_ylabel("to its left, m")
        figure.savefig(sys.argv[3])
        plt.close(figure)


if __name__ == "__main__":
    main()
