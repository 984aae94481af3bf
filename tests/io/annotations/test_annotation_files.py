import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from swardmap.errors import InputError, InvalidValueError, SwardmapError
from swardmap.io.annotations.annotation_files import (
    read_annotated_cloud,
    read_camvid,
    read_coco,
    read_cvat_masks,
    read_cvat_xml,
    read_masks,
)
from swardmap.io.annotations.coco import decode_rle
from swardmap.io.annotations.mask_folder import write_masks
from swardmap.io.annotations.masks import Masks, fill_polygon, runs_to_flat
from swardmap.labels import GRASS_OBSTACLE_PERSON, VOID_ID

GRASS, OTHER, PERSON = (GRASS_OBSTACLE_PERSON[n].id for n in ("grass", "other", "person"))
CLASSES = {"lawn": "grass", "tree": "other", "man": "person"}


def png(array: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".png", array)[1].tobytes()


def rgb(colors: list[list[tuple[int, int, int]]]) -> NDArray[np.uint8]:
    return np.array(colors, np.uint8)[..., ::-1]  # OpenCV writes BGR


def cvat_folder(folder: Path, labelmap: str, image: NDArray[np.uint8], name: str = "a") -> Path:
    target = folder / "SegmentationClass" / f"{name}.png"
    target.parent.mkdir(parents=True)
    (folder / "labelmap.txt").write_text(labelmap)
    target.write_bytes(png(image))
    return folder


LABELMAP = (
    "# label:color_rgb:parts:actions\nlawn:10,200,30::\nbackground:0,0,0::\ntree:1,2,3::\nman:250,0,0::\n"
)


def test_cvat_masks_by_colour(tmp_path: Path) -> None:
    image = rgb([[(0, 0, 0), (10, 200, 30)], [(1, 2, 3), (250, 0, 0)]])
    masks = read_cvat_masks(cvat_folder(tmp_path, LABELMAP, image, "sub/a"), classes=CLASSES)
    assert list(masks) == ["sub/a"]
    assert masks["sub/a"].tolist() == [[VOID_ID, GRASS], [OTHER, PERSON]]


def test_cvat_masks_by_index_count_the_background_first(tmp_path: Path) -> None:
    image = np.array([[0, 1, 2, 3]], np.uint8)  # background, then the other lines in their order
    masks = read_cvat_masks(cvat_folder(tmp_path, LABELMAP, image), classes=CLASSES)
    assert masks["a"].tolist() == [[VOID_ID, GRASS, OTHER, PERSON]]
    (tmp_path / "SegmentationClass" / "a.png").write_bytes(png(np.array([[4]], np.uint8)))
    with pytest.raises(InputError, match="index 4 is beyond"):
        masks["a"]


def test_background_means_what_the_caller_says(tmp_path: Path) -> None:
    image = rgb([[(0, 0, 0), (10, 200, 30)]])
    folder = cvat_folder(tmp_path, LABELMAP, image)
    masks = read_masks(folder, classes={**CLASSES, "background": "other"})
    assert masks["a"].tolist() == [[OTHER, GRASS]]


def test_a_colour_of_no_class_is_refused(tmp_path: Path) -> None:
    image = rgb([[(0, 0, 0), (10, 200, 31)]])  # as after saving as JPEG
    masks = read_cvat_masks(cvat_folder(tmp_path, LABELMAP, image), classes=CLASSES)
    with pytest.raises(InputError, match=r"colour \(10, 200, 31\) at \(1, 0\)"):
        masks["a"]


def test_classes_that_mean_nothing_are_refused(tmp_path: Path) -> None:
    folder = cvat_folder(tmp_path, LABELMAP, rgb([[(0, 0, 0)]]))
    with pytest.raises(InputError, match=r"'tree', 'man'.*--class 'tree=\.\.\.' --class 'man=\.\.\.'"):
        read_cvat_masks(folder, classes={"lawn": "grass"})
    with pytest.raises(InvalidValueError, match="no class 'meadow'"):
        read_cvat_masks(folder, classes={"lawn": "meadow"})
    assert len(read_cvat_masks(folder, classes={"lawn": "grass", "*": "void"})) == 1


