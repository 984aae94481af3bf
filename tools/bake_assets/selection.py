"""Which models of Debian's sweethome3d-furniture go into the garden, and as what."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Choice:
    """A model to take.

    Attributes:
        model: its name in the catalogue (file name of the OBJ).
        kind: of garden thing.
        name: in the bundle; the catalogue's, in lower case with dashes, if empty.
        yaw_deg: turn about z that brings its front to +x.
        pose, seat_m, tags: see swardmap.synth.assets.ModelEntry. Seats were measured on the baked models: the
            lowest points behind the knees, from x = -0.4 m to -0.1 m.
        triangles: at most about so many.
        scale: where the catalogue's size is wrong for a garden.
        stone: made of stone from head to foot, whatever the colours of the model are.
    """

    model: str
    kind: str
    name: str = ""
    yaw_deg: float = 0.0
    pose: str = ""
    seat_m: float = 0.0
    tags: tuple[str, ...] = ()
    triangles: int = 3000
    scale: float = 1.0
    stone: bool = False


def _person(model: str, pose: str, *tags: str, seat_m: float = 0.0) -> Choice:
    return Choice(
        model, "person", pose=pose, tags=tags, seat_m=seat_m, triangles=12000 if "-01-" in model else 19000
    )


PEOPLE = (
    _person("female01", "standing", "female"),
    _person("female02", "standing", "female"),
    _person("female03", "standing", "female"),
    _person("male01", "standing", "male"),
    _person("male02", "standing", "male"),
    _person("male03", "standing", "male"),
    _person("holdingMale01", "standing", "male", "arms-out"),
    _person("holdingFemale01", "standing", "female", "arms-out"),
    _person("holdingFemale02", "standing", "female", "arms-out"),
    _person("holdingFemale03", "standing", "female", "arms-out"),
    _person("sitMale01", "sitting", "male", seat_m=0.37),
    _person("sitMale02", "sitting", "male", seat_m=0.46),
    _person("sitMale03", "sitting", "male"),
    _person("sitFemale01", "sitting", "female"),
    _person("sitFemale02", "sitting", "female"),
    _person("sitFemale03", "sitting", "female", seat_m=0.46),
    _person("lyingDownFemale01", "lying", "female"),
    _person("lyingDownMale01", "lying", "male"),
    _person("lyingDownMale02", "lying", "male"),
    _person("boyLying", "lying", "child", "male"),
    _person("boySitting", "sitting", "child", "male", seat_m=0.42),
    _person("boyStanding", "standing", "child", "male"),
    _person("girlSittingGround", "sitting", "child", "female"),
    _person("girlSittingTable", "sitting", "child", "female", seat_m=0.44),
    _person("girlStanding", "standing", "child", "female"),
    _person("female-01-casual-clothing", "standing", "female"),
    _person("male-01-suit", "standing", "male"),
)

ANIMALS = (
    Choice("dog", "dog", pose="sitting"),
    Choice("bulldog", "dog", pose="standing"),
    Choice("cat", "cat", pose="sitting"),
    Choice("siameseCat", "cat", pose="standing"),
    Choice("rabbit", "rabbit", pose="sitting"),
    Choice("chicken", "chicken", pose="standing"),
    Choice("horse", "horse", pose="standing", triangles=5000),
)

STATUES = (
    Choice("female02", "statue", "statue-woman", triangles=13000, stone=True),
    Choice("male-01-suit", "statue", "statue-man", triangles=9000, stone=True),
    Choice("sitMale03", "statue", "statue-sitting", triangles=6000, stone=True),
    Choice("boyStanding", "statue", "statue-small", triangles=17000, scale=0.42, stone=True),
    Choice("bonecoDeNeve", "statue", "snowman"),
    Choice("deer", "statue", "deer-statue", scale=3.0),
    Choice("teddyBear", "statue", "teddy-bear"),
    Choice("doll", "toy", "doll", scale=2.5),
    Choice("stoneLantern", "lantern", "stone-lantern-1"),
    Choice("lantern", "lantern", "stone-lantern-2"),
    Choice("fountain", "fountain", triangles=5000),
)

PLANTS = (
    Choice("hedge", "hedge", "hedge-1", triangles=9000),
    Choice("high-hedge", "hedge", "hedge-2", triangles=9000),
    Choice("hedgeTextured", "hedge", "hedge-3", triangles=9000),
    Choice("bush", "shrub", "shrub-1", triangles=8000),
    Choice("bamboo", "shrub", "bamboo", triangles=8000),
    Choice("yuccaPlant", "shrub", "yucca", triangles=5000),
    Choice("decorativePlant", "planter", "decorative-plant", triangles=5000),
    Choice("maceta", "planter", "flower-pot", triangles=3500),
    Choice("spatifilum", "planter", "spathiphyllum", triangles=5000),
    Choice("mediumIndoorPlant", "planter", "leafy-plant", triangles=5000),
    Choice("flowerBox", "planter", "flower-box", triangles=6000),
    Choice("tulips", "planter", "tulips-1", triangles=6000),
    Choice("tulip", "planter", "tulips-2", triangles=6000),
    Choice("cypress", "tree", "cypress", triangles=9000),
    Choice("rock1", "rock"),
    Choice("rock2", "rock"),
    Choice("rock3", "rock"),
)

FURNITURE = (
    Choice("bench", "bench"),
    Choice("painted-bench", "bench"),
    Choice("wood_bank", "bench", "wooden-bench"),
    Choice("littlebank", "bench", "little-bench"),
    Choice("concrete-bench", "bench"),
    Choice("foldingChair", "chair", "folding-stool"),
    Choice("cafe-chair", "chair"),
    Choice("silla_teca", "chair", "teak-chair"),
    Choice("plastic_chair", "chair", "plastic-chair"),
    Choice("plasticChair", "chair", "plastic-armchair"),
    Choice("rattanArmchair", "chair", "rattan-armchair"),
    Choice("rattanSofa", "chair", "rattan-sofa"),
    Choice("children_chair", "chair", "children-chair"),
    Choice("wheelchair", "wheelchair", triangles=4000),
    Choice("relaxChair", "lounger", "relax-chair"),
    Choice("deckChair", "lounger", "deck-chair"),
    Choice("poolLounge", "lounger", "pool-lounge"),
    Choice("beach_chair", "lounger", "beach-chair"),
    Choice("chair_deck", "lounger", "long-deck-chair"),
    Choice("hammock", "lounger", "hammock", triangles=4000),
    Choice("cafe-table", "table"),
    Choice("rattanTable", "table", "rattan-table"),
    Choice("folding-table", "table"),
    Choice("children_table", "table", "children-table"),
    Choice("ext_table", "table", "low-table"),
    Choice("table_tennis", "table", "table-tennis", triangles=4000),
    Choice("umbrella", "parasol"),
    Choice("barnum", "pavilion", "pavilion"),
    Choice("campingTent", "tent", "camping-tent"),
)

PLAY = (
    Choice("trampoline", "trampoline"),
    Choice("childSwing", "swing", "double-swing", triangles=4000),
    Choice("child_swing", "swing", "swing-and-slide", triangles=4000),
    Choice("parque", "slide", "play-tower", triangles=6000),
    Choice("seesaw", "seesaw"),
    Choice("sandpit", "sandpit"),
    Choice("childHut", "playhut", "play-hut", triangles=4500),
    Choice("doll-house", "toy"),
    Choice("caballito", "toy", "rocking-horse", yaw_deg=90),
    Choice("toyTrain", "toy", "toy-train", yaw_deg=90, scale=1.6),
    Choice("ballonFoot", "ball", "soccer-ball", triangles=1500),
    Choice("basketball", "ball", triangles=1200),
    Choice("football-goal", "goal", "small-goal"),
    Choice("tricycle", "tricycle"),
    Choice("skateboard", "skateboard", triangles=1800),
    Choice("stroller", "stroller", triangles=4000),
    Choice("scooter2", "scooter", "motor-scooter", triangles=5000),
    Choice("bicycle", "bicycle", "bicycle-1", triangles=4000),
    Choice("round-swimming-pool", "pool", "round-pool", triangles=5000),
    Choice("air-mattress", "mattress"),
    Choice("backpack", "bag"),
    Choice("tennisRacket", "toy", "tennis-racket", triangles=1500),
    Choice("rowboat", "boat"),
)

WORK = (
    Choice("mower", "mower", "hand-mower"),
    Choice("wheelbarrow", "wheelbarrow", yaw_deg=-90, triangles=4000),
    Choice("hose-reel", "hose", triangles=4000),
    Choice("pelle", "tool", "shovel"),
    Choice("broom", "tool", "broom"),
    Choice("shovel", "tool", "dustpan"),
    Choice("marteau", "tool", "hammer", triangles=1000),
    Choice("scie-egoine", "tool", "saw", triangles=1000),
    Choice("step-ladder-metal", "ladder"),
    Choice("step-ladder-wood", "ladder"),
    Choice("clothes-horse", "laundry"),
    Choice("clothes-basket", "basket"),
    Choice("wood_logs", "logs", "wood-logs"),
    Choice("pallet", "pallet"),
    Choice("barrel", "barrel"),
    Choice("crate", "crate"),
    Choice("cardboard-box", "crate"),
    Choice("cone", "cone"),
    Choice("dog-house", "dog-house"),
    Choice("garden-hut", "shed"),
    Choice("fire-hydrant", "pole"),
    Choice("mofx_mailbox", "pole", "mailbox"),
    Choice("residential-trashcan", "bin", "trashcan-1"),
    Choice("park-trashcan", "bin", "trashcan-2"),
    Choice("dustbin", "bin", "bucket"),
    Choice("farola1", "lamp", "lamp-1", triangles=4000),
    Choice("classic-lamppost", "lamp", "lamp-2"),
    Choice("park-light", "lamp", "lamp-3"),
    Choice("fence", "fence", "iron-fence", triangles=3500),
    Choice("iron-railing-1", "railing", "iron-railing", triangles=3000),
    Choice("concept-sedan-01v1", "car", "car-sedan", triangles=7000),
    Choice("smart-car", "car", "car-small", triangles=7000),
    Choice("suv", "car", "car-suv", triangles=7000),
    Choice("peugeot-308", "car", "car-cabrio", triangles=7000),
)
BUNDLES = {
    "people-dressed": PEOPLE, "animals": (*ANIMALS, *STATUES), "plants": PLANTS,
    "objects": (*FURNITURE, *PLAY, *WORK),
}  # fmt: skip
