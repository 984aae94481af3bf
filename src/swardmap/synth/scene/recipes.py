"""What stands in gardens: how often, where, and how it is made."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from swardmap.labels import GRASS, OTHER, LabelClass
from swardmap.synth.model import Model
from swardmap.synth.scene import furniture, plants, small_objects

Maker = Callable[[np.random.Generator], Model]


@dataclass(frozen=True, slots=True)
class ThingKind:
    """One kind of thing.

    Attributes:
        kind: as in Thing.
        where: a sort of site (see Sites.of).
        mean: how many a lot of 500 square metres has on average; it grows with the root of the area.
        make: a model by chance; None = only from the bundle.
        assets: kinds of the asset bundle that do as well.
        room_m: free space around it.
        upright: stands vertically however the ground lies; else it leans with the ground.
        variants: different models in one garden.
        scale: smallest and largest.
        foot_m: only what is lower than this takes up ground (trees: the trunk).
        label: of its pixels. Flowers and leaves of the lawn below 5 cm are grass.
        rooted: grows or is dug in: on a slope a part of its foot may be in the ground.
    """

    kind: str
    where: str
    mean: float
    make: Maker | None
    assets: tuple[str, ...] = ()
    room_m: float = 0.1
    upright: bool = False
    variants: int = 1
    scale: tuple[float, float] = (1.0, 1.0)
    foot_m: float = np.inf
    label: LabelClass = OTHER
    rooted: bool = False


RECIPES: tuple[ThingKind, ...] = (
    ThingKind("tree", "lawn", 1.8, plants.tree, ("tree",), 1.3, True, 2, (0.85, 1.2), 0.5, rooted=True),
    ThingKind("tree", "bed", 1.0, plants.tree, ("tree",), 1.0, True, 2, (0.8, 1.1), 0.5, rooted=True),
    ThingKind("playhouse", "middle", 0.14, None, ("playhut", "pavilion"), 0.5),
    ThingKind("tent", "lawn", 0.1, None, ("tent",), 0.3),
    ThingKind("swing", "lawn", 0.4, furniture.play_frame, ("swing", "slide", "seesaw"), 0.4),
    ThingKind("trampoline", "lawn", 0.2, furniture.trampoline, ("trampoline",), 0.3),
    ThingKind("raised bed", "lawn", 0.5, plants.raised_bed, (), 0.3, rooted=True),
    ThingKind("washing line", "middle", 0.35, furniture.washing_line_post, (), 0.2, True),
    ThingKind("bench", "path", 0.7, furniture.bench, ("bench",), 0.15),
    ThingKind("table", "terrace", 0.6, furniture.table, ("table",), 0.15),
    ThingKind("table", "lawn", 0.3, furniture.table, ("table", "parasol"), 0.3),
    ThingKind("chair", "terrace", 1.2, furniture.chair, ("chair",), 0.1),
    ThingKind("chair", "lawn", 0.6, furniture.chair, ("chair", "lounger"), 0.1),
    ThingKind(
        "vehicle", "lawn", 0.5, None, ("bicycle", "tricycle", "stroller", "wheelchair", "scooter"), 0.15
    ),
    ThingKind("play", "lawn", 0.5, None, ("goal", "pool", "sandpit", "mattress"), 0.2),
    ThingKind("statue", "lawn", 0.45, None, ("statue",), 0.2),
    ThingKind("laundry", "lawn", 0.3, None, ("laundry",), 0.2),
    ThingKind("fountain", "middle", 0.1, None, ("fountain",), 0.4, True, rooted=True),
    ThingKind("trellis", "rim", 0.3, plants.trellis, (), 0.1, True, rooted=True),
    ThingKind("bin", "rim", 0.5, furniture.bin_or_barrel, ("bin", "barrel", "crate", "dog-house"), 0.1),
    ThingKind("wheelbarrow", "lawn", 0.35, furniture.wheelbarrow, ("wheelbarrow", "mower", "ladder")),
    ThingKind("shrub", "bed", 7.0, plants.shrub, ("shrub",), 0.0, False, 3, (0.7, 1.15), rooted=True),
    ThingKind("shrub", "lawn", 1.6, plants.shrub, ("shrub",), 0.3, False, 2, (0.8, 1.15), rooted=True),
    ThingKind("flowers", "bed", 4.0, plants.flowers, (), 0.0, False, 2, (0.8, 1.2), rooted=True),
    ThingKind("planter", "terrace", 0.4, furniture.planter, ("planter", "basket")),
    ThingKind("flower pot", "terrace", 0.8, plants.flower_pot, ("planter",), 0.05, False, 2),
    ThingKind("flower pot", "lawn", 0.7, plants.flower_pot, ("planter",), 0.1, False, 2),
    ThingKind("pole", "lawn", 0.8, furniture.pole, ("pole", "cone"), 0.2, True, rooted=True),
    ThingKind("lamp post", "path", 0.5, furniture.lamp_post, ("lamp",), 0.1, True, rooted=True),
    ThingKind("sign", "lawn", 0.2, furniture.sign_board, (), 0.1, True, rooted=True),
    ThingKind("garden figure", "lawn", 0.6, small_objects.garden_figure, ("lantern",), 0.15),
    ThingKind("rock", "bed", 0.8, small_objects.rock, ("rock",), 0.0, False, 2, (0.6, 1.2), rooted=True),
    ThingKind("rock", "lawn", 0.9, small_objects.rock, ("rock",), 0.1, False, 2, (0.5, 1.2), rooted=True),
    ThingKind("stump", "lawn", 0.4, plants.stump, ("logs",), 0.2, rooted=True),
    ThingKind("log", "lawn", 0.3, plants.log, (), 0.2, rooted=True),
    ThingKind("test body", "middle", 0.45, small_objects.iso_test_body, (), 0.3),
    ThingKind("animal", "lawn", 0.7, small_objects.animal, ("dog", "cat", "chicken", "rabbit"), 0.2),
    ThingKind("ball", "lawn", 1.3, small_objects.ball, ("ball",), 0.1, False, 2),
    ThingKind("toy", "lawn", 1.2, small_objects.toy, ("toy", "skateboard", "bag"), 0.1, False, 2),
    ThingKind("hose", "lawn", 0.5, small_objects.hose, ("hose",), 0.1),
    ThingKind("tool", "lawn", 0.8, small_objects.tool, ("tool",), 0.1),
    ThingKind("low object", "lawn", 1.8, small_objects.low_object, ("low object",), 0.15, False, 2),
    ThingKind("twigs", "lawn", 0.7, small_objects.bough, (), 0.05, rooted=True),
)

GRASSY: tuple[ThingKind, ...] = (
    ThingKind(
        "daisies", "lawn", 9.0, plants.daisies, (), 0.0, False, 2, (0.9, 1.1), label=GRASS, rooted=True
    ),
    ThingKind(
        "fallen leaves",
        "lawn",
        7.0,
        plants.fallen_leaves,
        (),
        0.0,
        False,
        2,
        (0.9, 1.0),
        label=GRASS,
        rooted=True,
    ),
)

KINDS = frozenset(recipe.kind for recipe in (*RECIPES, *GRASSY)) | {"ground cover"}
"""What a garden can be asked to have more or less of."""
