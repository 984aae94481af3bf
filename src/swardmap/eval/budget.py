"""The error budget: the same frame mapped again with one stage after another switched from true to real.

The paper tells processing errors from sensor errors by two data sets; with clean depth beside the
sensor's, each stage can be told apart on the same frames. The ladder switches the stages in the order
of the pipeline; beside it each stage is switched alone, so that interactions show.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from swardmap.config import Config
from swardmap.errors import InvalidValueError
from swardmap.eval.confusion import Share
from swardmap.eval.distances import DistanceSummary
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import compare_maps, spec_of, true_segmentation
from swardmap.eval.tally import MapTally
from swardmap.geometry import Pose
from swardmap.types import Frame, Segmentation

STAGES = ("processing", "mask", "depth", "pose")
"""What is switched from true to real, in the order of the ladder."""

ABLATIONS: Mapping[str, frozenset[str]] = {
    "truth": frozenset(),
    "+ processing": frozenset(STAGES[:1]),
    "+ mask": frozenset(STAGES[:2]),
    "+ depth": frozenset(STAGES[:3]),
    "+ pose": frozenset(STAGES),
    "processing alone": frozenset({"processing"}),
    "mask alone": frozenset({"mask"}),
    "depth alone": frozenset({"depth"}),
    "pose alone": frozenset({"pose"}),
}
"""Name of each ablation stage and what is real in it; those with a + form the ladder."""


@dataclass(frozen=True, slots=True)
class PoseNoise:
    """How wrong the pose of a frame may be: independent normal errors, drawn for each frame.

    Attributes:
        xy_m: standard deviation of x and of y; 0.02 is the paper's RTK receiver (Sec. 3.1).
        yaw_deg: of the heading.
        tilt_deg: of roll and of pitch, as a wheel on uneven ground gives them.
    """

    xy_m: float = 0.02
    yaw_deg: float = 0.5
    tilt_deg: float = 0.5

    def __post_init__(self) -> None:
        if not all(np.isfinite(s) and s >= 0 for s in (self.xy_m, self.yaw_deg, self.tilt_deg)):
            raise InvalidValueError(f"pose noise: expected standard deviations of 0 or more, got {self}")


def noisy_pose(T_map_camera: Pose, noise: PoseNoise, seed: int, index: int) -> Pose:
    """A pose with errors that depend on the seed and the frame's index only, however the work is split."""
    rng = np.random.default_rng([seed, index])
    dx, dy = rng.normal(0, noise.xy_m, 2) if noise.xy_m else (0.0, 0.0)
    yaw, roll, pitch = np.deg2rad(rng.normal(0, 1, 3) * (noise.yaw_deg, noise.tilt_deg, noise.tilt_deg))
    turn = _rotation(2, yaw) @ _rotation(1, pitch) @ _rotation(0, roll)
    matrix = T_map_camera.matrix.copy()
    matrix[:3, :3] = turn @ matrix[:3, :3]
    matrix[:2, 3] += dx, dy
    return Pose(T_map_camera.parent, T_map_camera.child, matrix)


@dataclass(frozen=True, slots=True, eq=False)
class RealAndTrue:
    """One frame with both sides of every stage that has two.

    Attributes:
        frame: as recorded, with true labels.
        segmentation: what the segmenter says.
        T_map_camera: the true pose, or the best known.
        clean: the same frame with clean depth; None if nobody has it (then `frame` is the truth).
        T_real: the pose with errors; None leaves the pose out of the budget.
        unfiltered: the frame before the source took flying pixels out of its depth; None if it took none.
    """

    frame: Frame
    segmentation: Segmentation
    T_map_camera: Pose
    clean: Frame | None = None
    T_real: Pose | None = None
    unfiltered: Frame | None = None

    def __post_init__(self) -> None:
        if self.clean is not None and self.clean.depth.shape != self.frame.depth.shape:
            raise InvalidValueError(
                f"frame {self.frame.name}: expected clean depth of shape {self.frame.depth.shape}, "
                f"got {self.clean.depth.shape}"
            )


def missing_stages(has_clean_depth: bool, has_pose_noise: bool) -> dict[str, str]:
    """Stages that cannot be switched, and why."""
    missing = {}
    if not has_clean_depth:
        missing["depth"] = "the data has no clean depth beside the sensor's; its errors are in all of them"
    if not has_pose_noise:
        missing["pose"] = "the pose noise is 0"
    return missing


