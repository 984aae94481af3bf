"""The work area: boundary and exclusion zones, from GPS coordinates to cells that are kept out of."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.config import AreaConfig
from swardmap.errors import ConfigError, InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.mapping.costmap import FREE, Layer, check_frames, restrict
from swardmap.mapping.geodesy import Projection
from swardmap.mapping.polygons import cells_inside

Ring = NDArray[np.float64]
"""(N, 2) corners in order; the last joins the first."""

MAX_CORNERS = 10_000
EDGES_AT_ONCE = 256
MAX_DISTANCE_M = 20_000.0
"""A lawn is nearer to its datum than that; what is not has another field's datum, or swapped coordinates."""


class AreaRole(StrEnum):
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

    role: AreaRole
    rings: tuple[Ring, ...]
    name: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "role", AreaRole(self.role))
        if not self.rings:
            raise InvalidValueError(f"polygon '{self.name}': expected an outer ring, got none")
        rings = tuple(checked_ring(ring, f"polygon '{self.name}'") for ring in self.rings)
        object.__setattr__(self, "rings", rings)

    def covers(self, spec: GridSpec) -> NDArray[np.bool_]:
        """(height, width) bool: cells whose centre lies in the polygon, for rings in the grid's metres."""
        covered = cells_inside(spec, self.rings[0])
        for hole in self.rings[1:]:
            covered &= ~cells_inside(spec, hole)
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
        check_frames([self], frame_id)

    def keep_out(self, spec: GridSpec) -> NDArray[np.bool_]:
        """(height, width) bool: cells whose centre lies outside every boundary, or in an exclusion.

        Without any boundary only exclusions are kept out of. It is drawn once for each extent, read only.

        Raises:
            InvalidValueError: if the grid is in another frame.
        """
        self.check_frame(spec.frame_id)
        return _kept_out(self, spec)

    def apply(self, costs: NDArray[np.uint8], grid: OccupancyGrid) -> NDArray[np.uint8]:
        """Costs with `cost` where to keep out (see `swardmap.mapping.costmap.Layer`)."""
        return restrict(costs, np.where(self.keep_out(grid.spec), np.uint8(self.cost), np.uint8(FREE)))

    @property
    def area_m2(self) -> float:
        """Area of the boundaries less their holes; exclusions and overlaps are not taken off."""
        from shapely import Polygon as Shape

        boundaries = (p.rings for p in self.polygons if p.role == AreaRole.BOUNDARY)
        return float(sum(Shape(outer, holes).area for outer, *holes in boundaries))


def work_area_in(layers: Iterable[Layer]) -> WorkArea | None:
    """The work area among the layers of a costmap; None if there is none."""
    return next((layer for layer in layers if isinstance(layer, WorkArea)), None)


@lru_cache(maxsize=4)
def _kept_out(area: WorkArea, spec: GridSpec) -> NDArray[np.bool_]:
    boundaries = [p for p in area.polygons if p.role == AreaRole.BOUNDARY]
    out = np.full(spec.shape, bool(boundaries))
    for polygon in boundaries:
        out &= ~polygon.covers(spec)
    for polygon in area.polygons:
        if polygon.role == AreaRole.EXCLUSION:
            out |= polygon.covers(spec)
    out.flags.writeable = False
    return out


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


def checked_ring(ring: ArrayLike, what: str) -> Ring:
    """A ring without repeated corners; refused if it encloses nothing or crosses itself.

    Raises:
        InvalidValueError: saying what is wrong, and where.
    """
    from shapely import Polygon as Shape

    corners: Ring = np.array(ring, np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or not np.isfinite(corners).all():
        raise InvalidValueError(f"{what}: expected finite corners (N, 2), got shape {corners.shape}")
    if len(corners) > MAX_CORNERS:
        raise InvalidValueError(
            f"{what}: expected at most {MAX_CORNERS} corners, got {len(corners)}; simplify it"
        )
    repeated: NDArray[np.bool_] = np.asarray((corners == np.roll(corners, 1, axis=0)).all(axis=1))
    corners = corners[~repeated]
    crossing = first_crossing(corners) if len(corners) >= 3 else None
    if crossing is not None:
        i, j = crossing
        raise InvalidValueError(
            f"{what} crosses itself: the edge after corner {i} at {corners[i].tolist()} meets the one after "
            f"corner {j} at {corners[j].tolist()}; what is inside is not certain"
        )
    if len(corners) < 3 or Shape(corners).area == 0:
        raise InvalidValueError(f"{what}: expected at least three corners that enclose an area")
    return corners


def first_crossing(corners: Ring) -> tuple[int, int] | None:
    """Numbers of the first two edges of a ring that cross, or None. Edges that only touch do not cross."""
    import shapely

    if shapely.is_valid(shapely.Polygon(corners)):  # fast, and true of nearly all; but touching is not valid
        return None
    edges = shapely.linestrings(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    tree = shapely.STRtree(edges)
    for start in range(0, len(edges), EDGES_AT_ONCE):
        one, two = tree.query(edges[start : start + EDGES_AT_ONCE], predicate="crosses")
        if len(one):
            i = int(one.min())
            return start + i, int(two[one == i].min())
    return None
