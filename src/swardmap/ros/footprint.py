"""The shape of a robot as Nav2 is to be told it, so that what Nav2 makes of it is never smaller than meant.

Nav2 takes the circle inside the footprint for its inflation. It makes of `robot_radius` a polygon of 16
corners on the circle, whose inscribed radius is smaller by cos(pi/16) (makeFootprintFromRadius and
calculateMinAndMaxDistances in nav2_costmap_2d/src/footprint.cpp); `footprint_padding` moves corners, and the
sides of a slanting polygon by less (padFootprint). So the margin goes into the shape, with a padding of 0.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import ConfigError, InvalidValueError

NAV2_CORNERS = 16
"""Of the polygon that Nav2 makes of a radius."""

STEP_M = 1e-4
"""Numbers in the files are rounded outwards to it."""

FLOAT32_SLACK = 1e-6
"""Nav2 takes the resolution of a map message, and corners, as float32: half a step of that is 6e-8."""

MAX_CORNERS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Footprint:
    """The robot's outline seen from above; what it leaves out of its convex hull is not used.

    Attributes:
        corners_m: (N, 2) in the robot's base frame, in order. The base must lie inside.
    """

    corners_m: NDArray[np.float64]

    def __post_init__(self) -> None:
        corners = np.asarray(self.corners_m, np.float64)
        if corners.ndim != 2 or corners.shape[1] != 2 or not 3 <= len(corners) <= MAX_CORNERS:
            raise InvalidValueError(
                f"footprint: expected 3 to {MAX_CORNERS} corners (N, 2), got shape {corners.shape}"
            )
        if not np.isfinite(corners).all():
            raise InvalidValueError("footprint: expected finite corners in metres")
        object.__setattr__(self, "corners_m", corners)
        if self.inscribed_radius_m <= 0:
            raise InvalidValueError(
                "footprint: expected the robot's base (0, 0) inside of it; corners are measured from there"
            )

    @property
    def inscribed_radius_m(self) -> float:
        """Radius of the largest circle about the base inside the hull; not positive if it lies outside."""
        return float(self._sides()[1].min())

    def grown(self, margin_m: float) -> NDArray[np.float64]:
        """(N, 2) corners of the convex hull with every side moved out by a margin, counter-clockwise."""
        normals, distances = self._sides()
        far = distances + margin_m
        pairs = zip(normals, np.roll(normals, -1, axis=0), far, np.roll(far, -1), strict=True)
        return np.array([np.linalg.solve(np.stack([n0, n1]), [d0, d1]) for n0, n1, d0, d1 in pairs])

    def _sides(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Outward normals (N, 2) of the hull's sides, counter-clockwise, and distances (N,) from the base."""
        from scipy.spatial import ConvexHull, QhullError

        try:
            equations = ConvexHull(self.corners_m).equations
        except QhullError as error:
            raise InvalidValueError("footprint: expected corners that span an area, got a line") from error
        order = np.argsort(np.arctan2(equations[:, 1], equations[:, 0]))
        return equations[order, :2], -equations[order, 2]


def footprint_from_text(text: str) -> Footprint:
    """A footprint as Nav2 writes it: `[[0.4, 0.3], [0.4, -0.3], [-0.4, -0.3], [-0.4, 0.3]]`.

    Raises:
        ConfigError: if it is none.
    """
    import json

    try:
        corners: Any = json.loads(text)
        return Footprint(np.array(corners, np.float64))
    except InvalidValueError as error:
        raise ConfigError(str(error)) from error
    except (ValueError, TypeError, RecursionError) as error:
        raise ConfigError(
            f"footprint: expected [[x, y], [x, y], ...] in metres from the base, got '{text[:80]}'"
        ) from error


def nav2_radius(radius_m: float) -> float:
    """The `robot_radius` whose 16 corners enclose a circle, rounded up."""
    return _up(radius_m / math.cos(math.pi / NAV2_CORNERS))


def nav2_shape(radius_m: float, margin_m: float, footprint: Footprint | None) -> str:
    """The line that tells a costmap the robot grown by a margin: `robot_radius` or `footprint`.

    Args:
        radius_m: inscribed radius, where there is no footprint.
        margin_m: grown by it on all sides.
        footprint: outline, or None.
    """
    if footprint is None:
        return f"robot_radius: {nav2_radius(radius_m + margin_m)!r}"
    return f'footprint: "{corners_text(footprint, margin_m)}"'


def corners_text(footprint: Footprint, margin_m: float) -> str:
    """Corners of a grown footprint as Nav2 reads them, rounded so that no side comes nearer to the base."""
    slack_m = 2 * STEP_M + FLOAT32_SLACK  # a corner is off by half a step in x and in y
    corners = np.round(footprint.grown(margin_m + slack_m), 4)
    return "[" + ", ".join(f"[{x!r}, {y!r}]" for x, y in (corners + 0.0).tolist()) + "]"


def _up(value_m: float) -> float:
    return round(math.ceil(value_m * (1 + FLOAT32_SLACK) / STEP_M) * STEP_M, 6)
