"""Whoever asks for a start area waits for the answer, and knows how many were granted."""

import sys
from types import SimpleNamespace
from typing import Any

import pytest

from swardmap.ros.grants import ANSWERS_NS, ASKS_NS, Grants

NOW_NS = 50 * ASKS_NS


class Answer:
    """As rclpy's future: its callbacks are called once it is there."""

    def __init__(self) -> None:
        self.callbacks = list[Any]()
        self.value: Any = None

    def add_done_callback(self, callback: Any) -> None:
        self.callbacks.append(callback)

    def done(self) -> bool:
        return self.value is not None

    def result(self) -> Any:
        return self.value

    def comes(self, success: bool) -> None:
        self.value = SimpleNamespace(success=success)
        for callback in self.callbacks:
            callback(self)


class Service:
    """A client of the service, and all answers that it was promised."""

    def __init__(self) -> None:
        self.ready, self.promised = True, list[Answer]()

    def service_is_ready(self) -> bool:
        return self.ready

    def call_async(self, _: Any) -> Answer:
        self.promised.append(Answer())
        return self.promised[-1]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> tuple[Grants, Service]:
    trigger = SimpleNamespace(Trigger=SimpleNamespace(Request=SimpleNamespace))
    monkeypatch.setitem(sys.modules, "std_srvs", SimpleNamespace(srv=trigger))
    monkeypatch.setitem(sys.modules, "std_srvs.srv", trigger)
    service = Service()
    return Grants(SimpleNamespace(create_client=lambda *_: service)), service


def test_it_waits_for_the_answer_and_counts_what_was_granted(asked: tuple[Grants, Service]) -> None:
    grants, service = asked
    assert not grants.awaited(NOW_NS)
    grants.ask(NOW_NS)
    assert grants.awaited(NOW_NS)
    service.promised[0].comes(True)
    assert (grants.awaited(NOW_NS), grants.count) == (False, 1)


def test_what_was_refused_is_not_counted_and_asked_for_again_after_a_while(
    asked: tuple[Grants, Service],
) -> None:
    grants, service = asked
    grants.ask(NOW_NS)
    service.promised[0].comes(False)
    grants.ask(NOW_NS + ASKS_NS)
    assert len(service.promised) == 1
    grants.ask(NOW_NS + ASKS_NS + 1)
    service.promised[1].comes(True)
    assert grants.count == 1


def test_an_answer_that_never_comes_is_not_waited_for_for_ever(asked: tuple[Grants, Service]) -> None:
    grants, service = asked
    grants.ask(NOW_NS)
    grants.ask(NOW_NS + ANSWERS_NS)
    assert len(service.promised) == 1
    assert grants.awaited(NOW_NS + ANSWERS_NS)
    assert not grants.awaited(NOW_NS + ANSWERS_NS + 1)
    grants.ask(NOW_NS + ANSWERS_NS + 1)
    assert len(service.promised) == 2


def test_where_there_is_no_service_nothing_is_asked(asked: tuple[Grants, Service]) -> None:
    grants, service = asked
    service.ready = False
    grants.ask(NOW_NS)
    assert not service.promised