@pytest.mark.parametrize(
    "labelmap",
    [
        "lawn:1,2::", "lawn:1,2,300::", "lawn:a,b,c::", "a:0,0,0::\na:1,1,1::", ":1,2,3::", "lawn:-1,2,3::",
        f"lawn:{'9' * 5000},1,1::",
    ],
)  # fmt: skip
def test_a_damaged_labelmap_is_one_clear_error(tmp_path: Path, labelmap: str) -> None:
    folder = cvat_folder(tmp_path, labelmap, rgb([[(0, 0, 0)]]))
    with pytest.raises(InputError, match=r"labelmap\.txt: expected (each class|a colour of three)") as told:
        read_cvat_masks(folder, classes={"*": "void"})
    assert len(str(told.value)) < 300 + len(str(folder))


def test_a_truncated_mask_is_one_clear_error(tmp_path: Path) -> None:
    folder = cvat_folder(tmp_path, LABELMAP, np.zeros((20, 20), np.uint8))
    file = folder / "SegmentationClass" / "a.png"
    file.write_bytes(file.read_bytes()[:-20])
    with pytest.raises(InputError, match="truncated"):
        read_cvat_masks(folder, classes=CLASSES)["a"]


def camvid_folder(folder: Path, pairs: str) -> Path:
    (folder / "testannot").mkdir()
    (folder / "testannot" / "a.png").write_bytes(png(rgb([[(0, 0, 0), (9, 8, 7), (1, 1, 1)]])))
    (folder / "label_colors.txt").write_text("0 0 0 background\n9 8 7 lawn\n1 1 1 man\n")
    (folder / "test.txt").write_text(pairs)
    return folder


@pytest.mark.parametrize("pair", ["/test/a.png /testannot/a.png", '"/test/a.png" "/testannot/a.png"'])
def test_camvid(tmp_path: Path, pair: str) -> None:
    masks = read_masks(camvid_folder(tmp_path, pair + "\n"), classes=CLASSES)
    assert {name: mask.tolist() for name, mask in masks.items()} == {"test/a": [[VOID_ID, GRASS, PERSON]]}


@pytest.mark.parametrize(
    "pair", ["/test/a.png", "/test/a.png ../../etc/passwd", "a b c", "../a.png testannot/a.png"]
)
def test_camvid_pairs_that_lead_nowhere_are_refused(tmp_path: Path, pair: str) -> None:
    with pytest.raises(InputError):
        read_camvid(camvid_folder(tmp_path, pair), classes=CLASSES)


def coco(
    folder: Path, *annotations: tuple[str, Any], size: tuple[int, int] = (4, 4), name: str = "a.jpg"
) -> Path:
    names = sorted({n for n, _ in annotations} | {"unused"})
    tree = {
        "images": [{"id": 7, "file_name": name, "height": size[0], "width": size[1]}],
        "categories": [{"id": i, "name": n} for i, n in enumerate(names, 1)],
        "annotations": [
            {"image_id": 7, "category_id": names.index(n) + 1, "segmentation": s} for n, s in annotations
        ],
    }
    path = folder / "instances.json"
    path.write_text(json.dumps(tree))
    return path


CENTRE = [[0, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0]]


def test_the_run_lengths_of_coco() -> None:
    assert decode_rle([5, 2, 2, 2, 5], 4, 4, "").tolist() == CENTRE
    # a 2 x 3 image whose first column is set: column by column, not row by row
    assert decode_rle([0, 2, 4], 2, 3, "").tolist() == [[1, 0, 0], [1, 0, 0]]


def packed(runs: list[int]) -> str:
    """COCO's string, encoded as its definition says."""
    text = ""
    for i, run in enumerate(runs):
        value = run - (runs[i - 2] if i > 2 else 0)
        more = True
        while more:
            bits, value = value & 31, value >> 5
            more = value != (-1 if bits & 16 else 0)
            text += chr(48 + (bits | 32 * more))
    return text


