"""What a drive teaches: which weights learn, and how much of what was known is replayed."""

from dataclasses import replace
from pathlib import Path

import pytest

from swardmap.teach.learn import teach_recipe
from swardmap.teach.plan import LearnConfig
from swardmap.train.recipe import Recipe

pytest.importorskip("torch")


def recipe(**changes: float) -> Recipe:
    learning = replace(LearnConfig(), **changes)  # type: ignore[arg-type]
    return teach_recipe("my-lawn", Path("lawn.onnx"), "MIT", learning, (), "fp32")


@pytest.mark.parametrize("rate", [0.0, 1e-5])
def test_the_encoder_stays_as_it_is_unless_it_has_a_rate(rate: float) -> None:
    from swardmap.train.build import build_network

    taught = recipe(encoder_rate=rate)
    assert (taught.schedule.kept_batches > 0) == (rate == 0)  # what an encoder says is kept while it stays
    network = build_network(taught, pretrained=False)
    assert any(p.requires_grad for p in network.encoder.parameters()) == (rate > 0)
    assert all(p.requires_grad for p in network.decoder.parameters())
    assert all(p.requires_grad for p in network.segmentation_head.parameters())


def test_driven_pixels_weigh_what_they_are_told() -> None:
    told = teach_recipe("my-lawn", Path("lawn.onnx"), "MIT", LearnConfig(), (), "fp32", 12.0)
    assert {d.name: d.free_weight for d in told.data if not d.validation} == {
        "drive": 12.0,
        "gardens": 1.0,
        "demo": 1.0,
    }


def test_half_of_the_views_are_of_the_drive() -> None:
    weights = {d.name: d.weight for d in recipe().data if not d.validation}
    assert weights["drive"] == pytest.approx(sum(weights.values()) / 2)


def test_half_of_the_gardens_are_in_the_light_of_the_drive_where_that_is_known() -> None:
    lit = teach_recipe("my-lawn", Path("lawn.onnx"), "MIT", LearnConfig(), (), "fp32", in_your_light=True)
    plain = {d.name: d for d in recipe().data if not d.validation}
    data = {d.name: d for d in lit.data if not d.validation}
    assert data["gardens"].weight == data["gardens-lit"].weight == plain["gardens"].weight / 2
    assert (
        data["gardens"].hold_out == data["gardens-lit"].hold_out
    )  # none is watched in one light, learnt in the other
    assert sum(d.weight for d in data.values()) == pytest.approx(sum(d.weight for d in plain.values()))
