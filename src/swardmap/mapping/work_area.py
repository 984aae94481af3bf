"""The work area: boundary and exclusion zones, from GPS coordinates to cells that are kept out of."""

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.config import AreaConfig
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.grid import GridSpec
from swardmap.mapping.costmap import FREE, boundary_layer
from swardmap.mapping.geodesy import Projection

Ring = NDArray[np.float64]
"""(N, 2) corners in order; the last joins the first."""

MAX_CORNERS = 10_000
MAX_DISTANCE_M = 20_000.0
"""A lawn is nearer to its datum than that; what is not has another field's datum, or swapped coordinates."""


class Role(StrEnum):
    """What a polygon is for."""

    BOUNDARY = "boundary"
    EXCLUSION = "exclusion"


@dataclass(frozen=True, slots=True, eq=False)
class Polygon:
    """One polygon: an outer ring, and rings that are cut out of it, whichever way round they run.

    Attributes:
        role: boundary or exclusion.
        rings: outer first; (N, 2) each, of at least three corners, that do not cross themselves.
        name: what a person would call it.
    """

    role: Role
    rings: tuple[Ring, ...]
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "role", Role(self.role))
        if not self.rings:
            raise InvalidValueError(f"polygon '{self.name}': expected an outer ring, got none")
        rings = tuple(checked_ring(ring, f"polygon '{self.name}'") for ring in self.rings)
        object.__setattr__(self, "rings", rings)

    def covers(self, spec: GridSpec) -> NDArray[np.bool_]:
        """(height, width) bool: cells whose centre lies in the polygon, for rings in the grid's metres."""
        covered = np.asarray(boundary_layer(spec, self.rings[0]) == FREE)
        for hole in self.rings[1:]:
            covered &= boundary_layer(spec, hole) != FREE
        return covered


@dataclass(frozen=True, slots=True, eq=False)
class WorkArea:
    """Where the robot may work, in metres of the map frame.

    Attributes:
        polygons: boundaries and exclusions.
        frame_id: frame of the map.
        cost: of cells that are kept out of.
        ignored: what the file held beside polygons, by kind.
    """

    polygons: tuple[Polygon, ...]
    frame_id: str = "map"
    cost: int = 254
    ignored: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.polygons:
            raise InvalidValueError("work area: expected at least one polygon, got none")

    def check_frame(self, frame_id: str) -> None:
        """Hold that poses or a grid are in the frame of this area.

        Raises:
            InvalidValueError: if not.
        """
        if frame_id != self.frame_id:
            raise InvalidValueError(
                f"the work area is in the frame '{self.frame_id}', the map in '{frame_id}': "
                "set area.frame_id to the frame whose origin the datum is"
            )

    def keep_out(self, spec: GridSpec) -> NDArray[np.bool_]:
        """(height, width) bool: cells whose centre lies outside every boundary, or in an exclusion.

        Without any boundary only exclusions are kept out of.

        Raises:
            InvalidValueError: if the grid is in another frame.
        """
        self.check_frame(spec.frame_id)
        boundaries = [p for p in self.polygons if p.role == Role.BOUNDARY]
        out = np.full(spec.shape, bool(boundaries))
        for polygon in boundaries:
            out &= ~polygon.covers(spec)
        for polygon in self.polygons:
            if polygon.role == Role.EXCLUSION:
                out |= polygon.covers(spec)
        return out

    def layer(self, spec: GridSpec) -> NDArray[np.uint8]:
        """(height, width) uint8 for `build_costmap`: `cost` where to keep out, else 0, which says nothing."""
        return np.where(self.keep_out(spec), np.uint8(self.cost), np.uint8(FREE))

    @property
    def area_m2(self) -> float:
        """Area of the boundaries less their holes; exclusions and overlaps are not taken off."""
        return sum(
            abs(signed_area(p.rings[0])) - sum(abs(signed_area(hole)) for hole in p.rings[1:])
            for p in self.polygons
            if p.role == Role.BOUNDARY
        )


