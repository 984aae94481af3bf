import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError, OutputError
from swardmap.io.bags.lzf import lzf_decompress
from swardmap.io.clouds.cloud_files import label_points, read_cloud, read_points, write_cloud
from swardmap.io.clouds.pcd import decode_pcd
from swardmap.io.clouds.ply import decode_ply
from swardmap.labels import GRASS_OBSTACLE, GRASS_OBSTACLE_PERSON, LabelClass, LabelSet, Role
from swardmap.types import LabeledCloud

IDS = [c.id for c in GRASS_OBSTACLE_PERSON.classes]
finite = st.floats(width=32, allow_nan=False, allow_infinity=False)


@st.composite
def clouds(draw: st.DrawFn) -> LabeledCloud:
    count = draw(st.integers(0, 20))
    xyz = draw(arrays(np.float32, (count, 3), elements=finite))
    labels = draw(arrays(np.uint8, count, elements=st.sampled_from(IDS)))
    frame = draw(st.text(min_size=1, max_size=5))
    return LabeledCloud(xyz, labels, frame, GRASS_OBSTACLE_PERSON, draw(st.integers(0, 2**62)))


def header(fields: str, sizes: str, types: str, count: object, data: str, counts: str | None = None) -> bytes:
    counts = counts or " ".join("1" for _ in fields.split())
    return (
        f"VERSION .7\nFIELDS {fields}\nSIZE {sizes}\nTYPE {types}\nCOUNT {counts}\nWIDTH {count}\nHEIGHT 1\n"
        f"VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {count}\nDATA {data}\n"
    ).encode()


def written(folder: Path, content: bytes, name: str = "cloud.pcd") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def lzf_compress(data: bytes) -> bytes:
    """A plain encoder: longest match by search, else a literal."""
    out, at = bytearray(), 0
    while at < len(data):
        start, length = -1, 0
        for candidate in range(max(0, at - 8192), at):
            n = 0
            while n < 264 and at + n < len(data) and data[candidate + n] == data[at + n]:
                n += 1
            if n > length:
                start, length = candidate, n
        if length >= 3:
            distance, code = at - start - 1, length - 2
            if code < 7:
                out += bytes([code << 5 | distance >> 8, distance & 255])
            else:
                out += bytes([7 << 5 | distance >> 8, code - 7, distance & 255])
            at += length
        else:
            out += bytes([0, data[at]])
            at += 1
    return bytes(out)


@settings(max_examples=40)
@given(cloud=clouds(), suffix=st.sampled_from([".pcd", ".ply"]), text=st.booleans())
def test_a_cloud_reads_back_with_nothing_lost(
    tmp_path_factory: pytest.TempPathFactory, cloud: LabeledCloud, suffix: str, text: bool
) -> None:
    path = tmp_path_factory.mktemp("cloud") / f"cloud{suffix}"
    write_cloud(cloud, path, ascii_text=text)
    back = read_cloud(path)
    assert np.array_equal(back.xyz, cloud.xyz)
    assert np.array_equal(back.labels, cloud.labels)
    assert (back.frame_id, back.stamp_ns, back.label_set) == (cloud.frame_id, cloud.stamp_ns, cloud.label_set)


@settings(max_examples=15)
@given(cloud=clouds())
def test_semantickitti_files_read_back(tmp_path_factory: pytest.TempPathFactory, cloud: LabeledCloud) -> None:
    path = tmp_path_factory.mktemp("cloud") / "000000.bin"
    write_cloud(cloud, path)
    back = read_cloud(path, GRASS_OBSTACLE_PERSON)
    assert np.array_equal(back.xyz, cloud.xyz)
    assert np.array_equal(back.labels, cloud.labels)


def test_semantickitti_layout(tmp_path: Path) -> None:
    (tmp_path / "velodyne").mkdir()
    (tmp_path / "labels").mkdir()
    points = np.array([[1, 2, 3, 0.5], [4, 5, 6, 0.1]], "<f4")
    (tmp_path / "velodyne" / "000007.bin").write_bytes(points.tobytes())
    labels = np.array([72 | 9 << 16, 30 | 1 << 16], "<u4")  # terrain and person, with instance numbers
    (tmp_path / "labels" / "000007.label").write_bytes(labels.tobytes())
    path = tmp_path / "velodyne" / "000007.bin"
    cloud = read_cloud(path, GRASS_OBSTACLE_PERSON, {72: "grass", 30: "person"}, frame_id="velodyne")
    assert cloud.labels.tolist() == [GRASS_OBSTACLE_PERSON["grass"].id, GRASS_OBSTACLE_PERSON["person"].id]
    assert cloud.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    (tmp_path / "labels" / "000007.label").write_bytes(labels.tobytes()[:-1])
    with pytest.raises(InputError, match="expected 8 bytes"):
        read_points(path)
    path.write_bytes(points.tobytes()[:-1])
    with pytest.raises(InputError, match="truncated"):
        read_points(path)


