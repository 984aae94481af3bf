"""What a garden is made of: materials, meshes, things that stand or move, the ground, the whole.

Frames: `map` has z up. A model has z up, +x to its front, and its origin where it touches the ground.
Classes are those of GRASS_OBSTACLE_PERSON. Colours of materials are linear RGB, textures are sRGB.
"""

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.labels import OTHER, LabelClass

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

MAP_FRAME = "map"


@dataclass(frozen=True, slots=True, eq=False)
class Texture:
    """A picture on a surface.

    Attributes:
        name: unique among all textures.
        rgba: H x W x 4, uint8, sRGB with straight alpha; row 0 is the top (v = 1).
    """

    name: str
    rgba: NDArray[np.uint8]

    def __post_init__(self) -> None:
        if self.rgba.dtype != np.uint8 or self.rgba.ndim != 3 or self.rgba.shape[2] != 4:
            raise InvalidValueError(
                f"texture '{self.name}': expected H x W x 4 of uint8, "
                f"got {self.rgba.shape} of {self.rgba.dtype}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Material:
    """How a surface answers light.

    Attributes:
        color: linear RGB in 0..1, multiplied with the texture.
        texture: None = plain.
        cutout: texels with an alpha below 0.4 are holes (leaves, nets); both sides are seen.
        translucency: share of light that shines through (leaves, cloth), 0..1.
        specular: strength of the highlight, 0..1.
        roughness: 0 = mirror, 1 = matt.
    """

    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    texture: Texture | None = None
    cutout: bool = False
    translucency: float = 0.0
    specular: float = 0.0
    roughness: float = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of one material.

    Attributes:
        xyz: n x 3, float32, metres.
        normals: n x 3, float32, of length 1, outward.
        uv: n x 2, float32.
        faces: m x 3, uint32, counter-clockwise seen from outside.
        material: of all faces.
    """

    xyz: Float32Array
    normals: Float32Array
    uv: Float32Array
    faces: NDArray[np.uint32]
    material: Material

    def __post_init__(self) -> None:
        n = len(self.xyz)
        expected = {"xyz": (n, 3), "normals": (n, 3), "uv": (n, 2), "faces": (len(self.faces), 3)}
        for name, shape in expected.items():
            array = getattr(self, name)
            dtype = np.uint32 if name == "faces" else np.float32
            if array.shape != shape or array.dtype != dtype:
                raise InvalidValueError(
                    f"mesh: expected {name} of shape {shape} and {np.dtype(dtype).name}, "
                    f"got {array.shape} and {array.dtype}"
                )
        if not np.isfinite(self.xyz).all():
            raise InvalidValueError("mesh: expected finite coordinates, got some that are not")
        if len(self.faces) and int(self.faces.max()) >= n:
            raise InvalidValueError(
                f"mesh: expected faces of {n} vertices, got index {int(self.faces.max())}"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Model:
    """A named shape of one or more meshes, in its own frame."""

    name: str
    meshes: tuple[Mesh, ...]

    def bounds_m(self) -> tuple[Float32Array, Float32Array]:
        """Lowest and highest corner of the box around it, each of shape (3,)."""
        xyz = np.concatenate([mesh.xyz for mesh in self.meshes])
        return xyz.min(axis=0), xyz.max(axis=0)


@dataclass(frozen=True, slots=True, eq=False)
class Thing:
    """A model somewhere in the garden.

    Attributes:
        model: its shape; shared between things that look alike.
        kind: of obstacle, for the statistics: tree, shrub, hedge, fence, wall, house, person, dog, ball ...
        T_map_model: 4 x 4, float64: rotation times a positive scale (it may differ by axis), translation.
        label: class of its pixels and cells.
        pose: of a person or animal: standing, walking, crouching, lying ...; empty for the rest.
        tint: linear RGB, multiplies its materials' colours.
    """

    model: Model
    kind: str
    T_map_model: Float64Array = field(default_factory=lambda: np.eye(4))
    label: LabelClass = OTHER
    pose: str = ""
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        matrix = self.T_map_model
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise InvalidValueError(f"thing '{self.kind}': expected a finite 4 x 4 matrix, got {matrix!r}")


class Actor(Protocol):
    """Somebody or something that moves: a thing at every time."""

    def at(self, stamp_ns: int) -> Thing:
        """The thing at a time; the same time gives the same thing."""


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


@dataclass(frozen=True, slots=True, eq=False)
class Garden:
    """A lot with all that is on it.

    Attributes:
        name: such as garden-0007.
        seed: that it was built from.
        ground: of the lot and some way around it; beyond the raster lies a plain of lawn.
        things: what stands still.
        actors: who and what moves.
        lot_m: k x 2, float64: corners of the lot, counter-clockwise.
    """

    name: str
    seed: int
    ground: Terrain
    things: tuple[Thing, ...]
    lot_m: Float64Array
    actors: tuple[Actor, ...] = ()

    def at(self, stamp_ns: int) -> tuple[Thing, ...]:
        """All things at a time, those that move last."""
        return (*self.things, *(actor.at(stamp_ns) for actor in self.actors))


@dataclass(frozen=True, slots=True)
class Light:
    """The light of a scene: sun, sky and air, as linear RGB; a clear day in a garden has a mean near 0.3.

    Attributes:
        illumination: clear, cloudy, overcast, sunset or twilight, as in EDEN.
        sun_direction: (3,), of length 1, towards the sun, in the frame map.
        sun: irradiance of the sun on a surface that faces it.
        zenith, horizon: colour of the sky above and low down.
        bounce: light that comes back from the ground.
        softness: half-shadow, 0 = sharp.
        clouds: share of the sky, 0..1.
        haze_per_m: share of the light lost on each metre.
    """

    illumination: str
    sun_direction: tuple[float, float, float]
    sun: tuple[float, float, float]
    zenith: tuple[float, float, float]
    horizon: tuple[float, float, float]
    bounce: tuple[float, float, float]
    softness: float
    clouds: float
    haze_per_m: float


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """What an ideal camera sees, before optics and sensors.

    Attributes:
        radiance: H x W x 3, float32: linear RGB, anti-aliased.
        depth_m: H x W, float32: along the optical axis, at pixel centres; 0 = sky.
        labels: H x W, uint8: ids of GRASS_OBSTACLE_PERSON, at pixel centres; sky is other.
        thing: H x W, uint16: 1 + index in `garden.at(stamp_ns)`; 0 = ground, blades, sky.
    """

    radiance: Float32Array
    depth_m: Float32Array
    labels: NDArray[np.uint8]
    thing: NDArray[np.uint16]
