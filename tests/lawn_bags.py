"""A lawn with one box on it, driven up to, as the messages of a recording: the truth of tests about bags.

The camera stands 0.9 m above z = 0 and looks 25 degrees down; the box is at x 2.2 to 2.6, y -0.2 to 0.2, 0.5
m high, gray on green. A map of it has obstacles on the box and nowhere else.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import config_from_dict
from swardmap.geometry import R_BODY_OPTICAL, Intrinsics, Pose
from swardmap.io import open_source
from swardmap.io.bags import ros_fields as rf
from swardmap.io.sources.source import Source
from swardmap.labels import MapClass
from swardmap.runs.recording import map_recording
from tests.bags import IMAGE, INFO, TF, Event

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
CAMERA = Intrinsics(160, 120, 130.0, 130.0, 79.5, 59.5)
OPTICAL = "camera_color_optical_frame"
COLOR, DEPTH = "/camera/color/image_raw", "/camera/aligned_depth_to_color/image_raw"
GREEN, GRAY, SKY = (60, 160, 50), (150, 140, 150), (90, 150, 230)
LOWER, UPPER = np.array([2.2, -0.2, 0.0]), np.array([2.6, 0.2, 0.5])
PERIOD_MS = 100
FRAMES = 6

Rays = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]


def down(degrees: float = 25.0) -> NDArray[np.float64]:
    """Rotation of the body axes of a camera that looks down."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


def pose(parent: str, child: str, place: Iterable[float], turn: NDArray[np.float64] | None = None) -> Pose:
    matrix = np.eye(4)
    matrix[:3, 3] = list(place)
    matrix[:3, :3] = np.eye(3) if turn is None else turn
    return Pose(parent, child, matrix)


def mount(child: str = OPTICAL) -> Pose:
    return pose("base_link", child, (0.2, 0, 0.9), down() @ R_BODY_OPTICAL)


def T_map_base(at: float) -> Pose:
    """After so many periods: 0.1 m each."""
    return pose("map", "base_link", (0.1 * at, 0, 0))


def render(
    camera: Intrinsics, T_map_camera: NDArray[np.float64], rays: Rays | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Colours, and depth along the optical axis in metres with 0 for the sky."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=float), np.arange(camera.height, dtype=float))
    d = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones_like(u)], -1)
    d = d if rays is None else rays(u, v)
    turned, eye = d @ T_map_camera[:3, :3].T, T_map_camera[:3, 3]
    with np.errstate(all="ignore"):
        ground = -eye[2] / turned[..., 2]
        near, far = (LOWER - eye) / turned, (UPPER - eye) / turned
    enter, leave = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
    on_ground = (ground > 0) & (ground < 60)
    distance = np.where(on_ground, ground, np.inf)
    on_box = (enter < leave) & (enter > 0) & (enter < distance)
    distance = np.where(on_box, enter, distance)
    rgb = np.full((camera.height, camera.width, 3), SKY, np.uint8)
    rgb[on_ground], rgb[on_box] = GREEN, GRAY
    depth = np.where(np.isfinite(distance), distance * d[..., 2], 0)
    return rgb, depth


def millimetres(depth_m: NDArray[np.float64]) -> NDArray[np.uint16]:
    return np.round(depth_m * 1000).clip(0, 65535).astype(np.uint16)