def test_the_written_pcd_is_what_pcl_calls_xyzl(tmp_path: Path) -> None:
    cloud = LabeledCloud(
        np.array([[1.5, -2.25, 0.125]], np.float32), np.array([2], np.uint8), "map", GRASS_OBSTACLE_PERSON
    )
    write_cloud(cloud, tmp_path / "c.pcd")
    lines = (tmp_path / "c.pcd").read_bytes().split(b"\n", 12)
    assert lines[0] == b"# .PCD v0.7 - Point Cloud Data file format"
    assert lines[2:12] == [
        b"VERSION 0.7",
        b"FIELDS x y z label",
        b"SIZE 4 4 4 4",
        b"TYPE F F F U",
        b"COUNT 1 1 1 1",
        b"WIDTH 1",
        b"HEIGHT 1",
        b"VIEWPOINT 0 0 0 1 0 0 0",
        b"POINTS 1",
        b"DATA binary",
    ]
    assert lines[12] == struct.pack("<fffI", 1.5, -2.25, 0.125, 2)


def test_any_order_padding_and_several_values_a_field(tmp_path: Path) -> None:
    head = header("label _ z histogram x y _", "1 1 8 4 4 4 1", "U U F F F F U", 2, "binary", "1 3 1 5 1 1 2")
    row = struct.Struct("<B3xd5fff2x")
    body = row.pack(1, 3.0, *[9.0] * 5, 1.0, 2.0) + row.pack(2, 6.0, *[9.0] * 5, 4.0, 5.0)
    cloud = read_cloud(written(tmp_path, head + body), GRASS_OBSTACLE_PERSON)
    assert cloud.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.labels.tolist() == [1, 2]
    array, _ = decode_pcd(head + body, "x")
    assert array.dtype.names == ("label", "z", "histogram", "x", "y")
    assert array["histogram"].shape == (2, 5)


@pytest.mark.parametrize("kind", ["u1", "u2", "u4", "u8", "i1", "i2", "i4", "i8", "f4", "f8"])
@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_every_encoding_and_label_type(tmp_path: Path, kind: str, data: str) -> None:
    points = np.zeros(50, [("x", "<f4"), ("label", f"<{kind}"), ("y", "<f8"), ("z", "<f4")])
    points["x"], points["y"], points["z"] = np.arange(50) / 4, 7.0, -np.arange(50)
    points["label"] = np.arange(50) % 3
    head = header("x label y z", f"4 {kind[1]} 8 4", f"F {kind[0].upper()} F F", 50, data)
    if data == "ascii":
        body = "\n".join(" ".join(str(v) for v in p) for p in points.tolist()).encode()
    elif data == "binary":
        body = points.tobytes()
    else:
        raw = b"".join(points[name].tobytes() for name in ("x", "label", "y", "z"))
        packed = lzf_compress(raw)
        body = struct.pack("<II", len(packed), len(raw)) + packed
    cloud = read_cloud(written(tmp_path, head + body), GRASS_OBSTACLE_PERSON)
    assert np.array_equal(cloud.xyz, np.stack([points["x"], points["y"], points["z"]], axis=1))
    assert np.array_equal(cloud.labels, points["label"])


def test_points_without_a_reading_are_left_out_or_kept(tmp_path: Path) -> None:
    head = header("x y z label", "4 4 4 4", "F F F U", 4, "ascii")
    path = written(tmp_path, head + b"nan nan nan 1\n1 2 3 1\n-inf 2 3 2\n4 5 6 2\n")
    points = read_points(path)
    assert points.valid.tolist() == [False, True, False, True]
    assert len(points.xyz) == 4
    cloud = label_points(points, GRASS_OBSTACLE_PERSON)
    assert cloud.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.labels.tolist() == [1, 2]


