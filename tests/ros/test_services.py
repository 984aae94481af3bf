"""The node's services without ROS."""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from swardmap.errors import OutputError
from swardmap.ros import services
from swardmap.ros.parameters import NodeConfig


def pipeline(save: Any, folder: Path) -> Any:
    node = NodeConfig(save_folder=str(folder))
    return SimpleNamespace(mapper=SimpleNamespace(save=save), parameters=SimpleNamespace(node=node))


@pytest.fixture(autouse=True)
def _no_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(services, "run_facts", lambda _: {"frames": {"camera": 1}})


def answer(saving: Any) -> Any:
    """Go on with a callback until it returns."""
    while True:
        try:
            saving.send(None)
        except StopIteration as ended:
            return ended.value


def test_while_the_map_is_saved_other_callbacks_have_their_turn(tmp_path: Path) -> None:
    go_on, folders = threading.Event(), list[Path]()

    def save(folder: Path, facts: object) -> None:
        assert facts == {"frames": {"camera": 1}}
        assert go_on.wait(timeout=30)
        folders.append(folder)

    saving = services._save(pipeline(save, tmp_path), None, SimpleNamespace())
    for _ in range(5):
        saving.send(None)  # comes back, though nothing was saved yet
    go_on.set()
    said = answer(saving)
    assert said.success
    assert [said.message] == [str(folder.absolute()) for folder in folders]
    assert folders[0].parent == tmp_path


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
@pytest.mark.parametrize(
    ("error", "expected"),
    [(OutputError("the disk is full"), "the disk is full"), (MemoryError(), "could not be saved")],
)
def test_what_went_wrong_is_answered(error: Exception, expected: str, tmp_path: Path) -> None:
    def save(*_: object) -> None:
        raise error

    said = answer(services._save(pipeline(save, tmp_path), None, SimpleNamespace()))
    assert not said.success
    assert expected in said.message
