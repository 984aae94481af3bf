"""What `swardmap synth` made, read as one data set."""

from pathlib import Path

import numpy as np
import pytest

from swardmap.config import SourceConfig
from swardmap.errors import InputError
from swardmap.eval.dataset import DatasetSpec, read_frames
from swardmap.io import open_source
from swardmap.io.sources import gardens
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import produce
from tests.io.contract import check_source
from tests.synth.small_stage import small_config, small_stage

PLAN = SynthPlan(scenes=2, frames=3, illuminations=("clear", "twilight"), config=small_config())


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("gardens") / "out"
    produce(PLAN, out, small_stage, jobs=1)
    return out


def test_contract(made: Path) -> None:
    frames = check_source(lambda: open_source(made))
    assert len(frames) == 12
    assert [frame.tags["sequence"] for frame in frames[::3]] == [
        "0000-clear", "0000-twilight", "0001-clear", "0001-twilight"
    ]  # fmt: skip


def test_frames_are_those_of_eden_s_layout_with_the_depth_of_the_sensor(made: Path) -> None:
    eden = list(open_source(made / "eden"))
    for frame, exact in zip(open_source(made), eden, strict=True):
        assert frame.name == exact.name
        np.testing.assert_array_equal(frame.rgb, exact.rgb)
        np.testing.assert_array_equal(frame.labels, exact.labels)


def test_the_evaluation_pairs_it_with_exact_depth(made: Path) -> None:
    spec = DatasetSpec(str(made), SourceConfig(), clean=str(made / "eden"))
    numbered = list(read_frames(spec, 2, 8))
    eden = list(open_source(made / "eden"))[2:8]
    for one, exact in zip(numbered, eden, strict=True):
        assert one.clean is not None, one.error
        np.testing.assert_array_equal(one.clean.depth, exact.depth)


@pytest.mark.parametrize(("start", "stop", "every"), [(0, None, 5), (2, 9, 2), (4, 5, 1), (11, None, 1)])
def test_any_part_of_it_can_be_read(made: Path, start: int, stop: int | None, every: int) -> None:
    names = [frame.name for frame in open_source(made)][start:stop:every]
    part = open_source(made, SourceConfig(start=start, stop=stop, every=every))
    assert [frame.name for frame in part] == names
    assert part.frame_count == len(names)


def test_a_sequence_that_is_not_whole_is_left_out_and_counted(tmp_path: Path) -> None:
    produce(PLAN, tmp_path / "out", small_stage, jobs=1)
    (tmp_path / "out/folder/0000/twilight/complete.json").write_text("{")
    source = open_source(tmp_path / "out")
    assert source.frame_count == 9
    assert dict(source.skipped) == {gardens.NOT_WHOLE: 1}
    for file in (tmp_path / "out/folder").glob("*/*/complete.json"):
        file.unlink()
    with pytest.raises(InputError, match="at least one sequence"):
        open_source(tmp_path / "out")
