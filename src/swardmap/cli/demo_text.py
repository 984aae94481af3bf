"""What the demo says at its end, in words that need no manual."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

IN_WORDS = {0.99: "99 of 100", 0.95: "19 of 20", 0.9: "9 of 10", 0.8: "4 of 5", 0.75: "3 of 4", 0.5: "half"}
"""Shares of `margin.PLAIN_SHARES`, as people say them."""

NEXT = """\
Next, with a drive of your own (a bag, a folder of images, a camera):
  swardmap map MY_DRIVE -o my_map                      its map, and a page to look at
  swardmap convert MY_DRIVE photos --images            photos to draw what is lawn and what is not
  swardmap evaluate MY_DRIVE -o my_run --masks DRAWN   a margin for your lawn: my_run/margin.yaml
  swardmap map MY_DRIVE -o safe_map -c my_run/margin.yaml"""


def told(found: Mapping[str, Any], out: Path) -> str:
    """Margin, its cost, who is in danger, and what to do next.

    Args:
        found: results of the evaluation, with `cost` and `worst_things`.
        out: folder of the demo.
    """
    pages = f"{out / 'report.html'} (the map), {out / 'evaluation' / 'report.html'} (where it is wrong)"
    parts = [
        "How far can this map be trusted? What truly stands in this garden is known, so it was measured.",
        *margin_lines(found),
        *danger_lines(found),
        "This is one short drive in a drawn garden: an example of how it goes, not a number for your lawn.",
        f"To look at: {pages}",
        NEXT,
    ]
    return "\n" + "\n".join(parts)


def margin_lines(found: Mapping[str, Any]) -> list[str]:
    """The margin and what it costs."""
    margin = found["margin"]
    if margin["margin_m"] is None:
        count, used = found["frames"]["evaluated"], found["margin_in_use_m"]
        return [f"Margin: {count} frames are too few to measure one; {_cm(used)} is taken until one is."]
    share, chances = margin["options"]["share"], round(1 / (1 - margin["options"]["confidence"]))
    words = IN_WORDS.get(share, f"{100 * share:g} of 100")
    return [
        f"Margin: stay {_cm_up(margin['margin_m'])} away from every obstacle in the map.",
        f"  Where an obstacle reaches out of its mark, that covers {words} of the places that the map",
        f"  calls lawn by mistake (the chance that this is too little is at most 1 in {chances}).",
        *cost_lines(found.get("cost")),
    ]


def cost_lines(cost: Mapping[str, Any] | None) -> list[str]:
    """How much lawn the margin takes."""
    if not cost or cost["margin_m"] is None:
        return []
    at = {p["margin_m"]: p for p in cost["points"]}
    without, kept = at[0.0], at[cost["margin_m"]]
    if not without["reachable_m2"]:
        return []
    (before_m2, after_m2), wide = (p["reachable_m2"] for p in (without, kept)), _cm(cost["mower_width_m"])
    lost = f"{100 * (1 - after_m2 / before_m2):.0f} % is lost"
    return [
        f"Its price: a mower {wide} wide reaches {after_m2:.0f} m² of the lawn that was seen,",
        f"  {before_m2:.0f} m² without a margin: {lost}.",
    ]


def danger_lines(found: Mapping[str, Any]) -> list[str]:
    """Who would be in danger, without a margin and with one."""
    total, margin_m = found["metrics"]["overall"]["things_missed"], found["margin"]["margin_m"]
    if not total["of"]:
        return []
    count, things = int(total["of"]), found["worst_things"]
    unseen = [t for t in things if t["missed"] and t["free_cells"]]
    lines = [f"Of {count} sightings of people and things within 5 m, {_overlooked(unseen)}."]
    used = found["margin_in_use_m"]
    tried = [(0.0, "Without a margin"), (used, f"With {_cm(used)}, what is taken while nothing is measured")]
    if margin_m is not None:
        tried.append((margin_m, f"With {_cm_up(margin_m)}"))
    for limit_m, words in tried:
        hurt = [t for t in things if _in_danger(t, limit_m)]
        lines.append(f"  {words}, {_who(hurt)} where the map shows lawn.")
    return lines


def _in_danger(thing: Mapping[str, Any], margin_m: float) -> bool:
    needs_m = thing["needs_m"]
    return thing["free_cells"] > 0 and (needs_m is None or needs_m > margin_m + 1e-9)


def _overlooked(unseen: Sequence[Mapping[str, Any]]) -> str:
    if not unseen:
        return "none was overlooked whole"
    return f"{len(unseen)} were overlooked whole ({_nearest(unseen)}), and no margin helps there"


def _who(hurt: Sequence[Mapping[str, Any]]) -> str:
    if not hurt:
        return "nobody and nothing could be hit"
    return f"{len(hurt)} could be hit ({_nearest(hurt)})"


def _nearest(things: Sequence[Mapping[str, Any]]) -> str:
    """The nearest person, or the nearest thing if nobody is among them."""
    first = min(things, key=lambda t: (t["height"] != "person", t["away_m"]))
    name = f"a {first['title'].split(',')[0]} at {first['away_m']:.1f} m in frame {first['frame']}"
    return name if len(things) == 1 else f"such as {name}"


def _cm_up(metres: float) -> str:
    """Whole centimetres, never less than it is."""
    return f"{math.ceil(round(100 * metres, 6))} cm"


def _cm(metres: float) -> str:
    return f"{100 * metres:.3g} cm"