@given(mask=arrays(bool, st.tuples(st.integers(1, 60), st.integers(1, 60))))
def test_run_lengths_as_text_and_as_numbers_agree(mask: NDArray[np.bool_]) -> None:
    flat = mask.T.ravel()
    borders = np.flatnonzero(np.diff(np.concatenate([[False], flat])))
    runs = np.diff(np.concatenate([[0], borders, [flat.size]])).tolist()
    assert np.array_equal(decode_rle(runs, mask.shape[0], mask.shape[1], ""), mask)
    assert np.array_equal(decode_rle(packed(runs), mask.shape[0], mask.shape[1], ""), mask)


def test_a_string_that_pycocotools_wrote() -> None:
    # pycocotools 2.0.11, mask.encode: ones in rows 10:300, columns 20:22 of 480 x 640; the centre of 4 x 4
    wanted = np.zeros((480, 640), bool)
    wanted[10:300, 20:22] = True
    assert np.array_equal(decode_rle("Z\\9R9n50feQ9", 480, 640, ""), wanted)
    assert decode_rle("52203", 4, 4, "").tolist() == CENTRE


def test_coco_polygons_and_run_lengths(tmp_path: Path) -> None:
    file = coco(
        tmp_path,
        ("man", {"counts": [5, 2, 2, 2, 5], "size": [4, 4]}),
        ("lawn", [[0, 0, 4, 0, 4, 3, 0, 3]]),  # after the person in the file, but under it in the mask
    )
    g, p, v = GRASS, PERSON, VOID_ID
    mask = read_masks(file, classes=CLASSES)["a"]
    assert mask.tolist() == [[g, g, g, g], [g, p, p, g], [g, p, p, g], [v, v, v, v]]


@pytest.mark.parametrize(
    "segmentation",
    [
        5,
        [[1, 2, 3]],
        [[0, 0, 1, 1]],
        [["a"] * 6],
        [[0, 0, 1e400, 0, 1, 1]],
        {"counts": [99], "size": [4, 4]},
        {"counts": [-1, 5], "size": [4, 4]},
        {"counts": [2**70], "size": [4, 4]},
        {"counts": "\x00", "size": [4, 4]},
        {"counts": "ooooooooooooooooooooooooooo", "size": [4, 4]},
        {"counts": [1.5], "size": [4, 4]},
        {"counts": [16], "size": [2, 2]},
    ],
)
def test_damaged_coco_shapes_are_one_clear_error(tmp_path: Path, segmentation: Any) -> None:
    masks = read_coco(coco(tmp_path, ("lawn", segmentation)), classes=CLASSES)
    with pytest.raises(InputError, match=r"image a\.jpg"):
        masks["a"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"categories": 1}', "[" * 5000, "\xff"])
def test_a_json_that_is_no_coco_is_one_clear_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text, encoding="latin-1")
    with pytest.raises(InputError, match=r"x\.json"):
        read_coco(tmp_path / "x.json")


def test_image_names_cannot_lead_out_and_are_unique(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="inside"):
        read_coco(coco(tmp_path, ("lawn", []), name="../../a.jpg"), classes=CLASSES)
    images = "".join(f'<image name="a.{suffix}" width="1" height="1"/>' for suffix in ("jpg", "png"))
    (tmp_path / "a.xml").write_text(f"<annotations>{images}</annotations>")
    with pytest.raises(InputError, match="'a' twice"):
        read_cvat_xml(tmp_path / "a.xml")


def cvat_xml(folder: Path, shapes: str, size: int = 4) -> Path:
    path = folder / "annotations.xml"
    path.write_text(
        '<?xml version="1.0" encoding="utf-8"?><annotations><version>1.1</version>'
        f'<image id="0" name="d/a.jpg" width="{size}" height="{size}">{shapes}</image></annotations>'
    )
    return path


