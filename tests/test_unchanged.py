"""What a rebuild of the structure must not change: digests of maps, costs, counts, tables and gardens.

A digest says nothing about what is right; the other tests do. It says that a change which was meant to move
code has moved nothing else. A change that is meant to change results writes the digests anew, and says so:

    python -m tests.test_unchanged
"""

import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import swardmap
from swardmap import load_config, map_recording

DEMO = Path(swardmap.__file__).parent / "data" / "demo"
DIGESTS = Path(__file__).parent / "unchanged.json"


def digest(*parts: Any) -> str:
    """Of arrays by shape, type and bytes, of plain data by its JSON with floats to nine digits."""
    state = sha256()
    for part in parts:
        if isinstance(part, np.ndarray):
            state.update(f"{part.shape}{part.dtype}".encode())
            state.update(np.ascontiguousarray(part).tobytes())
        else:
            state.update(json.dumps(_rounded(part), sort_keys=True).encode())
    return state.hexdigest()[:16]


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return float(f"{value:.9g}")
    if isinstance(value, dict):
        return {str(key): _rounded(item) for key, item in value.items()}
    return [_rounded(item) for item in value] if isinstance(value, list | tuple) else value


def mapped(*settings: str) -> str:
    """Map, costmap and counts of the demo's drive with its true labels."""
    config = load_config(overrides=["segmenter.name=truth", "source.stop=12", *settings])
    run = map_recording(DEMO, config=config)
    assert run.grid is not None
    assert run.costmap is not None
    spec = run.grid.spec
    counts = {k: v for k, v in run.summary["pixels"].items() if isinstance(v, int)}
    return digest(run.grid.classes, [*spec.origin_m, *spec.shape], run.costmap.costs, counts)


def evaluated(location: str, folder: Path, *settings: str) -> str:
    """Tables, margin and budget of an evaluation."""
    from swardmap.eval.dataset import DatasetSpec
    from swardmap.eval.results import results
    from swardmap.eval.run import evaluate, make_plan

    config = load_config(overrides=list(settings))
    plan = make_plan(DatasetSpec(location, config.source), config)
    found = results(plan, evaluate(plan, folder, workers=1))
    leave = ("swardmap", "fingerprint", "command", "dataset")
    found["margin"].pop("measured_with")  # settings, which may become more
    text = json.dumps({key: value for key, value in found.items() if key not in leave})
    return digest(json.loads(text.replace(location, "here")))


def living(folder: Path) -> str:
    """Evidence of a saved map, tile by tile."""
    config = load_config(
        overrides=["segmenter.name=truth", "source.stop=12", "grid.mode=evidence", "output.pictures=0"]
    )
    map_recording(DEMO, folder / "map", config)
    with np.load(folder / "map" / "living.npz", allow_pickle=False) as saved:
        return digest(*(saved[name] for name in sorted(saved.files) if saved[name].dtype.kind in "iu"))


def garden() -> str:
    """A garden of simple solids: depth and labels of one view."""
    from swardmap.synth.analytic import VGA, garden_scene, lane_poses, render

    frame = render(garden_scene(3), VGA.scaled_to(160, 120), lane_poses(1)[0], 0, "x")
    assert frame.labels is not None
    return digest(frame.depth, frame.labels, frame.rgb)


CASES: dict[str, Callable[[Path], str]] = {
    "map": lambda folder: mapped(),
    "map plain": lambda folder: mapped("road=staged", "source.stop=3"),
    "map with geometry": lambda folder: mapped("geometry.enabled=true"),
    "map of evidence with geometry": lambda folder: mapped("grid.mode=evidence", "geometry.enabled=true"),
    "map by colour": lambda folder: mapped("segmenter.name=colour", "costmap.margin_m=0.2"),
    "saved map of evidence": living,
    "evaluation of the demo": lambda folder: evaluated(
        str(DEMO), folder / "demo", "segmenter.name=colour", "source.stop=6"
    ),
    "evaluation of analytic gardens": lambda folder: evaluated(
        "analytic:scenes=2,frames=3,width=320", folder / "analytic", "segmenter.name=colour"
    ),
    "garden of solids": lambda folder: garden(),
}


@pytest.mark.parametrize("name", CASES)
def test_results_are_what_they_were(name: str, tmp_path: Path) -> None:
    assert CASES[name](tmp_path) == json.loads(DIGESTS.read_text())[name]


if __name__ == "__main__":
    from tempfile import TemporaryDirectory

    found = {}
    for case, make in CASES.items():
        with TemporaryDirectory() as scratch:
            found[case] = make(Path(scratch))
    DIGESTS.write_text(json.dumps(found, indent=2) + "\n")
