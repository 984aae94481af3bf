"""Runs of many sequences: whole or not there, resumed, refused, and read back by the loaders."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swardmap.config import SourceConfig
from swardmap.errors import ConfigError, OutputError
from swardmap.grid import OccupancyGrid
from swardmap.io import open_source
from swardmap.io.maps.map_files import read_map
from swardmap.io.maps.npz_files import read_npz
from swardmap.labels import MapClass
from swardmap.synth.config import MapConfig, OpticsConfig, SceneConfig, StereoConfig
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import make_source, produce
from tests.io.contract import check_source
from tests.synth.small_stage import SmallStage, dying_stage, small_config, small_stage

PLAN = SynthPlan(scenes=2, frames=3, illuminations=("clear", "sunset"), config=small_config())


def files(root: Path) -> dict[str, bytes]:
    return {str(p.relative_to(root)): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()}


def make(out: Path, plan: SynthPlan = PLAN, **options: Any) -> dict[str, Any]:
    return produce(plan, out, options.pop("stage_of", small_stage), jobs=options.pop("jobs", 1), **options)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("gardens") / "out"
    assert make(out) == {"out": str(out), "sequences": 4, "frames": 12, "made": 4}
    return out


def test_the_folder_holds_what_the_source_gave(made: Path) -> None:
    here = made / "folder" / "0001" / "sunset"
    frames = check_source(lambda: open_source(here))
    for frame, shot in zip(frames, make_source(PLAN, SmallStage(), 1, "sunset").shots(), strict=True):
        np.testing.assert_array_equal(frame.rgb, shot.frame.rgb)
        np.testing.assert_array_equal(frame.depth, shot.frame.depth)
        np.testing.assert_array_equal(frame.labels, shot.view.labels)
        assert frame.tags == {"scene": "0001", "illumination": "sunset", "sequence": "0001-sunset"}
        assert frame.T_map_camera is not None
        assert shot.frame.T_map_camera is not None
        np.testing.assert_allclose(frame.T_map_camera.matrix, shot.frame.T_map_camera.matrix, atol=1e-12)


def test_exact_depth_lies_beside_as_a_recording_of_the_same_frames(made: Path) -> None:
    here = made / "folder" / "0000" / "clear"
    for frame, exact in zip(open_source(here), open_source(here / "exact"), strict=True):
        assert frame.name == exact.name
        np.testing.assert_array_equal(frame.rgb, exact.rgb)
        assert (frame.depth != exact.depth).any()


def test_eden_has_the_same_frames_with_depth_to_the_last_bit(made: Path) -> None:
    eden = list(open_source(made / "eden", SourceConfig(level=False)))
    assert len(eden) == 12
    shots = make_source(PLAN, SmallStage(), 0, "clear").shots()
    for frame, shot in zip(eden, shots, strict=False):
        np.testing.assert_array_equal(frame.depth, shot.view.depth_m)
        np.testing.assert_array_equal(frame.labels, shot.view.labels)
        np.testing.assert_array_equal(frame.rgb, shot.frame.rgb)
        assert frame.T_map_camera is not None
        assert shot.frame.T_map_camera is not None
        np.testing.assert_allclose(frame.T_map_camera.matrix, shot.frame.T_map_camera.matrix, atol=1e-12)


def test_maps_hold_what_is_there_seen_or_not(made: Path) -> None:
    maps = made / "folder" / "0000" / "clear" / "maps"
    scene, same = read_map(maps / "scene.yaml"), read_npz(maps / "scene.npz")
    np.testing.assert_array_equal(scene.classes, same.classes)  # type: ignore[union-attr]
    assert scene.count(MapClass.PERSON) == 0
    frames = [read_npz(maps / f"{i + 1:05d}.npz") for i in range(3)]
    for i, grid in enumerate(frames):
        assert isinstance(grid, OccupancyGrid)
        assert grid.stamp_ns == i * 200_000_000
        assert 16 <= grid.count(MapClass.PERSON) <= 25, "a walker of 0.4 x 0.4 m in cells of 0.1 m"
        assert grid.count(MapClass.GRASS) > 500


def test_all_that_was_drawn_is_written_down(made: Path) -> None:
    meta = json.loads((made / "folder" / "0001" / "sunset" / "meta.json").read_text())
    source = make_source(PLAN, SmallStage(), 1, "sunset")
    assert meta["light"]["illumination"] == "sunset"
    assert meta["camera"]["exposure_ev"] == source.faults.exposure_ev
    assert meta["stereo"]["subpixel_px"] == source.sensor.subpixel_px  # type: ignore[union-attr]
    assert meta["garden"]["things"] == {"pot": 1, "shed": 1}
    assert (meta["seed"], meta["scene"], meta["stage"]["assets"]) == (0, "0001", "none")
    lines = (made / "folder" / "0001" / "sunset" / "frames.jsonl").read_text().splitlines()
    assert [json.loads(line)["name"] for line in lines] == ["00001", "00002", "00003"]


def test_nothing_is_left_over(made: Path) -> None:
    assert not [p for p in made.rglob("*") if p.name.endswith(".part")]


def test_processes_make_the_same_files(made: Path, tmp_path: Path) -> None:
    steps: list[tuple[int, int]] = []
    make(tmp_path / "out", jobs=2, on_done=lambda done, total: steps.append((done, total)))
    assert files(tmp_path / "out") == files(made)
    assert [done for done, _ in steps] == list(range(13))


def test_a_second_run_makes_nothing_and_more_scenes_add_to_it(made: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made, out, symlinks=True)
    before = files(out)
    assert make(out)["made"] == 0
    assert files(out) == before
    assert make(out, replace(PLAN, scenes=3))["made"] == 2
    after = files(out)
    assert before.items() <= after.items()


def test_a_half_written_sequence_is_made_again(made: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made, out, symlinks=True)
    half = out / "folder" / "0000" / "sunset"
    (half / "complete.json").unlink()
    (half / "rgb" / "00001.png").write_bytes(b"half")
    shutil.rmtree(out / "eden" / "Depth" / "0000" / "sunset")
    shutil.rmtree(out / "folder" / "0001" / "clear")
    (out / "folder" / "0001" / ".clear.part").mkdir()
    steps: list[int] = []
    assert make(out, on_done=lambda done, _: steps.append(done))["made"] == 2
    assert steps[0] == 6
    assert files(out) == files(made)


def test_ctrl_c_keeps_what_is_whole(made: Path, tmp_path: Path) -> None:
    def stop_at_the_fifth(done: int, total: int) -> None:
        if done == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt, match="1 of 4 sequences are whole; give the same command again"):
        make(tmp_path / "out", on_done=stop_at_the_fifth)
    assert make(tmp_path / "out")["made"] == 3
    assert files(tmp_path / "out") == files(made)


def test_a_process_that_dies_gives_one_clear_error_and_can_be_resumed(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(OutputError, match=r"a process died.*give the same command again"):
        make(out, jobs=2, stage_of=dying_stage)
    assert make(out)["frames"] == 12


def test_a_folder_of_before_a_setting_came_goes_on_where_it_is_at_its_default(tmp_path: Path) -> None:
    out = tmp_path / "out"
    make(out, replace(PLAN, scenes=1))
    plan = json.loads((out / "plan.json").read_text())
    del plan["config"]["scene"]["more"]
    (out / "plan.json").write_text(json.dumps(plan))
    assert make(out)["made"] > 0
    crowded = replace(PLAN, config=replace(PLAN.config, scene=SceneConfig(more="tree=5")))
    with pytest.raises(OutputError, match=r"config\.scene\.more: '' there, 'tree=5' now"):
        make(out, crowded)


@pytest.mark.parametrize(
    ("plan", "named"),
    [
        (replace(PLAN, seed=1), "seed: 0 there, 1 now"),
        (replace(PLAN, frames=5), "frames: 3 there, 5 now"),
        (
            replace(PLAN, config=replace(PLAN.config, camera=OpticsConfig(faults=False))),
            "config.camera.faults: True there, False now",
        ),
    ],
)
def test_other_settings_are_refused_by_name(made: Path, plan: SynthPlan, named: str) -> None:
    before = files(made)
    with pytest.raises(OutputError) as refused:
        make(made, plan)
    assert named in str(refused.value)
    assert files(made) == before


def test_overwrite_begins_anew_but_only_in_a_folder_of_ours(made: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(made, out, symlinks=True)
    plan = replace(PLAN, scenes=1, frames=2, illuminations=("clear",))
    assert make(out, plan, overwrite=True)["made"] == 1
    assert [p.name for p in (out / "folder").iterdir()] == ["0000"]
    other = tmp_path / "photos"
    other.mkdir()
    (other / "holiday.jpg").write_bytes(b"photo")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match="was not made by swardmap"):
            make(other, overwrite=overwrite)
    assert files(other) == {"holiday.jpg": b"photo"}


def test_sensor_and_maps_can_be_left_out(tmp_path: Path) -> None:
    config = small_config(stereo=StereoConfig(enabled=False))
    config = replace(config, map=MapConfig(enabled=False))
    make(tmp_path / "out", replace(PLAN, scenes=1, illuminations=("clear",), config=config))
    here = tmp_path / "out" / "folder" / "0000" / "clear"
    assert not (here / "exact").exists()
    assert not (here / "maps").exists()
    for frame, exact in zip(open_source(here), open_source(tmp_path / "out" / "eden"), strict=True):
        np.testing.assert_allclose(np.nan_to_num(frame.depth_m), exact.depth, atol=0.00051)


def test_a_folder_that_cannot_be_written_is_one_error(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("in the way")
    with pytest.raises(OutputError, match="is a file"):
        make(file)
    with pytest.raises(OutputError, match="cannot write"):
        make(file / "below")


@pytest.mark.parametrize(
    "wrong", [{"scenes": 0}, {"scenes": 10_001}, {"frames": 0}, {"seed": -1}, {"illuminations": ("noon",)},
              {"illuminations": ()}, {"illuminations": ("clear", "clear")}],
)  # fmt: skip
def test_plans_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="expected"):
        replace(PLAN, **wrong)
