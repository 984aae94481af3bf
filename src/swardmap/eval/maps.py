"""Reference map and predicted map of one frame, and their comparison (Sec. 4.3)."""

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from swardmap.config import Config
from swardmap.errors import InputError, InvalidValueError
from swardmap.eval.confusion import confusion_of_maps
from swardmap.eval.dmin import Misses, find_misses, nearest_hits
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.protocols import protocol_configs
from swardmap.eval.tally import RANGE_BANDS_M, MapTally, MissedKind, MissKind
from swardmap.eval.truth import fitted_ground, within_limits
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid, classify_cells, count_points
from swardmap.labels import MapClass
from swardmap.pipeline import observe, view_spec
from swardmap.types import Frame, LabeledCloud, Segmentation


@dataclass(frozen=True, slots=True, eq=False)
class MapComparison:
    """One predicted map against its reference.

    Attributes:
        reference, predicted: the maps, on one grid.
        misses: the FN cells, their distances, and the missed obstacles.
        tally: what adds up.
    """

    reference: OccupancyGrid
    predicted: OccupancyGrid
    misses: Misses
    tally: MapTally


def compare_maps(
    reference: OccupancyGrid, predicted: OccupancyGrid, camera_xy_m: ArrayLike = (0.0, 0.0)
) -> MapComparison:
    """Compare two maps of one grid.

    Args:
        reference: the truth.
        predicted: what is to be judged.
        camera_xy_m: where distances for the range bands are measured from.
    """
    if reference.spec != predicted.spec:
        raise InvalidValueError(f"expected maps on one grid, got {reference.spec} and {predicted.spec}")
    misses = find_misses(reference.classes, predicted.classes)
    centers = reference.spec.center_of(misses.cells)
    away = np.hypot(*(centers - np.asarray(camera_xy_m, np.float64)).T)
    bands = np.searchsorted(RANGE_BANDS_M, away, side="right") - 1
    columns = (misses.person, misses.from_person, misses.found, bands, misses.squared)
    kinds = Counter(map(MissKind._make, zip(*(c.tolist() for c in columns), strict=True)))
    tally = MapTally(
        resolution_m=reference.spec.resolution_m,
        frames=1,
        frames_with_misses=int(len(misses.cells) > 0),
        frames_without_hit=int(len(misses.cells) > 0 and misses.hits == 0),
        matrix=confusion_of_maps(reference.classes, predicted.classes),
        misses=dict(kinds),
        obstacles=misses.obstacles,
        missed=dict(Counter(MissedKind(m.person, m.cells, m.called_free) for m in misses.missed)),
    )
    return MapComparison(reference, predicted, misses, tally)


def frame_map(
    frame: Frame, segmentation: Segmentation, T_map_camera: Pose, config: Config, spec: GridSpec | None = None
) -> OccupancyGrid:
    """The standalone map of one frame, as the pipeline makes it.

    Args:
        frame: aligned images.
        segmentation: its mask.
        T_map_camera: pose of the camera.
        config: filters, resolution, points a cell needs.
        spec: grid to use; None = all that the camera can see.
    """
    spec = spec or spec_of(frame, T_map_camera, config)
    return observe(frame, segmentation, T_map_camera, spec, config).grid


def cloud_map(cloud: LabeledCloud, T_map_cloud: Pose, config: Config, spec: GridSpec) -> OccupancyGrid:
    """The reference map of an annotated cloud, as the paper makes it for real data (Sec. 4.1.2).

    Every point with a label counts, within the limits of height above the ground through its lawn (all of
    them where there is no lawn); void points say nothing.

    Args:
        cloud: from `io.cloud_files` or `io.annotation_files`.
        T_map_cloud: pose of the cloud's frame.
        config: of the robot; only its height limits are used.
        spec: grid of the predicted map.
    """
    xyz = T_map_cloud.apply(cloud.xyz)
    classes = cloud.label_set.map_class_table[cloud.labels]
    ground = fitted_ground(xyz[classes == MapClass.GRASS])
    height_m = xyz[:, 2] - (0.0 if ground is None else ground.at(xyz[:, 0], xyz[:, 1]))
    inside = within_limits(height_m, config.cloud, ground is not None)
    judged = cloud[(classes != MapClass.UNKNOWN) & inside]
    counts, _ = count_points(judged.transformed(spec.T_grid_map @ T_map_cloud.of_child(cloud.frame_id)), spec)
    return OccupancyGrid(spec, classify_cells(counts, 1), cloud.stamp_ns)


def spec_of(frame: Frame, T_map_camera: Pose, config: Config) -> GridSpec:
    """The grid of all that a camera can see."""
    return view_spec(frame.intrinsics, T_map_camera, config.cloud.max_range_m, config.grid.resolution_m)


def compare_frame(
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    config: Config,
    protocol: str = "dense",
    clean: Frame | None = None,
    maps: FrameMaps | None = None,
) -> MapComparison:
    """The map of one frame against its reference map.

    Args:
        frame: with true labels.
        segmentation: what the segmenter says of it.
        T_map_camera: pose of the camera.
        config: of the robot.
        protocol: see PROTOCOLS.
        clean: the same frame with clean or unfiltered depth, which the dense reference is then made of; the
            paper's reference takes the sensor's depth, as its annotated clouds do.
        maps: those already made of this frame; knows what is truly there.

    Raises:
        InputError: if the frame has no labels.
        InvalidValueError: for another protocol.
    """
    spec, make = spec_of(frame, T_map_camera, config), maps or FrameMaps()
    if protocol == "dense":
        truth = frame if clean is None else clean
        reference = make.dense(truth, true_segmentation(truth), T_map_camera, config, spec)
        predicted = make(frame, segmentation, T_map_camera, config, spec)
    else:
        of_reference, of_predicted = protocol_configs(config, protocol)
        reference = make(frame, true_segmentation(frame), T_map_camera, of_reference, spec)
        predicted = make(frame, segmentation, T_map_camera, of_predicted, spec)
    return compare_maps(reference, predicted, T_map_camera.position_m[:2])


def true_segmentation(frame: Frame) -> Segmentation:
    """The true labels of a frame as a mask.

    Raises:
        InputError: if it has none.
    """
    if frame.labels is None or frame.label_set is None:
        raise InputError(
            f"frame {frame.name or frame.stamp_ns}: expected true labels to compare with, got none"
        )
    return Segmentation(frame.labels, frame.label_set)


def tied_cells(comparison: MapComparison, most: int = 400) -> NDArray[np.int64]:
    """FN cells and the TP cells nearest to them, the farthest first, to be drawn as in Figure 5.

    Args:
        comparison: of one frame.
        most: number of ties at most.

    Returns:
        (N, 2, 2) int64 [[ix, iy] of the FN cell, [ix, iy] of the TP cell]; empty without TP cells.
    """
    misses = comparison.misses
    if misses.hits == 0 or len(misses.cells) == 0:
        return np.empty((0, 2, 2), np.int64)
    chosen = misses.cells[np.argsort(-misses.squared, kind="stable")[:most]]
    nearest = nearest_hits(comparison.reference.classes, comparison.predicted.classes, chosen)
    return np.stack((chosen, nearest), axis=1)
