"""Gardens that a mower drives through live.

python -m tests.synth.test_live_garden     writes the network of the garden of simple solids anew
"""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from swardmap.config import SegmenterConfig
from swardmap.labels import GRASS, GRASS_OBSTACLE_PERSON, PERSON, VOID_ID
from swardmap.models import build_segmenter
from swardmap.models.spec import METADATA_KEY, NetworkSpec
from swardmap.synth.live_garden import CAMERA, SOLIDS_NETWORK, SolidGarden, Visit

SPEC = NetworkSpec(
    "solids", CAMERA.width, CAMERA.height, GRASS_OBSTACLE_PERSON, (0, 1, 2), (0, 0, 0), (1, 1, 1),
    licence="Apache-2.0", training={"made": "by hand: a 1x1 convolution of red, green and blue"},
)  # fmt: skip


def network() -> bytes:
    """Grass where green outweighs red and blue, a person where they outweigh green by far."""
    onnx = pytest.importorskip("onnx", reason="the network is built with the package onnx")
    helper, size = onnx.helper, [CAMERA.height, CAMERA.width]
    weights = [0.0, 0, 0, -40, 80, -40, 40, -80, 40]
    graph = helper.make_graph(
        [helper.make_node("Conv", ["image", "w", "b"], ["logits"])],
        "solids",
        [helper.make_tensor_value_info("image", 1, [1, 3, *size])],
        [helper.make_tensor_value_info("logits", 1, [1, 3, *size])],
        [helper.make_tensor("w", 1, [3, 3, 1, 1], weights), helper.make_tensor("b", 1, [3], [0.0, -3, -12])],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    helper.set_model_props(model, {METADATA_KEY: SPEC.to_json()})
    data: bytes = model.SerializeToString()
    return data


def test_the_network_of_the_solids_is_what_is_built_here() -> None:
    assert SOLIDS_NETWORK.read_bytes() == network()


@pytest.mark.parametrize("x_m", [0.0, 1.2])
def test_that_network_tells_lawn_and_the_visitor(x_m: float) -> None:
    garden = SolidGarden()
    garden.visit = replace(garden.visit, began_ns=0)
    frame = garden.look(garden.base_at(x_m, 0.0, 0.0), 4_000_000_000)  # they stand in the lane
    assert frame.labels is not None
    found = build_segmenter(SegmenterConfig(name=str(SOLIDS_NETWORK)))(frame).labels
    known = frame.labels != VOID_ID
    person, grass = frame.labels == PERSON.id, frame.labels == GRASS.id
    assert np.count_nonzero(person) > 300
    assert (found[person] == PERSON.id).mean() > 0.7  # hands and face are as obstacles
    assert (found[grass] == GRASS.id).mean() > 0.97
    assert (found[known & ~person] == PERSON.id).mean() < 0.003
    assert (found[known & ~grass] == GRASS.id).mean() < 0.03


def test_the_visitor_walks_in_stands_and_walks_back() -> None:
    waits = Visit()
    assert waits.position_m(9_000_000_000) == waits.from_m
    visit = replace(waits, began_ns=1_000_000_000)
    places = np.array([visit.position_m(round(1e9 * (1 + t))) for t in np.arange(0, 15, 0.1)])
    np.testing.assert_allclose(places[[0, -1]], [visit.from_m] * 2)
    steps = np.hypot(*np.diff(places, axis=0).T)
    assert steps.max() <= 0.1 * visit.speed_mps + 1e-9
    stands = np.hypot(*(places - visit.lane_m).T) < 1e-6
    assert np.count_nonzero(stands) == pytest.approx(10 * visit.stands_s, abs=2)


def test_the_camera_goes_with_the_mower() -> None:
    garden = SolidGarden()
    T = garden.base_at(1.0, 0.5, math.pi / 2)
    np.testing.assert_allclose(T.apply([[1.0, 0, 0]]), [[1.0, 1.5, 0]], atol=1e-12)
    here, there = (garden.look(garden.base_at(x, 0, 0), 0) for x in (0.0, 2.0))
    column = here.depth[:100, 79]
    assert int(np.median(column[column > 0])) - int(np.median(there.depth[:100, 79])) > 500


if __name__ == "__main__":
    Path(SOLIDS_NETWORK).write_bytes(network())
