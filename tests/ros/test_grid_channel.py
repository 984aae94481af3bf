"""A grid and its updates as Nav2's StaticLayer takes them: nothing that was sent is lost for long."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from swardmap.grid import GridSpec
from swardmap.ros import outputs
from swardmap.ros.messages import joined

Grid = NDArray[np.int8]


class StaticLayer:
    """nav2_costmap_2d/plugins/static_layer.cpp of Nav2 jazzy (f4108e5), without costs: values stay values."""

    def __init__(self) -> None:
        self.values: Grid | None = None
        self.buffer: Grid | None = None

    def incoming_map(self, fields: dict[str, Any]) -> None:
        new = np.array(fields["data"]).reshape(fields["info"]["height"], fields["info"]["width"])
        if self.values is None:
            self.values = new.copy()
            return
        self.buffer = new.copy()

    def incoming_update(self, fields: dict[str, Any]) -> None:
        if self.values is None:
            return
        x, y, width, height = (fields[key] for key in ("x", "y", "width", "height"))
        if y < 0 or self.values.shape[0] < y + height or x < 0 or self.values.shape[1] < x + width:
            return  # "Map update ignored. Exceeds bounds of static layer."
        self.values[y : y + height, x : x + width] = np.array(fields["data"]).reshape(height, width)

    def update_bounds(self) -> None:
        if self.buffer is not None:
            self.values, self.buffer = self.buffer, None


@pytest.fixture
def channel_to(monkeypatch: pytest.MonkeyPatch) -> Callable[[StaticLayer, bool], outputs.GridChannel]:
    """A channel whose messages reach the layer at once; no ROS is needed."""

    def made(layer: StaticLayer, with_updates: bool = True) -> outputs.GridChannel:
        return channel(layer, monkeypatch, with_updates)

    return made


def channel(layer: StaticLayer, patch: pytest.MonkeyPatch, with_updates: bool = True) -> outputs.GridChannel:
    patch.setitem(__import__("sys").modules, "nav_msgs", SimpleNamespace())
    patch.setitem(__import__("sys").modules, "nav_msgs.msg", SimpleNamespace(OccupancyGrid="grid"))
    patch.setattr(outputs, "latched_qos", lambda: None)
    patch.setattr(outputs, "ros_message", lambda _, fields: fields)
    taken = {"map": layer.incoming_map, "map_updates": layer.incoming_update}
    node = SimpleNamespace(create_publisher=lambda _, topic, __: SimpleNamespace(publish=taken[topic]))
    return outputs.GridChannel(node, "map", "update" if with_updates else None)


cells = st.sampled_from([-1, 0, 100])
changes = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 7), cells), max_size=3)


@given(st.lists(st.tuples(changes, st.booleans(), st.booleans()), max_size=30), st.booleans())
def test_two_cycles_after_a_change_the_layer_has_it(
    events: list[tuple[list[tuple[int, int, int]], bool, bool]], with_updates: bool
) -> None:
    """Whatever changes, grows, and however the layer's cycles fall between the messages."""
    with pytest.MonkeyPatch.context() as patch:
        layer = StaticLayer()
        sender = channel(layer, patch, with_updates)
        values, spec, now_s = np.full((6, 8), -1, np.int8), GridSpec(0.05, 8, 6, (0.0, 0.0), "map"), 0.0

        def publish() -> None:
            nonlocal now_s
            now_s += 0.2
            sender.publish(values.copy(), spec, 0, now_s, full_s=2.0)

        publish()
        for changed, grows, cycle in events:
            for row, column, value in changed:
                values[row, column] = value
            if grows:
                values = np.pad(values, ((0, 0), (0, 1)), constant_values=-1)
                spec = GridSpec(0.05, values.shape[1], values.shape[0], (0.0, 0.0), "map")
            publish()
            if cycle:
                layer.update_bounds()
        layer.update_bounds()
        publish()
        assert layer.values is not None
        layer.update_bounds()
        np.testing.assert_array_equal(layer.values, values)


def test_an_update_that_came_while_a_whole_map_waited_is_sent_again(
    channel_to: Callable[..., outputs.GridChannel],
) -> None:
    layer = StaticLayer()
    sender, spec = channel_to(layer), GridSpec(0.05, 8, 6, (0.0, 0.0), "map")
    values = np.zeros((6, 8), np.int8)
    sender.publish(values, spec, 0, 0.0, full_s=2.0)
    sender.publish(values, spec, 0, 2.1, full_s=2.0)  # due: it waits in the layer's buffer
    person = values.copy()
    person[3, 4] = 100
    sender.publish(person, spec, 0, 2.3, full_s=2.0)
    assert layer.values is not None
    assert layer.values[3, 4] == 100
    layer.update_bounds()
    assert layer.values[3, 4] == 0  # the older map went over the update
    sender.publish(person, spec, 0, 2.5, full_s=2.0)
    assert layer.values[3, 4] == 100


def test_what_does_not_change_is_sent_whole_now_and_then_only(
    channel_to: Callable[..., outputs.GridChannel], monkeypatch: pytest.MonkeyPatch
) -> None:
    layer = StaticLayer()
    sender, spec = channel_to(layer), GridSpec(0.05, 8, 6, (0.0, 0.0), "map")
    sent: list[str] = []
    monkeypatch.setattr(layer, "incoming_map", lambda _: sent.append("map"))
    monkeypatch.setattr(layer, "incoming_update", lambda _: sent.append("update"))
    sender = channel_to(layer)
    values = np.zeros((6, 8), np.int8)
    for i in range(21):
        sender.publish(values, spec, 0, 0.2 * i, full_s=2.0)
    assert sent == ["map"] * 3
    sent.clear()
    for i in range(5):
        sender.publish(values + np.int8(i), spec, 0, 10 + 0.2 * i, full_s=0.0)
    assert sent == ["map"] * 5  # 0: always whole


@pytest.mark.parametrize(("of_whole", "of_updates"), [(0, 0), (1, 0), (1, 1)])
def test_who_hears_the_whole_map_alone_hears_no_updates(
    of_whole: int, of_updates: int, channel_to: Callable[..., outputs.GridChannel]
) -> None:
    sender = channel_to(StaticLayer())
    for publisher, count in zip(sender.publishers, (of_whole, of_updates), strict=True):
        publisher.get_subscription_count = lambda count=count: count
    assert sender.updates_are_heard == bool(of_updates)
    without = channel_to(StaticLayer(), False)
    without.publishers[0].get_subscription_count = lambda: of_whole
    assert not without.updates_are_heard


rectangles = st.one_of(
    st.none(), st.tuples(st.integers(0, 5), st.integers(0, 5), st.integers(1, 4), st.integers(1, 4))
)


@given(rectangles, rectangles)
def test_rectangles_are_joined_as_sets_of_cells(
    first: tuple[int, int, int, int] | None, second: tuple[int, int, int, int] | None
) -> None:
    covered = np.zeros((10, 10), bool)
    for rectangle in (first, second):
        if rectangle is not None:
            x, y, width, height = rectangle
            covered[y : y + height, x : x + width] = True
    both = joined(first, second)
    if both is None:
        assert not covered.any()
        return
    rows, columns = np.nonzero(covered)
    x, y, width, height = both
    assert (x, y) == (columns.min(), rows.min())
    assert (x + width - 1, y + height - 1) == (columns.max(), rows.max())
