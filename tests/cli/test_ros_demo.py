"""`swardmap ros --demo` without ROS: which garden, and what the node is told."""

from contextlib import nullcontext
from types import SimpleNamespace

import pytest

from swardmap.cli import ros_demo
from swardmap.config import Config, config_from_dict
from swardmap.errors import InputError, MissingExtraError
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
    told = ros_demo.demo_parameters(Config(), "solids")
    assert told.config.segmenter.name == str(SOLIDS_NETWORK)
    assert told.config.source.odometry_topic == "odom"
    assert told.config.mount.height_m == 0.9
    assert told.config.costmap.inscribed_radius_m == INSCRIBED_M > TURN_RADIUS_M
    assert told.node.start_area_at_start
    chosen = config_from_dict({"segmenter": {"name": "colour"}, "grid": {"mode": "evidence"}})
    told = ros_demo.demo_parameters(chosen, "rendered")
    assert told.config.segmenter.name == "colour"
    assert told.config.grid == chosen.grid


class Mower:
    """A process that has ended, or has not."""

    def __init__(self, alive: bool, exitcode: int) -> None:
        self.alive, self.exitcode, self.calls = alive, exitcode, list[str]()

    def __call__(self, **_: object) -> "Mower":
        return self

    def is_alive(self) -> bool:
        return self.alive

    def __getattr__(self, name: str) -> object:
        return lambda *_, **__: self.calls.append(name)


@pytest.mark.parametrize(
    ("alive", "exitcode", "rounds", "fails"),
    [
        (True, -15, None, False),
        (False, 0, 1, False),
        (False, 1, 1, True),
        (False, 1, None, True),
        (True, -15, 1, True),
    ],
)
def test_a_mower_that_ends_early_is_an_error_and_none_is_left_behind(
    alive: bool, exitcode: int, rounds: int | None, fails: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    mower = Mower(alive, exitcode)
    monkeypatch.setattr("multiprocessing.get_context", lambda _: SimpleNamespace(Process=mower))
    monkeypatch.setattr("swardmap.ros.topics.rclpy_module", lambda: None)
    monkeypatch.setattr("swardmap.ros.run.run_node", lambda *_: None)
    with pytest.raises(InputError, match="ended early") if fails else nullcontext():
        ros_demo.run_demo(Config(), ["--ros-args"], "solids", rounds, 1.0)
    assert mower.calls == ["start", "terminate", "join", "kill"]
