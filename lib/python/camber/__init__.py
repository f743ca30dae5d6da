"""Metric road surfaces and vehicles from a few frames of one moving camera.

    import camber
    camera = camber.PinholeCamera(1242, 375, fx=721.5, fy=721.5, cx=609.6, cy=172.9)
    scene = camber.Scene(camera, [image0, image1, image2], height_above_road=1.65)
    result = camber.reconstruct(scene)
    result.cloud.points      # N x 3, metres, in the reference camera's frame
    result.surface.query([0, 0, 20])

Names, fields, frames and units are those of the C++ library (docs/conventions.md): metres, radians,
camera frame x right, y down, z forward. Statuses and choices are strings.
"""

from ._core import *  # noqa: F401,F403
from ._core import __version__  # noqa: F401
from ._profile import profile as profile
