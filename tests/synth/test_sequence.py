"""A drive as a source of frames: what sensors may change, and what must stay exact."""

from dataclasses import replace

import numpy as np
import pytest

from swardmap.errors import InvalidValueError
from swardmap.geometry import mount_pose
from swardmap.labels import PERSON
from swardmap.synth.config import OpticsConfig, StereoConfig
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import make_source
from swardmap.synth.sequence import GardenSource, pose_near, to_millimetres
from tests.io.contract import check_source
from tests.synth.small_stage import SmallStage, small_config

PLAN = SynthPlan(frames=4, config=small_config())


def source(plan: SynthPlan = PLAN, scene: int = 0, light: str = "clear") -> GardenSource:
    return make_source(plan, SmallStage(), scene, light)


def test_it_keeps_the_contract_of_sources() -> None:
    frames = check_source(source)
    assert [frame.name for frame in frames] == ["00001", "00002", "00003", "00004"]
    assert frames[0].tags == {"scene": "0000", "illumination": "clear", "sequence": "0000-clear"}
    assert frames[1].stamp_ns - frames[0].stamp_ns == 200_000_000


def test_labels_and_exact_depth_are_those_of_the_sharp_view_whatever_the_sensors_do() -> None:
    wild = replace(
        PLAN, config=replace(PLAN.config, camera=OpticsConfig(blur_share=1.0, shutter_s=(0.1, 0.1)))
    )
    for shot in source(wild).shots():
        view = SmallStage().view(source().garden, source().light, shot.frame.intrinsics,
                                 shot.frame.T_map_camera, shot.frame.stamp_ns)  # type: ignore[arg-type] # fmt: skip
        np.testing.assert_array_equal(shot.frame.labels, view.labels)
        np.testing.assert_array_equal(shot.view.depth_m, view.depth_m)
        assert shot.blurred


def test_depth_is_exact_without_the_sensor_and_noisy_with_it() -> None:
    exact = replace(PLAN, config=replace(PLAN.config, stereo=StereoConfig(enabled=False)))
    for clean, noisy in zip(source(exact).shots(), source().shots(), strict=True):
        truth = clean.view.depth_m
        np.testing.assert_allclose(clean.frame.depth_m, np.where(truth > 0, truth, np.nan), atol=0.00051)
        both = (noisy.frame.depth > 0) & (truth > 0)
        error = noisy.frame.depth_m[both] - truth[both]
        assert 0.002 < np.median(np.abs(error)) < 0.2


def test_motion_blur_smears_what_moves() -> None:
    still, moving = (
        replace(PLAN, config=replace(
            PLAN.config,
            camera=replace(OpticsConfig(faults=False), faults=True, blur_share=share, shutter_s=(0.3, 0.3),
                           shot_noise=(0, 0), read_noise=(0, 0), jpeg_quality=(0, 0), softness_px=(0, 0)),
        ))
        for share in (0.0, 1.0)
    )  # fmt: skip

    def sharpness(plan: SynthPlan) -> float:
        return float(np.abs(np.diff(list(source(plan))[1].rgb.astype(float), axis=0)).mean())

    assert sharpness(moving) < 0.85 * sharpness(still)


def test_all_lights_share_garden_drive_and_truth_but_not_the_camera() -> None:
    clear, dusk = source(), source(light="twilight")
    assert clear.intrinsics == dusk.intrinsics
    assert clear.faults != dusk.faults
    assert clear.sensor != dusk.sensor
    assert clear.light.sun != dusk.light.sun
    for one, two in zip(clear.shots(), dusk.shots(), strict=True):
        np.testing.assert_array_equal(one.view.labels, two.view.labels)
        np.testing.assert_array_equal(one.frame.T_map_camera.matrix, two.frame.T_map_camera.matrix)  # type: ignore[union-attr]
        assert (one.frame.rgb != two.frame.rgb).any()


def test_scenes_and_seeds_differ() -> None:
    assert source(scene=1).garden.seed == 1
    assert source(replace(PLAN, seed=3), 1).garden.seed == 30_001
    assert source(replace(PLAN, seed=3)).faults != source().faults


def test_somebody_walks_through_the_frames() -> None:
    shots = source(replace(PLAN, frames=6)).shots()
    columns = [np.nonzero(shot.view.labels == PERSON.id)[1].mean() for shot in shots]
    assert (np.diff(columns) < 0).all(), "to the left"


def test_poses_near_a_frame_follow_the_motion() -> None:
    run = [(i * 100_000_000, mount_pose(1.0, 10.0, xy_m=(0.2 * i, 0.0), parent="map")) for i in range(3)]
    for index, offset_s, x in ((0, 0.05, 0.1), (1, -0.05, 0.1), (2, 0.05, 0.5), (1, 0.0, 0.2)):
        stamp_ns, pose = pose_near(run, index, offset_s)
        assert stamp_ns == run[index][0] + round(offset_s * 1e9)
        assert pose.position_m[0] == pytest.approx(x)
    assert pose_near(run[:1], 0, 0.05) == run[0]


def test_millimetres_are_rounded_and_what_is_too_far_has_no_reading() -> None:
    depth = np.array([[0.0, 1.2344, 1.2346, 65.535, 70.0, np.inf, np.nan]])
    assert to_millimetres(depth).tolist() == [[0, 1234, 1235, 65535, 0, 0, 0]]


def test_a_drive_needs_frames_at_rising_times() -> None:
    one = source()
    for run in ((), (one.run[1], one.run[0]), (one.run[0], one.run[0])):
        with pytest.raises(InvalidValueError, match="rising times"):
            replace(one, run=run)
