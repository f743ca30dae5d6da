"""profile() of whatever has a height: results, surfaces and clouds."""

import pathlib
from typing import Any, List, Optional, Union

from numpy.typing import ArrayLike

from . import _core


def profile(source: Any, along: Optional[ArrayLike] = None,
            **options: Any) -> Union[List[_core.ProfilePoint], List[_core.CrossSection]]:
    """Height, grade and cross slope along a line, as camber profile measures them.

    source: a result of reconstruct() or a surface (options: those of road_profile), the path of a
    result folder or its surface.json; or a cloud, N x 3 or a file (options: those of profile_cloud).
    along: N x 3, metres, in the source's frame; None: the driven line of a result."""
    if isinstance(source, _core.Reconstruction):
        source = source.surface
    if isinstance(source, (str, pathlib.PurePath)):
        path = pathlib.Path(source)
        if path.is_dir():
            inner = path / "surface" / "surface.json"  # of a drive
            source = _core.read_surface(inner if inner.exists() else path / "surface.json")
        elif path.suffix == ".json":
            source = _core.read_surface(path)
        else:
            source = _core.read_cloud(path)
    if isinstance(source, _core.RoadSurface):
        return _core.road_profile(source, along, **options)
    if along is None:
        raise ValueError("along: a cloud has no driven line, expected N x 3 numbers")
    return _core.profile_cloud(source, along, **options)
