"""The page of a training: curves, examples and every validation, in one file that works offline."""

from base64 import b64encode
from collections.abc import Mapping, Sequence
from typing import Any

from swardmap.eval import charts
from swardmap.eval.metrics import UNDEFINED
from swardmap.eval.pages import render, told_command

SHOWN = ("accuracy", "grass_iou", "person_iou", "obstacle_called_grass")
"""Figures of the cards; those of a run that has none of them are left out."""
MOST_CHARTS = 24


def training_page(
    name: str, history: Sequence[Mapping[str, Any]], steps: int, examples: bytes | None, command: str
) -> str:
    """The whole page.

    Args:
        name: of the recipe.
        history: figures of each validation, as `curve.json` holds them.
        steps: that the recipe asks for.
        examples: PNG of photos and masks, or None.
        command: that trained.
    """
    last = history[-1] if history else {}
    keys = list(dict.fromkeys(key for figures in history for key in figures if key != "step"))
    shares = [key for key in keys if all(_is_share(f.get(key)) for f in history)]
    done = last.get("step", 0)
    return render(
        "train.html",
        title=f"How {name} was trained",
        subtitle=f"{done} of {steps} steps, {len(history)} validations",
        cards=[
            (_text(last[key]), key.replace("_", " "), _best(history, key)) for key in SHOWN if key in last
        ],
        charts=[(key.replace("_", " "), _chart(history, key)) for key in shares[:MOST_CHARTS]],
        heads=["step", *(key.replace("_", " ") for key in keys)],
        rows=[[str(figures["step"]), *(_text(figures.get(key)) for key in keys)] for figures in history],
        examples=None if examples is None else f"data:image/png;base64,{b64encode(examples).decode()}",
        command=told_command(command),
    )


def _is_share(value: Any) -> bool:
    return value is None or 0 <= value <= 1


def _chart(history: Sequence[Mapping[str, Any]], key: str) -> Any:
    from markupsafe import Markup

    points = [(float(f["step"]), float(f[key])) for f in history if f.get(key) is not None]
    drawn = charts.curve(points, [], "steps", key.replace("_", " "), key.replace("_", " "))
    return Markup(drawn)  # noqa: S704 - charts escape what they are told


def _best(history: Sequence[Mapping[str, Any]], key: str) -> str:
    """The best value and its step; errors are best where they are small."""
    known = [(f[key], f["step"]) for f in history if f.get(key) is not None]
    if not known:
        return ""
    value, step = (min if key == "obstacle_called_grass" else max)(known)
    return f"best {_text(value)} at step {step}"


def _text(value: float | None) -> str:
    return UNDEFINED if value is None else f"{value:.4f}"
