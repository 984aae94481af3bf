"""What the index of a bundle says of models and textures, known without reading their shape or pixels."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Source:
    """Where an asset comes from, for the attribution.

    Attributes:
        title: what its author calls it.
        author: who made it.
        licence: SPDX identifier, such as CC-BY-3.0.
        package: package and version that it was baked from.
        changes: what the bake did to it.
    """

    title: str
    author: str
    licence: str
    package: str
    changes: str = ""

    def __str__(self) -> str:
        changes = f"; {self.changes}" if self.changes else ""
        return f"'{self.title}' by {self.author}, {self.licence}, from {self.package}{changes}"


@dataclass(frozen=True, slots=True)
class ModelEntry:
    """What the index says of a model, known without reading its shape.

    Attributes:
        name, kind: such as park-bench of kind bench.
        low_m, high_m: corners of the box around it.
        triangles: how many.
        source: for the attribution.
        pose: of a person or animal: standing, sitting, lying ...; empty for the rest.
        seat_m: height of the seat that somebody who sits needs beneath; 0 = none, or sits on the ground.
        tags: such as child, female, conifer.
    """

    name: str
    kind: str
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    triangles: int
    source: Source
    pose: str = ""
    seat_m: float = 0.0
    tags: tuple[str, ...] = ()

    @property
    def size_m(self) -> tuple[float, float, float]:
        """Length (x, back to front), width (y) and height (z)."""
        x, y, z = (high - low for low, high in zip(self.low_m, self.high_m, strict=True))
        return x, y, z


@dataclass(frozen=True, slots=True)
class TextureEntry:
    """What the index says of a texture.

    Attributes:
        name, kind: such as gravel-grey of kind gravel; `skin` if it belongs to a model.
        tile_m: how far it reaches on a surface before it repeats (width, height); 0 = it does not.
        source: for the attribution.
    """

    name: str
    kind: str
    tile_m: tuple[float, float]
    source: Source


def model_entry_of(name: str, entry: Mapping[str, Any]) -> ModelEntry:
    """The entry of a model, as the index has it."""
    low, high = ((float(x), float(y), float(z)) for x, y, z in (entry["low_m"], entry["high_m"]))
    source, tags = Source(**entry["source"]), tuple(str(tag) for tag in entry["tags"])
    return ModelEntry(
        name, str(entry["kind"]), low, high, int(entry["triangles"]), source,
        str(entry["pose"]), float(entry["seat_m"]), tags,
    )  # fmt: skip


def texture_entry_of(name: str, entry: Mapping[str, Any]) -> TextureEntry:
    """The entry of a texture, as the index has it."""
    width, height = (float(value) for value in entry["tile_m"])
    return TextureEntry(name, str(entry["kind"]), (width, height), Source(**entry["source"]))
