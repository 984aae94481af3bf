"""What a drive labels, held against the truth of the scene: grass is lawn, and nothing else is called so."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from swardmap.errors import InputError
from swardmap.geometry import Pose
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID
from swardmap.mapping.work_area import AreaRole, Polygon, WorkArea
from swardmap.synth.analytic import Patch, Walker, lane_poses
from swardmap.synth.analytic_solids import Box, Finish
from swardmap.teach.drive import Drive, driven_again
from swardmap.teach.labels import label_frame
from swardmap.teach.plan import TeachPlan, circle
from swardmap.teach.write import doubt_of, evened, ground_of, shrunk
from swardmap.types import Frame, Segmentation
from tests.teach.scenes import CONFIG, GARDEN, PLAN, Says, drive_of, lane, moved, with_poses

Pixels = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]


def true(frame: Frame) -> Pixels:
    assert frame.labels is not None
    return frame.labels


def poses_of(frames: list[Frame]) -> list[Pose]:
    return [f.T_map_camera for f in frames if f.T_map_camera is not None]


def labels_of(
    frames: list[Frame], drive: Drive, says: Says | None = None, unwanted: tuple[WorkArea, ...] = ()
) -> tuple[Pixels, Pixels, Pixels]:
    """Labels by the drive, by the network, and the truth, of all frames together."""
    says = says or Says()
    ground = ground_of(drive, doubt_of(drive), None, unwanted)
    sure, said, truth = [], [], []
    for _, frame, heights, found in driven_again(frames, drive, says, CONFIG, lambda: None):
        labels = label_frame(heights, found, ground, PLAN.labels)
        sure.append(labels.sure)
        said.append(labels.said)
        truth.append(true(frame))
    return np.stack(sure), np.stack(said), np.stack(truth)


@pytest.fixture(scope="module")
def frames() -> list[Frame]:
    return list(lane())


@pytest.fixture(scope="module")
def drive(frames: list[Frame]) -> Drive:
    return drive_of(frames)


def test_driven_ground_is_grass_and_what_stands_is_not(frames: list[Frame], drive: Drive) -> None:
    says = Says(grass_is=0)  # a network that knows nothing of this lawn
    sure, said, truth = labels_of(frames, drive_of(frames, says), says)
    assert (truth[sure == GRASS.id] == GRASS.id).all()
    assert (truth[sure == OTHER.id] == OTHER.id).mean() > 0.99
    assert (sure == GRASS.id).mean() > 0.05
    stands = truth == OTHER.id
    assert (sure[stands] == OTHER.id).mean() > 0.4  # the rest is farther than 8 m, at edges, or the sky
    assert (said == OTHER.id).sum() == 0  # it calls driven ground so: its word counts nowhere


def test_a_network_that_knows_the_lawn_labels_the_flat_rest(frames: list[Frame], drive: Drive) -> None:
    sure, said, truth = labels_of(frames, drive)
    assert (said == GRASS.id).sum() > (sure == GRASS.id).sum()
    assert (truth[said == GRASS.id] == GRASS.id).all()
    doubtful = Says(confidence=0.7)
    _, said, _ = labels_of(frames, drive_of(frames, doubtful), doubtful)
    assert (said == GRASS.id).sum() == 0


@dataclass
class SurerOfPaths(Says):
    """Takes a lawn that it does not know for no lawn, but is surer of what is none."""

    def __call__(self, frame: Frame) -> Segmentation:
        found = super().__call__(frame)
        confidence = np.where(true(frame) == GRASS.id, np.float32(0.91), np.float32(0.98))
        return replace(found, confidence=confidence, hazard=np.rint(255 * confidence).astype(np.uint8))


def test_its_no_grass_counts_where_it_is_surer_than_of_the_driven_ground() -> None:
    """Of a campus it called a quarter of the lawn no grass, and its paths far more surely."""
    path = Patch((4.5, -1.6), (5.0, 1.2), material=Finish((150, 146, 140), "slabs", 0.1))
    frames, says = list(lane(replace(GARDEN, patches=(path,)))), SurerOfPaths(grass_is=0)
    sure, said, truth = labels_of(frames, drive_of(frames, says), says)
    assert (said[(truth == OTHER.id) & (sure == VOID_ID)] == OTHER.id).mean() > 0.5
    assert (truth[said == OTHER.id] == OTHER.id).all()


def test_the_driven_area_is_that_of_the_footprint(drive: Drive) -> None:
    length_m = 25 * 0.25
    inside = 0.6 * length_m + np.pi * 0.3**2
    assert drive.driven_m2 == pytest.approx(inside, rel=0.06)


@pytest.mark.parametrize("knows", [True, False])
def test_paving_that_was_crossed_is_doubtful_and_not_learnt(knows: bool) -> None:
    grey = Finish((150, 146, 140), "slabs", 0.1)
    scene = replace(GARDEN, patches=(Patch((4.5, 0.0), (1.2, 3.0), material=grey),))
    frames = list(lane(scene))
    says = Says(grass_is=1 if knows else 0)
    drive = drive_of(frames, says)
    assert doubt_of(drive).cells.sum() * 0.0025 > 0.4  # of 0.6 m x 1.2 m
    sure, _, truth = labels_of(frames, drive, says)
    assert (sure == GRASS.id).any()
    assert (truth[sure == GRASS.id] == GRASS.id).mean() > 0.98


def test_the_edge_of_a_bed_stays_other() -> None:
    bed = Box((4.0, 0.75), (6.0, 0.8, 0.14), material=Finish((92, 70, 50), grain=0.2))
    frames = list(lane(replace(GARDEN, solids=(*GARDEN.solids, bed))))
    drive = drive_of(frames)  # 5 cm beside the footprint
    sure, _, truth = labels_of(frames, drive)
    assert (truth[sure == GRASS.id] == GRASS.id).all()
    assert not drive.left_out


@pytest.mark.parametrize("known", [True, False])
def test_a_person_who_walks_behind_is_never_grass(known: bool) -> None:
    there = lane_poses(10, (0.0, 0.0), 0.0, 0.25, 0.7, 22)
    turn = [lane_poses(1, (2.5, 0.0), 30.0 * k, 0.25, 0.7, 22)[0] for k in range(1, 6)]
    back = lane_poses(9, (2.4, 0.1), 180.0, 0.25, 0.7, 22)
    walker = Walker((-4.0, 0.1), (0.45, 0.0))
    scene = replace(GARDEN, persons=(walker,))
    frames = list(lane(scene, poses=[*there, *turn, *back]))
    if not known:  # a network that takes the person for grass, and is sure
        frames = [replace(f, labels=np.where(true(f) == 2, np.uint8(1), true(f))) for f in frames]
    truth = np.stack([true(f) for f in lane(scene, poses=[*there, *turn, *back])])
    drive = drive_of(frames)
    sure, said, _ = labels_of(frames, drive)
    truth = truth[[p.index for p in drive.used]]
    person = truth == PERSON.id
    assert person.sum() > 500
    assert (sure[person] == GRASS.id).sum() == 0
    if known:
        assert (sure[person] == PERSON.id).mean() > 0.5
        assert (said[person] == GRASS.id).sum() == 0


@pytest.mark.parametrize("off_m", [(0.0, 0.4), (0.3, 0.5), (0.0, 2.0), (3.0, -1.0)])
def test_a_pose_that_is_wrong_for_a_while_is_left_out(
    frames: list[Frame], off_m: tuple[float, float]
) -> None:
    wrong = [moved(p, *off_m) if 10 <= i < 17 else p for i, p in enumerate(poses_of(frames))]
    drive = drive_of(with_poses(frames, wrong))
    (spans,) = drive.left_out.values()
    assert spans == [(4.0, 6.4)]
    sure, _, truth = labels_of(with_poses(frames, wrong), drive)
    assert (truth[sure == GRASS.id] == GRASS.id).all()


@pytest.mark.parametrize("off_m", [(0.0, 0.5), (1.0, -2.0)])
def test_ten_seconds_of_a_wrong_pose_are_left_out(off_m: tuple[float, float]) -> None:
    """Of a slow drive of 40 s, as a localisation that was lost for a while gives it."""
    frames = list(lane(n=100, step_m=0.1))
    wrong = [moved(p, *off_m) if 40 <= i < 66 else p for i, p in enumerate(poses_of(frames))]
    drive = drive_of(with_poses(frames, wrong))
    assert drive.left_out == {"the pose jumped": [(16.0, 26.0)]}
    sure, _, truth = labels_of(with_poses(frames, wrong), drive)
    assert (sure == GRASS.id).any()
    assert (truth[sure == GRASS.id] == GRASS.id).all()


def test_a_drive_that_contradicts_itself_is_refused(frames: list[Frame]) -> None:
    wrong = [moved(p, 0, 0.9 * (i // 5 % 2)) for i, p in enumerate(poses_of(frames))]
    with pytest.raises(InputError, match=r"contradicts the rest .* --leave-out"):
        drive_of(with_poses(frames, wrong))


def test_spans_and_areas_are_left_out(frames: list[Frame]) -> None:
    plan = TeachPlan(circle(0.3), leave_out_s=((2.0, 4.0),))
    drive = drive_of(frames, plan=plan)
    assert drive.left_out == {"left out as told": [(2.0, 4.0)]}
    whole = drive_of(frames)
    assert drive.driven_m2 < whole.driven_m2 - 0.6
    square = Polygon(AreaRole.BOUNDARY, (np.array([[2.0, -1], [4, -1], [4, 1], [2, 1]]),))
    ground = ground_of(whole, doubt_of(whole), None, (WorkArea((square,)),))
    assert ground.driven.sum() * 0.0025 == pytest.approx(whole.driven_m2 - 1.2, abs=0.1)
    bed = Polygon(
        AreaRole.BOUNDARY, (np.array([[3.0, -3], [7, -3], [7, -1.5], [3, -1.5]]),)
    )  # where a box stands
    silent, _, truth = labels_of(frames, whole, unwanted=(WorkArea((bed,)),))
    loud, _, _ = labels_of(frames, whole)
    assert 0 < (silent == OTHER.id).sum() < (loud == OTHER.id).sum()
    assert (truth[(silent == VOID_ID) & (loud != VOID_ID)] == OTHER.id).mean() > 0.7
    lawn = WorkArea((square,))
    ground = ground_of(whole, doubt_of(whole), lawn, ())
    assert ground.driven.sum() * 0.0025 == pytest.approx(1.2, abs=0.1)


@pytest.mark.parametrize("at_m", [(500_000.0, 5_600_000.0), (-3_000.0, 2_500.0)])
def test_poses_that_begin_far_away_are_left_out_like_any_jump(
    frames: list[Frame], at_m: tuple[float, float]
) -> None:
    """Before a fix of the position a robot is at the origin, then where it is: no map holds both."""
    poses = [moved(p, *at_m) if i >= 4 else p for i, p in enumerate(poses_of(frames))]
    drive = drive_of(with_poses(frames, poses))
    assert list(drive.left_out) == ["the pose jumped"]
    assert len(drive.used) >= len(frames) - 6
    assert drive.spec.width * drive.spec.height < 1_000_000
    assert drive.driven_m2 == pytest.approx(0.6 * 21 * 0.25 + np.pi * 0.3**2, rel=0.1)


def test_without_poses_nothing_is_taught(frames: list[Frame]) -> None:
    with pytest.raises(InputError, match="poses in one frame, got none in 26"):
        drive_of([replace(f, T_map_camera=None) for f in frames])


def test_near_and_far_cells_teach_alike(frames: list[Frame], drive: Drive) -> None:
    ground = ground_of(drive, doubt_of(drive), None, ())
    number, _, heights, found = next(iter(driven_again(frames, drive, Says(), CONFIG, lambda: None)))
    labels = label_frame(heights, found, ground, PLAN.labels)
    even = evened(labels, heights.cells, 2.0, number)
    kept = even.sure == GRASS.id
    assert (labels.sure[kept] == GRASS.id).all()
    assert (even.sure[labels.sure != GRASS.id] == labels.sure[labels.sure != GRASS.id]).all()
    near, far = heights.depth_m < 1.5, heights.depth_m > 3.0
    before, after = (
        [np.count_nonzero(mask & part) for part in (near, far)] for mask in (labels.sure == GRASS.id, kept)
    )
    assert after[1] > 0.7 * before[1] > 100  # far cells hold few pixels, and lose few
    assert after[0] < 0.2 * before[0]
    in_cell = np.bincount(heights.cells[kept & near])
    assert in_cell[in_cell > 0].mean() < 2.5
    np.testing.assert_array_equal(evened(labels, heights.cells, 2.0, number).sure, even.sure)


def test_a_large_image_teaches_as_many_pixels_of_a_cell_as_a_small_one(
    frames: list[Frame], drive: Drive, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a frame of 1280 x 720 three quarters of the thinned pixels were dropped again."""
    ground = ground_of(drive, doubt_of(drive), None, ())
    _, _, heights, found = next(iter(driven_again(frames, drive, Says(), CONFIG, lambda: None)))
    labels = label_frame(heights, found, ground, PLAN.labels)
    monkeypatch.setattr("swardmap.teach.write.MOST_EDGE", 120)
    small, cells = shrunk(labels, heights.cells)
    assert small.sure.shape == cells.shape == (90, 120)
    np.testing.assert_array_equal(cells, heights.cells[::2, ::2])
    even = evened(small, cells, 2.0, 0)
    in_cell = np.bincount(cells[even.sure == GRASS.id])
    thinned = np.bincount(cells[small.sure == GRASS.id]) >= 8
    assert in_cell[thinned[: len(in_cell)].nonzero()].mean() == pytest.approx(2.0, abs=0.4)
    free = (small.open_ground > 0) & (small.open_ground <= 253)
    counts = np.bincount(cells[free])
    assert (small.open_ground[free] == np.minimum(counts[cells[free]], 253)).all()


def test_void_is_what_nobody_knows(frames: list[Frame], drive: Drive) -> None:
    sure, said, _ = labels_of(frames, drive)
    assert set(np.unique(sure)) <= {0, 1, 2, VOID_ID}
    assert ((sure != VOID_ID) & (said != VOID_ID)).sum() == 0
