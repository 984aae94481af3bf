"""`swardmap ros --demo` without ROS: which garden, and what the node is told."""

import pytest

from swardmap.cli import ros_demo
from swardmap.config import Config, config_from_dict
from swardmap.errors import MissingExtraError
from swardmap.ros.driver import INSCRIBED_M, TURN_RADIUS_M
from swardmap.synth.live_garden import SOLIDS_NETWORK, SolidGarden


def fails() -> None:
    raise MissingExtraError("OpenGL cannot be opened")


def test_without_a_renderer_the_garden_is_of_simple_solids_and_that_is_said(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("swardmap.synth.render.context.open_context", fails)
    assert ros_demo.garden_kind("auto") == "solids"
    assert "OpenGL cannot be opened" in capsys.readouterr().out
    with pytest.raises(MissingExtraError):
        ros_demo.garden_kind("rendered")


def test_who_asks_for_simple_solids_gets_them_in_silence(capsys: pytest.CaptureFixture[str]) -> None:
    assert ros_demo.garden_kind("solids") == "solids"
    assert not capsys.readouterr().out
    assert isinstance(ros_demo.open_garden("solids"), SolidGarden)


def test_the_node_is_told_what_the_mower_is() -> None:
    told = ros_demo.demo_parameters(Config(), str(SOLIDS_NETWORK))
    assert told.config.segmenter.name == str(SOLIDS_NETWORK)
    assert told.config.source.odometry_topic == "odom"
    assert told.config.mount.height_m == 0.9
    assert told.config.costmap.inscribed_radius_m == INSCRIBED_M > TURN_RADIUS_M
    assert told.node.start_area_at_start
    chosen = config_from_dict({"segmenter": {"name": "colour"}, "grid": {"mode": "evidence"}})
    told = ros_demo.demo_parameters(chosen, "auto")
    assert told.config.segmenter.name == "colour"
    assert told.config.grid == chosen.grid
