"""Gardens to pictures with exact depth and classes."""

from typing import Any

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.synth.assets import Assets
from swardmap.synth.model import Float32Array, Garden, Light, Thing, View
from swardmap.synth.render.camera import Camera, frame_block
from swardmap.synth.render.context import driver_of, open_context, program_of, set_uniforms
from swardmap.synth.render.detail import details_of
from swardmap.synth.render.ground import GroundPart
from swardmap.synth.render.lawn import LawnPart
from swardmap.synth.render.shadow import Shadows
from swardmap.synth.render.targets import Targets
from swardmap.synth.render.things import Placed, ThingStore

SURFACES = ("thing", "ground", "blade")
UNITS = {
    "picture": 0, "shadow_near": 1, "shadow_far": 2, "height_map": 3, "lawn_map": 4, "surface_map": 5,
    "albedo_map": 6, "details": 7,
}  # fmt: skip
RASTERS = ("height_map", "lawn_map", "surface_map", "albedo_map", "details")


class _Scene:
    """What is uploaded of one garden."""

    def __init__(self, context: Any, garden: Garden, assets: Assets | None, blades: bool) -> None:
        self.garden = garden
        self.ground = GroundPart(context, garden.ground, details_of(context, assets, garden.seed))
        self.lawn = LawnPart(context, garden.ground, garden.seed) if blades else None
        self.still = Placed.of(garden.things)
        self.phase = float(np.random.default_rng([garden.seed, 62]).random())


class GardenRenderer:
    """Draws gardens; what does not change from frame to frame is uploaded once.

    Args:
        width: of the pictures in pixels.
        height: of the pictures in pixels.
        samples: anti-aliasing, samples a pixel.
        assets: photos of surfaces; None = drawn ones.
        blades: False leaves the blades of grass out.

    Attributes:
        driver: what draws, and its version.

    Raises:
        MissingExtraError: if moderngl or an OpenGL driver is missing.
    """

    def __init__(
        self, width: int, height: int, samples: int = 4, assets: Assets | None = None, blades: bool = True
    ) -> None:
        if min(width, height, samples) < 1:
            raise InvalidValueError(
                f"renderer: expected sizes of 1 or more, got {width} x {height}, {samples} samples"
            )
        self._context = open_context()
        self.driver = driver_of(self._context)
        self._size, self._assets, self._blades = (width, height), assets, blades
        with self._context:
            self._targets = Targets(self._context, width, height, samples)
            self._frame = self._context.buffer(reserve=512)
            self._store = ThingStore(self._context)
            self._shadows = Shadows(self._context)
            soft = ("COVERAGE",) if self._targets.multi > 1 else ()
            self._radiance = self._programs("RADIANCE", *soft)
            self._truth = self._programs("TRUTH")
            self._sky = program_of(self._context, "screen", "sky", "RADIANCE")
            self._finish = program_of(self._context, "screen", "finish")
            self._screens = [self._context.vertex_array(p, []) for p in (self._sky, self._finish)]
        self._scene: _Scene | None = None

    def render(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> View:
        """What an ideal camera sees.

        Args:
            garden: what there is.
            light: of the scene.
            intrinsics: of the size the renderer was made for.
            T_map_camera: pose of the optical frame.
            stamp_ns: time, for what moves.

        Raises:
            InvalidValueError: for intrinsics of another size.
        """
        if (intrinsics.width, intrinsics.height) != self._size:
            raise InvalidValueError(
                f"renderer: expected intrinsics of {self._size[0]} x {self._size[1]}, "
                f"got {intrinsics.width} x {intrinsics.height}"
            )
        with self._context:
            scene = self._scene_of(garden)
            moving = Placed.of([actor.at(stamp_ns) for actor in garden.actors], len(garden.things))
            camera = Camera.of(intrinsics, T_map_camera)
            self._begin(scene, light, camera, moving)
            seen = scene.still.seen_by(camera) + moving.seen_by(camera)
            self._draw_truth(scene, camera, seen)
            self._draw_radiance(scene, camera, seen)
            view = View(self._targets.radiance(), *self._read_truth())
            self._forget(scene, moving)
        return view

    def _programs(self, *defines: str) -> dict[str, Any]:
        found = {name: program_of(self._context, name, name, *defines) for name in SURFACES}
        for program in found.values():
            set_uniforms(program, **UNITS)
        return found

    def _scene_of(self, garden: Garden) -> _Scene:
        if self._scene is None or self._scene.garden is not garden:
            self._scene = None
            self._store.keep_only(thing.model for thing in garden.things)
            self._context.gc()
            self._scene = _Scene(self._context, garden, self._assets, self._blades)
        return self._scene

    def _forget(self, scene: _Scene, moving: Placed) -> None:
        """Drop the shapes of those who have moved on."""
        if moving.things:
            things = [*scene.garden.things, *(thing for _, thing in moving.things)]
            self._store.keep_only(thing.model for thing in things)
            self._context.gc()

    def _begin(self, scene: _Scene, light: Light, camera: Camera, moving: Placed) -> None:
        self._shadows.update(id(scene), light, camera, scene.garden.lot_m, scene.still, moving, self._store)
        block = frame_block(
            camera, light, self._shadows.matrices, self._shadows.softness(light), self._targets.scale,
            scene.phase,
        )  # fmt: skip
        self._frame.write(block)
        self._frame.bind_to_uniform_block(0)

    def _draw_surfaces(
        self, programs: dict[str, Any], scene: _Scene, camera: Camera, seen: list[tuple[int, Thing]]
    ) -> None:
        self._store.draw(programs["thing"], seen, camera)
        if scene.lawn is not None:
            scene.lawn.draw(programs["blade"], camera)
        scene.ground.draw(programs["ground"], camera, {name: UNITS[name] for name in RASTERS})

    def _draw_truth(self, scene: _Scene, camera: Camera, seen: list[tuple[int, Thing]]) -> None:
        c = self._context
        c.enable_only(c.DEPTH_TEST)
        self._targets.truth.use()
        self._targets.truth.clear(depth=1.0)
        self._draw_surfaces(self._truth, scene, camera, seen)

    def _draw_radiance(self, scene: _Scene, camera: Camera, seen: list[tuple[int, Thing]]) -> None:
        c, targets = self._context, self._targets
        self._shadows.use(UNITS["shadow_near"], UNITS["shadow_far"])
        targets.picture.use()
        targets.picture.clear(depth=1.0)
        self._store.draw(self._radiance["thing"], seen, camera, soft=targets.multi > 1)
        if scene.lawn is not None:
            scene.lawn.draw(self._radiance["blade"], camera)
        scene.ground.draw(self._radiance["ground"], camera, {name: UNITS[name] for name in RASTERS})
        c.depth_func = "<="
        set_uniforms(self._sky, shadow_near=UNITS["shadow_near"], shadow_far=UNITS["shadow_far"])
        self._screens[0].render(vertices=3)
        c.depth_func = "<"
        targets.resolve()
        targets.finished.use()
        c.enable_only(c.NOTHING)
        targets.plain.use(8)
        targets.depth.use(9)
        set_uniforms(self._finish, picture=8, depth_map=9)
        self._screens[1].render(vertices=3)

    def _read_truth(self) -> tuple[Float32Array, Any, Any]:
        w, h = self._size
        depth = np.frombuffer(self._targets.depth.read(alignment=1), np.float32).reshape(h, w).copy()
        ids = np.frombuffer(self._targets.ids.read(alignment=1), np.uint16).reshape(h, w, 2)
        return depth, ids[..., 0].astype(np.uint8), ids[..., 1].copy()
