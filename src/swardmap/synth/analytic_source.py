"""Gardens of simple solids as a data set: what the evaluation is tried on where there is no recording."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from swardmap.config import SourceConfig
from swardmap.errors import ConfigError
from swardmap.geometry import Intrinsics, Pose
from swardmap.io.sources.truth import FIRST_AREA, FrameTruth, GroundRaster, KnownThing
from swardmap.labels import GRASS_OBSTACLE_PERSON, PERSON, LabelSet
from swardmap.types import Frame

if TYPE_CHECKING:
    from swardmap.synth.analytic import Scene

ANALYTIC = "analytic"
"""Location that names no file, such as `analytic:scenes=20,frames=10`."""

DEFAULTS = {"scenes": 4, "frames": 25, "noise": 1, "seed": 0, "width": 640}


class AnalyticGardens:
    """Gardens of simple solids, one sequence each, seen by a depth sensor with known faults.

    Args:
        location: see DatasetSpec.
        config: start, stop and every.
    """

    def __init__(self, location: str, config: SourceConfig) -> None:
        self._values = dict(DEFAULTS)
        for part in filter(None, location.removeprefix(ANALYTIC).removeprefix(":").split(",")):
            key, _, text = part.partition("=")
            if key not in self._values or not text.isdigit():
                raise ConfigError(
                    f"'{location}': expected whole numbers for {', '.join(self._values)}, got '{part}'"
                )
            self._values[key] = int(text)
        total = self._values["scenes"] * self._values["frames"]
        stop = total if config.stop is None else min(config.stop, total)
        self._indices = range(config.start, max(config.start, stop), config.every)
        self._location = location

    @property
    def name(self) -> str:
        """The location."""
        return self._location

    @property
    def frame_count(self) -> int:
        """Frames of all gardens."""
        return len(self._indices)

    @property
    def label_set(self) -> LabelSet:
        """Other, grass, person."""
        return GRASS_OBSTACLE_PERSON

    @property
    def skipped(self) -> Mapping[str, int]:
        """Nothing, ever."""
        return {}

    def __iter__(self) -> Iterator[Frame]:
        """Render frame by frame."""
        from swardmap.synth.analytic import StereoNoise, with_sensor_noise

        for index in self._indices:
            frame = self._render(index)
            if self._values["noise"]:
                rng = np.random.default_rng([self._values["seed"], index])
                frame = with_sensor_noise(frame, rng, StereoNoise())
            yield frame

    def clean_frame(self, position: int) -> Frame:
        """The frame at a position of this dataset as an ideal sensor sees it."""
        return self._render(self._indices[position])

    def truth(self, position: int) -> FrameTruth:
        """Which solid each pixel of a frame shows; the lawn is the plane z = 0."""
        from swardmap.synth.analytic_render import cast

        scene, pose, intrinsics, stamp_ns = self._view(self._indices[position])
        solids = scene.at(stamp_ns)
        surface = cast(solids, scene.patches, intrinsics, pose).surface.astype(np.int64)
        ids = np.where(surface < 0, 0, np.where(surface < len(solids), surface + 1, FIRST_AREA)).astype(
            np.uint16
        )
        things = {
            k + 1: KnownThing(
                "person" if s.label == PERSON else type(s).__name__.lower(), float(s.bounds()[1][2])
            )
            for k, s in enumerate(solids)
        }
        ground = GroundRaster((-1.0, -1.0), 1.0, np.zeros((2, 2), np.float32))
        return FrameTruth(ids, things | {FIRST_AREA: KnownThing("patch", 0.0)}, ground)

    def _render(self, index: int) -> Frame:
        from swardmap.synth.analytic import render

        scene, pose, intrinsics, stamp_ns = self._view(index)
        scene_number, step = divmod(index, self._values["frames"])
        name = f"{self._values['seed'] + scene_number:04d}_{step:04d}"
        return replace(render(scene, intrinsics, pose, stamp_ns, name), tags={"sequence": scene.name})

    def _view(self, index: int) -> "tuple[Scene, Pose, Intrinsics, int]":
        from swardmap.synth.analytic import VGA, garden_scene, lane_poses

        scene_number, step = divmod(index, self._values["frames"])
        width = self._values["width"]
        pose = lane_poses(1, start_m=(0.25 * step % 3.0, 0.0))[0]
        scene = garden_scene(self._values["seed"] + scene_number)
        return scene, pose, VGA.scaled_to(width, width * 3 // 4), step * 200_000_000


def open_named(location: str, config: SourceConfig) -> AnalyticGardens:
    """Open the gardens that a location describes.

    Raises:
        ConfigError: for a key that is not known, or a value that is no whole number.
    """
    return AnalyticGardens(location, config)
