"""Text files of a million rows: read in bounded memory, or refused at once with the number and the limit."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from swardmap.errors import InputError
from swardmap.io.sources.tum import MAX_IMAGES
from swardmap.io.text_lines import MAX_LINES, numbered_lines

CHILD = """
import re, resource, sys, time
from pathlib import Path
from swardmap.errors import SwardmapError
from swardmap.config import SourceConfig, AreaConfig
import swardmap.io.sources.folder, swardmap.io.sources.tum, swardmap.io.sources.trajectory
import swardmap.io.maps.area_files, swardmap.io.annotations.annotation_files, scipy.spatial.transform
import swardmap.rig.rig, swardmap.config, yaml, shapely, xml.etree.ElementTree, xml.sax, swardmap.io
import swardmap.io.clouds.cloud_files
now = 1024 * int(re.search(r"VmData:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])
resource.setrlimit(resource.RLIMIT_DATA, (now + int(sys.argv[2]) * 2**20,) * 2)
path = Path(sys.argv[1])
began = time.process_time()
try:
    {read}
    said = "read"
except SwardmapError as error:
    said = str(error)
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(said)
print(f"{{time.process_time() - began:.1f}} s, {{peak / 1024:.0f}} MB at most", file=sys.stderr)
"""
CAMERA = "{width: 8, height: 6, fx: 7, fy: 7, cx: 4, cy: 3}"
POSE = "1 2 0 0 0 0 1"


def in_child(read: str, path: Path, megabytes: int) -> str:
    """What a child says that may take so much more memory than it has after its imports."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD.format(read=read), str(path), str(megabytes)],
        capture_output=True, text=True, timeout=300, check=False,
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    print(f"{path.name}: {done.stderr.strip()}: {done.stdout.strip()[:200]}")  # noqa: T201 - for docs/safety.md
    return done.stdout.strip()


def rows(line: Callable[[int], str], count: int, head: str = "", tail: str = "") -> str:
    return head + "".join(map(line, range(count))) + tail


def folder_of(tmp_path: Path, poses: str) -> Path:
    for part in ("rgb", "depth"):
        (tmp_path / part).mkdir(exist_ok=True)
    (tmp_path / "camera.yaml").write_text(CAMERA)
    (tmp_path / "poses.txt").write_text(poses)
    return tmp_path


FOLDER = "swardmap.io.sources.folder.open_source(path, SourceConfig())"
TUM = "swardmap.io.sources.tum.open_source(path, SourceConfig())"
TRAJECTORY = "swardmap.io.sources.trajectory.read_trajectory(path)"
LINES = f"expected at most {MAX_LINES} lines, got {MAX_LINES + 1}"


def test_poses_of_a_folder_beyond_the_limit_are_refused_at_once(tmp_path: Path) -> None:
    path = folder_of(tmp_path, rows(lambda i: f"f{i} {i} {POSE}\n", MAX_LINES + 1))
    assert LINES in in_child(FOLDER, path, 128)


def test_trajectories_and_lists_beyond_the_limit_are_refused_at_once(tmp_path: Path) -> None:
    file = tmp_path / "poses.txt"
    file.write_text(rows(lambda i: f"{i}.5 {POSE}\n", MAX_LINES + 1))
    assert LINES in in_child(TRAJECTORY, file, 128)
    for name in ("rgb.txt", "depth.txt"):
        (tmp_path / name).write_text(rows(lambda i: f"{i}.5 rgb/{i}.png\n", MAX_LINES))
    assert "expected at most 200000 lines, got 1000000" in in_child(TUM, tmp_path, 128)


AREA = "swardmap.io.maps.area_files.read_area(AreaConfig(file=str(path), datum_lat=52, datum_lon=17))"
CONFIG = "swardmap.config.load_config(path)"
RIG = "swardmap.rig.rig.read_rig(path)"
KML = (
    "<kml><Placemark><Polygon><outerBoundaryIs><LinearRing><coordinates>",
    "</coordinates></LinearRing></outerBoundaryIs></Polygon></Placemark></kml>",
)
GEOJSON = '{"type": "Polygon", "coordinates": [[', "[1,52]]]}"
YAML_BYTES = "expected YAML of at most 1048576 bytes"


@pytest.mark.parametrize(
    ("name", "read", "head", "line", "tail", "expected"),
    [
        ("a.yaml", AREA, "polygon_m:\n", "- [%d, 1]\n", "", YAML_BYTES),
        ("b.geojson", AREA, GEOJSON[0], "[1.%06d,52],", GEOJSON[1], "at most 10000 corners"),
        ("c.kml", AREA, KML[0], "1.%06d,52 ", KML[1], "at most 10000 corners"),
        ("d.yaml", CONFIG, "grid:\n", "  a%d: 1\n", "", YAML_BYTES),
        ("e.yaml", RIG, "cameras:\n", "  a%d: 1\n", "", "expected at most 1000000 bytes"),
    ],
)
def test_polygons_and_settings_of_a_million_rows_are_refused(
    name: str, read: str, head: str, line: str, tail: str, expected: str, tmp_path: Path
) -> None:
    file = tmp_path / name
    file.write_text(rows(lambda i: line % i, 1_000_000, head, tail))
    said = in_child(read, file, 600)
    assert expected in said
    assert len(said) <= 300


@pytest.mark.parametrize(("kind", "read"), [("folder", FOLDER), ("trajectory", TRAJECTORY), ("tum", TUM)])
def test_a_tenth_of_the_rows_takes_no_more_than_a_tenth_of_a_gigabyte(
    kind: str, read: str, tmp_path: Path
) -> None:
    """So the most that is taken stays within what no reader may exceed."""
    path = tmp_path
    if kind == "folder":
        folder_of(tmp_path, rows(lambda i: f"f{i} {i} {POSE}\n", MAX_LINES // 10))
    elif kind == "trajectory":
        path = tmp_path / "poses.txt"
        path.write_text(rows(lambda i: f"{i}.5 {POSE}\n", MAX_LINES // 10))
    else:
        for name in ("rgb.txt", "depth.txt"):
            (tmp_path / name).write_text(rows(lambda i: f"{i}.5 rgb/{i}.png\n", MAX_IMAGES // 10))
    assert in_child(read, path, 102) == "read"


def test_lines_are_numbered_and_end_as_any_editor_ends_them(tmp_path: Path) -> None:
    file = tmp_path / "list.txt"
    for end in ("\n", "\r\n", "\r"):
        file.write_bytes(f"# head{end}{end}a b,c # rest{end}d\xff".encode("latin-1") + end.encode())
        assert list(numbered_lines(file)) == [(3, ["a", "b,c"]), (4, ["d\N{REPLACEMENT CHARACTER}"])]
        assert next(numbered_lines(file, commas=True)) == (3, ["a", "b", "c"])
    file.write_bytes(b"\r" * (MAX_LINES + 1))
    with pytest.raises(InputError, match=LINES):
        next(numbered_lines(file))