def test_cvat_xml_run_lengths_go_row_by_row_in_the_box(tmp_path: Path) -> None:
    shape = '<mask label="man" rle="1, 2, 1, 2" left="1" top="2" width="3" height="2" z_order="0"/>'
    mask = read_masks(cvat_xml(tmp_path, shape), classes=CLASSES)["d/a"]
    v, p = VOID_ID, PERSON
    assert mask.tolist() == [[v] * 4, [v] * 4, [v, v, p, p], [v, v, p, p]]
    # the runs of COCO's golden example: here, too, the centre, in a box of the whole image
    shape = '<mask label="man" rle="5,2,2,2,5" left="0" top="0" width="4" height="4"/>'
    mask = read_cvat_xml(cvat_xml(tmp_path, shape), classes=CLASSES)["d/a"]
    assert (mask == PERSON).tolist() == CENTRE


def test_cvat_xml_is_painted_in_its_order(tmp_path: Path) -> None:
    shapes = (
        '<polygon label="lawn" points="0,0;4,0;4,4;0,4" z_order="2"/>'
        '<box label="tree" xtl="0" ytl="0" xbr="2" ybr="4" z_order="3"><attribute/></box>'
        '<polygon label="man" points="0,0;4,0;4,4;0,4" z_order="1"/><tag label="sunny"/>'
    )
    mask = read_cvat_xml(cvat_xml(tmp_path, shapes), classes=CLASSES)["d/a"]
    assert mask.tolist() == [[OTHER, OTHER, GRASS, GRASS]] * 4


@pytest.mark.parametrize(
    "shape",
    [
        '<mask label="man" rle="1,2" left="3" top="0" width="2" height="2"/>',
        '<mask label="man" rle="1,2" left="-1" top="0" width="2" height="2"/>',
        '<mask label="man" rle="1,9" left="0" top="0" width="2" height="2"/>',
        '<mask label="man" rle="x" left="0" top="0" width="2" height="2"/>',
        '<mask label="man" rle="1,-1" left="0" top="0" width="2" height="2"/>',
        '<mask label="man" rle="99999999999999999999999" left="0" top="0" width="2" height="2"/>',
        '<mask label="man" rle="1" left="0" top="0" width="2"/>',
        '<polygon label="man" points="0,0;1,1"/>',
        '<polygon label="man" points="0,0;1,1;2"/>',
        '<polygon label="man" points=""/>',
        '<polygon label="man" points="0,0;nan,1;2,2"/>',
        '<polygon label="man" points="0,0;1,0;1,1" z_order="up"/>',
        '<polyline label="man" points="0,0;1,0;1,1"/>',
        '<skeleton label="man"/>',
    ],
)
def test_damaged_cvat_shapes_are_one_clear_error(tmp_path: Path, shape: str) -> None:
    path = cvat_xml(tmp_path, shape)
    with pytest.raises(InputError, match=r"d/a\.jpg"):
        read_cvat_xml(path, classes=CLASSES)["d/a"]


BOMB = '<!DOCTYPE a [<!ENTITY x "ha"><!ENTITY y "&x;&x;&x;&x;">]>'


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("doctype", [BOMB, '<!DOCTYPE a SYSTEM "file:///etc/passwd">', "<!DOCTYPE a>"])
def test_a_document_type_is_refused(tmp_path: Path, doctype: str, encoding: str) -> None:
    head = f'<?xml version="1.0" encoding="{encoding}"?>'
    (tmp_path / "a.xml").write_text(f"{head}{doctype}<annotations></annotations>", encoding=encoding)
    with pytest.raises(InputError, match="document type"):
        read_cvat_xml(tmp_path / "a.xml")


@pytest.mark.parametrize(
    "text", ["", "<a>", "<a/>", "<annotations><track/></annotations>", "<annotations>&x;</annotations>"]
)
def test_other_xml_is_one_clear_error(tmp_path: Path, text: str) -> None:
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(InputError, match=r"a\.xml"):
        read_cvat_xml(tmp_path / "a.xml")


def test_huge_images_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pixels"):
        read_cvat_xml(cvat_xml(tmp_path, "", size=10**9))["d/a"]
    with pytest.raises(InputError, match="pixels"):
        read_coco(coco(tmp_path, ("lawn", []), size=(0, 5)), classes=CLASSES)["a"]