@dataclass(frozen=True)
class Lawn:
    """What is recorded. A change of one field is a test of one thing."""

    color_topic: str = COLOR
    depth_topic: str = DEPTH
    color_frame: str = OPTICAL
    depth_frame: str = OPTICAL
    camera: Intrinsics = CAMERA
    depth_camera: Intrinsics = CAMERA
    T_color_depth: NDArray[np.float64] | None = None
    rays: Rays | None = None
    tf_topic: str = "/tf"
    chain: tuple[str, str] = ("map", "odom")
    tf_ms: int = 20
    tf_late_ms: int = 0
    tf_shift_ns: int = 0
    depth_shift_ms: int = 0
    static: tuple[Pose, ...] | None = None
    with_tf: bool = True
    frames: int = FRAMES
    # from an image, its time and its frame to fields of a message, and of a CameraInfo
    color: Callable[[Any, int, str], Any] = rf.image_fields
    depth: Callable[[Any, int, str], Any] = rf.image_fields
    info: Callable[..., Any] = rf.camera_info_fields
    depth_info: Callable[..., Any] | None = None
    info_topics: tuple[str, str] | None = None
    kind_of: Callable[[str], str] = lambda topic: IMAGE

    def with_(self, **changes: Any) -> "Lawn":
        return replace(self, **changes)

    def events(self) -> list[Event]:
        found = [*self._images(), *(self._tf() if self.with_tf else ())]
        return sorted(found, key=lambda event: event[0])

    def _tf(self) -> Iterable[Event]:
        static = (mount(self.color_frame),) if self.static is None else self.static
        if static:
            yield START_NS - 500 * MS, f"{self.tf_topic}_static", TF, rf.tf_fields(static, START_NS)
        top, odom = self.chain
        for ms in range(-200, self.frames * PERIOD_MS + 200, self.tf_ms):
            t = START_NS + ms * MS
            moved = pose(odom, "base_link", T_map_base(ms / PERIOD_MS).position_m)
            poses = [moved] if top == odom else [pose(top, odom, (0, 0, 0)), moved]
            yield t + self.tf_late_ms * MS, self.tf_topic, TF, rf.tf_fields(poses, t + self.tf_shift_ns)

    def _images(self) -> Iterable[Event]:
        for i in range(self.frames):
            t = START_NS + i * PERIOD_MS * MS
            yield from self._shot(i, t)

    def _shot(self, i: int, t: int) -> Iterable[Event]:
        T = (T_map_base(i) @ mount("camera")).matrix
        rgb, _ = render(self.camera, T, self.rays)
        T_depth = T if self.T_color_depth is None else T @ self.T_color_depth
        depth = millimetres(render(self.depth_camera, T_depth, self.rays)[1])
        at, deep = t + 5 * MS, t + self.depth_shift_ms * MS
        sides = (
            (self.color_topic, self.color, rgb, t, self.color_frame, self.info, self.camera),
            (self.depth_topic, self.depth, depth, deep, self.depth_frame,
             self.depth_info or self.info, self.depth_camera),
        )  # fmt: skip
        for topic, make, image, stamp, frame, info, camera in sides:
            place = topic.removesuffix("/compressed").removesuffix("/compressedDepth").rpartition("/")[0]
            beside = dict(
                zip((self.color_topic, self.depth_topic), self.info_topics or ("", ""), strict=True)
            )
            yield at, beside[topic] or f"{place}/camera_info", INFO, info(camera, stamp, frame)
            yield at + MS, topic, self.kind_of(topic), make(image, stamp, frame)


@dataclass(frozen=True)
class Mapped:
    """A map of the lawn."""

    source: Source
    frames: int
    obstacles: NDArray[np.float64]
    grass: int
    seen: frozenset[tuple[int, int]]

    @property
    def on_box(self) -> int:
        """Obstacle cells within a cell of the box."""
        inside = (self.obstacles > LOWER[:2] - 0.05) & (self.obstacles < UPPER[:2] + 0.05)
        return int(inside.all(axis=1).sum())

    @property
    def elsewhere(self) -> int:
        """Obstacle cells that are not on the box."""
        return len(self.obstacles) - self.on_box


def mapped(path: Path, **sections: dict[str, Any]) -> Mapped:
    """The map of a recording, by excess green."""
    config = config_from_dict({"segmenter": {"name": "colour"}, **sections})
    source = open_source(path, config)
    assert isinstance(source, Source)
    run = map_recording(source, None, config)
    assert run.grid is not None, source.facts
    x0, y0 = run.grid.spec.origin_m
    rows, columns = np.nonzero(run.grid.classes == MapClass.OBSTACLE)
    resolution_m = run.grid.spec.resolution_m
    centers = np.asarray((np.stack([columns, rows], 1) + 0.5) * resolution_m + (x0, y0), np.float64)
    green = zip(*np.nonzero(run.grid.classes == MapClass.GRASS), strict=True)
    offset = (round(y0 / run.grid.spec.resolution_m), round(x0 / run.grid.spec.resolution_m))
    seen = frozenset((int(r) + offset[0], int(c) + offset[1]) for r, c in green)
    return Mapped(source, run.totals.frames, centers, len(seen), seen)
