"""Gardens to pictures with exact depth and classes."""

from typing import Any

import numpy as np

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose
from swardmap.synth.assets import Assets
from swardmap.synth.model import Float32Array, Garden, Light, View
from swardmap.synth.render.camera import RenderCamera, frame_block
from swardmap.synth.render.context import driver_of, open_context, program_of, set_uniforms
from swardmap.synth.render.detail import details_of
from swardmap.synth.render.ground import GroundPart
from swardmap.synth.render.lawn import LawnPart
from swardmap.synth.render.shadow import Shadows
from swardmap.synth.render.targets import Targets
from swardmap.synth.render.things import Placed, Seen, ThingStore

SURFACES = ("thing", "ground", "blade")
UNITS = {
    "picture": 0, "shadow_near": 1, "shadow_far": 2, "height_map": 3, "lawn_map": 4, "surface_map": 5,
    "albedo_map": 6, "details": 7,
}  # fmt: skip
FINISH_UNITS = {"picture": 8, "depth_map": 9, "occlusion_map": 10}
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
        self._assets, self._blades = assets, blades
        with self._context:
            self._targets = Targets(self._context, width, height, samples)
            self._frame = self._context.buffer(reserve=512)
            self._store = ThingStore(self._context)
            self._shadows = Shadows(self._context)
            self._programs: dict[tuple[str, ...], dict[str, Any]] = {}
            self._screens: list[Any] = []
            for name in ("occlusion", "finish"):
                program = program_of(self._context, "screen", name)
                set_uniforms(program, **FINISH_UNITS)
                self._screens.append(self._context.vertex_array(program, []))
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
        with self._context:
            scene, camera, seen = self._begin(garden, light, intrinsics, T_map_camera, stamp_ns)
            self._draw(scene, camera, seen, "TRUTH")
            self._draw(scene, camera, seen, "RADIANCE")
            self._finished(self._targets.samples)
            return View(self._targets.radiance(), *self._targets.exact())

    def radiance(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> Float32Array:
        """Only the colours of `render`, with one sample a pixel: cheaper, for pictures that are averaged.

        Returns:
            H x W x 3, float32, linear RGB.
        """
        with self._context:
            scene, camera, seen = self._begin(garden, light, intrinsics, T_map_camera, stamp_ns, scale=1)
            self._draw(scene, camera, seen, "RADIANCE", "TRUTH")
            self._finished(self._targets.plain)
            return self._targets.radiance()

    def close(self) -> None:
        """Give back all memory; the renderer cannot be used any more."""
        self._scene = None
        self._context.release()

    def _begin(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int,
        scale: int = 0,
    ) -> tuple[_Scene, RenderCamera, list[Seen]]:  # fmt: skip
        """Upload what is new, draw shadow maps, tell shaders of the frame; return what the camera may see."""
        if (intrinsics.width, intrinsics.height) != self._targets.size:
            w, h = self._targets.size
            raise InvalidValueError(
                f"renderer: expected intrinsics of {w} x {h}, got {intrinsics.width} x {intrinsics.height}"
            )
        scene, camera = self._scene_of(garden), RenderCamera.of(intrinsics, T_map_camera)
        moving = Placed.of([actor.at(stamp_ns) for actor in garden.actors], len(garden.things))
        if moving.things:  # drop the shapes of those who have moved on
            self._store.keep_only(t.model for t in (*garden.things, *(thing for _, thing in moving.things)))
            self._context.gc()
        self._shadows.update(id(scene), light, camera, garden.lot_m, scene.still, moving, self._store)
        block = frame_block(
            camera, light, self._shadows.matrices, self._shadows.softness(light),
            scale or self._targets.scale, scene.phase,
        )  # fmt: skip
        self._frame.write(block)
        self._frame.bind_to_uniform_block(0)
        return scene, camera, scene.still.seen_by(camera) + moving.seen_by(camera)

    def _scene_of(self, garden: Garden) -> _Scene:
        if self._scene is None or self._scene.garden is not garden:
            self._scene = None
            self._store.keep_only(thing.model for thing in garden.things)
            self._context.gc()
            self._scene = _Scene(self._context, garden, self._assets, self._blades)
        return self._scene

    def _draw(self, scene: _Scene, camera: RenderCamera, seen: list[Seen], *outputs: str) -> None:
        """Draw everything; what is near first, since what it hides is not shaded."""
        c, targets = self._context, self._targets
        programs = self._programs_of(outputs)
        alone = {"TRUTH": targets.truth, "RADIANCE": targets.picture}
        target: Any = alone[outputs[0]] if len(outputs) == 1 else targets.both
        self._shadows.use(UNITS["shadow_near"], UNITS["shadow_far"])
        c.enable_only(c.DEPTH_TEST)
        target.use()
        target.clear(depth=1.0)
        self._store.draw(programs["thing"], seen, camera)
        if scene.lawn is not None:
            scene.lawn.draw(programs["blade"], camera)
        scene.ground.draw(programs["ground"], camera, {name: UNITS[name] for name in RASTERS})
        if "sky" in programs:
            programs["sky array"].render(vertices=3)

    def _programs_of(self, outputs: tuple[str, ...]) -> dict[str, Any]:
        if outputs not in self._programs:
            found = {name: program_of(self._context, name, name, *outputs) for name in SURFACES}
            if "RADIANCE" in outputs:  # the truth of the sky is what the target is cleared to
                found["sky"] = program_of(self._context, "screen", "sky", *outputs)
            for program in found.values():
                set_uniforms(program, **UNITS)
            if "sky" in found:
                found["sky array"] = self._context.vertex_array(found["sky"], [])
            self._programs[outputs] = found
        return self._programs[outputs]

    def _finished(self, picture: Any) -> None:
        """Ambient occlusion, and the mean of the samples."""
        targets = self._targets
        self._context.enable_only(self._context.NOTHING)
        targets.depth.use(FINISH_UNITS["depth_map"])
        targets.occluded.use()
        self._screens[0].render(vertices=3)
        picture.use(FINISH_UNITS["picture"])
        targets.occlusion.use(FINISH_UNITS["occlusion_map"])
        targets.finished.use()
        self._screens[1].render(vertices=3)
