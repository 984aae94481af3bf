"""What one frame says of the cells it sees: the only thing that maps take in."""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.perception.geometric_obstacles import GroundEvidence


@dataclass(frozen=True, slots=True)
class PixelCounts:
    """What became of the pixels of a frame; every pixel is in exactly one of the rows but the first.

    Attributes:
        pixels: of the depth image.
        no_reading: 0, NaN or infinite depth.
        out_of_range: nearer or farther than the limits.
        inconsistent: removed by the 3x3 consistency filter.
        void: the mask says nothing, or is not sure.
        out_of_height: below or above the limits.
        outside_grid: fell beside the grid.
        merged: joined with others in a voxel, or removed as outliers after that (plain backend only).
        used: counted in a cell.
    """

    pixels: int
    no_reading: int
    out_of_range: int
    inconsistent: int
    void: int
    out_of_height: int
    outside_grid: int
    merged: int
    used: int

    def __add__(self, other: "PixelCounts") -> "PixelCounts":
        theirs = asdict(other)
        return PixelCounts(**{name: n + theirs[name] for name, n in asdict(self).items()})


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What one frame says of the cells of a grid.

    Attributes:
        spec: the grid, on the lattice of the map.
        classes: (height, width) uint8 MapClass, the standalone map of this frame.
        points: (height, width, 4) uint32 points by MapClass that it was made of.
        viewpoint_m: (x, y, z) of the camera in the grid's frame.
        stamp_ns: time of the frame.
        counts: what became of its pixels.
        semantic: (height, width) uint8 MapClass from the network's classes alone.
        geometry: what depth alone says; None = switched off.
    """

    spec: GridSpec
    classes: NDArray[np.uint8]
    points: NDArray[np.uint32]
    viewpoint_m: tuple[float, float, float]
    stamp_ns: int
    counts: PixelCounts
    semantic: NDArray[np.uint8]
    geometry: GroundEvidence | None = None

    def __post_init__(self) -> None:
        if self.classes.shape != self.spec.shape or self.points.shape != (*self.spec.shape, 4):
            raise InvalidValueError(
                f"observation: expected arrays of {self.spec.shape} cells, "
                f"got classes {self.classes.shape} and points {self.points.shape}"
            )

    @property
    def grid(self) -> OccupancyGrid:
        """The standalone map of this frame."""
        return OccupancyGrid(self.spec, self.classes, self.stamp_ns)

    @property
    def semantic_grid(self) -> OccupancyGrid:
        """The same from the network's classes alone."""
        return OccupancyGrid(self.spec, self.semantic, self.stamp_ns)

    @property
    def by_geometry(self) -> NDArray[np.bool_] | None:
        """(height, width) bool, cells that geometry alone marks; None if it is switched off."""
        return None if self.geometry is None else self.geometry.marks & (self.semantic < 2)
