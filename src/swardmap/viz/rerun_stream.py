"""A run as a stream to the Rerun viewer, or into an .rrd file.

world/camera                pose and frustum; below it, in its pixels:
world/camera/photo          colour image
world/camera/mask           classes, as the segmenter gave them
world/camera/confidence     how sure it was, 0..255, if it says so
world/camera/depth          depth image
world/cloud                 labelled points of the frame, filtered, in the map frame
world/map                   the map on the ground, with the margin in it; of poses, the accumulated one
costmap                     its costs, seen from above
timings/STAGE               milliseconds of each stage, and of reading the frame
latency/pipeline            milliseconds of all stages; latency/image: from the time of a live image on

Timelines: `frame`, and `stamp`, the time of the image.
"""

import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.errors import OutputError, require
from swardmap.grid import OccupancyGrid
from swardmap.labels import LabelSet
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.types import Frame
from swardmap.viz.maps import View, bounds_of, draw_classes, draw_costs, tint_costs

EPOCH_FROM_NS = 946_684_800 * 10**9
"""Stamps from the year 2000 on are dates; earlier ones count from the beginning of a recording."""

MAP_EVERY = 5
"""Of so many frames one sends the accumulated map."""

MAX_TEXTURE = 1024
"""Pixels of the longer side of a map; finer maps show the gravest class of each pixel."""


@contextmanager
def rerun_recording(
    save: Path | None = None, connect: str | None = None, overwrite: bool = False
) -> Iterator[Any]:
    """A rerun.RecordingStream into a file, to a viewer that runs, or to one that is started for it.

    Args:
        save: .rrd file; it appears under its name when it is whole.
        connect: such as rerun+http://127.0.0.1:9876/proxy.
        overwrite: replace the file of that name.

    Raises:
        MissingExtraError: without rerun-sdk.
        OutputError: if the file cannot be written, or the viewer cannot be started or named so.
    """
    rr = require("rerun", "view")
    stream = rr.RecordingStream("swardmap")
    blueprint = _layout()
    if save is not None:
        with _whole_file(save, overwrite) as temporary:
            stream.save(temporary, default_blueprint=blueprint)
            yield stream
            _finish(stream)
        return
    try:
        if connect is not None:
            stream.connect_grpc(connect, default_blueprint=blueprint)
        else:
            stream.spawn(default_blueprint=blueprint)
    except (RuntimeError, ValueError, OSError) as error:
        raise OutputError(
            f"no Rerun viewer at {connect}: {error}"
            if connect
            else f"the Rerun viewer does not start: {error}"
        ) from error
    try:
        yield stream
    finally:
        _finish(stream)


class RerunStream:
    """Sends what each frame gave.

    Args:
        stream: an open rerun.RecordingStream.
        config: of the run.
        jpeg_quality: of the photo; None = as it is.
        live: whether the stamps are those of a camera that runs now.
    """

    def __init__(
        self, stream: Any, config: Config, jpeg_quality: int | None = None, live: bool = False
    ) -> None:
        self._rr = require("rerun", "view")
        self._stream, self._config = stream, config
        self._jpeg_quality, self._live = jpeg_quality, live
        self._frames = 0

    def add(self, step: StepResult, mapper: ObstacleMapper, read_ms: float = 0.0) -> None:
        """Send one frame: images, pose, cloud, timings; the map now and then."""
        image_to_map_ms = (time.time_ns() - step.frame.stamp_ns) / 1e6
        if self._frames == 0:
            self._begin(step.segmentation.label_set)
        self._set_time(step.frame.stamp_ns)
        self._log_camera(step)
        self._log_images(step)
        self._log_cloud(step)
        accumulated = mapper.map
        if accumulated is None:
            self._log_map(step.seen, mapper)
        elif self._frames % MAP_EVERY == 0:
            self._log_map(accumulated, mapper)
        timings = {"read": read_ms, **step.timings_ms}
        for stage, milliseconds in timings.items():
            self._log(f"timings/{stage}", self._rr.Scalars(milliseconds))
        self._log("latency/pipeline", self._rr.Scalars(sum(step.timings_ms.values())))
        if self._live:
            self._log("latency/image", self._rr.Scalars(image_to_map_ms))
        self._frames += 1

    def finish(self, mapper: ObstacleMapper) -> None:
        """Send the map as it is after the last frame."""
        if mapper.map is not None:
            self._log_map(mapper.map, mapper)

    def _begin(self, label_set: LabelSet) -> None:
        rr = self._rr
        classes = [(c.id, c.name, c.color) for c in label_set.classes]
        self._stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log("world", rr.AnnotationContext(classes), static=True)

    def _set_time(self, stamp_ns: int) -> None:
        self._stream.set_time("frame", sequence=self._frames)
        if stamp_ns >= EPOCH_FROM_NS:
            self._stream.set_time("stamp", timestamp=np.datetime64(stamp_ns, "ns"))
        else:
            self._stream.set_time("stamp", duration=np.timedelta64(stamp_ns, "ns"))

    def _log_camera(self, step: StepResult) -> None:
        rr, camera, matrix = self._rr, step.frame.intrinsics, step.T_map_camera.matrix
        transform = rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3])
        pinhole = rr.Pinhole(
            image_from_camera=camera.matrix,
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.6,
        )
        self._log("world/camera", transform)
        self._log("world/camera", pinhole)

    def _log_images(self, step: StepResult) -> None:
        rr, frame = self._rr, step.frame
        photo = rr.Image(frame.rgb)
        if self._jpeg_quality is not None:
            photo = photo.compress(jpeg_quality=self._jpeg_quality)
        self._log("world/camera/photo", photo)
        segmentation = step.segmentation.resized_to(frame.intrinsics.height, frame.intrinsics.width)
        self._log("world/camera/mask", rr.SegmentationImage(segmentation.labels, opacity=0.4))
        if segmentation.confidence is not None:
            sure = np.nan_to_num(segmentation.confidence).clip(0, 1)
            self._log("world/camera/confidence", rr.Image((255 * sure + 0.5).astype(np.uint8), "L"))
        self._log("world/camera/depth", rr.DepthImage(frame.depth, meter=_per_metre(frame)))

    def _log_cloud(self, step: StepResult) -> None:
        cloud = step.cloud(self._config)
        points = self._rr.Points3D(cloud.xyz, class_ids=cloud.labels.astype(np.uint16), radii=0.012)
        self._log("world/cloud", points)

    def _log_map(self, grid: OccupancyGrid, mapper: ObstacleMapper) -> None:
        rr, view, costmap = self._rr, view_of(grid), mapper.costmap(grid)
        picture = draw_classes(grid, view)
        if costmap is not None:
            picture = tint_costs(picture, grid, costmap.costs, view)
            self._log("costmap", rr.Image(draw_costs(costmap.costs, costmap.spec, view)))
        mesh = rr.Mesh3D(
            vertex_positions=corners_of(view),
            vertex_texcoords=[[0, 0], [1, 0], [1, 1], [0, 1]],
            triangle_indices=[[0, 2, 1], [0, 3, 2]],
            albedo_texture=picture,
        )
        self._log("world/map", mesh)

    def _log(self, path: str, what: Any) -> None:
        self._stream.log(path, what)


