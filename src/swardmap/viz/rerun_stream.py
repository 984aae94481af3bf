"""What each frame of a run gave, as a stream for the Rerun viewer (docs/view.md).

world/camera                pose and frustum; below it, in its pixels:
world/camera/photo          colour image
world/camera/mask           classes, as the segmenter gave them
world/camera/confidence     how sure it was, 0..255, if it says so
world/camera/depth          depth image
world/cloud                 labelled points of the frame, filtered, in the map frame
world/map                   the map on the ground, drawn, with the margin in it
map/classes                 its cells as they are, seen from above; of poses, the accumulated map
map/costs                   its costs for Nav2, 0..255
timings/STAGE               milliseconds of each stage, and of reading the frame
latency/pipeline            milliseconds of all stages; latency/image: from the time of a live image on

Timelines: `frame`, and `stamp`, the time of the image.
"""

import importlib
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.grid import OccupancyGrid
from swardmap.labels import LabelSet, MapClass
from swardmap.mapping.costmap import INSCRIBED, LETHAL, NO_INFORMATION
from swardmap.pipeline import ObstacleMapper, StepResult
from swardmap.types import Frame
from swardmap.viz.maps import (
    COLOR_OF_CLASS,
    UNKNOWN_COLOR,
    View,
    bounds_of,
    cost_colors,
    draw_classes,
    tint_costs,
)
from swardmap.viz.rerun_sink import RerunSink, load_rerun

EPOCH_FROM_NS = 946_684_800 * 10**9
"""Stamps from the year 2000 on are dates; earlier ones count from the beginning of a recording."""

MAP_EVERY = 5
"""Of so many frames one sends the accumulated map."""

MAX_TEXTURE = 1024
"""Pixels of the longer side of the drawn map; finer maps show the gravest class of each pixel."""

COST_NAMES = {0: "free", INSCRIBED: "inscribed", LETHAL: "lethal", NO_INFORMATION: "unknown"}