def projected(
    polygons: tuple[Polygon, ...], config: AreaConfig, ignored: dict[str, int] | None = None
) -> WorkArea:
    """A work area from polygons in longitude and latitude.

    Args:
        polygons: rings of (longitude, latitude) in WGS84 degrees.
        config: datum, projection, frame and cost.
        ignored: see `WorkArea`.

    Raises:
        ConfigError: if there is no datum.
        InvalidValueError: if a corner is no coordinate, or farther than 20 km from the datum.
        MissingExtraError: without pyproj.
    """
    if config.datum_lat is None or config.datum_lon is None:
        raise ConfigError("area: expected datum_lat and datum_lon, the position of the map's origin")
    projection = Projection(
        config.datum_lat, config.datum_lon, config.datum_heading_deg, config.projection, config.datum_alt_m
    )
    moved = tuple(
        Polygon(p.role, tuple(_ring_to_map(r, projection, p) for r in p.rings), p.name) for p in polygons
    )
    return WorkArea(moved, config.frame_id, config.keep_out_cost, ignored or {})


def _ring_to_map(ring: Ring, projection: Projection, polygon: Polygon) -> Ring:
    if (np.abs(ring) > [180, 90]).any():
        raise InvalidValueError(
            f"{polygon.role} '{polygon.name}': expected longitude -180..180, then latitude -90..90"
        )
    # a degree is at most 112 km: sort out what is far before a projection is asked beyond where it holds
    off = np.abs(ring - [projection.lon_deg, projection.lat_deg])
    near = (np.minimum(off[:, 0], 360 - off[:, 0]) < 90).all() and (off[:, 1] < 1).all()
    xy_m = projection.to_map(ring) if near else np.full((1, 2), np.inf)
    if not (np.hypot(*xy_m.T) <= MAX_DISTANCE_M).all():
        raise InvalidValueError(
            f"{polygon.role} '{polygon.name}' lies more than {MAX_DISTANCE_M / 1000:g} km from the datum "
            f"{projection.lat_deg}, {projection.lon_deg}: are latitude and longitude swapped, or is it the "
            "datum of another field?"
        )
    return xy_m


def signed_area(ring: Ring) -> float:
    """Area of a ring; positive if it runs counterclockwise."""
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)) / 2


def checked_ring(ring: ArrayLike, what: str) -> Ring:
    """A ring without repeated corners; refused if it encloses nothing or crosses itself.

    Raises:
        InvalidValueError: saying what is wrong, and where.
    """
    corners: Ring = np.array(ring, np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise InvalidValueError(f"{what}: expected finite corners (N, 2), got shape {corners.shape}")
    if len(corners) > MAX_CORNERS:
        raise InvalidValueError(
            f"{what}: expected at most {MAX_CORNERS} corners, got {len(corners)}; simplify it"
        )
    repeated: NDArray[np.bool_] = np.asarray((corners == np.roll(corners, 1, axis=0)).all(axis=1))
    corners = corners[~repeated]
    crossing = first_crossing(corners)
    if crossing is not None:
        i, j = crossing
        raise InvalidValueError(
            f"{what} crosses itself: the edge after corner {i} at {corners[i].tolist()} meets the one after "
            f"corner {j} at {corners[j].tolist()}; what is inside is not certain"
        )
    if len(corners) < 3 or signed_area(corners) == 0:
        raise InvalidValueError(f"{what}: expected at least three corners that enclose an area")
    return corners


def first_crossing(corners: Ring) -> tuple[int, int] | None:
    """Numbers of the first two edges of a ring that cross, or None. Edges that only touch do not cross."""
    a, b = corners, np.roll(corners, -1, axis=0)

    def side(p: Ring, q: Ring, r: Ring) -> Ring:
        cross = (q - p)[..., 0] * (r - p)[..., 1] - (q - p)[..., 1] * (r - p)[..., 0]
        signs: Ring = np.sign(cross)
        return signs

    for i in range(len(corners) - 2):
        c, d = a[i + 2 :], b[i + 2 :]
        across = (side(a[i], b[i], c) * side(a[i], b[i], d) < 0) & (side(c, d, a[i]) * side(c, d, b[i]) < 0)
        if across.any():
            return i, i + 2 + int(np.argmax(across))
    return None
