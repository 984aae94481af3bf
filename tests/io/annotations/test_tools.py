"""Exports of annotation tools as people have them: own class names, renamed images, boxes, split folders."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.io.annotations.annotation_files import read_masks
from swardmap.io.annotations.label_studio import decode_brush
from swardmap.io.annotations.mask_folder import write_masks
from swardmap.io.annotations.masks import Masks
from swardmap.labels import GRASS_OBSTACLE, GRASS_OBSTACLE_PERSON, VOID_ID

GRASS, OTHER, PERSON = (GRASS_OBSTACLE_PERSON[n].id for n in ("grass", "other", "person"))
W, H = 64, 48
WHOLE = [[0, 0, W, 0, W, H, 0, H]]


def coco(
    annotations: list[dict[str, Any]], names: tuple[str, ...], image: dict[str, Any], **more: Any
) -> str:
    tree = {
        "images": [{"id": 1, "width": W, "height": H, **image}],
        "categories": [{"id": i, "name": name} for i, name in enumerate(names)],
        "annotations": [{"id": i, "image_id": 1, "iscrowd": 0, **a} for i, a in enumerate(annotations)],
        **more,
    }
    return json.dumps(tree)


def image_of(shape: shapely.Polygon) -> NDArray[np.bool_]:
    x, y = np.meshgrid(np.arange(W) + 0.5, np.arange(H) + 0.5)
    return np.asarray(shapely.contains_xy(shape, x, y))


def only_mask(masks: Masks) -> NDArray[np.uint8]:
    (name,) = masks
    return masks[name]


LAWN = {"category_id": 0, "segmentation": WHOLE}


@pytest.mark.parametrize(
    "outline", [{"segmentation": []}, {}, {"segmentation": None}, {"segmentation": [[1, 1, 9, 9]]}]
)
def test_a_person_of_which_there_is_only_a_box_fills_it(outline: dict[str, Any], tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    person = {"category_id": 1, "bbox": [10, 10, 20, 25], **outline}
    file.write_text(coco([LAWN, person], ("grass", "person"), {"file_name": "a.jpg"}))
    masks = read_masks(file)
    mask = only_mask(masks)
    assert (mask[10:35, 10:30] == PERSON).all()
    assert (mask == PERSON).sum() == 20 * 25
    assert masks.notes == ("1 annotations have only a box: all of it was filled",)


def test_grass_of_which_there_is_only_a_box_is_asked_for(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(coco([{"category_id": 0, "bbox": [1, 1, 5, 5]}], ("grass",), {"file_name": "a.jpg"}))
    with pytest.raises(InputError, match=r"'grass' has only a box.*draw its outline"):
        only_mask(read_masks(file))
    file.write_text(coco([{"category_id": 0}], ("person",), {"file_name": "a.jpg"}))
    with pytest.raises(InputError, match="neither an outline nor a box"):
        only_mask(read_masks(file))


@pytest.mark.parametrize(
    ("image", "info"),
    [
        ({"file_name": "000012_png.rf.0a1b2c3d4e5f60718293a4b5c6d7e8f9.jpg"}, None),
        ({"file_name": "x_jpg.rf.0a1b2c3d.jpg", "extra": {"name": "000012.png"}}, None),
        ({"file_name": "images/0a1b2c3d-000012.png"}, {"contributor": "Label Studio"}),
        (
            {"file_name": "../../label-studio/data/media/upload/1/0a1b2c3d-000012.png"},
            {"contributor": "Label Studio"},
        ),
        ({"file_name": "000012.png"}, {"contributor": "CVAT"}),
    ],
)
def test_images_have_the_names_they_had(image: dict[str, Any], info: Any, tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(coco([LAWN], ("grass",), image, info=info))
    assert list(read_masks(file)) == ["000012"]


def test_an_export_of_roboflow_is_read_with_its_folders(tmp_path: Path) -> None:
    for split, name in (("train", "000001"), ("valid", "000002")):
        (tmp_path / split).mkdir()
        text = coco([LAWN], ("lawn-objects", "Lawn"), {"file_name": f"{name}_png.rf.0a1b2c3d.jpg"})
        tree = json.loads(text)
        tree["annotations"][0]["category_id"] = 1
        (tmp_path / split / "_annotations.coco.json").write_text(json.dumps(tree))
    masks = read_masks(tmp_path, guess=True)
    assert sorted(masks) == ["000001", "000002"]
    assert masks.guessed == {"Lawn": "grass"}
    assert (masks["000002"] == GRASS).all()
    with pytest.raises(InputError, match="'Lawn'"):
        read_masks(tmp_path)


def test_masks_of_roboflow_are_read_by_their_table(tmp_path: Path) -> None:
    (tmp_path / "train").mkdir()
    mask = np.zeros((H, W), np.uint8)
    mask[:20], mask[:, :9] = 1, 2
    cv2.imwrite(str(tmp_path / "train/000001_png.rf.0a1b2c3d_mask.png"), mask)
    (tmp_path / "train/_classes.csv").write_text("Pixel Value, Class\n0, background\n1, my lawn\n2, man\n")
    masks = read_masks(tmp_path, classes={"my lawn": "grass"}, guess=True)
    want = np.array([VOID_ID, GRASS, PERSON])[mask]
    np.testing.assert_array_equal(masks["000001"], want)
    (tmp_path / "train/_classes.csv").write_text("Pixel Value, Class\nx, background\n")
    with pytest.raises(InputError, match=r"_classes\.csv"):
        read_masks(tmp_path)


def task(*results: dict[str, Any], **data: str) -> dict[str, Any]:
    full = [{"original_width": W, "original_height": H, **r} for r in results]
    cancelled = {"was_cancelled": True, "result": [{"type": "damaged"}]}
    return {"data": data, "annotations": [cancelled, {"was_cancelled": False, "result": full}]}


def region(kind: str, label: str, **value: Any) -> dict[str, Any]:
    return {"type": kind, "value": {kind: [label], **value}}


ALL = region("polygonlabels", "lawn", points=[[0, 0], [100, 0], [100, 100], [0, 100]])


def label_studio(folder: Path, *tasks: dict[str, Any]) -> Path:
    file = folder / "project.json"
    file.write_text(json.dumps(list(tasks)))
    return file


def test_shapes_of_label_studio_are_where_shapely_says(tmp_path: Path) -> None:
    box = region("rectanglelabels", "person", x=25, y=25, width=25, height=10, rotation=30)
    oval = region("ellipselabels", "tree", x=75, y=50, radiusX=10, radiusY=20, rotation=40)
    file = label_studio(tmp_path, task(box, oval, ALL, image="/data/upload/3/0a1b2c3d-000012.png"))
    masks = read_masks(file, guess=True)
    mask = masks["000012"]
    corner = shapely.Point(0.25 * W, 0.25 * H)
    rectangle = shapely.box(corner.x, corner.y, corner.x + 0.25 * W, corner.y + 0.1 * H)
    turned = shapely.affinity.rotate(rectangle, 30, origin=corner)
    circle = shapely.Point(0, 0).buffer(1, quad_segs=64)
    ellipse = shapely.affinity.scale(circle, 0.1 * W, 0.2 * H)
    ellipse = shapely.affinity.rotate(ellipse, 40, origin=(0, 0))
    ellipse = shapely.affinity.translate(ellipse, 0.75 * W, 0.5 * H)
    np.testing.assert_array_equal(mask == PERSON, image_of(turned))
    np.testing.assert_array_equal(mask == OTHER, image_of(ellipse) & ~image_of(turned))
    assert (mask[(mask != PERSON) & (mask != OTHER)] == GRASS).all()


def brush(mask: NDArray[np.bool_]) -> list[int]:
    """Run lengths as label-studio-converter writes them: words of 8 bits, runs of up to 256 values."""
    values = np.repeat(mask.ravel()[:, None] * 255, 4, axis=1).ravel()
    bits = f"{values.size:032b}{7:05b}" + "".join(f"{n - 1:04b}" for n in (3, 4, 8, 16))
    at = 0
    while at < values.size:
        same = 1
        while at + same < values.size and values[at + same] == values[at] and same < 256:
            same += 1
        if same > 1:
            bits += f"1{2:02b}{same - 1:08b}{values[at]:08b}"
        else:
            bits += f"0{0:02b}{0:03b}{values[at]:08b}"
        at += same
    bits += "0" * (-len(bits) % 8)
    return [int(bits[i : i + 8], 2) for i in range(0, len(bits), 8)]


def test_brush_strokes_of_label_studio_come_back(tmp_path: Path) -> None:
    strokes = np.random.default_rng(3).random((H, W)) < 0.3
    np.testing.assert_array_equal(decode_brush(brush(strokes), H, W), strokes)
    results = (ALL, region("brushlabels", "pond", format="rle", rle=brush(strokes)))
    masks = read_masks(label_studio(tmp_path, task(*results, image="a/000012.png")), guess=True)
    np.testing.assert_array_equal(masks["000012"], np.where(strokes, OTHER, GRASS))
    for damaged in (brush(strokes)[:50], brush(strokes[:-1]), [], ["x"], [900]):
        bad = region("brushlabels", "pond", rle=damaged)
        with pytest.raises(InputError, match="image 000012"):
            only_mask(read_masks(label_studio(tmp_path, task(bad, image="000012.png")), guess=True))


@pytest.mark.parametrize(
    "content", ['[{"image": "a", "label": []}]', "[1]", "[", '[{"data": {}, "annotations": []}]', "[[]]"]
)
def test_what_is_no_export_of_label_studio_is_one_clear_error(content: str, tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text(content)
    with pytest.raises(InputError, match=r"a\.json"):
        read_masks(file)


def test_lines_of_label_studio_are_refused(tmp_path: Path) -> None:
    key_point = region("keypointlabels", "hose", x=1, y=1, width=1)
    with pytest.raises(InputError, match="keypointlabels: draw it as a polygon"):
        read_masks(label_studio(tmp_path, task(key_point, image="a.png")))


def test_the_folder_that_convert_writes_is_read_back(tmp_path: Path) -> None:
    mask = np.random.default_rng(0).choice([0, 1, 2, 255], (H, W)).astype(np.uint8)
    given = Masks(GRASS_OBSTACLE_PERSON, {"a/000001": lambda: mask, "b": lambda: mask})
    write_masks(given, tmp_path / "masks")
    back = read_masks(tmp_path / "masks")
    assert sorted(back) == ["a/000001", "b"]
    np.testing.assert_array_equal(back["a/000001"], mask)
    as_two = read_masks(tmp_path / "masks", GRASS_OBSTACLE)
    np.testing.assert_array_equal(as_two["b"], np.where(mask == 2, 0, mask))  # a person is an obstacle
    assert (read_masks(tmp_path / "masks", classes={"person": "void"})["b"][mask == 2] == VOID_ID).all()
    (tmp_path / "masks/classes.yaml").write_text("classes: [{id: 0}]\n")
    with pytest.raises(InputError, match=r"classes\.yaml"):
        read_masks(tmp_path / "masks")


def cvat(folder: Path, shapes: str) -> Path:
    file = folder / "annotations.xml"
    file.write_text(
        f'<annotations><image name="a.jpg" width="{W}" height="{H}">{shapes}</image></annotations>'
    )
    return folder


LAWN_XML = f'<polygon label="grass" points="0,0;{W},0;{W},{H};0,{H}" z_order="0"/>'


def test_ellipses_and_turned_boxes_of_cvat_are_where_shapely_says(tmp_path: Path) -> None:
    oval = '<ellipse label="person" cx="20" cy="20" rx="5.2" ry="8.1" rotation="20" z_order="0"/>'
    box = '<box label="other" xtl="40" ytl="10" xbr="60" ybr="20" rotation="30" z_order="0"/>'
    mask = only_mask(read_masks(cvat(tmp_path, LAWN_XML + oval + box)))
    ellipse = shapely.affinity.scale(shapely.Point(20, 20).buffer(1, quad_segs=64), 5.2, 8.1)
    turned = shapely.affinity.rotate(shapely.box(40, 10, 60, 20), 30)
    np.testing.assert_array_equal(mask == PERSON, image_of(shapely.affinity.rotate(ellipse, 20)))
    np.testing.assert_array_equal(mask == OTHER, image_of(turned))


def test_on_one_level_of_cvat_grass_hides_no_person(tmp_path: Path) -> None:
    person = '<polygon label="person" points="10,10;20,10;20,30;10,30" z_order="{}"/>'
    mask = only_mask(read_masks(cvat(tmp_path, person.format(0) + LAWN_XML)))
    assert (mask == PERSON).sum() == 10 * 20
    mask = only_mask(read_masks(cvat(tmp_path, person.format(-1) + LAWN_XML)))
    assert (mask == GRASS).all()  # drawn over it on a level of its own


def test_what_words_mean_is_guessed_only_where_asked_and_plain(tmp_path: Path) -> None:
    shapes = LAWN_XML.replace("grass", "Mown grass")
    masks = read_masks(cvat(tmp_path, shapes), guess=True)
    assert masks.guessed == {"Mown grass": "grass"}
    masks = read_masks(cvat(tmp_path, shapes), classes={"Mown grass": "void"}, guess=True)
    assert masks.guessed == {}
    assert (only_mask(masks) == VOID_ID).all()
    for word in ("verge", "meadow", "weeds", "field"):  # may be driven on, or not
        with pytest.raises(InputError, match=f"--class '{word}=...'"):
            read_masks(cvat(tmp_path, LAWN_XML.replace("grass", word)), guess=True)


def test_a_frame_finds_its_mask_in_any_folder() -> None:
    masks = Masks(
        GRASS_OBSTACLE_PERSON,
        {name: lambda: np.zeros((1, 1), np.uint8) for name in ("rgb/1", "2", "x/3", "y/3")},
    )
    assert [masks.name_of(frame) for frame in ("1", "2", "3", "4")] == ["rgb/1", "2", None, None]


def test_polygons_of_any_number_of_corners_take_no_seconds(tmp_path: Path) -> None:
    """A COCO outline of 200,000 corners; one whose edges cross the image all the time is refused."""
    import time

    angles = np.linspace(0, 2 * np.pi, 200_000, endpoint=False)
    ring = np.stack([32 + 20 * np.cos(angles), 24 + 20 * np.sin(angles)], axis=-1).ravel()
    file = tmp_path / "a.json"
    started = time.process_time()
    file.write_text(
        coco([{"category_id": 0, "segmentation": [ring.tolist()]}], ("grass",), {"file_name": "a.jpg"})
    )
    assert (only_mask(read_masks(file)) == GRASS).sum() == pytest.approx(np.pi * 400, rel=0.01)
    assert time.process_time() - started < 5