def view_of(grid: OccupancyGrid) -> View:
    """The window of a map's texture: what is known, a pixel a cell where that is not too many."""
    x_min, x_max, y_min, y_max = bounds_of(grid)
    edge_m = max(grid.spec.resolution_m, max(x_max - x_min, y_max - y_min) / MAX_TEXTURE)
    width, height = (max(1, round(length / edge_m)) for length in (x_max - x_min, y_max - y_min))
    return View(x_min, y_max, 1 / edge_m, width, height)


def corners_of(view: View) -> NDArray[np.float64]:
    """(4, 3) corners of a window on the ground: upper left, upper right, lower right, lower left."""
    left, top = view.left_m, view.top_m
    right, bottom = left + view.width / view.px_per_m, top - view.height / view.px_per_m
    return np.array([[left, top, 0], [right, top, 0], [right, bottom, 0], [left, bottom, 0]])


def _per_metre(frame: Frame) -> float:
    """Depth units in a metre."""
    return 1.0 if frame.depth.dtype == np.float32 else 1 / frame.depth_unit_m


def _layout() -> Any:
    rrb = require("rerun.blueprint", "view")
    images = rrb.Vertical(
        rrb.Spatial2DView(
            origin="world/camera", contents=["$origin/photo", "$origin/mask"], name="Photo and mask"
        ),
        rrb.Spatial2DView(origin="world/camera", contents=["$origin/depth"], name="Depth"),
        rrb.Tabs(
            rrb.Spatial2DView(origin="costmap", name="Costmap"),
            rrb.TimeSeriesView(origin="timings", name="Milliseconds"),
            rrb.TimeSeriesView(origin="latency", name="Latency"),
        ),
    )
    cloud_and_map = ["world/camera", "world/camera/photo", "world/cloud", "world/map"]
    world = rrb.Spatial3DView(origin="world", contents=cloud_and_map, name="Map")
    return rrb.Blueprint(rrb.Horizontal(world, images, column_shares=[3, 2]), collapse_panels=True)


def _finish(stream: Any) -> None:
    stream.flush()
    stream.disconnect()


@contextmanager
def _whole_file(path: Path, overwrite: bool) -> Iterator[Path]:
    """A temporary file beside `path` that takes its name at the end."""
    if path.suffix != ".rrd" or path.is_dir():
        raise OutputError(f"expected a file whose name ends in .rrd, got {path}")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists: choose another name, or pass --overwrite")
    temporary = path.parent / f".{path.name}.{uuid.uuid4().hex[:12]}.part"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary.touch(exist_ok=False)  # Rerun writes in a thread of its own, and would only log it
        yield temporary
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
