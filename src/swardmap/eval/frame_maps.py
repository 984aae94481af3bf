"""All that is made of one frame while it is evaluated, each made once."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config
from swardmap.eval.truth import TruePixels, dense_map, true_pixels
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.io.sources.truth import FrameTruth
from swardmap.perception.ground_surface import ground_settings
from swardmap.pipeline import Located, locate, observe
from swardmap.types import Frame, Segmentation


class FrameMaps:
    """The maps of one frame, each made once however many comparisons ask for it.

    What it was asked with is known by identity, and kept, so that no other object takes its id.

    Args:
        truth: what is truly there in the frame, if the data set knows.
    """

    def __init__(self, truth: FrameTruth | None = None) -> None:
        self.truth = truth
        self._made: dict[tuple[object, ...], tuple[OccupancyGrid, object]] = {}
        self._located: dict[tuple[object, ...], tuple[Located, Frame, Pose, Config]] = {}
        self._pixels: dict[tuple[object, ...], tuple[TruePixels, object]] = {}
        self._dense: dict[tuple[object, ...], tuple[OccupancyGrid, Segmentation]] = {}
        self._cells: dict[tuple[object, ...], NDArray[np.int64]] = {}

    def pixels(
        self, frame: Frame, T_map_camera: Pose, config: Config, T_placed: Pose | None = None
    ) -> TruePixels:
        """The same as `true_pixels`; with the heights of the true pose, placed by another."""
        placed = T_placed or T_map_camera
        key = (id(frame.depth), id(T_map_camera), id(placed), id(config.cloud))
        if key not in self._pixels:
            if placed is T_map_camera:
                found = true_pixels(frame, T_map_camera, config, self.truth)
            else:
                found = replace(self.pixels(frame, T_map_camera, config), T_map_camera=placed)
            self._pixels[key] = found, (frame, T_map_camera, placed, config)
        return self._pixels[key][0]

    def cells(self, pixels: TruePixels, spec: GridSpec) -> NDArray[np.int64]:
        """The same as `TruePixels.cells`, of what `pixels` gave."""
        key = (id(pixels), spec)
        if key not in self._cells:
            self._cells[key] = pixels.cells(spec)
        return self._cells[key]

    def dense(
        self,
        frame: Frame,
        segmentation: Segmentation,
        T_map_camera: Pose,
        config: Config,
        spec: GridSpec,
        T_placed: Pose | None = None,
    ) -> OccupancyGrid:
        """The same as `dense_map`, of `pixels`."""
        pixels = self.pixels(frame, T_map_camera, config, T_placed)
        key = (id(pixels), id(segmentation.labels), spec)
        if key not in self._dense:
            cells = self.cells(pixels, spec)
            grid = dense_map(pixels, segmentation, spec, cells, frame.stamp_ns)
            self._dense[key] = grid, segmentation
        return self._dense[key][0]

    def __call__(
        self, frame: Frame, segmentation: Segmentation, T_map_camera: Pose, config: Config, spec: GridSpec
    ) -> OccupancyGrid:
        """The same as `frame_map`."""
        key = (id(frame.depth), id(segmentation.labels), id(T_map_camera), id(config), spec)
        if key not in self._made:
            located = self._depth_of(frame, T_map_camera, config, spec)
            grid = observe(frame, segmentation, T_map_camera, spec, config, located=located).grid
            self._made[key] = grid, (frame, segmentation, T_map_camera, config)
        return self._made[key][0]

    def ground_slope(
        self, frame: Frame, T_map_camera: Pose, config: Config, spec: GridSpec
    ) -> tuple[float, float] | None:
        """(dz/dx, dz/dy) of the ground that the frame shows, in the map; None = none."""
        ground = self._depth_of(frame, T_map_camera, config, spec).ground
        return None if ground is None else ground.shown_slope

    def _depth_of(self, frame: Frame, T_map_camera: Pose, config: Config, spec: GridSpec) -> Located:
        """Cells and ground of a frame: the same for every mask and for every rule of marking."""
        rules = id(config.cloud), ground_settings(config.geometry), config.backend
        key = (id(frame.depth), frame.depth_filtered, id(T_map_camera), spec, *rules)
        if key not in self._located:
            located = locate(frame, T_map_camera, spec, config)
            self._located[key] = located, frame, T_map_camera, config
        return self._located[key][0]
