"""What a recording knows beyond its labels: files round trip, and bad ones are one clear error."""

from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import RegularGridInterpolator

from swardmap.errors import InputError, InvalidValueError
from swardmap.io import TruthSource, open_source
from swardmap.io.images import encode_png
from swardmap.io.sources.folder import write_folder
from swardmap.io.sources.truth import (
    FIRST_AREA,
    GroundRaster,
    KnownThing,
    read_ground,
    read_things,
    read_truth,
    write_ground,
    write_things,
)
from swardmap.synth.analytic import AnalyticSource, lane_poses
from swardmap.synth.plan import SynthPlan
from swardmap.synth.produce import produce
from tests.synth.small_stage import small_config, small_stage

THINGS = {3: KnownThing("shrub", 0.43), FIRST_AREA + 8: KnownThing("water", 0.0)}


def test_the_ground_is_linear_between_texels() -> None:
    rng = np.random.default_rng(0)
    ground = GroundRaster((-1.0, 2.0), 0.25, rng.normal(0, 1, (20, 30)).astype(np.float32))
    x, y = rng.uniform((-0.8, 2.2), (6.3, 6.8), (100, 2)).T
    axes = (2.0 + (np.arange(20) + 0.5) * 0.25, -1.0 + (np.arange(30) + 0.5) * 0.25)
    expected = RegularGridInterpolator(axes, ground.height_m)(np.column_stack((y, x)))
    np.testing.assert_allclose(ground.at(x, y), expected, atol=1e-6)
    assert float(ground.at(-50.0, -50.0)) == pytest.approx(float(ground.height_m[0, 0]))
    with pytest.raises(InvalidValueError, match="texel"):
        GroundRaster((0, 0), 0.0, np.zeros((2, 2), np.float32))


def test_files_round_trip(tmp_path: Path) -> None:
    ground = GroundRaster((1.0, -2.0), 0.1, np.arange(12, dtype=np.float32).reshape(3, 4))
    write_ground(tmp_path / "ground.npz", ground)
    again = read_ground(tmp_path / "ground.npz")
    assert (again.origin_m, again.texel_m) == (ground.origin_m, ground.texel_m)
    np.testing.assert_array_equal(again.height_m, ground.height_m)
    write_things(tmp_path / "instances.json", THINGS)
    assert read_things(tmp_path / "instances.json") == THINGS
    assert read_truth(tmp_path, "one") is not None
    assert read_truth(tmp_path / "nothing", "one") is None


@pytest.mark.parametrize("text", ["[]", "{", '{"x": {"kind": "a", "height_m": 1}}', '{"1": {"kind": "a"}}',
                                  '{"1": {"kind": "", "height_m": 1}}'])  # fmt: skip
def test_a_bad_table_is_one_clear_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "instances.json").write_text(text)
    with pytest.raises(InputError, match=r"instances\.json: (thing: )?expected (ids|a kind)"):
        read_things(tmp_path / "instances.json")


def test_a_recording_without_truth_has_none_and_with_it_knows_each_pixel(tmp_path: Path) -> None:
    frames = list(AnalyticSource(poses=tuple(lane_poses(2))))
    write_folder(frames, tmp_path / "plain")
    source = open_source(tmp_path / "plain")
    assert isinstance(source, TruthSource)
    assert source.truth(0) is None
    assert source.clean_frame(0) is None
    ids = np.zeros(frames[0].depth.shape, np.uint16)
    ids[100:200] = 3
    (tmp_path / "plain" / "instances").mkdir()
    (tmp_path / "plain" / "instances" / "000001.png").write_bytes(encode_png(ids))
    write_things(tmp_path / "plain" / "instances.json", THINGS)
    assert source.truth(0) is None
    found = source.truth(1)
    assert found is not None
    assert found.instances is not None
    np.testing.assert_array_equal(found.instances, ids)
    assert found.things == THINGS
    assert found.ground is None
    (tmp_path / "plain" / "instances" / "000001.png").write_bytes(encode_png(ids.astype(np.uint8)))
    with pytest.raises(InputError, match="16-bit"):
        source.truth(1)


def test_gardens_record_which_thing_each_pixel_is(tmp_path: Path) -> None:
    plan = SynthPlan(scenes=2, frames=2, illuminations=("clear",), config=small_config())
    produce(plan, tmp_path / "out", small_stage, jobs=1)
    source = open_source(tmp_path / "out")
    assert isinstance(source, TruthSource)
    seen: set[str] = set()
    for position, frame in enumerate(source):
        truth, exact = source.truth(position), source.clean_frame(position)
        assert truth is not None
        assert truth.instances is not None
        assert truth.ground is not None
        assert exact is not None
        assert exact.name == frame.name
        assert exact.stamp_ns == frame.stamp_ns
        assert frame.labels is not None
        assert set(np.unique(truth.instances).tolist()) - {0} <= set(truth.things)
        seen |= {t.kind for t in truth.things.values()}
        for key, thing in truth.things.items():
            own = truth.instances == key
            if thing.kind == "person":
                assert thing.height_m == pytest.approx(1.7, abs=0.01)
                assert (frame.labels[own] == 2).all()
        assert (frame.labels[truth.instances == 0] != 2).all()
    assert {"shed", "pot", "person", "gravel"} & seen >= {"person"}
