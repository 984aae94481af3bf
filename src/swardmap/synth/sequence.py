"""A drive through a garden in one light: frames with exact truth, as a source that needs no file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, Pose, interpolate_pose
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet
from swardmap.synth.config import OpticsConfig, StereoConfig
from swardmap.synth.model import Garden, Light, View
from swardmap.synth.sensor.camera import CameraFaults, draw_faults, photograph
from swardmap.synth.sensor.stereo import StereoModel, draw_stereo, stereo_depth
from swardmap.types import Frame

ViewOf = Callable[[Garden, Light, Intrinsics, Pose, int], View]
"""What an ideal camera sees of a garden in a light, from a pose, at a time."""
RadianceOf = Callable[[Garden, Light, Intrinsics, Pose, int], NDArray[np.float32]]
"""Its colours alone."""

MAX_DEPTH_MM = 65535


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """One moment of a drive, with all that is known of it.

    Attributes:
        frame: as a robot gets it: with the sensor's depth, if there is one.
        view: what an ideal camera sees; its depth is exact.
        blurred: whether the colour image has motion blur.
        heavy_loss: whether the depth sensor lost far more than it does by rule.
    """

    frame: Frame
    view: View
    blurred: bool = False
    heavy_loss: bool = False


@dataclass(frozen=True, eq=False)
class GardenSource:
    """Frames of a garden along a way; iterating it again gives the same.

    Attributes:
        garden: what there is.
        light: of the whole sequence.
        run: time and pose T_map_camera of each frame.
        intrinsics: of colour and depth.
        view_of: draws.
        camera, stereo: settings; the strengths are drawn from `seed`, once a sequence.
        seed: whole numbers; frame i draws from (*seed, i).
        tags: of all frames.
        radiance_of: draws what is averaged to motion blur; None = `view_of`.
    """

    garden: Garden
    light: Light
    run: Sequence[tuple[int, Pose]]
    intrinsics: Intrinsics
    view_of: ViewOf
    camera: OpticsConfig
    stereo: StereoConfig
    seed: tuple[int, ...] = (0,)
    tags: Mapping[str, str] | None = None
    radiance_of: RadianceOf | None = None

    def __post_init__(self) -> None:
        stamps = [stamp_ns for stamp_ns, _ in self.run]
        if not stamps or stamps != sorted(set(stamps)):
            raise InvalidValueError(
                f"drive: expected at least one frame, at rising times, got {len(stamps)} at {stamps[:4]} ..."
            )

    @property
    def name(self) -> str:
        """Of the garden, and its light."""
        return f"{self.garden.name}-{self.light.illumination}"

    @property
    def frame_count(self) -> int:
        """One a pose."""
        return len(self.run)

    @property
    def label_set(self) -> LabelSet:
        """Other, grass, person."""
        return GRASS_OBSTACLE_PERSON

    @property
    def skipped(self) -> Mapping[str, int]:
        """Nothing, ever."""
        return {}

    @property
    def faults(self) -> CameraFaults:
        """Of the camera, the same for all frames."""
        return draw_faults(self.camera, np.random.default_rng([*self.seed, 1]))

    @property
    def sensor(self) -> StereoModel | None:
        """Of the depth, the same for all frames; None if it is exact."""
        return (
            draw_stereo(self.stereo, np.random.default_rng([*self.seed, 2])) if self.stereo.enabled else None
        )

    def __iter__(self) -> Iterator[Frame]:
        """Draw frame by frame."""
        for shot in self.shots():
            yield shot.frame

    def shots(self) -> Iterator[Shot]:
        """Frame by frame, each with its exact truth."""
        faults, sensor = self.faults, self.sensor
        for index in range(len(self.run)):
            yield self._shot(index, faults, sensor)

    def _shot(self, index: int, faults: CameraFaults, sensor: StereoModel | None) -> Shot:
        rng = np.random.default_rng([*self.seed, 3, index])
        blurred = self.camera.faults and bool(rng.random() < self.camera.blur_share)
        shutter_s = float(rng.uniform(*self.camera.shutter_s))
        heavy_loss = sensor is not None and bool(rng.random() < self.stereo.heavy_loss_share)
        dropout = float(rng.uniform(*self.stereo.heavy_dropout))
        stamp_ns, T_map_camera = self.run[index]
        view = self.view_of(self.garden, self.light, self.intrinsics, T_map_camera, stamp_ns)
        radiance = self._blurred(index, view.radiance, shutter_s) if blurred else view.radiance
        rgb = photograph(radiance, faults, rng)
        depth = to_millimetres(view.depth_m)
        if sensor is not None:
            model = replace(sensor, dropout=dropout) if heavy_loss else sensor
            depth = sensed_depth(view, rgb, self.intrinsics, model, rng)
        frame = Frame(
            stamp_ns,
            self.intrinsics,
            rgb,
            depth,
            T_map_camera=T_map_camera,
            labels=view.labels,
            label_set=GRASS_OBSTACLE_PERSON,
            name=f"{index + 1:05d}",  # as EDEN counts
            tags=dict(self.tags or {"scene": self.garden.name, "illumination": self.light.illumination}),
        )
        return Shot(frame, view, blurred, heavy_loss)

    def _blurred(self, index: int, sharp: NDArray[np.float32], shutter_s: float) -> NDArray[np.float32]:
        """Mean of several pictures while the shutter is open; the sharp one is the middle."""
        steps = self.camera.blur_steps
        total = sharp.astype(np.float32)
        for k in range(1, steps):
            offset = (k + 1) // 2 * (1 if k % 2 else -1) / steps
            stamp_ns, T_map_camera = pose_near(self.run, index, offset * shutter_s)
            total = total + self._radiance(T_map_camera, stamp_ns)
        return total / np.float32(steps)

    def _radiance(self, T_map_camera: Pose, stamp_ns: int) -> NDArray[np.float32]:
        if self.radiance_of is None:
            return self.view_of(self.garden, self.light, self.intrinsics, T_map_camera, stamp_ns).radiance
        return self.radiance_of(self.garden, self.light, self.intrinsics, T_map_camera, stamp_ns)


def pose_near(run: Sequence[tuple[int, Pose]], index: int, offset_s: float) -> tuple[int, Pose]:
    """Time and pose shortly before or after a frame, by the motion to the next one (or from the last)."""
    first = min(index, len(run) - 2)
    if first < 0:
        return run[index]
    (t0, before), (t1, after) = run[first], run[first + 1]
    stamp_ns = max(0, run[index][0] + round(offset_s * 1e9))
    return stamp_ns, interpolate_pose(before, after, (stamp_ns - t0) / (t1 - t0))


def to_millimetres(depth_m: NDArray[np.floating]) -> NDArray[np.uint16]:
    """Metres to whole millimetres; what is farther than 65.535 m has no reading."""
    millimetres = np.rint(np.nan_to_num(depth_m, posinf=0.0) * 1000)
    return np.where(millimetres <= MAX_DEPTH_MM, millimetres, 0).astype(np.uint16)


def sensed_depth(
    view: View,
    rgb: NDArray[np.uint8],
    intrinsics: Intrinsics,
    sensor: StereoModel,
    rng: np.random.Generator,
) -> NDArray[np.uint16]:
    """Depth of the stereo sensor in millimetres, of what a camera sees; (H, W) uint16, 0 = no reading.

    Args:
        view: of an ideal camera.
        rgb: its picture: where it is plain, stereo finds less.
        intrinsics: of both.
        sensor: the sensor.
        rng: source of the noise.
    """
    import cv2

    gray = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return stereo_depth(view.depth_m, gray, intrinsics.fx, sensor, rng)
