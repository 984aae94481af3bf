"""What an evaluation says on a terminal."""

import math
import shlex
from pathlib import Path
from typing import Any


def summary_text(found: dict[str, Any], out: Path) -> str:
    """What a person wants to know after an evaluation, in a few lines."""
    from swardmap.eval.pages import percent

    frames, margin = found["frames"], found["margin"]
    lines = [f"{frames['evaluated']} of {frames['total']} frames evaluated with '{found['segmenter']}'"]
    lines += [f"  not evaluated: frame {bad['index']}: {bad['error']}" for bad in frames["unreadable"][:5]]
    if len(frames["unreadable"]) > 5:
        lines.append(f"  ... and {len(frames['unreadable']) - 5} more, see frames.csv")
    if frames["evaluated"]:
        section = found["maps"][found["main"]]["overall"]
        cells, d_min = section["cells"], section["d_min"]["all"]
        called = cells["obstacle_called_free"]
        rate = f"{percent(called['share'])} % ({called['count']} of {called['of']})"
        lines += [
            f"masks: accuracy {percent(found['masks']['overall']['accuracy'])} %",
            f"maps ({found['main']}): obstacle cells called free: {rate}",
            *safety_lines(found),
        ]
        if d_min["count"]:
            lines.append(
                f"d_min-obst: mean {d_min['mean_m']:.3f} m, 99 % {d_min['quantiles_m']['0.99']:.3f} m"
            )
    if found.get("faults"):
        counts = ", ".join(f"{n} x {fault}" for fault, n in found["faults"].items())
        lines.append(f"frames that the watchdog of the node would name: {counts}")
    lines += [f"warning: {warning}" for warning in found.get("warnings", ())]
    if margin["margin_m"] is None:
        lines += [f"no margin: {margin['reason']}", *refusal_lines(found, out)]
    else:
        lines.append(f"margin: {margin['margin_m']:.3f} m, see {out / 'margin.yaml'}")
    if more := len(found.get("recordings", ())) - 1:
        lines.append(f"of {more + 1} recordings: {', '.join(r['name'] for r in found['recordings'])}")
    lines += [
        f"not counted: {name}, whose addition was interrupted; give its command again"
        for name in found.get("unfinished", ())
    ]
    return "\n".join([*lines, f"report: {out / 'report.html'}"])


def refusal_lines(found: dict[str, Any], out: Path) -> list[str]:
    """What to do where no margin can be promised: a smaller share, or more frames."""
    margin, lines = found["margin"], []
    if margin["carried_share"] and found["command"].startswith("swardmap evaluate"):
        lines.append(f"  for that share: {with_share(found['command'], margin['carried_share'])}")
    more, units, unit = margin["units_more"], margin["units"], margin["options"]["unit"]
    if more and units:
        drives = math.ceil(more / (units / len(found.get("recordings") or [None])))
        like = (
            f"{drives} more like {'these' if drives > 1 else 'this'}" if unit == "frame" else f"{more} more"
        )
        command = f"swardmap evaluate ANOTHER_RECORDING -o {out} --more"
        lines.append(f"  for the whole share, about {like}, each added by: {command}")
    return lines


def with_share(command: str, share: float) -> str:
    """The same command for another share of the missed cells; what is evaluated already is not done again."""
    words = shlex.split(command)
    if "--share" in words[:-1]:
        at = words.index("--share")
        del words[at : at + 2]
    words = [word for word in words if not word.startswith("--share=") and word != "--overwrite"]
    return shlex.join([*words, "--share", f"{share:g}"])


def safety_lines(found: dict[str, Any]) -> list[str]:
    """What a safety engineer reads first."""
    from swardmap.eval.metrics import interval_text, metric

    section = found["metrics"]["overall"]

    def told(key: str, name: str) -> str:
        one = section[key]
        interval = interval_text(one)
        more = f", 95 % by {found['unit']}: {interval}" if interval else ""
        return f"{one['count']} of {one['of']} {name} ({metric(key).text(one['value'])}{more})"

    near = metric("free_beyond_margin_near").text(section["free_beyond_margin_near"]["value"])
    kept = metric("lawn_kept_near").text(section["lawn_kept_near"]["value"])
    margin = f"beyond the margin of {found['margin_in_use_m']:g} m"
    return [
        f"things within 5 m: {told('things_missed', 'missed')}; {told('things_dangerous', 'dangerous')}",
        f"corridors of 3 m: {told('corridor_missed', 'missed')}; {told('false_stops', 'false stops')}",
        f"obstacle cells within 5 m called free {margin}: {near}; lawn kept there: {kept}",
    ]