def test_a_cloud_without_labels_needs_a_word_about_them(tmp_path: Path) -> None:
    path = written(tmp_path, header("x y z", "4 4 4", "F F F", 1, "ascii") + b"1 2 3\n")
    with pytest.raises(InputError, match="has no labels"):
        read_cloud(path, GRASS_OBSTACLE)
    assert read_cloud(path, GRASS_OBSTACLE, unlabeled="grass").labels.tolist() == [1]
    with pytest.raises(InputError, match="pass a label set"):
        read_cloud(path)
    with pytest.raises(InvalidValueError, match="no class 'lawn'"):
        read_cloud(path, GRASS_OBSTACLE, unlabeled="lawn")


@pytest.mark.parametrize("label", [3, 254, 300, 2**32 - 1])
def test_ids_that_mean_nothing_are_refused(tmp_path: Path, label: int) -> None:
    head = header("x y z label", "4 4 4 4", "F F F U", 1, "binary")
    path = written(tmp_path, head + struct.pack("<fffI", 1, 2, 3, label))
    with pytest.raises(InputError, match="nobody says what the label ids"):
        read_cloud(path, GRASS_OBSTACLE_PERSON)
    if label < 1000:
        assert read_cloud(path, GRASS_OBSTACLE_PERSON, {label: "person"}).labels.tolist() == [2]


@pytest.mark.parametrize("value", ["0.5", "nan", "inf", "-1", "1e30"])
def test_labels_that_are_no_whole_numbers_are_refused(tmp_path: Path, value: str) -> None:
    path = written(
        tmp_path, header("x y z label", "4 4 4 4", "F F F F", 1, "ascii") + f"1 2 3 {value}\n".encode()
    )
    with pytest.raises(InputError, match="label ids -1"):
        read_cloud(path, GRASS_OBSTACLE_PERSON)


def test_classes_written_in_the_file_are_translated_by_name(tmp_path: Path) -> None:
    own = LabelSet(
        (LabelClass(7, "lawn", Role.FREE, (0, 0, 0)), LabelClass(0, "person", Role.PERSON, (1, 1, 1)))
    )
    cloud = LabeledCloud(np.zeros((2, 3), np.float32), np.array([7, 0], np.uint8), "map", own)
    write_cloud(cloud, tmp_path / "c.pcd")
    assert read_cloud(tmp_path / "c.pcd").label_set == own
    assert read_cloud(tmp_path / "c.pcd", GRASS_OBSTACLE_PERSON).labels.tolist() == [1, 2]
    assert read_cloud(tmp_path / "c.pcd", GRASS_OBSTACLE).labels.tolist() == [1, 0]  # a person is an obstacle


