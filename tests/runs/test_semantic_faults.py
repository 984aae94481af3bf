"""Faults of camera, pose and clock: no cell is wrongly free, or the fault is named, or it is listed here."""

import pytest

from tests.runs.semantic_faults import FAULTS, Fault, in_the_node, offline

NOT_NOTICED = {
    "a tenth of the readings is noise", "mirrored left to right", "images torn: lower half of the one before",
    "pose a frame late",
}  # fmt: skip
"""docs/safety.md says so, and why."""


@pytest.mark.slow
@pytest.mark.parametrize("engine", [offline, in_the_node])
@pytest.mark.parametrize("fault", FAULTS, ids=[f.name for f in FAULTS])
def test_no_cell_is_wrongly_free_or_the_fault_is_named(fault: Fault, engine: object) -> None:
    found = engine(fault)  # type: ignore[operator]
    if fault.name in NOT_NOTICED:
        assert not found.named, "it is noticed now: say so in docs/safety.md"
        return
    assert found.is_safe, found
    assert fault.name != "nothing wrong" or not found.named


def test_there_are_forty_and_each_has_a_name_of_its_own() -> None:
    names = [fault.name for fault in FAULTS]
    assert len(set(names) - NOT_NOTICED - {"nothing wrong"}) == len(names) - len(NOT_NOTICED) - 1 >= 35
    assert set(names) >= NOT_NOTICED
