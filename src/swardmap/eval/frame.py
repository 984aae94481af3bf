"""One frame evaluated: all that a report needs of it, as plain data that can be stored and added up."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from hashlib import sha256
from typing import Any

import numpy as np

from swardmap import __version__
from swardmap.config import Config, SegmenterConfig, config_from_dict, config_to_dict
from swardmap.config.outputs import DEFAULT_MARGIN_M
from swardmap.errors import InputError, InvalidValueError, SwardmapError
from swardmap.eval.budget import PoseNoise, RealAndTrue, budget, noisy_pose
from swardmap.eval.confusion import aligned_masks, confusion_of_masks
from swardmap.eval.dataset import DatasetSpec, Numbered, read_frames
from swardmap.eval.frame_maps import FrameMaps
from swardmap.eval.maps import MapComparison, compare_frame, spec_of
from swardmap.eval.protocols import PROTOCOLS, at_resolution
from swardmap.eval.safety import SafetyTally, judge, unjudged
from swardmap.eval.things import find_things
from swardmap.geometry import Pose
from swardmap.io.maps.margin_file import LARGEST_M
from swardmap.io.sources.truth import FrameTruth
from swardmap.labels import LabelSet
from swardmap.models import build_segmenter
from swardmap.runs.record_looks import Look, Looker, first_looked_at, with_mask
from swardmap.runs.versions import segmenter_title
from swardmap.segmenter import Segmenter
from swardmap.types import Frame, Segmentation

FORMAT = 3
"""Raised when records change their meaning: shards of another format are not taken up again."""


@dataclass(frozen=True)
class Plan:
    """What is to be evaluated, and how: all that the numbers depend on.

    Attributes:
        dataset: the frames.
        config: of the robot: segmenter, filters, resolution.
        resolutions_m: of the maps; the first is that of the margin, the budget and the gallery.
        protocols: see `protocols.PROTOCOLS`.
        pose_noise: of the budget's last stage.
        with_budget: run the budget.
        seed: of the pose noise and of every bootstrap.
        T_base_camera: mount for frames without pose: 16 numbers, row by row; None = measured frame by frame.
        network: digest of the network file, if there is one.
        margin_m: that marks are grown by where safety is judged.
        data: what the files of the dataset look like, by role; see `dataset.data_marks`.
    """

    dataset: DatasetSpec
    config: Config = field(default_factory=Config)
    resolutions_m: tuple[float, ...] = (0.05, 0.1)
    protocols: tuple[str, ...] = PROTOCOLS[:2]
    pose_noise: PoseNoise = field(default_factory=PoseNoise)
    with_budget: bool = True
    seed: int = 0
    T_base_camera: tuple[float, ...] | None = None
    network: str = ""
    margin_m: float = DEFAULT_MARGIN_M
    data: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        wrong = [p for p in self.protocols if p not in PROTOCOLS]
        if wrong or not self.protocols or not self.resolutions_m:
            raise InvalidValueError(
                f"evaluation: expected protocols of {', '.join(PROTOCOLS)} and at least one resolution, "
                f"got {self.protocols} and {self.resolutions_m}"
            )
        if not 0 <= self.margin_m <= LARGEST_M:
            raise InvalidValueError(
                f"evaluation: expected a margin of 0 to {LARGEST_M:g} m, got {self.margin_m}"
            )
        for resolution_m in self.resolutions_m:
            at_resolution(self.config, resolution_m)  # raises for what is no resolution

    def to_json(self) -> str:
        """The plan as text; the same plan gives the same bytes."""
        plain = asdict(self) | {
            "config": config_to_dict(self.config),
            "format": FORMAT,
            "version": __version__,
        }
        return stable_text(plain)

    @classmethod
    def from_json(cls, text: str) -> "Plan":
        """What `to_json` gave."""
        from swardmap.config import SourceConfig

        plain = json.loads(text)
        dataset = plain["dataset"] | {"source": SourceConfig(**plain["dataset"]["source"])}
        mount = plain["T_base_camera"]
        return cls(
            dataset=DatasetSpec(**dataset),
            config=config_from_dict(plain["config"]),
            resolutions_m=tuple(plain["resolutions_m"]),
            protocols=tuple(plain["protocols"]),
            pose_noise=PoseNoise(**plain["pose_noise"]),
            with_budget=plain["with_budget"],
            seed=plain["seed"],
            T_base_camera=None if mount is None else tuple(mount),
            network=plain["network"],
            margin_m=plain["margin_m"],
            data=tuple((str(role), str(marks)) for role, marks in plain.get("data", ())),  # none in old runs
        )

    @property
    def fingerprint(self) -> str:
        """Tells plans apart: results of different plans are never mixed."""
        return sha256(self.to_json().encode()).hexdigest()[:16]

    @property
    def segmenter_name(self) -> str:
        """What a report calls the segmenter; a network file with the head of its digest."""
        return segmenter_title(self.config, self.network)

    @property
    def main(self) -> str:
        """Key of the maps that the margin, the budget and the gallery are about."""
        return map_key(self.protocols[0], self.resolutions_m[0])


def map_key(protocol: str, resolution_m: float) -> str:
    """Name of one kind of map in records and results.

    >>> map_key("dense", 0.05)
    'dense@0.05'
    """
    return f"{protocol}@{resolution_m:g}"


def split_key(key: str) -> tuple[str, float]:
    """Protocol and resolution of a `map_key`."""
    protocol, _, resolution = key.partition("@")
    return protocol, float(resolution)


def evaluate_part(plan: Plan, start: int, stop: int) -> str:
    """Records of the frames start..stop-1, one line of JSON each; the same wherever and whenever it runs."""
    return "".join(stable_text(record) + "\n" for record in records(plan, start, stop))


def records(plan: Plan, start: int, stop: int) -> Iterator[dict[str, Any]]:
    """Evaluate the frames start..stop-1, each index once; some before them are looked at."""
    looker = Looker(plan.config.watchdog)
    for numbered in read_frames(plan.dataset, first_looked_at(start), stop, plan.config):
        index, frame = numbered.index, numbered.frame
        look = looker.see(index, frame)
        if index < start:
            continue
        if frame is None:
            yield {"index": index, "error": numbered.error}
            continue
        try:
            yield evaluate_frame(plan, numbered, segmenter_of(plan, frame.label_set), look)
        except SwardmapError as error:
            yield {"index": index, "error": f"frame {frame.name or index}: {error}"}


def evaluate_frame(
    plan: Plan, numbered: Numbered, segmenter: Segmenter, look: Look | None = None
) -> dict[str, Any]:
    """Everything that is counted of one frame, as plain data.

    Args:
        plan: of the run.
        numbered: the frame.
        segmenter: gives its mask.
        look: of a `Looker` that has seen the frames before it; None = it is looked at alone.
    """
    frame = numbered.frame
    if frame is None or frame.labels is None or frame.label_set is None:
        raise InputError(f"frame {numbered.index}: expected a frame with true labels, got none")
    segmentation = segmenter(frame)
    truth, called = aligned_masks(frame.labels, frame.label_set, scored_mask(plan, segmentation))
    pose = pose_of(plan, frame)
    maps, missed, made = {}, [], FrameMaps(numbered.truth)
    for protocol in plan.protocols:
        for resolution_m in plan.resolutions_m:
            config = at_resolution(plan.config, resolution_m)
            found = compare_frame(frame, segmentation, pose, config, protocol, numbered.best, made)
            key = map_key(protocol, resolution_m)
            maps[key] = found.tally.to_dict()
            if key == plan.main:
                missed = _places(found)
    robot, watchdog = at_resolution(plan.config, plan.resolutions_m[0]), plan.config.watchdog
    slope = made.ground_slope(frame, pose, robot, spec_of(frame, pose, robot))
    seen = look or Looker(watchdog).see(numbered.index, frame)
    return {
        "index": numbered.index,
        "name": frame.name,
        "tags": {str(k): str(v) for k, v in sorted(frame.tags.items())},
        "looks": with_mask(seen, frame, segmentation, slope, watchdog),
        "mask": confusion_of_masks(truth, called, segmentation.label_set).to_dict(),
        "maps": maps,
        "missed": missed,
        "safety": safety_of(plan, numbered, frame, segmentation, pose, made).to_dict(),
        "budget": _budget(plan, numbered, frame, segmentation, pose, made) if plan.with_budget else {},
    }


def safety_of(
    plan: Plan,
    numbered: Numbered,
    frame: Frame,
    segmentation: Segmentation,
    T_map_camera: Pose,
    made: FrameMaps,
) -> SafetyTally:
    """The map of the robot against all that is truly there, at the first resolution."""
    config = at_resolution(plan.config, plan.resolutions_m[0])
    truth = numbered.best or frame
    found = compare_frame(frame, segmentation, T_map_camera, config, "dense", numbered.best, made)
    spec, pixels = found.reference.spec, made.pixels(truth, T_map_camera, config)
    cells = made.cells(pixels, spec)
    things = find_things(truth, pixels, cells, spec, config, made.truth, numbered.filtered)
    tally = judge(found.reference, found.predicted, things, T_map_camera, plan.margin_m)
    assert truth.labels is not None  # noqa: S101 - compare_frame has asked for them
    assert truth.label_set is not None  # noqa: S101
    left_out = unjudged(pixels, cells, truth.labels, truth.label_set)
    return tally + SafetyTally(plan.margin_m, {}, left_out)


def scored_mask(plan: Plan, segmentation: Segmentation) -> Segmentation:
    """The mask that is scored and shown: grass that is not sure is void.

    Maps take the mask as the segmenter gave it: there such pixels are in doubt, and keep cells from clearing.
    """
    return segmentation.confident(plan.config.segmenter.min_confidence)


def compare_again(
    plan: Plan, frame: Frame, clean: Frame | None, segmenter: Segmenter, truth: FrameTruth | None = None
) -> tuple[Segmentation, MapComparison]:
    """The main comparison of a frame once more, for pictures, with the mask as the segmenter gave it."""
    segmentation = segmenter(frame)
    config = at_resolution(plan.config, plan.resolutions_m[0])
    pose, protocol = pose_of(plan, frame), plan.protocols[0]
    made = FrameMaps(truth)
    return segmentation, compare_frame(frame, segmentation, pose, config, protocol, clean, made)


def pose_of(plan: Plan, frame: Frame) -> Pose:
    """Pose of a frame; without one the configured mount, or that measured from this frame's ground.

    Measured frame by frame, so that the result does not depend on how frames are split among processes.
    The reference map and the predicted one share it.

    Raises:
        InputError: if there is no pose and no ground to be seen.
    """
    if frame.T_map_camera is not None:
        return frame.T_map_camera
    if plan.T_base_camera is None:
        from swardmap.perception.ground_plane import estimate_mount

        return estimate_mount(replace(frame, labels=None))  # the robot has no true labels to find its lawn by
    return Pose("base", "camera", np.array(plan.T_base_camera).reshape(4, 4))


def segmenter_of(plan: Plan, label_set: LabelSet | None) -> Segmenter:
    """The segmenter of a plan, made once in each process."""
    return _segmenter(plan.config.segmenter, label_set)


@lru_cache(maxsize=2)
def _segmenter(config: SegmenterConfig, label_set: LabelSet | None) -> Segmenter:
    return build_segmenter(config, label_set)


def _budget(
    plan: Plan, numbered: Numbered, frame: Frame, segmentation: Segmentation, pose: Pose, made: FrameMaps
) -> dict[str, Any]:
    noise = plan.pose_noise
    moves = noise != replace(noise, xy_m=0, yaw_deg=0, tilt_deg=0)
    real = noisy_pose(pose, noise, plan.seed, numbered.index) if moves else None
    sides = RealAndTrue(frame, segmentation, pose, numbered.clean, real, numbered.unfiltered)
    tallies = budget(sides, at_resolution(plan.config, plan.resolutions_m[0]), made)
    return {stage: tally.to_dict() for stage, tally in tallies.items()}


def _places(found: MapComparison) -> list[dict[str, Any]]:
    """The missed obstacles of a map with size and place in metres."""
    spec = found.reference.spec
    (x, y), r = spec.origin_m, spec.resolution_m
    return [
        {
            "cells": m.cells,
            "called_free": m.called_free,
            "person": m.person,
            "xy_m": [round(x + m.center[0] * r, 4), round(y + m.center[1] * r, 4)],
        }
        for m in found.misses.missed
    ]


def stable_text(value: Mapping[str, Any]) -> str:
    """JSON with sorted keys and no spaces: the same value gives the same bytes."""
    return json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=False)
