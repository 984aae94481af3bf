"""WGS84 degrees to metres of the map frame, and back: a projection at the map's origin.

The datum is robot_localization's: latitude, longitude, and the heading of the map's x axis from east
towards north.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.errors import InvalidValueError, require

Points = NDArray[np.float64]
"""(N, 2)."""

Project = Callable[[Points, bool], tuple[Points, Points]]
"""Degrees to metres of the projection's grid; with True, back."""


@dataclass(frozen=True, slots=True)
class Projection:
    """WGS84 degrees to metres of the map frame and back.

    Attributes:
        lat_deg, lon_deg: of the map's origin.
        heading_deg: of the map's x axis, from true east towards north.
        kind: tmerc, topocentric or utm; see `AreaConfig.projection`.
        alt_m: height of the map's origin above the ellipsoid, for topocentric.
    """

    lat_deg: float
    lon_deg: float
    heading_deg: float = 0.0
    kind: str = "tmerc"
    alt_m: float = 0.0

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) <= 90 and abs(self.lon_deg) <= 180):
            raise InvalidValueError(
                f"datum: expected latitude -90..90 and longitude -180..180 degrees, "
                f"got {self.lat_deg}, {self.lon_deg}"
            )

    def to_map(self, lonlat_deg: ArrayLike) -> Points:
        """Metres (N, 2) in the map frame of (N, 2) longitude, latitude in degrees (GeoJSON's order)."""
        lonlat = np.asarray(lonlat_deg, np.float64).reshape(-1, 2)
        project, turn, origin = self._parts()
        grid = np.stack(project(lonlat, False), axis=-1) - origin
        moved: Points = grid @ turn  # rows are vectors: this turns by minus the heading
        return moved

    def to_gps(self, xy_m: ArrayLike) -> Points:
        """Longitude, latitude (N, 2) in degrees of (N, 2) metres in the map frame, on the datum's height."""
        project, turn, origin = self._parts()
        grid = np.asarray(xy_m, np.float64).reshape(-1, 2) @ turn.T + origin
        return np.stack(project(grid, True), axis=-1)

    def _parts(self) -> tuple[Project, Points, Points]:
        """The projection both ways, the turn from map to its grid, and the datum in its grid."""
        pyproj = require("pyproj", "gps")
        lat, lon = self.lat_deg, self.lon_deg
        if self.kind == "topocentric":
            return self._topocentric(pyproj), self._turn(0.0), np.zeros(2)
        if self.kind == "utm":
            zone = min(60, int((lon + 180) // 6) + 1)
            proj = pyproj.Proj(proj="utm", zone=zone, south=lat < 0, ellps="WGS84")
        else:
            proj = pyproj.Proj(proj="tmerc", lat_0=lat, lon_0=lon, k_0=1.0, ellps="WGS84")
        convergence_deg = float(proj.get_factors(lon, lat).meridian_convergence)

        def project(points: Points, inverse: bool) -> tuple[Points, Points]:
            x, y = proj(points[:, 0], points[:, 1], inverse=inverse)
            return np.asarray(x), np.asarray(y)

        return project, self._turn(convergence_deg), np.array(proj(lon, lat))

    def _turn(self, convergence_deg: float) -> Points:
        """From map axes to the projection's grid: the heading counts from true east, not from the grid's."""
        angle = np.deg2rad(self.heading_deg + convergence_deg)
        return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])

    def _topocentric(self, pyproj: ModuleType) -> Project:
        """East and north in the plane that touches the ellipsoid's parallel surface at the datum."""
        steps = (
            "+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps=WGS84 "
            f"+step +proj=topocentric +ellps=WGS84 +lat_0={self.lat_deg!r} +lon_0={self.lon_deg!r} "
            f"+h_0={self.alt_m!r}"
        )
        transformer = pyproj.Transformer.from_pipeline(steps)

        def project(points: Points, inverse: bool) -> tuple[Points, Points]:
            x, y = points[:, 0], points[:, 1]
            if not inverse:
                east, north, _ = transformer.transform(x, y, np.full(len(points), self.alt_m))
                return east, north
            up = np.zeros(len(points))
            for _ in range(4):  # the ground falls away from the plane: find the point at the datum's height
                lon, lat, alt = transformer.transform(x, y, up, direction="INVERSE")
                up = up + (self.alt_m - alt)
            return lon, lat

        return project
