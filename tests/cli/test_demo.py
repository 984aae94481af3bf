"""The drive that comes with the package: whole, small, with everybody on it."""

from swardmap.cli.demo import RECORDING
from swardmap.io import open_source
from swardmap.labels import GRASS, OTHER, PERSON
from tests.io.contract import check_source

MOST_BYTES = 6_000_000


def test_the_bundled_drive_is_a_whole_recording_with_true_labels() -> None:
    frames = check_source(lambda: open_source(RECORDING))
    assert len(frames) >= 20
    assert not open_source(RECORDING).skipped
    seen = set().union(*(set(frame.labels.ravel().tolist()) for frame in frames if frame.labels is not None))
    assert seen == {OTHER.id, GRASS.id, PERSON.id}
    for frame in frames:
        assert frame.T_map_camera is not None
        assert frame.labels is not None
        assert (frame.depth > 0).mean() > 0.3
        assert 40 < frame.rgb.mean() < 190  # neither dark nor washed out


def test_the_bundled_drive_is_small() -> None:
    assert sum(f.stat().st_size for f in RECORDING.rglob("*") if f.is_file()) < MOST_BYTES
