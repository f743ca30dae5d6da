"""Clouds as arrays: one plane, the ground, files; and to other libraries and back.

  02_clouds.py samples/steep_hill/truth/road.ply
"""

import math
import sys

import numpy

import camber


def main() -> None:
    # Any N x 3 array is a cloud: a floor with a box on it and 1 cm of noise, z up.
    random = numpy.random.default_rng(1)
    floor = random.uniform([-10, -10, 0], [10, 10, 0], (20000, 3))
    box = random.uniform([2, 2, 0], [4, 4, 1.5], (3000, 3))
    points = numpy.vstack([floor, box]) + random.normal(0, 0.01, (23000, 3))

    fit = camber.fit_plane(points)
    tilt, height = numpy.sqrt(numpy.diag(fit.plane.covariance))[1:]
    print(f"{fit.num_inliers} of {len(points)} points on a plane, {fit.plane.plane}")
    print(f"known to {math.degrees(tilt):.4f} degrees and {1000 * height:.2f} mm")

    ground = camber.segment_ground(points, largest_object=5.0)
    print(f"{ground.ground} points are ground, within {ground.tolerance:.2f} m")

    # A file's cloud; its arrays are views, what is written to them is in the cloud.
    cloud = camber.read_cloud(sys.argv[1] if len(sys.argv) > 1
                              else "samples/steep_hill/truth/road.ply")
    fit = camber.fit_plane(cloud)
    near = numpy.zeros(len(cloud), int)
    near[fit.inliers] = 1
    cloud.set_label("on_plane", near)
    print(cloud)

    # Open3D, PCL's bindings and others take and give plain arrays:
    #   pcd = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(cloud.true_points()))
    #   cloud = camber.RoadCloud(numpy.asarray(pcd.points), normals=numpy.asarray(pcd.normals))
    again = camber.RoadCloud(cloud.true_points(), frame=cloud.frame, labels=cloud.labels)
    print(f"the same after a round trip: {numpy.array_equal(again.points, cloud.points)}")


if __name__ == "__main__":
    main()