class RerunStream:
    """Sends what each frame gave.

    Args:
        sink: an open stream.
        config: of the run.
        jpeg_quality: of the photo; None = as it is.
        live: whether the stamps are those of a camera that runs now.
    """

    def __init__(
        self, sink: RerunSink, config: Config, jpeg_quality: int | None = None, live: bool = False
    ) -> None:
        self._rr = load_rerun()
        self._sink, self._config = sink, config
        self._jpeg_quality, self._live = jpeg_quality, live
        self._frames = 0

    def add(self, step: StepResult, mapper: ObstacleMapper, read_ms: float = 0.0) -> None:
        """Send one frame: images, pose, cloud, timings; the map now and then.

        Raises:
            OutputError: if it does not arrive.
        """
        image_to_map_ms = (time.time_ns() - step.frame.stamp_ns) / 1e6
        if self._frames == 0:
            self._begin(step.segmentation.label_set)
        self._set_time(step.frame.stamp_ns)
        self._log_camera(step)
        self._log_images(step)
        self._log_cloud(step)
        if step.frame.T_map_camera is None:
            self._log_map(step.seen, mapper)
        elif self._frames % MAP_EVERY == 0 and (accumulated := mapper.map) is not None:
            self._log_map(accumulated, mapper)
        timings = {"read": read_ms, **step.timings_ms}
        for stage, milliseconds in timings.items():
            self._log(f"timings/{stage}", self._rr.Scalars(milliseconds))
        self._log("latency/pipeline", self._rr.Scalars(sum(step.timings_ms.values())))
        if self._live:
            self._log("latency/image", self._rr.Scalars(image_to_map_ms))
        self._sink.arrive()
        self._frames += 1

    def finish(self, mapper: ObstacleMapper) -> None:
        """Send the map as it is after the last frame."""
        if mapper.map is not None:
            self._log_map(mapper.map, mapper)

    def _begin(self, label_set: LabelSet) -> None:
        rr = self._rr
        classes = [(c.id, c.name, c.color) for c in label_set.classes]
        cells = [(int(c), c.name.lower(), tuple(COLOR_OF_CLASS[c].tolist())) for c in MapClass]
        colors = np.roll(cost_colors(), -1, axis=0).tolist()  # unknown comes first there, and is 255
        costs = [(i, COST_NAMES.get(i, str(i)), tuple(color)) for i, color in enumerate(colors)]
        for path, what in (("world", classes), ("map/classes", cells), ("map/costs", costs)):
            self._sink.stream.log(path, rr.AnnotationContext(what), static=True)
        self._sink.stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)

    def _set_time(self, stamp_ns: int) -> None:
        stream = self._sink.stream
        stream.set_time("frame", sequence=self._frames)
        if stamp_ns >= EPOCH_FROM_NS:
            stream.set_time("stamp", timestamp=np.datetime64(stamp_ns, "ns"))
        else:
            stream.set_time("stamp", duration=np.timedelta64(stamp_ns, "ns"))

    def _log_camera(self, step: StepResult) -> None:
        rr, camera, matrix = self._rr, step.frame.intrinsics, step.T_map_camera.matrix
        self._log("world/camera", rr.Transform3D(translation=matrix[:3, 3], mat3x3=matrix[:3, :3]))
        pinhole = rr.Pinhole(
            image_from_camera=camera.matrix,
            resolution=[camera.width, camera.height],
            camera_xyz=rr.ViewCoordinates.RDF,
            image_plane_distance=0.6,
        )
        self._log("world/camera", pinhole)

    def _log_images(self, step: StepResult) -> None:
        rr, frame = self._rr, step.frame
        if self._jpeg_quality is None:
            photo = rr.Image(frame.rgb)
        else:
            from swardmap.io.images import encode_jpeg

            content = encode_jpeg(frame.rgb, self._jpeg_quality)
            photo = rr.EncodedImage(contents=content, media_type="image/jpeg")
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
        self._log("map/classes", rr.SegmentationImage(grid.classes[::-1]))  # y is up, rows are down
        place = rr.AnyValues(origin_m=np.array(grid.spec.origin_m), resolution_m=grid.spec.resolution_m)
        self._log("map/classes", place)
        if costmap is not None:
            picture = tint_costs(picture, grid, costmap.costs, view)
            self._log("map/costs", rr.SegmentationImage(costmap.costs[::-1]))
        seen = ~(picture == UNKNOWN_COLOR).all(axis=-1, keepdims=True)
        self._log("world/map", self._on_the_ground(np.dstack((picture, 255 * seen.astype(np.uint8))), view))

    def _on_the_ground(self, picture: NDArray[np.uint8], view: View) -> Any:
        """A picture with opacity, its lower left corner where that of the window is."""
        components = self._rr.components
        return self._rr.GridMap(
            data=picture.tobytes(),
            format=components.ImageFormat(
                width=view.width, height=view.height, color_model="RGBA", channel_datatype="U8"
            ),
            opacity=0.99,  # below 1, or the viewer leaves the picture's own opacity out
            cell_size=1 / view.px_per_m,
            translation=[view.left_m, view.top_m - view.height / view.px_per_m, 0.0],
        )

    def _log(self, path: str, what: Any) -> None:
        self._sink.stream.log(path, what)


def view_of(grid: OccupancyGrid) -> View:
    """The window of a map's texture: what is known, a pixel a cell where that is not too many."""
    x_min, x_max, y_min, y_max = bounds_of(grid)
    edge_m = max(grid.spec.resolution_m, max(x_max - x_min, y_max - y_min) / MAX_TEXTURE)
    width, height = (max(1, round(length / edge_m)) for length in (x_max - x_min, y_max - y_min))
    return View(x_min, y_max, 1 / edge_m, width, height)


def layout() -> Any:
    """The blueprint: the world on the left, the camera's images and the map on the right."""
    load_rerun()
    rrb = importlib.import_module("rerun.blueprint")
    camera = "world/camera"
    images = rrb.Vertical(
        rrb.Spatial2DView(origin=camera, contents=["$origin/photo", "$origin/mask"], name="Photo and mask"),
        rrb.Tabs(
            rrb.Spatial2DView(origin=camera, contents=["$origin/depth"], name="Depth"),
            rrb.Spatial2DView(origin=camera, contents=["$origin/confidence"], name="Confidence"),
        ),
        rrb.Tabs(
            rrb.Spatial2DView(origin="map/costs", name="Costmap"),
            rrb.Spatial2DView(origin="map/classes", name="Map"),
            rrb.TimeSeriesView(origin="timings", name="Milliseconds"),
            rrb.TimeSeriesView(origin="latency", name="Latency"),
        ),
    )
    in_world = [camera, f"{camera}/photo", "world/cloud", "world/map"]
    world = rrb.Spatial3DView(origin="world", contents=in_world, name="World")
    return rrb.Blueprint(rrb.Horizontal(world, images, column_shares=[3, 2]), collapse_panels=True)


def _per_metre(frame: Frame) -> float:
    """Depth units in a metre."""
    return 1.0 if frame.depth.dtype == np.float32 else 1 / frame.depth_unit_m
