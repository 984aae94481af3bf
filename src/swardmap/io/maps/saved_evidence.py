"""What saved evidence is worth under the settings of the run that goes on from it.

Evidence means something only beside its settings: a cell called free under a limit of 30 nats stays free
through dozens of frames that all see an obstacle, and lawn seen without geometry is not lawn seen with it.
So a saved map carries its settings. Under the same ones it goes on to the bit; under another sensor model its
sums are brought within the new limits; where anything else differed that decides what is seen, only hazards
are kept, and what was called free is unknown until it is seen again.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from swardmap.config import Config, EvidenceConfig, config_to_dict
from swardmap.labels import MapClass
from swardmap.mapping.sensor_model import PER_NAT, Cells

LEFT_OUT = {
    "grid": ("mode", "resolution_m", "origin_m", "size_m", "resume"),  # the lattice is checked by itself
    "segmenter": ("threads", "provider"),
    "evidence": ("window_m",),
}
SECTIONS = ("cloud", "grid", "geometry", "segmenter", "evidence")


def settings_of_evidence(config: Config) -> dict[str, Any]:
    """The settings that decide what frames say of cells, and what cells make of it; section by section."""
    plain = config_to_dict(config)
    return {
        section: {k: v for k, v in plain[section].items() if k not in LEFT_OUT.get(section, ())}
        for section in SECTIONS
    }


@dataclass(frozen=True, slots=True)
class Difference:
    """In what a saved map was made otherwise.

    Attributes:
        model: names of settings of the sensor model.
        seeing: names of settings that decide what a frame says; or that nothing is known of them.
    """

    model: tuple[str, ...] = ()
    seeing: tuple[str, ...] = ()

    def __str__(self) -> str:
        names = (*self.seeing, *self.model)
        return ", ".join(names[:4]) + (f" and {len(names) - 4} more" if len(names) > 4 else "")


def difference(saved: str | None, config: Config) -> Difference:
    """Compare the settings in a saved map, as JSON, with those of the run that goes on.

    Raises:
        ValueError: if they are no such settings.
    """
    if saved is None:
        return Difference(seeing=("settings that it does not tell",))
    there = json.loads(saved)
    if not isinstance(there, dict) or not all(isinstance(v, dict) for v in there.values()):
        raise ValueError("expected its settings section by section")
    before, now = _flat(there), _flat(settings_of_evidence(config))
    names = sorted(name for name in before.keys() | now.keys() if before.get(name) != now.get(name))
    model = tuple(name for name in names if name.startswith("evidence."))
    return Difference(model, tuple(name for name in names if name not in model))


def _flat(sections: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {f"{section}.{key}": v for section, values in sections.items() for key, v in values.items()}


def check_cells(cells: Cells, model: EvidenceConfig | None) -> None:
    """Hold that cells are what a sensor model can make of sightings.

    Args:
        cells: of a saved map; arrays of any shape.
        model: they were made with; None = unknown, then only what no model can make is refused.

    Raises:
        ValueError: for a free cell without evidence, or evidence beyond its limit.
    """
    evidence, person, classes = cells.evidence, cells.person, cells.classes
    if classes.size and classes.max() > max(MapClass):
        raise ValueError(f"expected classes 0..{int(max(MapClass))}, got {classes.max()}")
    if person.size and person.min() < 0:
        raise ValueError("expected evidence of persons of 0 or more")
    if ((classes == MapClass.GRASS) & (evidence > 0)).any():
        raise ValueError("a cell is called grass against its evidence")
    if ((classes == MapClass.GRASS) & (evidence == 0)).any():
        raise ValueError("a cell is called grass without evidence")
    if model is not None and evidence.size:
        low, high = -_units(model.free_limit), _units(max(model.obstacle_limit, model.person_limit))
        if evidence.min() < low or evidence.max() > high:
            raise ValueError(f"expected evidence of {low}..{high}, got {evidence.min()}..{evidence.max()}")


def without_doubt(cells: Cells) -> NDArray[np.uint8]:
    """Classes of cells to be saved: one called free whose evidence has come to nothing is unknown."""
    free = (cells.classes == MapClass.GRASS) & (cells.evidence >= 0)
    return np.where(free, np.uint8(MapClass.UNKNOWN), cells.classes)


def adapted(cells: Cells, found: Difference, model: EvidenceConfig) -> Cells:
    """Cells as a run with another model may go on from them; as they are where nothing differs.

    No cell of the result needs more sightings to be marked than one that the run itself had made.
    """
    if not (found.model or found.seeing):
        return cells
    hazard = cells.classes >= MapClass.OBSTACLE
    person = np.minimum(cells.person, _units(model.person_limit)).astype(np.int16)
    limit = np.where(person > 0, _units(model.person_limit), _units(model.obstacle_limit))
    lowest = np.where(hazard, 1 - _units(model.clear_at), 0 if found.seeing else -_units(model.free_limit))
    evidence = np.clip(cells.evidence, lowest, limit).astype(np.int16)
    free = (cells.classes == MapClass.GRASS) & (evidence <= -_units(model.free_at))
    marked = hazard | (evidence >= _units(model.mark_at))
    named = np.where(person > 0, np.uint8(MapClass.PERSON), np.uint8(MapClass.OBSTACLE))
    classes = np.where(marked, named, np.where(free, np.uint8(MapClass.GRASS), np.uint8(MapClass.UNKNOWN)))
    return Cells(evidence, np.where(marked, person, np.int16(0)), classes)


def _units(nats: float) -> int:
    return round(PER_NAT * nats)
