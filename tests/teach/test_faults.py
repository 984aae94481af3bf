"""What of the safety set counts, and what the set in the package shows."""

import numpy as np

from swardmap.labels import PERSON
from swardmap.teach.faults import Counts, count_frame
from swardmap.teach.safety import REPLAY, SafetyFrame, safety_frames
from tests.teach.counting import BALL_ID, frame_of, says


def test_small_parts_and_grassy_things_do_not_count() -> None:
    frame = frame_of("a")
    small = np.where(frame.instances == BALL_ID, 0, frame.instances).astype(np.uint16)
    small[30:33, 40:43] = BALL_ID
    counts = Counts()
    count_frame(counts, SafetyFrame("a", frame.rgb, frame.labels, small, frame.things), says(frame))
    assert counts.cases("things_5-20 cm") == ([], [])
    assert counts.cases("persons") == ([0], [1])


def test_the_set_in_the_package_shows_what_a_gate_must_see() -> None:
    kinds, gardens, persons, heights = set(), set(), 0, []
    for frame in safety_frames():
        gardens.add(frame.garden)
        persons += bool((frame.labels == PERSON.id).any())
        kinds |= {kind for kind, _ in frame.things.values()}
        heights += [height for _, height in frame.things.values()]
    assert len(gardens) >= 15
    assert persons >= 20
    assert {"test body", "person"} <= kinds
    assert sum(0.05 <= h < 0.2 for h in heights) >= 25
    assert len(list((REPLAY / "images").iterdir())) >= 100
