"""What a garden is made of: materials, meshes, things that stand or move, light, the whole.

Frames: `map` has z up. A model has z up, +x to its front, and its origin where it touches the ground.
Classes are those of GRASS_OBSTACLE_PERSON. Colours of materials are linear RGB, textures are sRGB.
"""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.labels import OTHER, LabelClass
from swardmap.synth.terrain import Terrain

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
