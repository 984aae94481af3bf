import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from swardmap.cli.demo import RECORDING
from swardmap.cli.train import counts_line
from swardmap.errors import ConfigError, InputError
from swardmap.geometry import Intrinsics
from swardmap.io.sources.eden import write_eden
from swardmap.io.sources.folder import write_folder
from swardmap.labels import GRASS, OTHER, PERSON, VOID_ID
from swardmap.synth.analytic import AnalyticSource, lane_poses
from swardmap.train.augment import paste, relight, warp
from swardmap.train.data import draw_batch, load_photos
from swardmap.train.photos import (
    OBSTACLE_CODE,
    PARTIAL_CODE,
    PSEUDO_CODE,
    SMALL_CODE,
    image_paths,
    small_obstacles,
)
from swardmap.train.recipe import AugmentConfig, DataConfig, load_recipe, recipe_from_dict, recipe_to_dict

MakeRecipe = Callable[..., dict[str, Any]]


def one_photo(root: Path, recipe: dict[str, Any]) -> Any:
    return load_photos(recipe_from_dict(recipe), root, validation=False)[0].photos[0]


def test_masks_become_class_indices(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    photo = one_photo(data_root, tiny_recipe())
    mask = np.asarray(cv2.imread(str(data_root / "made/labels/000.png"), cv2.IMREAD_GRAYSCALE))
    np.testing.assert_array_equal(photo.codes, mask)
    assert photo.image[0, 0, 2] > photo.image[0, 0, 0]  # RGB: the sky is blue


def test_a_two_class_network_learns_a_person_as_obstacle(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    recipe = recipe_from_dict(tiny_recipe(classes="grass-obstacle", activation="sigmoid"))
    sets = load_photos(recipe, data_root, validation=False)
    assert set(np.unique(sets[0].photos[0].codes)) == {0, 1}
    for view in draw_batch(sets, recipe, range(30), step=0):  # nobody is pasted in
        assert set(np.unique(view.codes)) <= {0, 1, VOID_ID}


def test_foreign_ids_are_named_in_the_recipe(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    recipe = tiny_recipe()
    recipe["data"][0]["ids"] = "0=person, 2=grass"
    photo = one_photo(data_root, recipe)
    assert set(np.unique(photo.codes)) == {1, 2, VOID_ID}
    recipe["data"][0]["ids"] = "x=person"
    with pytest.raises(ConfigError, match="expected ids as"):
        one_photo(data_root, recipe)


def test_teachers_and_partial_labels_fill_only_what_is_void(
    data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    for source in ("images", "labels"):
        (tmp_path / "made" / source).mkdir(parents=True)
    image = cv2.imread(str(data_root / "made/images/000.png"))
    mask = np.asarray(cv2.imread(str(data_root / "made/labels/000.png"), cv2.IMREAD_GRAYSCALE))
    mask[:, :40] = VOID_ID
    cv2.imwrite(str(tmp_path / "made/images/000.png"), image)
    cv2.imwrite(str(tmp_path / "made/labels/000.png"), mask)
    (tmp_path / "said").mkdir()
    said = np.full((4, 4), VOID_ID, np.uint8)
    said[:, 0] = 1
    cv2.imwrite(str(tmp_path / "said/000.png"), said)
    recipe = tiny_recipe()
    recipe["data"] = [{"name": "made", "folder": "made", "pseudo": "said", "void_means": "other,grass"}]
    codes = one_photo(tmp_path, recipe).codes
    assert (codes[:, :24] == PSEUDO_CODE + 1).all()
    assert (codes[:, 24:40] == PARTIAL_CODE).all()
    np.testing.assert_array_equal(codes[:, 40:], mask[:, 40:])


def test_obstacles_that_weigh_otherwise_have_a_code_of_the_set(
    data_root: Path, tiny_recipe: MakeRecipe
) -> None:
    recipe = tiny_recipe()
    plain = one_photo(data_root, recipe).codes
    recipe["data"][0]["obstacle_weight"] = 2.0
    codes = one_photo(data_root, recipe).codes
    np.testing.assert_array_equal(codes, np.where(plain == 0, OBSTACLE_CODE, plain))
    recipe["data"].append(recipe["data"][0] | {"validation": True})  # figures are of classes, not of weights
    checked = load_photos(recipe_from_dict(recipe), data_root, validation=True)[0].photos[0]
    assert OBSTACLE_CODE not in np.unique(checked.codes)
    assert OBSTACLE_CODE + 1 not in np.unique(checked.codes)


def test_small_things_are_what_stands_alone_and_covers_little_of_a_recordings_frame(
    tiny_recipe: MakeRecipe,
) -> None:
    network = recipe_from_dict(tiny_recipe()).network
    mask = np.full((60, 80), GRASS.id, np.uint8)
    mask[:10] = OTHER.id  # a hedge
    mask[10:12, 40] = OTHER.id  # a post of it
    mask[30:36, 20:28] = OTHER.id  # 48 pixels, 1 % of the image
    mask[50:54, 60:70] = OTHER.id
    mask[40:42, 5:8] = PERSON.id
    expected = np.zeros(mask.shape, np.bool_)
    expected[50:54, 60:70] = True
    np.testing.assert_array_equal(small_obstacles(mask, network), expected)

    tree = tiny_recipe() | {"data": [{"name": "drive", "folder": ".", "kind": "recording"}]}
    plain = one_photo(RECORDING, tree).codes
    tree["data"][0]["small_things"] = True
    codes = one_photo(RECORDING, tree).codes
    small = small_obstacles(plain, network)
    assert small.any()
    np.testing.assert_array_equal(codes, np.where(small, SMALL_CODE, plain))


def test_held_out_images_are_never_learnt_from(data_root: Path) -> None:
    learn = image_paths(DataConfig(name="a", folder="made", hold_out=5), data_root)
    check = image_paths(DataConfig(name="a", folder="made", hold_out=5, validation=True), data_root)
    assert not set(learn) & set(check)
    assert len(learn) + len(check) == 24
    assert len(check) == 5


def test_missing_and_damaged_files_are_said(data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such folder"):
        image_paths(DataConfig(name="a", folder="nowhere"), data_root)
    with pytest.raises(InputError, match="no such list"):
        image_paths(DataConfig(name="a", folder="made", list="none.txt"), data_root)
    (tmp_path / "made/images").mkdir(parents=True)
    (tmp_path / "made/labels").mkdir()
    (tmp_path / "made/images/000.png").write_bytes(b"no image")
    with pytest.raises(InputError, match="missing or damaged"):
        one_photo(tmp_path, tiny_recipe())
    cv2.imwrite(str(tmp_path / "made/images/000.png"), np.zeros((8, 8, 3), np.uint8))
    cv2.imwrite(str(tmp_path / "made/labels/000.png"), np.zeros((8, 9), np.uint8))
    with pytest.raises(InputError, match="expected a mask of 8 x 8"):
        one_photo(tmp_path, tiny_recipe())


@pytest.mark.parametrize(
    "mask", [np.ones((8, 8), np.uint16), np.ones((8, 8, 3), np.uint8), np.ones((8, 8, 4), np.uint8)]
)
def test_masks_of_other_kinds_are_refused_and_never_read_as_ids(
    mask: np.ndarray, tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    """A mask of 16 bits was read as all 0, one of colours as their brightness."""
    for part, content in (("images", np.zeros((8, 8, 3), np.uint8)), ("labels", mask)):
        (tmp_path / "made" / part).mkdir(parents=True)
        cv2.imwrite(str(tmp_path / f"made/{part}/000.png"), content)
    with pytest.raises(InputError, match="expected an 8-bit single-channel mask of class ids"):
        one_photo(tmp_path, tiny_recipe())


def test_a_list_names_one_image_a_line_whatever_its_name(tmp_path: Path) -> None:
    (tmp_path / "made/images").mkdir(parents=True)
    for name in ("IMG 001", "b"):
        (tmp_path / f"made/images/{name}.jpg").write_bytes(b"x")
    (tmp_path / "made/train.txt").write_text("IMG 001\r\n\n b\n")
    found = image_paths(DataConfig(name="a", folder="made", list="train.txt"), tmp_path)
    assert [p.stem for p in found] == ["IMG 001", "b"]


def test_a_view_depends_on_seed_step_and_index_alone(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    sets = load_photos(recipe, data_root, validation=False)
    whole = draw_batch(sets, recipe, range(4), step=7)
    second = draw_batch(sets, recipe, [1, 3], step=7)
    for a, b in zip(whole[1::2], second, strict=True):
        np.testing.assert_array_equal(a.image, b.image)
        np.testing.assert_array_equal(a.codes, b.codes)
    other = draw_batch(sets, recipe, range(4), step=8)
    assert any(not np.array_equal(a.image, b.image) for a, b in zip(whole, other, strict=True))


def test_image_and_mask_move_together() -> None:
    rng = np.random.default_rng(0)
    mask = np.zeros((120, 160), np.uint8)
    mask[40:80, 50:110] = 1
    image = np.repeat(mask[..., None] * np.uint8(200), 3, axis=2)
    for _ in range(20):
        moved, codes = warp(image, mask, (96, 72), AugmentConfig(), rng)
        inside, outside = moved[codes == 1, 0], moved[codes == 0, 0]
        assert (inside > 100).mean() > 0.97
        assert (outside < 100).mean() > 0.97


def test_light_changes_colours_and_nothing_else() -> None:
    rng = np.random.default_rng(1)
    image = rng.integers(0, 256, (60, 80, 3), np.uint8)
    for _ in range(60):
        lit = relight(image, AugmentConfig(rare=0.5), rng)
        assert lit.shape == image.shape
        assert lit.dtype == np.uint8


def test_a_pasted_person_keeps_its_pixels_and_gets_a_void_outline() -> None:
    image, codes = np.zeros((20, 20, 3), np.uint8), np.ones((20, 20), np.uint8)
    donor, donor_codes = np.full((20, 20, 3), 9, np.uint8), np.zeros((20, 20), np.uint8)
    donor_codes[5:10, 5:10] = 2
    pasted, new = paste(image, codes, donor, donor_codes, 2)
    np.testing.assert_array_equal(pasted[..., 0] == 9, donor_codes == 2)
    assert (new == 2).sum() == 25
    assert (new == VOID_ID).sum() == 7 * 7 - 25
    assert not image.any()


def test_recipes_come_back_whole_and_refuse_what_they_do_not_know(
    tiny_recipe: MakeRecipe, tmp_path: Path
) -> None:
    recipe = recipe_from_dict(tiny_recipe())
    assert recipe_from_dict(recipe_to_dict(recipe)) == recipe
    assert recipe.digest == recipe_from_dict(recipe_to_dict(recipe)).digest
    said = tiny_recipe()
    said["schedule"]["zoom"] = 1.0  # the default
    assert recipe_from_dict(said).digest == recipe.digest
    said["schedule"]["zoom"] = 2.0
    assert recipe_from_dict(said).digest != recipe.digest
    (tmp_path / "tiny.yaml").write_text(yaml.safe_dump(tiny_recipe(steps=4)))
    shorter = load_recipe(
        tmp_path / "tiny.yaml", ["schedule.steps=3", "network.rates=[1, 1, 2]", "start=auto"]
    )
    assert (shorter.schedule.steps, shorter.network.rates, shorter.start) == (3, (1, 1, 2), "auto")
    assert shorter.data == recipe.data
    for wrong in ("schedule.step=3", "schedule", "schedule.steps=[", "schedule.steps=many", "schedule=3"):
        with pytest.raises(ConfigError, match=r"(?i)section|schedule"):
            load_recipe(tmp_path / "tiny.yaml", [wrong])
    with pytest.raises(ConfigError, match="did you mean 'steps'"):
        recipe_from_dict({**tiny_recipe(), "schedule": {"step": 3}})
    with pytest.raises(ConfigError, match="unknown keys nets"):
        recipe_from_dict({**tiny_recipe(), "nets": {}})
    with pytest.raises(ConfigError, match="two classes"):
        recipe_from_dict(tiny_recipe(activation="sigmoid"))
    with pytest.raises(ConfigError, match="data to learn from"):
        recipe_from_dict({"name": "x"})
    (tmp_path / "bad.yaml").write_text("name: [")
    with pytest.raises(ConfigError, match=r"cannot read the configuration .*bad\.yaml"):
        load_recipe(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    "path", sorted(Path(__file__).parents[2].glob("recipes/*.yaml")), ids=lambda p: p.stem
)
def test_the_committed_recipes_are_sound(path: Path) -> None:
    assert load_recipe(path).name


def test_the_recipe_in_the_document_is_sound() -> None:
    page = (Path(__file__).parents[2] / "docs/models.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```yaml\n(.*?)^```", page, re.DOTALL | re.MULTILINE)
    assert recipe_from_dict(yaml.safe_load(text)).start == "auto"


def test_a_coco_file_serves_as_masks(data_root: Path, tiny_recipe: MakeRecipe, tmp_path: Path) -> None:
    photo = one_photo(data_root, tiny_recipe())
    height, width = photo.codes.shape
    (tmp_path / "coco/images").mkdir(parents=True)
    for stem in ("000", "001"):
        cv2.imwrite(str(tmp_path / f"coco/images/{stem}.png"), photo.image)
    tree = {
        "images": [{"id": 7, "file_name": "sub/000.png", "height": height, "width": width}],
        "categories": [{"id": 1, "name": "person"}, {"id": 2, "name": "dog"}],
        "annotations": [
            {"image_id": 7, "category_id": 1, "segmentation": [[10, 20, 30, 20, 30, 50, 10, 50]]},
            {"image_id": 7, "category_id": 2, "segmentation": [[60, 20, 80, 20, 80, 50, 60, 50]]},
        ],
    }
    (tmp_path / "coco/persons.json").write_text(json.dumps(tree))
    recipe = tiny_recipe()
    made = {"name": "coco", "folder": "coco", "annotations": "persons.json", "void_means": "other,grass"}
    recipe["data"] = [made | {"classes": "dog=other"}]
    photos = load_photos(recipe_from_dict(recipe), tmp_path, validation=False)[0].photos
    assert [p.stem for p in photos] == ["000"]  # the file does not name 001
    expected = np.full((height, width), PARTIAL_CODE, np.uint8)
    expected[20:50, 10:30] = 2
    expected[20:50, 60:80] = 0
    np.testing.assert_array_equal(photos[0].codes, expected)
    recipe["data"] = [made]
    with pytest.raises(InputError, match="nobody says what these classes are: 'dog'"):
        one_photo(tmp_path, recipe)
    recipe["data"] = [made | {"classes": "dog"}]
    with pytest.raises(ConfigError, match="expected pairs as"):
        one_photo(tmp_path, recipe)


def test_a_recording_serves_as_photos(tiny_recipe: MakeRecipe, tmp_path: Path) -> None:
    camera = Intrinsics(96, 72, 70.0, 70.0, 47.5, 35.5)
    frames = [replace(f, tags={}) for f in AnalyticSource(poses=tuple(lane_poses(6)), intrinsics=camera)]
    write_folder(frames, tmp_path / "garden")
    recipe = tiny_recipe()
    recipe["data"] = [{"name": "garden", "folder": "garden", "kind": "recording", "hold_out": 3}]
    photos = load_photos(recipe_from_dict(recipe), tmp_path, validation=False)[0].photos
    assert len(photos) == 4
    np.testing.assert_array_equal(photos[0].codes, frames[0].labels)
    recipe["data"].append(recipe["data"][0] | {"validation": True})
    held = load_photos(recipe_from_dict(recipe), tmp_path, validation=True)[0].photos
    assert {p.stem for p in held} | {p.stem for p in photos} == {f"{i:06d}" for i in range(6)}
    told = counts_line(recipe_from_dict(recipe), tmp_path)  # what `swardmap train` says first
    assert "steps on 1 recording, checked on 1 recording every" in told


def test_gardens_are_held_out_by_the_scene_in_both_layouts(tiny_recipe: MakeRecipe, tmp_path: Path) -> None:
    camera = Intrinsics(96, 72, 70.0, 70.0, 47.5, 35.5)
    for scene in range(3):
        for light in ("clear", "sunset"):
            source = AnalyticSource(poses=tuple(lane_poses(2)), intrinsics=camera)
            tags = {"scene": f"{scene:04d}", "illumination": light}
            frames = [replace(frame, tags=tags) for frame in source]
            write_eden(frames, tmp_path / "eden", scene=tags["scene"], illumination=light)
            sequence = tmp_path / "gardens/folder" / tags["scene"] / light
            write_folder(frames, sequence)
            (sequence / "complete.json").write_text('{"frames": 2}')
    (tmp_path / "gardens/plan.json").write_text("{}")
    recipe = tiny_recipe()
    for layout in ("eden", "gardens"):
        entry = {"name": "gardens", "folder": layout, "kind": "recording", "hold_out": 3}
        recipe["data"] = [entry, entry | {"name": "held", "validation": True}]
        learn, held = (
            load_photos(recipe_from_dict(recipe), tmp_path, validation=v)[0].photos for v in (False, True)
        )
        assert (len(learn), len(held)) == (8, 4)
        assert [p.light for p in held] == ["clear", "clear", "sunset", "sunset"]
        assert {p.stem.split("-")[0] for p in held} == {"0001"}
        assert {p.stem.split("-")[0] for p in learn} == {"0000", "0002"}
    np.testing.assert_array_equal(held[0].codes, frames[0].labels)


def test_views_have_the_networks_stretch_and_the_recipes_zoom() -> None:
    image = np.zeros((120, 160, 3), np.uint8)
    codes = np.zeros((120, 160), np.uint8)
    codes[40:80, 60:100] = 1  # a square in the middle
    still = AugmentConfig(scale=0.0, aspect=0.0, rotation_deg=0.0)
    shapes = set()
    for seed in range(12):
        view = warp(image, codes, (96, 96), still, np.random.default_rng(seed), 1.0, 1.5)[1] == 1
        shapes.add((int(view.any(0).sum()), int(view.any(1).sum())))
    size = 40 * 1.5 * 96 / np.sqrt(160 * 120)
    expected = {(size, size), (size * np.sqrt(3 / 4), size * np.sqrt(4 / 3))}  # 4:3 into a square
    assert len(shapes) >= 2
    for shape in shapes:  # a pixel of rounding, and the shift may cut the square
        assert any(np.all(np.array(shape) <= np.array(e) + 1) for e in expected)
    for wanted in expected:
        assert any(np.allclose(shape, wanted, atol=1.01) for shape in shapes)


def test_a_covered_lens_is_an_obstacle_everywhere(data_root: Path, tiny_recipe: MakeRecipe) -> None:
    tree = tiny_recipe()
    tree["schedule"]["covered"] = 0.3
    recipe = recipe_from_dict(tree)
    views = draw_batch(load_photos(recipe, data_root, validation=False), recipe, range(300), step=0)
    blank = [v for v in views if v.stem == "covered"]
    assert 0.2 * 300 < len(blank) < 0.4 * 300
    assert all((v.codes == 0).all() for v in blank)
    assert sum(v.image.mean() < 40 for v in blank) > 0.4 * len(blank)  # most are dark
    for view in blank[:20]:  # nothing is to be seen: halves differ little, but for a soft gradient
        top, bottom = np.split(view.image.astype(float), 2)
        assert abs(top.mean() - bottom.mean()) < 30


def test_one_setting_leaves_out_the_sets_of_some_terms(tiny_recipe: MakeRecipe) -> None:
    tree = tiny_recipe()
    tree["data"].append({"name": "streets", "folder": "made", "terms": "non-commercial"})
    assert len(recipe_from_dict(tree).data) == 3
    recipe = recipe_from_dict({**tree, "without": "non-commercial"})
    assert [d.name for d in recipe.data] == ["made", "held"]
    assert "non-commercial" in recipe.licence
    assert recipe_from_dict(recipe_to_dict(recipe)) == recipe
    with pytest.raises(ConfigError, match="have the terms non-commercial; got noncommercial"):
        recipe_from_dict({**tree, "without": "noncommercial"})
