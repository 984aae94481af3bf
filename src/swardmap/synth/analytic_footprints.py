"""Which cells of the ground a shape stands on, in closed form."""

import numpy as np
from numpy.typing import NDArray

Float64Array = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


def ellipse_covers(
    center: tuple[float, float], radii: tuple[float, float], lower: Float64Array, upper: Float64Array
) -> BoolArray:
    """Whether an ellipse along the axes overlaps each of the rectangles (N, 2); a touch is no overlap."""
    nearest = np.clip(np.asarray(center), lower, upper) - np.asarray(center)
    inside: BoolArray = np.square(nearest / np.asarray(radii)).sum(axis=-1) < 1
    return inside


def rectangle_covers(
    center: tuple[float, float],
    size: tuple[float, float],
    yaw_deg: float,
    lower: Float64Array,
    upper: Float64Array,
) -> BoolArray:
    """Whether a turned rectangle overlaps each of the rectangles (N, 2): separating axes; touch is none."""
    half, turn = np.asarray(size) / 2, rotation_z(yaw_deg)[:2, :2]
    apart = (lower + upper) / 2 - np.asarray(center)
    cell_half = (upper - lower) / 2
    reach = np.abs(turn) @ half  # of the turned rectangle along x and y
    along_axes = (np.abs(apart) < reach + cell_half).all(axis=-1)
    along_edges = (np.abs(apart @ turn) < half + cell_half @ np.abs(turn)).all(axis=-1)
    overlap: BoolArray = along_axes & along_edges
    return overlap


def rotation_z(yaw_deg: float) -> Float64Array:
    """(3, 3) turn about z; exact at the multiples of 90 degrees."""
    quarter = {0.0: (1.0, 0.0), 90.0: (0.0, 1.0), 180.0: (-1.0, 0.0), 270.0: (0.0, -1.0)}
    c, s = quarter.get(yaw_deg % 360.0, (np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg))))
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
