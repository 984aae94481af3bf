"""What a page shows of the frames of a run: photo, mask, depth and map of some, and the camera's way."""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from swardmap.geometry import Pose
from swardmap.grid import OccupancyGrid
from swardmap.types import Frame, Segmentation
from swardmap.viz.drawing import Picture
from swardmap.viz.map_layers import image_url
from swardmap.viz.maps import View, bounds_of, draw_camera, draw_classes, draw_scale
from swardmap.viz.pictures import depth_colors

MOST_FRAMES = 80
"""Frames with pictures on a page; about 0.1 MB each."""

MOST_PLACES = 20_000
WIDTH = 480


@dataclass(frozen=True, slots=True)
class AlbumFrame:
    """One frame with its pictures.

    Attributes:
        index: of the frame in the run, from 0.
        name: of the frame.
        stamp_ns: its time.
        xy_m: where the camera was in the map, or None.
        heading_rad: where it looked, from x towards y.
        photo, mask, depth, map: data URLs; the mask is transparent where nothing is known, the map is of
            this frame alone.
        depth_range_m: of the colours of the depth.
    """

    index: int
    name: str
    stamp_ns: int
    xy_m: tuple[float, float] | None
    heading_rad: float
    photo: str
    mask: str
    depth: str
    map: str
    depth_range_m: tuple[float, float]


@dataclass(slots=True)
class Album:
    """Frames of a run at even distances, however long it becomes, and the camera's way.

    Attributes:
        pictures: whether frames are kept; the way always is.
        frames: those kept, between half of MOST_FRAMES and all of it once there are enough.
        way_m: (x, y) of the camera, at least `step_m` apart.
    """

    pictures: bool = True
    step_m: float = 0.02
    frames: list[AlbumFrame] = field(default_factory=list)
    way_m: list[tuple[float, float]] = field(default_factory=list)
    _every: int = 1
    _count: int = 0

    def add(self, frame: Frame, segmentation: Segmentation, seen: OccupancyGrid, T_seen_camera: Pose) -> None:
        """See one frame.

        Args:
            frame: with a pose where it has a place in the map of the run.
            segmentation: its mask.
            seen: the map of this frame alone.
            T_seen_camera: the camera in it.
        """
        T_map_camera = frame.T_map_camera
        if T_map_camera is not None:
            x, y = (float(v) for v in T_map_camera.position_m[:2])
            if not self.way_m or np.hypot(x - self.way_m[-1][0], y - self.way_m[-1][1]) >= self.step_m:
                self.way_m.append((x, y))
            if len(self.way_m) > MOST_PLACES:
                self.way_m, self.step_m = self.way_m[::2], 2 * self.step_m
        if self.pictures and self._count % self._every == 0:
            self.frames.append(album_frame(frame, segmentation, seen, T_seen_camera, self._count))
            if len(self.frames) > MOST_FRAMES:
                self.frames, self._every = self.frames[::2], 2 * self._every
        self._count += 1


def album_frame(
    frame: Frame, segmentation: Segmentation, seen: OccupancyGrid, T_seen_camera: Pose, index: int
) -> AlbumFrame:
    """The pictures of one frame, no wider than WIDTH; arguments as for `Album.add`."""
    T_map_camera = frame.T_map_camera
    height, width = frame.intrinsics.height, frame.intrinsics.width
    size = (min(WIDTH, width), max(1, round(height * min(WIDTH, width) / width)))
    depth, low_m, high_m = depth_colors(frame.depth_m)
    forward = np.zeros(3) if T_map_camera is None else T_map_camera.matrix[:3, 2]
    place = None if T_map_camera is None else T_map_camera.position_m
    return AlbumFrame(
        index,
        frame.name or str(index),
        frame.stamp_ns,
        None if place is None else (round(float(place[0]), 3), round(float(place[1]), 3)),
        round(float(np.arctan2(forward[1], forward[0])), 3),
        image_url(_smaller(frame.rgb, size, cv2.INTER_AREA), ".jpg"),
        image_url(_mask(segmentation, size), ".png"),
        # nearest: a mixture of two depths is a depth that nothing has
        image_url(_smaller(depth, size, cv2.INTER_NEAREST), ".jpg"),
        image_url(_map(frame, seen, T_seen_camera, size), ".png"),
        (round(low_m, 2), round(high_m, 2)),
    )


def _smaller(image: NDArray[np.uint8], size: tuple[int, int], how: int) -> NDArray[np.uint8]:
    resized: NDArray[np.uint8] = cv2.resize(np.ascontiguousarray(image), size, interpolation=how)
    return resized


def _mask(segmentation: Segmentation, size: tuple[int, int]) -> NDArray[np.uint8]:
    small = segmentation.resized_to(size[1], size[0])
    says_something = small.label_set.map_class_table[small.labels] > 0
    pixels = np.zeros((*small.labels.shape, 4), np.uint8)
    pixels[..., :3] = small.label_set.color_table[small.labels]
    pixels[..., 3] = np.where(says_something, 255, 0)
    return pixels


def _map(frame: Frame, seen: OccupancyGrid, T_seen_camera: Pose, size: tuple[int, int]) -> Picture:
    view = View.of(bounds_of(seen, T_seen_camera.position_m[:2]), *size)
    picture = draw_classes(seen, view)
    draw_camera(picture, view, T_seen_camera, frame.intrinsics)
    draw_scale(picture, view)
    return picture
