"""A training recipe: one YAML file that says what is trained, on what, and how.

The recipe of the shipped network is in the folder `recipes` of the repository.
"""

import hashlib
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from swardmap.config.loader import read_yaml
from swardmap.config.settings import Checked, build, merge_overrides, setting
from swardmap.errors import ConfigError
from swardmap.labels import GRASS_OBSTACLE_PERSON, LabelSet, Role
from swardmap.train.classes import PAPER_SETS, read_classes

MOST_SETS = 50
"""Data sets of a recipe: each has two codes of its own (see data.py)."""

ENCODER_NAMES = ("resnet18", "resnet34", "efficientnet-lite0", "efficientnet-lite1", "efficientnet-lite2")


@dataclass(frozen=True)
class NetworkConfig(Checked):
    """Which network."""

    encoder: str = setting("efficientnet-lite2", "", choices=ENCODER_NAMES)
    decoder_channels: int = setting(128, "256 in the paper's network", minimum=8)
    rates: tuple[int, int, int] = setting((6, 12, 18), "dilations of ASPP")
    dropout: float = setting(0.1, "before the head", minimum=0, maximum=0.9)
    activation: str = setting("softmax", "sigmoid: one channel, two classes", choices=("softmax", "sigmoid"))
    classes: str = setting(
        "grass-obstacle-person", "or grass-obstacle, or own ones: other=obstacle,grass=free,flowers=obstacle"
    )
    width: int = setting(384, "of the input in pixels", minimum=32)
    height: int = setting(288, "of the input in pixels", minimum=32)
    imagenet: bool = setting(True, "start the encoder from ImageNet where such weights are to be had")
    frozen_blocks: int = setting(2, "first blocks that do not learn; -1 = everything learns", minimum=-1)
    auxiliary_classes: int = setting(
        0, "classes of the finer labels that help in training; 0 = none", minimum=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        read_classes(self.classes)

    @property
    def label_set(self) -> LabelSet:
        """Classes of the mask."""
        return read_classes(self.classes)

    @property
    def data_label_set(self) -> LabelSet:
        """What ids and names mean in data sets that do not say it themselves."""
        return GRASS_OBSTACLE_PERSON if self.classes in PAPER_SETS else self.label_set

    @property
    def trained_ids(self) -> tuple[int, ...]:
        """Ids of the classes that have an output, in the order of the channels."""
        return tuple(c.id for c in self.label_set.classes if c.role is not Role.VOID)


@dataclass(frozen=True)
class ScheduleConfig(Checked):
    """How it learns."""

    steps: int = setting(1200, "", minimum=1)
    batch: int = setting(16, "images a step, over all processes", minimum=1)
    crop: int = setting(320, "edge of the square views it learns from; 0 = the network's input", minimum=0)
    zoom: float = setting(
        1.0, "mean zoom of the views; 2 = of a quarter of the image", minimum=0.1, maximum=10
    )
    decoder_rate: float = setting(1e-3, "learning rate at its peak", minimum=0)
    encoder_rate: float = setting(2e-4, "learning rate at its peak", minimum=0)
    warmup: int = setting(60, "steps to the peak", minimum=0)
    weight_decay: float = setting(0.01, "", minimum=0)
    averaging: float = setting(
        0.995, "decay of the running mean of the weights that is kept", minimum=0, maximum=1
    )
    person_weight: float = setting(2.0, "of a person pixel in the loss", minimum=0)
    small_weight: float = setting(1.0, "of a pixel of small things in the loss, where asked for", minimum=0)
    pseudo_weight: float = setting(0.5, "of a teacher's pixel in the loss", minimum=0)
    partial_weight: float = setting(0.5, "of a pixel known only to be one of several classes", minimum=0)
    auxiliary_weight: float = setting(0.4, "of the finer labels in the loss", minimum=0)
    paste_person: float = setting(0.15, "share of views that get a person pasted in", minimum=0, maximum=1)
    covered: float = setting(
        0.0, "share of views of a covered lens, an obstacle everywhere", minimum=0, maximum=1
    )
    frozen_norms: bool = setting(
        False, "batch norms keep the statistics they begin with: for a short run from a network's file"
    )
    kept_batches: int = setting(
        0,
        "draw only so many batches and learn from their views again and again; for an encoder that does not "
        "learn: it looks at each view once; 0 = new views each step",
        minimum=0,
    )
    check_every: int = setting(100, "steps from one checkpoint and validation to the next", minimum=1)
    seed: int = setting(0, "")
    precision: str = setting(
        "auto",
        "auto: bf16 where the device computes with it, else fp32; who imitates bf16 takes 15 times as long",
        choices=("auto", "bf16", "fp32"),
    )


@dataclass(frozen=True)
class AugmentConfig(Checked):
    """How each view is changed before it is learnt from; the defaults are those of version 0.1.0."""

    scale: float = setting(0.5, "log of the largest zoom in or out, about `schedule.zoom`", minimum=0)
    aspect: float = setting(0.3, "log of the largest stretch", minimum=0)
    rotation_deg: float = setting(4.0, "standard deviation", minimum=0)
    light: float = setting(0.25, "standard deviation of log gain and log gamma", minimum=0)
    rare: float = setting(
        0.15, "probability of each of blur, shadow, haze, noise, low resolution, JPEG", minimum=0, maximum=1
    )
    harsh: float = setting(
        0.0, "share of views in harsh light, by the settings below, in place of `light`", minimum=0, maximum=1
    )
    exposure: float = setting(
        0.6, "standard deviation of log gain of linear light; darker more often", minimum=0
    )
    gamma: float = setting(0.25, "standard deviation of log gamma", minimum=0)
    cast: float = setting(0.25, "standard deviation of the log of red and of blue against green", minimum=0)
    saturation_low: float = setting(0.1, "least saturation", minimum=0)
    saturation_high: float = setting(1.4, "most saturation", minimum=0)
    vignette: float = setting(0.8, "largest share of light lost in the corners", minimum=0, maximum=1)
    shade: float = setting(0.5, "share of these views with hard or dappled shade", minimum=0, maximum=1)


@dataclass(frozen=True)
class DataConfig(Checked):
    """One data set: a folder of images and masks, or a recording with true labels (folder, EDEN)."""

    name: str = setting("", "what to call it")
    folder: str = setting("", "relative to the data root")
    kind: str = setting("images", "recording: whatever `swardmap map` reads", choices=("images", "recording"))
    list: str | None = setting(None, "text file in the folder with one stem a line; none = all images")
    images: str = setting("images", "subfolder")
    labels: str | None = setting("labels", "subfolder of masks named as the images; none = unlabelled")
    annotations: str | None = setting(
        None,
        "COCO .json, CVAT .xml or export folder, in place of `labels`; images it does not name are left out",
    )
    classes: str = setting(
        "", "what the annotations' names mean, as person=person,*=void; background is void unless named"
    )
    label_suffix: str = setting(".png", "what follows the image's stem in the mask's name")
    ids: str = setting(
        "", "classes of the masks' ids, as 0=other,1=grass,2=person (own classes: as listed); others void"
    )
    fine: str | None = setting(None, "subfolder of masks with finer classes; 0 and 255 are void")
    pseudo: str | None = setting(None, "folder of teachers' masks, made by `swardmap train --distil`")
    void_means: str = setting("", "classes that a void pixel may be, with commas; empty = any")
    weight: float = setting(
        1.0, "share of the samples; of validation sets, in the choice of the best checkpoint", minimum=0
    )
    person_boost: float = setting(1.0, "how much more often an image with a person is drawn", minimum=0)
    obstacle_weight: float = setting(
        1.0,
        "of an obstacle's pixel in the loss: over 1 where grass said of it is the costly error",
        minimum=0,
    )
    free_weight: float = setting(
        1.0, "of a pixel that may be driven on in the loss: over 1 where few of them are labelled", minimum=0
    )
    small_things: bool = setting(
        False, "a recording's obstacles that cover less than 1 % of the image weigh `small_weight`"
    )
    validation: bool = setting(False, "measured on, not learnt from")
    every: int = setting(1, "use every n-th image", minimum=1)
    terms: str = setting(
        "", "terms of its licence, such as non-commercial; the recipe's `without` leaves sets out by them"
    )
    hold_out: int = setting(
        0,
        "every n-th image (of gardens: scene) is for validation alone; give both sets the same n; 0 = none",
        minimum=0,
    )


@dataclass(frozen=True)
class TeacherConfig(Checked):
    """A network that labels photos nobody labelled; it must give logits, classes first."""

    file: str = setting(
        "",
        ".onnx file, relative to the data root; auto = the package's; with swardmap's metadata that is all",
    )
    size: int = setting(512, "edge of its square input", minimum=32)
    mean: float = setting(0.5, "of its input in 0..1")
    std: float = setting(0.5, "of its input in 0..1", minimum=1e-3)
    grass: str = setting("", "its channels that are grass, with commas; empty = not asked")
    person: str = setting("", "its channels that are person; empty = not asked")
    doubtful: str = setting("", "its channels that say nothing about either, such as field or background")


@dataclass(frozen=True)
class Recipe:
    """All of it."""

    name: str
    network: NetworkConfig = field(default_factory=NetworkConfig)
    schedule: ScheduleConfig = field(default_factory=ScheduleConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    data: tuple[DataConfig, ...] = ()
    teachers: tuple[TeacherConfig, ...] = ()
    licence: str = ""
    start: str = (
        ""  # checkpoint or .onnx file it begins from, relative to the data root; auto = the package's
    )

    def __post_init__(self) -> None:
        if not any(d.weight > 0 and not d.validation for d in self.data):
            raise ConfigError(f"recipe {self.name}: expected data to learn from, got none")
        if len(self.data) > MOST_SETS:
            raise ConfigError(f"recipe {self.name}: expected at most {MOST_SETS} sets, got {len(self.data)}")
        sigmoid, classes = self.network.activation == "sigmoid", len(self.network.trained_ids)
        if sigmoid and classes != 2:
            raise ConfigError(f"recipe {self.name}: a sigmoid tells two classes apart, got {classes}")

    @property
    def digest(self) -> str:
        """Short hash of everything that shapes the result; a run resumes only under its own recipe.

        Settings left at their defaults do not count, so that a later version's new ones break no run.
        """
        parts = (self.network, self.schedule, *self.data, *self.teachers)
        said = [self.name, self.licence, self.start, len(self.data), *map(_changed, parts)]
        said += _changed(
            self.augment
        )  # nothing where all is at its default, as before there was such a section
        return hashlib.sha256(repr(said).encode()).hexdigest()[:12]


def _changed(config: Any) -> list[tuple[str, Any]]:
    """Settings that are not at their defaults."""
    values = ((f.name, getattr(config, f.name), f.default) for f in fields(config))
    return [(name, value) for name, value, default in values if value != default]


def load_recipe(path: Path, overrides: Iterable[str] = ()) -> Recipe:
    """Read a recipe.

    Args:
        path: YAML.
        overrides: `section.key=value`, values in YAML, such as `schedule.steps=200`.

    Raises:
        ConfigError: for a file that cannot be read, an unknown key or a value out of range.
    """
    tree = read_yaml(path)
    if isinstance(tree, dict):
        merge_overrides(tree, overrides)
    return recipe_from_dict(tree, str(path))


def recipe_from_dict(tree: Any, where: str = "recipe") -> Recipe:
    """Build a recipe from plain dicts, as `recipe_to_dict` gives them.

    The key `without` leaves out the data sets of some terms, such as `non-commercial`.

    Raises:
        ConfigError: as `load_recipe`.
    """
    if not isinstance(tree, dict) or "name" not in tree:
        raise ConfigError(f"{where}: expected keys with at least 'name', got {type(tree).__name__}")
    unknown = set(tree) - {f.name for f in fields(Recipe)} - {"without"}
    if unknown:
        raise ConfigError(f"{where}: unknown keys {', '.join(sorted(unknown))}")
    lists = {key: tree.get(key) or [] for key in ("data", "teachers")}
    for key, value in lists.items():
        if not isinstance(value, (list, tuple)):
            raise ConfigError(f"{where}: expected a list under '{key}', got {type(value).__name__}")
    data = tuple(build(DataConfig, d, f"data[{i}].") for i, d in enumerate(lists["data"]))
    licence, without = str(tree.get("licence", "")), str(tree.get("without") or "")
    if without:
        data = _without(data, without, where)
        licence = f"{licence} Trained without the sets whose terms are: {without}.".strip()
    return Recipe(
        name=str(tree["name"]),
        network=build(NetworkConfig, tree.get("network") or {}, "network."),
        schedule=build(ScheduleConfig, tree.get("schedule") or {}, "schedule."),
        augment=build(AugmentConfig, tree.get("augment") or {}, "augment."),
        data=data,
        teachers=tuple(build(TeacherConfig, t, f"teachers[{i}].") for i, t in enumerate(lists["teachers"])),
        licence=licence,
        start=str(tree.get("start") or ""),
    )


def _without(data: tuple[DataConfig, ...], without: str, where: str) -> tuple[DataConfig, ...]:
    """The data sets whose terms are none of these, which are given with commas."""
    unwanted, known = {term.strip() for term in without.split(",")}, {d.terms for d in data if d.terms}
    if not unwanted <= known:
        strange, names = ", ".join(sorted(unwanted - known)), ", ".join(sorted(known)) or "none"
        raise ConfigError(f"{where}: without: its data sets have the terms {names}; got {strange}")
    return tuple(d for d in data if d.terms not in unwanted)


def recipe_to_dict(recipe: Recipe) -> dict[str, Any]:
    """Plain dicts, lists, strings and numbers."""
    tree = asdict(recipe)
    tree["network"]["rates"] = list(recipe.network.rates)
    tree["data"], tree["teachers"] = list(tree["data"]), list(tree["teachers"])
    return tree
