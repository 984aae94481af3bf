"""What is needed to film gardens: who builds them, lights them, drives through them and draws them."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from swardmap.geometry import Intrinsics, Pose
from swardmap.synth.config import RigConfig, SynthConfig, read_more
from swardmap.synth.model import Float32Array, Garden, Light, View

if TYPE_CHECKING:
    from swardmap.synth.assets import Assets
    from swardmap.synth.render import GardenRenderer

Drive = tuple[Intrinsics, Sequence[tuple[int, Pose]]]
"""A camera, and time and pose T_map_camera of each frame."""


class Stage(Protocol):
    """Everything that `produce` asks for; tests bring a small one of their own."""

    @property
    def facts(self) -> dict[str, str]:
        """What pictures depend on beside the seed: digest of the assets, driver."""

    def garden(self, seed: int) -> Garden:
        """The garden of a seed."""

    def drive(self, garden: Garden, frames: int, rig: RigConfig) -> Drive:
        """A way through it; the same garden gives the same."""

    def light(self, illumination: str, rng: np.random.Generator) -> Light:
        """One of the many lights of that name."""

    def view(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> View:
        """What an ideal camera sees."""

    def radiance(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> Float32Array:
        """Its colours alone, perhaps coarser: several are averaged to a picture with motion blur."""


class GardenStage:
    """The gardens of the package, drawn by OpenGL.

    Args:
        config: of rig and scene; the driver is opened with the first view.

    Raises:
        MissingExtraError: if OpenGL or the assets are not installed.
    """

    def __init__(self, config: SynthConfig) -> None:
        from swardmap.errors import require
        from swardmap.synth.assets import open_assets

        require("moderngl", "synth")
        self._config = config
        self._assets = open_assets() if config.scene.assets else None
        self._renderer: GardenRenderer | None = None

    @property
    def facts(self) -> dict[str, str]:
        """Digest of the assets, and the driver once it has drawn."""
        driver = "" if self._renderer is None else self._renderer.driver
        return {"assets": "none" if self._assets is None else self._assets.digest, "driver": driver}

    @property
    def assets(self) -> "Assets | None":
        """Ready-made models and bodies; None where the scene is to have none."""
        return self._assets

    def garden(self, seed: int) -> Garden:
        """See `build_garden`."""
        from swardmap.synth.scene.garden import build_garden

        return build_garden(seed, self._assets, read_more(self._config.scene.more))

    def drive(self, garden: Garden, frames: int, rig: RigConfig) -> Drive:
        """See `mowing_run`."""
        from swardmap.synth.scene.camera_path import mowing_run, random_rig

        camera = random_rig(garden.seed, rig.width, rig.height)
        return camera.intrinsics, mowing_run(garden, garden.seed, frames, rig.rate_hz, camera)

    def light(self, illumination: str, rng: np.random.Generator) -> Light:
        """See `sample_light`."""
        from swardmap.synth.light import sample_light

        return sample_light(illumination, rng)

    def view(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> View:
        """See `GardenRenderer.render`."""
        return self._drawn_by.render(garden, light, intrinsics, T_map_camera, stamp_ns)

    def radiance(
        self, garden: Garden, light: Light, intrinsics: Intrinsics, T_map_camera: Pose, stamp_ns: int
    ) -> Float32Array:
        """See `GardenRenderer.radiance`."""
        return self._drawn_by.radiance(garden, light, intrinsics, T_map_camera, stamp_ns)

    @property
    def _drawn_by(self) -> "GardenRenderer":
        if self._renderer is None:
            from swardmap.synth.render import GardenRenderer

            rig = self._config.rig
            self._renderer = GardenRenderer(rig.width, rig.height, rig.samples, self._assets)
        return self._renderer


def garden_stage(config: SynthConfig) -> Stage:
    """The stage of `swardmap synth`."""
    return GardenStage(config)
