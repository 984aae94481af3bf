"""Things on the graphics side: every mesh and picture is uploaded once, and dropped when nothing shows it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from swardmap.synth.model import Float64Array, Mesh, Model, Texture, Thing
from swardmap.synth.render.camera import RenderCamera, columns
from swardmap.synth.render.context import Context, Program, layout_of, set_uniforms
from swardmap.synth.render.textures import upload


@dataclass(slots=True, eq=False)
class _Uploaded:
    """A mesh on the graphics side; holds the mesh itself, so that its identity is not given away."""

    mesh: Mesh
    vertices: Any
    indices: Any
    texture: Any
    arrays: dict[int, Any] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """Things with their numbers and the spheres around them.

    Attributes:
        things: number in the garden, and the thing.
        centres_m: n x 3.
        radii_m: n.
    """

    things: Sequence[tuple[int, Thing]]
    centres_m: Float64Array
    radii_m: Float64Array

    @classmethod
    def of(cls, things: Sequence[Thing], first: int = 0) -> "Placed":
        """Of things whose numbers start at `first`."""
        spheres = [_sphere(thing) for thing in things]
        centres = np.array([centre for centre, _ in spheres]).reshape(-1, 3)
        return cls(list(enumerate(things, first)), centres, np.array([radius for _, radius in spheres]))

    def seen_by(self, camera: RenderCamera) -> "list[Seen]":
        """Those that may be in the picture, near ones first."""
        seen = np.flatnonzero(camera.sees(self.centres_m, self.radii_m))
        depth = (self.centres_m[seen] - camera.position_m) @ camera.axes[:, 2]
        away = np.linalg.norm(self.centres_m[seen] - camera.position_m, axis=1) - self.radii_m[seen]
        found = [
            Seen(*self.things[int(k)], (float(z - self.radii_m[k]), float(z + self.radii_m[k])))
            for k, z in zip(seen, depth, strict=True)
        ]
        return [found[k] for k in np.argsort(away, kind="stable")]


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A thing that may be in the picture.

    Attributes:
        number: in the garden.
        thing: what it is.
        span_m: nearest and farthest depth it may have.
    """

    number: int
    thing: Thing
    span_m: tuple[float, float]


def _sphere(thing: Thing) -> tuple[Float64Array, float]:
    low, high = thing.model.bounds_m()
    T = thing.T_map_model
    middle = T[:3, :3] @ ((low + high) / 2) + T[:3, 3]
    return middle, float(np.linalg.norm(T[:3, :3], 2) * np.linalg.norm(high - low) / 2)


class ThingStore:
    """Meshes and pictures that are uploaded."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._meshes: dict[int, _Uploaded] = {}
        self._textures: dict[tuple[int, bool], tuple[Texture, Any]] = {}
        self._white = context.texture((1, 1), 4, b"\xff" * 4)

    def keep_only(self, models: Iterable[Model]) -> None:
        """Drop all meshes and pictures that these models do not use."""
        meshes = {id(mesh): mesh for model in models for mesh in model.meshes}
        self._meshes = {key: up for key, up in self._meshes.items() if key in meshes}
        pictures = {_key(mesh) for mesh in meshes.values()}
        self._textures = {key: pair for key, pair in self._textures.items() if key in pictures}

    def draw(self, program: Program, things: Iterable[Seen], camera: RenderCamera) -> None:
        """Draw things as the camera sees them.

        Args:
            program: with which.
            things: what the camera may see.
            camera: from where.
        """
        for seen in things:
            thing = seen.thing
            T = thing.T_map_model.copy()
            T[:3, 3] -= camera.position_m
            turned = np.linalg.inv(T[:3, :3]).T
            set_uniforms(
                program,
                rel_from_model=columns(T),
                normal_matrix=columns(np.asarray(turned, np.float64)),
                identity=(thing.label.id, seen.number + 1),
                span=seen.span_m,
            )
            for mesh in thing.model.meshes:
                m = mesh.material
                set_uniforms(
                    program,
                    color=tuple(a * b for a, b in zip(m.color, thing.tint, strict=True)),
                    gloss=(m.translucency, m.specular, m.roughness),
                    textured=m.texture is not None,
                )
                self._render(program, mesh)

    def cast(self, program: Program, things: Iterable[Thing], light_from_map: Float64Array) -> None:
        """Draw things into a shadow map."""
        for thing in things:
            set_uniforms(program, light_from_model=columns(light_from_map @ thing.T_map_model))
            for mesh in thing.model.meshes:
                self._render(program, mesh)

    def _render(self, program: Program, mesh: Mesh) -> None:
        up = self._meshes.get(id(mesh))
        if up is None:
            up = self._meshes[id(mesh)] = self._upload(mesh)
        array = up.arrays.get(program.glo)
        if array is None:
            layout = [layout_of(program, up.vertices, "xyz:3f", "normal:3f", "uv:2f")]
            array = up.arrays[program.glo] = self._context.vertex_array(program, layout, up.indices)
        set_uniforms(program, cutout=mesh.material.cutout and mesh.material.texture is not None)
        up.texture.use(0)
        array.render()

    def _upload(self, mesh: Mesh) -> _Uploaded:
        data = np.concatenate([mesh.xyz, mesh.normals, mesh.uv], axis=1)
        return _Uploaded(
            mesh, self._context.buffer(data.tobytes()), self._context.buffer(mesh.faces.tobytes()),
            self._texture(mesh),
        )  # fmt: skip

    def _texture(self, mesh: Mesh) -> Any:
        texture = mesh.material.texture
        if texture is None:
            return self._white
        key = _key(mesh)
        if key not in self._textures:
            self._textures[key] = (texture, upload(self._context, texture.rgba, mesh.material.cutout))
        return self._textures[key][1]


def _key(mesh: Mesh) -> tuple[int, bool]:
    return id(mesh.material.texture), mesh.material.cutout
