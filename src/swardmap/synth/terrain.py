"""The ground of a garden: a height field, and what covers it."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]


class Surface(IntEnum):
    """What the ground is covered with; only LAWN is grass (docs/garden.md has the rules)."""

    LAWN = 0
    GRAVEL = 1
    PAVING = 2
    DIRT = 3
    MULCH = 4
    SAND = 5
    CONCRETE = 6
    WOOD = 7
    WATER = 8
    GROUND_COVER = 9  # low green plants that are not lawn
    CARPET = 10  # green carpet, artificial turf
    LEAF_LITTER = 11  # so deep that no lawn shows


@dataclass(frozen=True, slots=True, eq=False)
class Terrain:
    """A height field with a map of what covers it; both rasters have the same square texels.

    Raster row iy, column ix is the point (origin + (ix + 0.5, iy + 0.5) * texel_m): values sit at texel
    centres. Between them `lawn_m` and `height_m` are linear; see `height_at`.

    Attributes:
        origin_m: outer corner of texel (0, 0) in the frame map.
        texel_m: edge of a texel.
        height_m: ny x nx, float32: z of the soil, without blades.
        lawn_m: ny x nx, float32: distance to the border of the lawn, positive inside; a point is grass
            where the bilinear value is > 0.
        surface: ny x nx, uint8 of Surface: what covers it where it is not lawn (and for texture).
        albedo: ny x nx x 3, float32: linear RGB, of lawn the colour of its blades seen from far.
        blade_height_m: ny x nx, float32: mean length of the blades; 0 = none.
        blade_density: ny x nx, float32, 0..1: share of the full density.
        dryness: ny x nx, float32, 0..1: share of dead, straw-coloured blades.
    """

    origin_m: tuple[float, float]
    texel_m: float
    height_m: Float32Array
    lawn_m: Float32Array
    surface: NDArray[np.uint8]
    albedo: Float32Array
    blade_height_m: Float32Array
    blade_density: Float32Array
    dryness: Float32Array

    def __post_init__(self) -> None:
        shape = self.height_m.shape
        if self.texel_m <= 0 or len(shape) != 2 or min(shape) < 2:
            raise InvalidValueError(
                f"ground: expected a positive texel and at least 2 x 2 texels, got {self.texel_m} m, {shape}"
            )
        for name in ("lawn_m", "surface", "albedo", "blade_height_m", "blade_density", "dryness"):
            if getattr(self, name).shape[:2] != shape:
                raise InvalidValueError(
                    f"ground: expected {name} of {shape}, got {getattr(self, name).shape}"
                )

    def height_at(self, xy: NDArray[np.floating]) -> Float64Array:
        """Height of the soil at points.

        The surface is made of triangles: each square between four texel centres is cut from its corner
        (ix + 1, iy) to (ix, iy + 1). The renderer draws these very triangles. Beyond the raster the
        nearest edge counts.

        Args:
            xy: n x 2, metres in the frame map.

        Returns:
            n, float64, metres.
        """
        i, j, a, b = self._square(xy)
        z = self.height_m.astype(np.float64)
        z00, z10, z01, z11 = z[j, i], z[j, i + 1], z[j + 1, i], z[j + 1, i + 1]
        lower = z00 + a * (z10 - z00) + b * (z01 - z00)
        upper = z11 + (1 - a) * (z01 - z11) + (1 - b) * (z10 - z11)
        return np.where(a + b <= 1, lower, upper)

    def is_lawn(self, xy: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Whether points are grass: the bilinear `lawn_m` is positive."""
        i, j, a, b = self._square(xy)
        d = self.lawn_m.astype(np.float64)
        low = d[j, i] * (1 - a) + d[j, i + 1] * a
        high = d[j + 1, i] * (1 - a) + d[j + 1, i + 1] * a
        inside: NDArray[np.bool_] = low * (1 - b) + high * b > 0
        return inside

    def _square(
        self, xy: NDArray[np.floating]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Float64Array, Float64Array]:
        """Index of the lower corner of the square around each point, and the place in it, 0..1."""
        ny, nx = self.height_m.shape
        at = (np.asarray(xy, np.float64) - self.origin_m) / self.texel_m - 0.5
        x, y = np.clip(at[:, 0], 0, nx - 1), np.clip(at[:, 1], 0, ny - 1)
        i, j = np.minimum(x.astype(np.intp), nx - 2), np.minimum(y.astype(np.intp), ny - 2)
        return i, j, x - i, y - j