def test_coordinates_that_float32_would_blur_are_refused(tmp_path: Path) -> None:
    head = header("x y z label", "8 8 8 4", "F F F U", 1, "binary")
    path = written(tmp_path, head + struct.pack("<dddI", 448262.4, 5411932.5, 3, 1))
    with pytest.raises(InputError, match="subtract an offset"):
        read_points(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PCD file"),
        (b"\x89PNG\r\n", "not a PCD file"),
        (header("x y z", "4 4 4", "F F F", 10**12, "binary"), "truncated"),
        (header("x y z", "4 4 4", "F F F", 10**12, "ascii") + b"1 2 3\n", "truncated"),
        (header("x y z", "4 4 4", "F F F", -1, "binary"), "whole numbers from 0"),
        (header("x y z", "4 4 4", "F F F", "many", "binary"), "whole numbers from 0"),
        (header("x y z", "4 4 4", "F F F", 10**30, "binary"), "whole numbers from 0"),
        (header("x y z", "4 4 4", "F F F", "²", "binary"), "whole numbers from 0"),
        (header("x y z", "4 4", "F F F", 0, "binary"), "of one length"),
        (header("x y z", "4 4 3", "F F F", 0, "binary"), "no such number"),
        (header("x y z", "4 4 4", "F F Q", 0, "binary"), "no such number"),
        (header("x y z", "4 4 4", "F F F", 0, "binary", "1 1 0"), "no such number"),
        (header("x y z", "4 4 4", "F F F", 0, "binary", "1 1 99999999"), "more than"),
        (header("x y z", "4 4 4", "F F F", 0, "zip"), "expected DATA"),
        (header("a b c", "4 4 4", "F F F", 0, "binary"), "x, y and z"),
        (header("x y z", "4 4 4", "F F F", 0, "binary", "1 1 2"), "x, y and z"),
        (header("x y z", "4 4 4", "F F F", 1, "ascii") + b"1 2\n    ", "rows of 3 numbers"),
        (header("x y z", "4 4 4", "F F F", 1, "ascii") + b"1 2 three", "rows of 3 numbers"),
        (header("x y z", "4 4 4", "F F F", 1, "ascii") + b"1 2 3 4", "rows of 3 numbers"),
        (header("x y z", "4 4 4", "F F F", 2, "ascii") + b"1 2 3         \n", "rows of 3 numbers"),
        (header("x y z", "4 4 4", "F F U", 1, "ascii") + b"1 2 nan", "whole numbers 0"),
        (header("x y z", "4 4 4", "F F F", 1, "ascii") + b"1 2 \xef\xbc\x93", "rows of 3 numbers"),
        (header("x y z", "4 4 4", "F F F", 1, "binary_compressed") + b"\0\0", "sizes"),
        (header("x y z", "4 4 4", "F F F", 1, "binary_compressed") + struct.pack("<II", 3, 13), "not 13"),
        (header("x y z", "4 4 4", "F F F", 1, "binary_compressed") + struct.pack("<II", 30, 12), "truncated"),
        (
            header("x y z", "4 4 4", "F F F", 10**8, "binary_compressed")
            + struct.pack("<II", 3, 12 * 10**8)
            + b"abc",
            "cannot hold",
        ),
        (
            header("x y z", "4 4 4", "F F F", 1, "binary_compressed")
            + struct.pack("<II", 2, 12)
            + b"\x20\x05",
            "damaged LZF",
        ),
        (b"FIELDS x\nSIZE 4\nTYPE F\nWIDTH 2\nHEIGHT 3\nPOINTS 5\nDATA ascii\n", "2 x 3"),
    ],
)
def test_a_hostile_pcd_is_one_clear_error(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_points(written(tmp_path, content))


PLY_HEAD = b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "not a PLY file"),
        (b"plyx\nend_header\n", "not a PLY file"),
        (b"ply\nformat ascii 2 3 4\nend_header\n", "damaged PLY header"),
        (b"ply\nend_header\n", "expected format"),
        (b"ply\nformat ascii 1.0\nend_header\n", "element 'vertex'"),
        (b"ply\nformat ascii 1.0\nelement vertex -1\nend_header\n", "damaged PLY header"),
        (b"ply\nformat ascii 1.0\nproperty float x\nend_header\n", "damaged PLY header"),
        (PLY_HEAD + b"property float x\nend_header\n1 2 3 4\n", "named twice"),
        (PLY_HEAD + b"property quad w\nend_header\n1 2 3 4\n", "no number"),
        (PLY_HEAD + b"property list uchar int i\nend_header\n1 2 3 0\n", "lists"),
        (PLY_HEAD + b"end_header\n1 2\n     ", "rows of 3"),
        (PLY_HEAD + b"end_header\n", "truncated"),
        (PLY_HEAD.replace(b"vertex 1", b"vertex 999999999999") + b"end_header\n1 2 3\n", "truncated"),
        (PLY_HEAD.replace(b"ascii", b"binary_big_endian") + b"end_header\n" + bytes(11), "truncated"),
    ],
)
def test_a_hostile_ply_is_one_clear_error(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_points(written(tmp_path, content, "cloud.ply"))


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_ply_of_another_program(tmp_path: Path, order: str) -> None:
    head = (
        f"ply\r\nformat binary_{'little' if order == '<' else 'big'}_endian 1.0\r\ncomment by another\r\n"
        "obj_info x\r\nelement camera 2\r\nproperty short a\r\nelement vertex 2\r\nproperty double x\r\n"
        "property double y\r\nproperty double z\r\nproperty uchar red\r\nproperty int scalar_Label\r\n"
        "element face 1\r\nproperty list uchar int vertex_indices\r\nend_header\r\n"
    ).encode()
    row = struct.Struct(f"{order}dddBi")
    body = bytes(4) + row.pack(1, 2, 3, 200, 1) + row.pack(4, 5, 6, 100, 0) + b"\x00"
    cloud = read_cloud(written(tmp_path, head + body, "c.ply"), GRASS_OBSTACLE)
    assert cloud.xyz.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert cloud.labels.tolist() == [1, 0]


@given(data=st.binary(max_size=300))
def test_lzf_gives_back_what_was_compressed(data: bytes) -> None:
    data = data + data[:50] + bytes(300)  # something to refer back to, and a long overlapping run
    assert lzf_decompress(lzf_compress(data), len(data)) == data


def test_lzf_by_hand() -> None:
    assert lzf_decompress(b"\x02abc", 3) == b"abc"
    assert lzf_decompress(b"\x02abc\x20\x02", 6) == b"abcabc"  # 3 bytes from 3 back
    assert lzf_decompress(b"\x00a\xe0\x01\x00", 11) == b"a" * 11  # 7 + 1 + 2 bytes from 1 back
    for broken in (b"\x02ab", b"\x20\x00", b"\x00a\xe0", b"\x00a\x20", b"\x00a\x20\x05"):
        with pytest.raises(InputError, match="damaged LZF"):
            lzf_decompress(broken, 4)


Decoder = Callable[[bytes, str], tuple[NDArray[np.void], str]]


@given(
    junk=st.binary(max_size=120),
    start=st.sampled_from(
        [b"", header("x y z label", "4 4 4 1", "F F F U", 3, "binary_compressed"), PLY_HEAD + b"end_header\n"]
    ),
    decoder=st.sampled_from([decode_pcd, decode_ply]),
)
def test_random_bytes_are_points_or_a_clear_error(junk: bytes, start: bytes, decoder: Decoder) -> None:
    try:
        points, _ = decoder(start + junk, "x")
    except InputError:
        return
    assert points.ndim == 1


WORDS = ["x", "y", "z", "label", "_", "4", "8", "1", "F", "U", "-1", "0", "999999999", "ascii", "binary"]


@given(words=st.lists(st.sampled_from(WORDS), max_size=20))
def test_random_headers_are_points_or_a_clear_error(words: list[str]) -> None:
    keys = ("FIELDS", "SIZE", "TYPE", "COUNT", "WIDTH", "POINTS", "DATA")
    lines = [f"{key} {' '.join(words[i::7])}" for i, key in enumerate(keys)]
    try:
        points, _ = decode_pcd("\n".join([*lines, ""]).encode() + bytes(64), "x")
    except InputError:
        return
    assert points.ndim == 1


def test_a_truncated_cloud_is_never_read(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cloud = LabeledCloud(
        rng.normal(size=(5, 3)).astype(np.float32), np.ones(5, np.uint8), "map", GRASS_OBSTACLE_PERSON
    )
    for suffix in (".pcd", ".ply"):
        write_cloud(cloud, tmp_path / f"c{suffix}")
        whole = (tmp_path / f"c{suffix}").read_bytes()
        for length in range(len(whole)):
            with pytest.raises(InputError):
                read_points(written(tmp_path, whole[:length], f"cut{suffix}"))


def test_unknown_suffixes_are_one_clear_error(tmp_path: Path) -> None:
    cloud = LabeledCloud(np.zeros((0, 3), np.float32), np.zeros(0, np.uint8), "map", GRASS_OBSTACLE)
    with pytest.raises(OutputError, match=r"\.pcd, \.ply or \.bin"):
        write_cloud(cloud, tmp_path / "c.las")
    with pytest.raises(OutputError, match=r"\.pcd, \.ply or \.bin"):
        write_cloud(cloud, tmp_path / "c.bin", ascii_text=True)
    with pytest.raises(InputError, match=r"\.pcd, \.ply or \.bin"):
        read_points(written(tmp_path, b"", "c.las"))
    with pytest.raises(InputError, match="No such file"):
        read_points(tmp_path / "none.pcd")


def test_other_programs_read_the_same_points(tmp_path: Path) -> None:
    pypcd4 = pytest.importorskip("pypcd4")
    rng = np.random.default_rng(0)
    xyz, labels = rng.normal(size=(100, 3)).astype(np.float32), rng.choice(IDS, 100).astype(np.uint8)
    for text in (False, True):
        write_cloud(LabeledCloud(xyz, labels, "map", GRASS_OBSTACLE_PERSON), tmp_path / "c.pcd", text)
        theirs = pypcd4.PointCloud.from_path(tmp_path / "c.pcd").numpy(("x", "y", "z", "label"))
        assert np.array_equal(theirs[:, :3].astype(np.float32), xyz)
        assert np.array_equal(theirs[:, 3], labels)


def test_no_readings_as_windows_prints_them(tmp_path: Path) -> None:
    file = tmp_path / "c.pcd"
    file.write_text(
        "VERSION .7\nFIELDS x y z label\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH 3\nHEIGHT 1\n"
        "POINTS 3\nDATA ascii\n1 2 3 1\n-1.#IND -1.#IND 1.#QNAN 0\n1.#INF 0 0 0\n"
    )
    cloud = read_cloud(file, GRASS_OBSTACLE_PERSON)
    assert cloud.xyz.tolist() == [[1, 2, 3]]
