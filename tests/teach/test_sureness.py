"""How sure a taught network may be, and how readily it says grass: no more daringly than before."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("torch")

from swardmap.teach import sureness
from swardmap.teach.learn import refit_sureness
from swardmap.teach.safety import FRESH, REPLAY, SAFETY
from swardmap.teach.sureness import IN_YOUR_LIGHT, STEP, bias_as_daring, daring
from swardmap.train.calibrate import LabelledLogits

GRASS = 1
EQUAL = (1.0, 1.0)


def logits_of(shift: float = 0.0, better: float = 0.0, n: int = 20_000) -> LabelledLogits:
    """What a network says that errs: grass shifted, and the classes farther apart by `better`."""
    rng = np.random.default_rng(0)
    truth = rng.integers(0, 3, n)
    logits = rng.normal(0, 1.5, (n, 3))
    logits[np.arange(n), truth] += 2.5 + better
    logits[:, GRASS] += shift
    return LabelledLogits(logits, truth, np.full(n, 1 / n))


def bias_of(
    old: LabelledLogits, new: LabelledLogits, temperature: float, shares: tuple[float, float] = EQUAL
) -> float:
    """Of a network that may be as daring as the old one, or in a share of it."""
    allowed = np.array(shares) * daring(old, GRASS, temperature, 0.0)
    return bias_as_daring([(new, allowed)], GRASS, temperature)


@pytest.mark.parametrize("shift", [-0.8, 0.0, 1.3])
def test_what_learning_added_to_grass_is_taken_back(shift: float) -> None:
    assert bias_of(logits_of(), logits_of(shift), 1.0) == pytest.approx(-shift, abs=STEP)


def test_a_better_network_may_say_grass_more_readily_and_is_no_more_daring() -> None:
    old, new = logits_of(), logits_of(better=1.0)
    bias = bias_of(old, new, 1.07)
    assert bias > 0.3
    allowed = daring(old, GRASS, 1.07, 0.0)
    assert (daring(new, GRASS, 1.07, bias) <= allowed).all()
    assert (daring(new, GRASS, 1.07, bias + 2 * STEP) > allowed).any()


def test_every_limit_is_held() -> None:
    old, new, lit = logits_of(), logits_of(better=1.0), logits_of(shift=0.6, better=1.0)
    allowed = daring(old, GRASS, 1.07, 0.0)
    limits = [(new, allowed), (lit, np.array(IN_YOUR_LIGHT) * allowed)]
    bias = bias_as_daring(limits, GRASS, 1.07)
    assert bias == bias_as_daring(limits[::-1], GRASS, 1.07)
    assert bias == min(bias_as_daring([one], GRASS, 1.07) for one in limits)
    assert daring(lit, GRASS, 1.07, bias)[1] <= IN_YOUR_LIGHT[1] * allowed[1] < allowed[1]


def test_sure_pixels_are_those_that_would_clear_a_cell() -> None:
    logits = np.log(np.array([[0.04, 0.96, 0.0], [0.06, 0.94, 0.0], [0.6, 0.4, 0.0], [0.1, 0.9, 0.0]]) + 1e-9)
    found = LabelledLogits(logits, np.array([0, 2, 0, 1]), np.full(4, 0.25))
    np.testing.assert_allclose(daring(found, GRASS, 1.0, 0.0), [2 / 3, 1 / 3])


@pytest.mark.parametrize(("fitted", "expected"), [(2.5, 2.5), (0.6, 1.1)])
def test_a_network_becomes_no_surer_than_the_start(
    fitted: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: dict[str, float] = {}
    monkeypatch.setattr(sureness, "read_spec", lambda _: SimpleNamespace(temperature=1.1))
    monkeypatch.setattr(sureness, "fit_temperature", lambda *_: fitted)
    monkeypatch.setattr(sureness, "with_spec", lambda _, **changes: written.update(changes))
    assert sureness.set_temperature(Path("new.onnx"), Path("old.onnx"), {}) == expected
    assert written == {"temperature": expected}


def test_neither_the_drive_nor_gardens_that_were_learnt_say_how_sure_it_may_be(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Long grass that stands counts as no lawn there: it made a network that knew it unsure of all lawns.

    In gardens that it has learnt the start is seldom wrong, and a network that may be no more so says grass
    nowhere.
    """
    asked: list[dict[str, int]] = []

    def note(_path: Path, _start: Path, *held: dict[str, list[object]]) -> None:
        asked.extend({k: len(v) for k, v in one.items()} for one in held)

    monkeypatch.setattr(sureness, "set_temperature", note)
    monkeypatch.setattr(sureness, "set_bias", note)
    refit_sureness(Path("new.onnx"), Path("old.onnx"), np.array([[0.02, 0.09, 0.1]]))
    fresh = {file.read_bytes() for file in (FRESH / "images").iterdir()}
    assert asked == [{"fresh": len(fresh)}, {"fresh": len(fresh)}, {"lit": len(fresh)}]
    refit_sureness(Path("new.onnx"), Path("old.onnx"), np.zeros((0, 3)))
    assert asked[3:] == [{"fresh": len(fresh)}, {"fresh": len(fresh)}, {}]  # whose light is not known
    assert len(fresh) >= 40
    for other in (REPLAY, SAFETY):
        assert not fresh & {file.read_bytes() for file in (other / "images").iterdir()}


@pytest.mark.parametrize(("old_lit", "expected"), [(-9.0, -0.6), (0.6, 0.0), (0.3, -0.3)])
def test_in_the_drives_light_it_may_be_as_daring_as_the_old_one_was(
    old_lit: float, expected: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Networks that err alike, whose grass is shifted in that light: the new one's by 0.6."""
    shifts = {("old", "plain"): 0.0, ("old", "lit"): old_lit, ("new", "plain"): 0.0, ("new", "lit"): 0.6}
    monkeypatch.setattr(
        sureness, "labelled_logits", lambda path, sets: logits_of(shifts[path.stem, next(iter(sets))])
    )
    monkeypatch.setattr(
        sureness, "read_spec", lambda _: SimpleNamespace(temperature=1.0, channel_ids=(0, GRASS, 2))
    )
    monkeypatch.setattr(sureness, "IN_YOUR_LIGHT", EQUAL)
    written: list[float] = []
    monkeypatch.setattr(sureness, "shift_grass", lambda _, bias: written.append(bias))
    bias = sureness.set_bias(Path("new.onnx"), Path("old.onnx"), {"plain": []}, {"lit": []})
    assert written == [bias]
    assert bias == pytest.approx(expected, abs=STEP)
