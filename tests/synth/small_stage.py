"""A stage without a graphics driver: boxes on a lawn, drawn in closed form."""

import os
import signal
from dataclasses import replace

import numpy as np

from swardmap.geometry import Intrinsics, Pose, mount_pose
from swardmap.labels import OTHER, PERSON, VOID_ID
from swardmap.synth import analytic
from swardmap.synth.config import RigConfig, SynthConfig
from swardmap.synth.model import Float32Array, Garden, Light, Model, Thing, View
from swardmap.synth.shapes import box, placed
from swardmap.synth.stage import Drive, Stage
from swardmap.synth.terrain import Terrain

SIZE_M, TEXEL_M = 16.0, 0.25


class Walker:
    """Somebody of boxes who walks to the left."""

    def at(self, stamp_ns: int) -> Thing:
        """Where he is at a time."""
        mesh = box((0.4, 0.4, 1.7))
        T = placed(4.0, -1.0 + 0.8 * stamp_ns * 1e-9)
        return Thing(Model("walker", (mesh,)), "person", T, PERSON, "walking")


class SmallStage:
    """Boxes: a shed and a pot by the seed, a walker; no way to go wrong with a driver."""

    facts = {"assets": "none", "driver": "closed form"}  # noqa: RUF012

    def garden(self, seed: int) -> Garden:
        """Two boxes and a walker."""
        x = 5.0 + float(np.random.default_rng(seed).uniform(0, 1))
        n = round(SIZE_M / TEXEL_M)
        one = np.ones((n, n), np.float32)
        lawn = np.tile(np.linspace(-6, 10, n, dtype=np.float32)[:, None], (1, n))  # gravel beyond y = -2
        ground = Terrain((-SIZE_M / 2, -SIZE_M / 2), TEXEL_M, 0 * one, lawn, (0 * one).astype(np.uint8),
                        np.ones((n, n, 3), np.float32), 0 * one, 0 * one, 0 * one)  # fmt: skip
        things = (
            Thing(Model("shed", (box((1.0, 2.0, 1.8)),)), "shed", placed(x, 2.0)),
            Thing(Model("pot", (box((0.3, 0.3, 0.4)),)), "pot", placed(2.5, -0.5)),
        )
        return Garden(f"garden-{seed:04d}", seed, ground, things, np.zeros((4, 2)), (Walker(),))

    def drive(self, garden: Garden, frames: int, rig: RigConfig) -> Drive:
        """Straight on."""
        focal = 0.9 * rig.width
        lens = Intrinsics(rig.width, rig.height, focal, focal, (rig.width - 1) / 2, (rig.height - 1) / 2)
        period_ns = round(1e9 / rig.rate_hz)
        poses = [mount_pose(0.8, 15.0, xy_m=(0.1 * i, 0.0), parent="map") for i in range(frames)]
        return lens, [(i * period_ns, pose) for i, pose in enumerate(poses)]

    def light(self, illumination: str, rng: np.random.Generator) -> Light:
        """Brightness by chance."""
        b = float(rng.uniform(0.5, 1.0))
        white = (b, b, b)
        return Light(illumination, (0.0, 0.0, 1.0), white, white, white, white, 0.1, 0.0, 0.0)

    def view(self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
             ) -> View:  # fmt: skip
        """By the analytic garden."""
        things = garden.at(stamp_ns)
        solids = tuple(_solid(thing) for thing in things)
        scene = analytic.Scene(solids, (analytic.Patch((0, -5.0), (16.0, 6.0), material=analytic.GRAVEL),))
        frame = analytic.render(scene, intrinsics, T_map_camera, exact=True)
        assert frame.labels is not None
        labels = np.where(frame.labels == VOID_ID, OTHER.id, frame.labels).astype(np.uint8)
        which = np.zeros(labels.shape, np.uint16)
        for k, solid in enumerate(solids):
            alone = analytic.render(analytic.Scene((solid,)), intrinsics, T_map_camera, exact=True)
            assert alone.labels is not None
            which[(alone.labels == solid.label.id) & (alone.depth == frame.depth)] = k + 1
        radiance = (frame.rgb.astype(np.float32) / 255) ** 2.2 * np.float32(light.sun[0])
        return View(radiance.astype(np.float32), np.asarray(frame.depth, np.float32), labels, which)

    def radiance(self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
                 ) -> Float32Array:  # fmt: skip
        """Of the view."""
        return self.view(garden, light, intrinsics, T_map_camera, stamp_ns).radiance


def _solid(thing: Thing) -> analytic.Box:
    low, high = thing.model.bounds_m()
    x, y = thing.T_map_model[:2, 3]
    size = tuple(float(v) for v in high - low)
    return analytic.Box((float(x), float(y)), size, label=thing.label)  # type: ignore[arg-type]


def small_stage(config: SynthConfig) -> Stage:
    """The stage, for processes."""
    return SmallStage()


class DyingStage(SmallStage):
    """Kills its process in the garden of seed 1, as the kernel does when memory is short."""

    def drive(self, garden: Garden, frames: int, rig: RigConfig) -> Drive:
        """The way, or the end."""
        if garden.seed == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().drive(garden, frames, rig)


def dying_stage(config: SynthConfig) -> Stage:
    """The stage, for processes."""
    return DyingStage()


def small_config(**sections: object) -> SynthConfig:
    """Tiny pictures and coarse maps."""
    base = SynthConfig()
    rig = replace(base.rig, width=96, height=72)
    return replace(base, rig=rig, map=replace(base.map, resolution_m=0.1), **sections)  # type: ignore[arg-type]
