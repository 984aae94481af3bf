"""A frame of a safety set, what networks of known faults say of it, and their counts."""

import numpy as np

from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID
from swardmap.teach.faults import LIT, Counts, Said, count_frame, count_held, count_pixels
from swardmap.teach.safety import SafetyFrame

PERSON_ID, BALL_ID, PATH_ID = 3, 4, 60_004


def frame_of(garden: str) -> SafetyFrame:
    """Lawn with a path, a person and a ball."""
    labels = np.full((40, 60), GRASS.id, np.uint8)
    instances = np.zeros((40, 60), np.uint16)
    for key, class_id, at in (
        (PATH_ID, OTHER.id, np.s_[:, :10]),
        (PERSON_ID, PERSON.id, np.s_[5:25, 20:28]),
        (BALL_ID, OTHER.id, np.s_[30:36, 40:46]),
    ):
        labels[at], instances[at] = class_id, key
    things = {PATH_ID: ("path", 0.0), PERSON_ID: ("person", 1.7), BALL_ID: ("ball", 0.15)}
    return SafetyFrame(garden, np.zeros((40, 60, 3), np.uint8), labels, instances, things)


def says(frame: SafetyFrame, blind_to: tuple[int, ...] = (), unsure_of: tuple[int, ...] = ()) -> Said:
    """The truth, but for things that are called grass, and things of which that is not sure."""
    grass = (frame.labels == GRASS.id) | np.isin(frame.instances, blind_to)
    return Said(grass, grass & ~np.isin(frame.instances, unsure_of))


def counts_of(
    blind_to: tuple[int, ...] = (),
    unsure_of: tuple[int, ...] = (),
    gardens: int = 8,
    driven_missed: int = 0,
    driven_unsure: int = 0,
    lit_blind_to: tuple[int, ...] = (),
    lit_unsure_of: tuple[int, ...] = (),
    ground_called: int = 0,
) -> Counts:
    """Of eight gardens that are alike, the same in the light of a drive, and of the part held out."""
    counts = Counts()
    for k in range(gardens):
        frame = frame_of(str(k))
        count_frame(counts, frame, says(frame, blind_to, unsure_of))
        count_pixels(counts, frame, says(frame, lit_blind_to, lit_unsure_of), LIT)
        held, before = np.full((20, 10), GRASS.id, np.uint8), np.full((20, 10), VOID_ID, np.uint8)
        held[0] = OTHER.id
        held[10:], before[10:] = VOID_ID, OTHER.id
        grass = held == GRASS.id
        grass[10 : 10 + ground_called] = True
        grass[1 : 1 + driven_missed] = False
        clears = grass.copy()
        clears[1 : 1 + driven_unsure] = False
        count_held(counts, str(k), held, before, Said(grass, clears))
    return counts
