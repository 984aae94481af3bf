"""What of an evaluation to look at first: the frames with most at stake, and the worst things in them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from swardmap.eval.gathered import Gathered
from swardmap.eval.look_again import FrameAgain, look_again, worst_things

Results = Mapping[str, Any]
FRAMES_SHOWN = 10
THINGS_SHOWN = 40


def worst_frames(run: Gathered, results: Results, most: int = FRAMES_SHOWN) -> list[tuple[int, FrameAgain]]:
    """The frames with most at stake, looked at again: index and frame, as far as they can still be read."""
    found = ((index, look_again(*run.locate(index))) for index in results["worst"][:most])
    names = {r["index"]: r["name"] for r in run.records if r.get("name")}
    return [
        (index, replace(seen, name=names.get(index, seen.name))) for index, seen in found if seen is not None
    ]


def things_first(again: Sequence[tuple[int, FrameAgain]]) -> list[tuple[int, FrameAgain]]:
    """Frames in the order of the worst things in them, so that the first of the list can be looked at."""
    order = [thing["index"] for thing in worst_things(again, 0.0)]
    rank = {index: place for place, index in reversed(list(enumerate(order)))}
    return sorted(again, key=lambda each: rank.get(each[0], len(order)))


def things_view(results: Results, again: Sequence[tuple[int, FrameAgain]], shown: set[str]) -> dict[str, Any]:
    """Rows of the worst things, each with its frame on the page if that is shown."""
    margin_m = results["margin_in_use_m"]
    things = worst_things(again, margin_m)
    rows = [
        {
            **thing,
            "id": f"frame-{thing['index']}",
            "has_view": f"frame-{thing['index']}" in shown,
            "state": _state(thing, margin_m),
            "needs": "no mark at all" if thing["needs_m"] is None else f"{thing['needs_m']:.2f} m",
        }
        for thing in things[:THINGS_SHOWN]
    ]
    dangerous = (
        results["metrics"]["overall"]["things_dangerous"]["count"] if results["metrics"]["overall"] else 0
    )
    listed = sum(thing["dangerous"] for thing in things[:THINGS_SHOWN])
    return {"rows": rows, "margin_m": margin_m, "dangerous": int(dangerous), "listed": listed,
            "frames": len(again)}  # fmt: skip


def _state(thing: Mapping[str, Any], margin_m: float) -> str:
    """What the map makes of a thing, in words."""
    if thing["missed"]:
        return "missed, and called free" if thing["free_cells"] else "missed, left unknown"
    if thing["dangerous"]:
        return "reaches out of its marks, and beyond the margin"
    return "reaches out of its marks, within the margin" if margin_m else "reaches out of its marks"