def budget(sides: RealAndTrue, config: Config, maps: FrameMaps | None = None) -> dict[str, MapTally]:
    """Map a frame once for each ablation stage that can be run, each against the same reference.

    Args:
        sides: true and real of every stage.
        config: of the robot; range and height limits hold in all of them.
        maps: those already made of this frame.

    Returns:
        Ablation stage -> tally; those that need what the data lacks are left out, see `missing_stages`.
    """
    true_frame = sides.clean or sides.unfiltered or sides.frame
    spec, make = spec_of(true_frame, sides.T_map_camera, config), maps or FrameMaps()
    true_mask = true_segmentation(true_frame)
    reference = make.dense(true_frame, true_mask, sides.T_map_camera, config, spec)
    missing = missing_stages(sides.clean is not None, sides.T_real is not None)
    tallies: dict[str, MapTally] = {}
    done: dict[int, MapTally] = {}
    for name, wanted in ABLATIONS.items():
        if name.split()[-1] in missing or name.split()[0] in missing:
            continue
        real = wanted.difference(missing)
        own_filter = "processing" in real and sides.clean is None  # the source's filter is of the processing
        frame = sides.frame if "depth" in real or own_filter else true_frame
        mask = sides.segmentation if "mask" in real else true_mask
        pose = sides.T_real if "pose" in real and sides.T_real is not None else sides.T_map_camera
        if "processing" in real:
            predicted = make(frame, mask, pose, config, spec)
        else:  # heights are by the true pose: finding them is processing
            predicted = make.dense(frame, mask, sides.T_map_camera, config, spec, pose)
        if id(predicted) not in done:
            done[id(predicted)] = compare_maps(reference, predicted, sides.T_map_camera.position_m[:2]).tally
        tallies[name] = done[id(predicted)]
    return tallies


@dataclass(frozen=True, slots=True)
class BudgetRow:
    """What one ablation stage of the budget says.

    Attributes:
        stage: see ABLATIONS.
        called_free: obstacle cells called grass: the FN rate.
        not_seen: obstacle cells of which nothing is said.
        false_alarm: grass cells called obstacle: the FP rate.
        obstacles: connected obstacles in the references.
        missed: of these, without one TP cell.
        missed_called_free: of these, with a cell that was called grass.
        d_min: of the FN cells.
        added: change of rates, missed obstacles and mean d_min-obst from the row above; from `truth` for
            the stages alone. None where one side is undefined.
    """

    stage: str
    called_free: Share
    not_seen: Share
    false_alarm: Share
    obstacles: int
    missed: int
    missed_called_free: int
    d_min: DistanceSummary
    added: Mapping[str, float | None]


def budget_rows(tallies: Mapping[str, MapTally]) -> list[BudgetRow]:
    """The budget as a table: what each stage has, and what it adds.

    Args:
        tallies: ablation stage -> sum over the frames, as `budget` gives them for one.
    """
    rows: list[BudgetRow] = []
    below: MapTally | None = None
    for stage in ABLATIONS:
        tally = tallies.get(stage)
        if tally is None:
            continue
        base = tallies["truth"] if stage.endswith("alone") else below
        rows.append(_row(stage, tally, tally if base is None else base))
        below = tally
    return rows


def _row(stage: str, tally: MapTally, base: MapTally) -> BudgetRow:
    matrix, summary = tally.matrix, tally.distances().summary()
    here, there = _measures(tally), _measures(base)
    added = {name: _difference(here[name], there[name]) for name in here}
    return BudgetRow(
        stage=stage,
        called_free=matrix.obstacle_called_free,
        not_seen=matrix.obstacle_not_seen,
        false_alarm=matrix.free_called_obstacle,
        obstacles=tally.obstacles,
        missed=tally.missed_obstacles,
        missed_called_free=tally.missed_called_free,
        d_min=summary,
        added=added,
    )


def _measures(tally: MapTally) -> dict[str, float | None]:
    matrix = tally.matrix
    return {
        "called_free": matrix.obstacle_called_free.value,
        "not_seen": matrix.obstacle_not_seen.value,
        "false_alarm": matrix.free_called_obstacle.value,
        "missed": float(tally.missed_obstacles),
        "mean_d_min_m": tally.distances().summary().mean_m,
    }


def _difference(here: float | None, there: float | None) -> float | None:
    return None if here is None or there is None else here - there


def _rotation(axis: int, angle_rad: float) -> "np.ndarray[tuple[int, int], np.dtype[np.float64]]":
    """(3, 3) rotation about a fixed axis."""
    i, j = [a for a in range(3) if a != axis]
    matrix = np.eye(3)
    sign = -1.0 if axis == 1 else 1.0
    matrix[i, i] = matrix[j, j] = np.cos(angle_rad)
    matrix[i, j], matrix[j, i] = -sign * np.sin(angle_rad), sign * np.sin(angle_rad)
    return matrix
