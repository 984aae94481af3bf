"""Images and masks to learn from: reading, mixing, and what a mask's pixel may mean.

A pixel need not be known exactly. Its *code* names a set of classes: one class (labelled), one class by
a teacher's word, some classes (a data set that knows persons but not grass), or any (void).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from swardmap.errors import InputError
from swardmap.labels import VOID_ID, Role
from swardmap.train.augment import covered, paste, relight, warp
from swardmap.train.photos import (
    FREE_CODE,
    OBSTACLE_CODE,
    PARTIAL_CODE,
    PSEUDO_CODE,
    SMALL_CODE,
    Photo,
    read_photos,
    role_code,
)
from swardmap.train.recipe import DataConfig, NetworkConfig, Recipe


@dataclass(frozen=True, eq=False)
class Codes:
    """What each code means.

    Attributes:
        sets: (256, C) bool, classes a pixel with that code may have; all of them for void.
        weights: (256,) float32, of such a pixel in the loss.
    """

    sets: NDArray[np.bool_]
    weights: NDArray[np.float32]


@dataclass(eq=False)
class PhotoSet:
    """The photos of one DataConfig and how often each is drawn; `person` is the code of a person, if any."""

    config: DataConfig
    photos: list[Photo]
    person: int | None
    chances: NDArray[np.float64] = field(init=False)

    def __post_init__(self) -> None:
        boost = np.ones(len(self.photos))
        for index, photo in enumerate(self.photos):
            if self.person is not None and (photo.codes == self.person).mean() > 0.002:
                boost[index] = self.config.person_boost
        self.chances = boost / boost.sum()


def make_codes(recipe: Recipe) -> Codes:
    """The code table of a recipe.

    Class index, 50 + data set (drivable with a weight of the set's own), 100 + class index (teacher),
    150 + data set (obstacle with a weight of its own), 200 + data set (known in part), 250 (small obstacle).
    """
    ids, names = recipe.network.trained_ids, recipe.network.label_set
    sets = np.ones((256, len(ids)), np.bool_)
    weights = np.zeros(256, np.float32)
    schedule = recipe.schedule
    for index, class_id in enumerate(ids):
        role = next(c.role for c in names.classes if c.id == class_id)
        weight = schedule.person_weight if role is Role.PERSON else 1.0
        for code, factor in ((index, 1.0), (PSEUDO_CODE + index, schedule.pseudo_weight)):
            sets[code] = np.arange(len(ids)) == index
            weights[code] = weight * factor
    obstacle = role_code(recipe.network, Role.OBSTACLE)
    if obstacle is not None:
        sets[SMALL_CODE], weights[SMALL_CODE] = sets[obstacle], schedule.small_weight
    for number, config in enumerate(recipe.data):
        own = (
            (config.obstacle_weight, Role.OBSTACLE, OBSTACLE_CODE),
            (config.free_weight, Role.FREE, FREE_CODE),
        )
        for weight, role, code in own:
            known = role_code(recipe.network, role)
            if weight != 1 and known is not None:
                sets[code + number] = sets[known]
                weights[code + number] = weights[known] * weight
        if config.void_means:
            allowed = {names[name.strip()].id for name in config.void_means.split(",")}
            sets[PARTIAL_CODE + number] = [i in allowed for i in ids]
            weights[PARTIAL_CODE + number] = schedule.partial_weight
    return Codes(sets, weights)


def person_code(network: NetworkConfig) -> int | None:
    """Code of a labelled person; None for a network that does not tell persons apart."""
    return role_code(network, Role.PERSON)


def load_photos(recipe: Recipe, root: Path, validation: bool) -> list[PhotoSet]:
    """Read every image and mask of the recipe's training or validation sets into memory.

    Raises:
        InputError: for a folder, list, image or mask that is missing or damaged.
    """
    loaded = []
    for number, config in enumerate(recipe.data):
        if config.validation != validation or (config.weight == 0 and not validation):
            continue
        photos = read_photos(config, number, recipe.network, root)
        if not photos:
            raise InputError(f"data set {config.name}: no images in {root / config.folder}")
        loaded.append(PhotoSet(config, photos, person_code(recipe.network)))
    return loaded


def draw_batch(sets: Sequence[PhotoSet], recipe: Recipe, indices: Sequence[int], step: int) -> list[Photo]:
    """The views of one step. A view depends on the seed, the step and its index alone.

    So a run that was killed goes on exactly as it would have, and any number of processes share a batch.
    """
    return [_draw(sets, recipe, np.random.default_rng((recipe.schedule.seed, step, i))) for i in indices]


def _draw(sets: Sequence[PhotoSet], recipe: Recipe, rng: np.random.Generator) -> Photo:
    crop = recipe.schedule.crop
    size = (crop, crop) if crop else (recipe.network.width, recipe.network.height)
    if recipe.schedule.covered and rng.random() < recipe.schedule.covered:
        return _nothing_seen(size, recipe.network, rng)
    photo = _pick(sets, rng)
    view = _view(photo, size, recipe, rng)
    person = person_code(recipe.network)
    if person is not None and rng.random() < recipe.schedule.paste_person:
        donor = _view(_pick_person(sets, person, rng), size, recipe, rng)
        image, codes = paste(view.image, view.codes, donor.image, donor.codes, person)
        fine = np.where(codes == view.codes, view.fine, VOID_ID).astype(np.uint8)
        view = Photo(image, codes, fine, view.stem)
    return Photo(relight(view.image, recipe.augment, rng), view.codes, view.fine, view.stem)


def _nothing_seen(size: tuple[int, int], network: NetworkConfig, rng: np.random.Generator) -> Photo:
    """A view of a covered lens: an obstacle everywhere."""
    obstacle = role_code(network, Role.OBSTACLE)
    codes = np.full(size[::-1], VOID_ID if obstacle is None else obstacle, np.uint8)
    return Photo(covered(size, rng), codes, np.full_like(codes, VOID_ID), "covered")


def _view(photo: Photo, size: tuple[int, int], recipe: Recipe, rng: np.random.Generator) -> Photo:
    masks = np.dstack([photo.codes, photo.fine])
    aspect = recipe.network.width / recipe.network.height
    image, masks = warp(photo.image, masks, size, recipe.augment, rng, aspect, recipe.schedule.zoom)
    codes, fine = (np.ascontiguousarray(masks[..., i]) for i in range(2))
    return Photo(image, codes, fine, photo.stem)


def _pick(sets: Sequence[PhotoSet], rng: np.random.Generator) -> Photo:
    weights = np.array([s.config.weight for s in sets])
    chosen = sets[int(rng.choice(len(sets), p=weights / weights.sum()))]
    return chosen.photos[int(rng.choice(len(chosen.photos), p=chosen.chances))]


def _pick_person(sets: Sequence[PhotoSet], person: int, rng: np.random.Generator) -> Photo:
    """A photo with a clear person, or any photo if there is none."""
    for _ in range(30):
        photo = _pick(sets, rng)
        if 0.02 < (photo.codes == person).mean() < 0.5:
            return photo
    return photo
