"""Two shadow maps: one around the camera, one of the whole garden. Both are kept while they stay true."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from swardmap.synth.model import Float64Array, Light, Thing
from swardmap.synth.render.camera import RenderCamera
from swardmap.synth.render.context import Context, program_of
from swardmap.synth.render.things import Placed, ThingStore

SIZE = 2048
NEAR_RADIUS_M = 8.0
NEAR_AHEAD_M = 4.5
NEAR_SLACK_M = 1.5
DEPTH_M = 60.0
TYPICAL_HEIGHT_M = 2.0
"""Shadows are as soft as those of things at this distance from where the shadow falls."""


def light_from_map(sun_direction: ArrayLike, centre_m: Float64Array, radius_m: float) -> Float64Array:
    """Clip coordinates of a parallel view from the sun, 4 x 4."""
    toward = np.asarray(sun_direction, np.float64)
    x = np.cross([0.0, 0.0, 1.0], toward)
    x /= max(float(np.linalg.norm(x)), 1e-9)
    y = np.cross(toward, x)
    clip = np.eye(4)
    clip[:3, :3] = np.stack((x / radius_m, y / radius_m, -toward / DEPTH_M))
    clip[:3, 3] = -clip[:3, :3] @ centre_m
    return clip


def to_texture(clip: Float64Array) -> Float64Array:
    """From -1..1 to 0..1."""
    half = np.diag([0.5, 0.5, 0.5, 1.0])
    half[:3, 3] = 0.5
    return half @ clip


class _Map:
    """One map: what stands still is kept, what moves is drawn over a copy."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self.textures = [context.depth_texture((SIZE, SIZE)) for _ in range(2)]
        for texture in self.textures:
            texture.compare_func = "<="
            texture.filter = (0x2601, 0x2601)  # GL_LINEAR
            texture.repeat_x = texture.repeat_y = False
        # a picture beside the depth, never drawn to: moderngl copies framebuffers only by their pictures
        self.buffers = [
            context.framebuffer([context.renderbuffer((SIZE, SIZE), 1)], texture) for texture in self.textures
        ]
        for buffer in self.buffers:
            buffer.color_mask = (False, False, False, False)
        self.key: tuple[Any, ...] = ()
        self.centre_m: Float64Array = np.zeros(3)
        self.radius_m = 1.0
        self.clip: Float64Array = np.eye(4)
        self.shown = self.textures[0]


class Shadows:
    """The two maps of the garden, light and camera drawn last."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._program = program_of(context, "caster", "caster")
        self._near, self._far = _Map(context), _Map(context)

    @property
    def matrices(self) -> tuple[Float64Array, Float64Array]:
        """From the map to both, 0..1."""
        return to_texture(self._near.clip), to_texture(self._far.clip)

    def softness(self, light: Light) -> tuple[float, float]:
        """Half-shadow in both, as share of their edges; at least what hides their texels."""
        radius_m = light.softness * TYPICAL_HEIGHT_M / 2
        return (
            max(radius_m / (2 * self._near.radius_m), 0.9 / SIZE),
            max(radius_m / (2 * self._far.radius_m), 0.7 / SIZE),
        )

    def use(self, near: int, far: int) -> None:
        """Bind both."""
        self._near.shown.use(near)
        self._far.shown.use(far)

    def update(
        self, key: object, light: Light, camera: RenderCamera, lot_m: Float64Array, still: Placed,
        moving: Placed, store: ThingStore,
    ) -> None:  # fmt: skip
        """Draw what has changed.

        Args:
            key: of the garden.
            light: of the scene.
            camera: that will look.
            lot_m: corners of the lot.
            still: what stands still.
            moving: what does not.
            store: of the meshes.
        """
        ahead = camera.axes[:, 2] * [1, 1, 0]
        centre = camera.position_m + NEAR_AHEAD_M * ahead / max(float(np.linalg.norm(ahead)), 1e-3)
        near = self._near
        kept = near.key == (key, light.sun_direction) and (
            float(np.linalg.norm(centre - near.centre_m)) < NEAR_SLACK_M
        )
        self._draw(near, (key, light.sun_direction), near.centre_m if kept else centre, NEAR_RADIUS_M,
                   still, moving, store)  # fmt: skip
        low, high = lot_m.min(axis=0) - 4, lot_m.max(axis=0) + 4
        middle = np.array([*(low + high) / 2, 0.0])
        self._draw(self._far, (key, light.sun_direction), middle, float(np.linalg.norm(high - low) / 2),
                   still, moving, store)  # fmt: skip

    def _draw(
        self, shadow: _Map, key: tuple[Any, ...], centre_m: Float64Array, radius_m: float, still: Placed,
        moving: Placed, store: ThingStore,
    ) -> None:  # fmt: skip
        toward = np.asarray(key[1], np.float64)
        c = self._context
        c.enable_only(c.DEPTH_TEST)
        c.polygon_offset = (1.5, 2.0)
        if shadow.key != key or not np.array_equal(shadow.centre_m, centre_m):
            shadow.key, shadow.centre_m, shadow.radius_m = key, centre_m.copy(), radius_m
            shadow.clip = light_from_map(toward, centre_m, radius_m)
            shadow.buffers[0].use()
            shadow.buffers[0].clear(depth=1.0)
            store.cast(self._program, _near_ray(still, centre_m, toward, radius_m), shadow.clip)
        shadow.shown = shadow.textures[0]
        movers = _near_ray(moving, centre_m, toward, radius_m)
        if movers:
            c.copy_framebuffer(shadow.buffers[1], shadow.buffers[0])
            shadow.buffers[1].use()
            store.cast(self._program, movers, shadow.clip)
            shadow.shown = shadow.textures[1]
        c.polygon_offset = (0.0, 0.0)


def _near_ray(placed: Placed, centre_m: Float64Array, toward: Float64Array, radius_m: float) -> list[Thing]:
    """Things that the square view from the sun may hold."""
    if not len(placed.radii_m):
        return []
    off = placed.centres_m - centre_m
    across = off - (off @ toward)[:, None] * toward
    seen = np.linalg.norm(across, axis=1) < radius_m * 1.42 + placed.radii_m
    return [placed.things[int(k)][1] for k in np.flatnonzero(seen)]