@given(corners=arrays(np.float64, st.tuples(st.integers(3, 7), st.just(2)), elements=st.integers(-4, 24)))
def test_polygons_hold_the_pixels_whose_centres_they_hold(corners: NDArray[np.float64]) -> None:
    corners = cv2.convexHull((corners * 0.9 + 0.13).astype(np.float32))[:, 0].astype(np.float64)
    if len(corners) < 3:
        return
    mask = np.zeros((20, 20), np.uint8)
    fill_polygon(mask, corners, 1)
    for row in range(20):
        for column in range(20):
            distance = cv2.pointPolygonTest(
                corners.astype(np.float32)[:, None], (column + 0.5, row + 0.5), measureDist=True
            )
            if abs(distance) > 1e-4:
                assert mask[row, column] == (distance > 0)


def test_a_polygon_with_a_crossing_follows_the_even_odd_rule() -> None:
    mask = np.zeros((4, 6), np.uint8)
    fill_polygon(mask, np.array([(0, 0), (6, 0), (6, 4), (2, 4), (2, 1), (4, 1), (4, 4), (0, 4)], float), 1)
    assert mask.tolist() == [[1] * 6, *[[1, 1, 0, 0, 1, 1]] * 3]


def test_what_is_left_of_the_run_lengths_is_background() -> None:
    assert runs_to_flat([0, 3], 5, "").tolist() == [True, True, True, False, False]
    assert not runs_to_flat([], 5, "").any()


def annotated_cloud(folder: Path, labels: list[int], names: str) -> tuple[Path, Path]:
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z rgba label\nSIZE 4 4 4 4 4\n"
        f"TYPE F F F U U\nCOUNT 1 1 1 1 1\nWIDTH {len(labels)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(labels)}\nDATA binary\n"
    ).encode()
    cloud = folder / "cloud.pcd"
    cloud.write_bytes(
        head + b"".join(struct.pack("<fffII", i, 0, 0, 0, label) for i, label in enumerate(labels))
    )
    (folder / "names.txt").write_text(names)
    return cloud, folder / "names.txt"


def test_rviz_cloud_annotation(tmp_path: Path) -> None:
    files = annotated_cloud(tmp_path, [0, 1, 2, 1], "1: lawn\n2: man\n3: never used\n")
    cloud = read_annotated_cloud(*files, classes=CLASSES, frame_id="map")
    assert cloud.labels.tolist() == [VOID_ID, GRASS, PERSON, GRASS]
    assert cloud.frame_id == "map"


@pytest.mark.parametrize("names", ["1: lawn\n", "1: lawn\n2: dragon\n", "1 lawn\n", "one: lawn\n"])
def test_labels_without_a_known_name_are_refused(tmp_path: Path, names: str) -> None:
    files = annotated_cloud(tmp_path, [1, 2], names)
    with pytest.raises(InputError):
        read_annotated_cloud(*files, classes=CLASSES)


def test_what_is_no_annotation_is_one_clear_error(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "x.zip"):
        with pytest.raises(InputError, match="CVAT"):
            read_masks(path)


def test_masks_are_written_as_a_folder(tmp_path: Path) -> None:
    wanted = np.array([[GRASS, PERSON], [OTHER, VOID_ID]], np.uint8)
    counts = write_masks(Masks(GRASS_OBSTACLE_PERSON, {"d/a": lambda: wanted}), tmp_path / "out")
    assert counts == {"other": 1, "grass": 1, "person": 1, "void": 1}
    back = cv2.imread(str(tmp_path / "out" / "d" / "a.png"), cv2.IMREAD_UNCHANGED)
    assert back is not None
    assert back.tolist() == wanted.tolist()
    assert "name: grass\n  role: free" in (tmp_path / "out" / "classes.yaml").read_text()


@given(content=st.binary(max_size=100), kind=st.sampled_from([(read_coco, ".json"), (read_cvat_xml, ".xml")]))
def test_random_bytes_are_a_clear_error(
    tmp_path_factory: pytest.TempPathFactory, content: bytes, kind: tuple[Callable[..., Masks], str]
) -> None:
    read, suffix = kind
    path = tmp_path_factory.getbasetemp() / f"random{suffix}"
    path.write_bytes(content)
    with pytest.raises(SwardmapError):
        read(path)
