"""What a person is told at the end of a run, line by line, of what summary.json holds."""

from collections.abc import Mapping
from typing import Any

from swardmap.monitor.diagnostics import MAPPED, Fault
from swardmap.runs.warnings import MOST, refused_by_fault

LOST_PIXELS = (
    ("no_reading", "without a reading"),
    ("out_of_range", "out of range (cloud.max_range_m)"),
    ("inconsistent", "removed by the filter (cloud.consistent_neighbours)"),
    ("void", "where the mask says nothing"),
    ("out_of_height", "out of height (cloud.max_height_m)"),
    ("outside_grid", "beside the grid"),
)


def report_lines(summary: Mapping[str, Any]) -> list[str]:
    """What a person wants to know after a run, line by line."""
    lines = [f"{summary['frames']} frames mapped with '{summary['segmenter']}'"]
    lines += _watched(summary["watchdog"])
    lines += seen_lines(summary)
    grid, ground = summary["map"], summary["ground"]
    if ground["frames_without"] or ground["frames_carried_over"]:
        lines.append(
            f"no ground of their own: {ground['frames_carried_over']} frames judged by an earlier one's, "
            f"{ground['frames_without']} by none, which cleared nothing"
        )
    if grid is None:
        alone = summary["frames"] == summary["frames_without_pose"]
        lines.append(
            "no poses: each frame has a map of its own in maps/" if alone else "nothing was seen: no map"
        )
    else:
        cells: dict[str, int] = grid["cells"]
        width, height = grid["size_cells"]
        lines.append(
            f"map {width} x {height} cells of {grid['resolution_m']:g} m: {cells['grass']} grass, "
            f"{cells['obstacle']} obstacle, {cells['person']} person, {cells['unknown']} unknown"
        )
    margin = summary["margin_m"]
    given = "" if summary["margin_measured"] else ", the default: none was measured (swardmap evaluate)"
    lines.append(f"margin in use: {margin:g} m{given}")
    stages = ", ".join(f"{stage} {t['p50']:.1f}" for stage, t in summary["timings_ms"].items())
    lines.append(f"median milliseconds a frame: {stages}")
    lines += [f"note: {note}" for note in summary["notes"]]
    lines += [f"warning: {warning}" for warning in summary["warnings"]]
    return lines


def seen_lines(summary: Mapping[str, Any]) -> list[str]:
    """What came in: what was left out, poses, pairing, and where the pixels went if they are lost.

    Args:
        summary: `skipped`, `source` and `pixels` of a run, offline or in the node.
    """
    source = summary["source"]
    firsts = {reason: of["first"] for reason, of in source.get("left_out", {}).items() if "first" in of}
    return [
        *left_out_lines(summary["skipped"], firsts),
        *pose_lines(source.get("poses")),
        *pairing_lines(source.get("pairing")),
        *pixel_lines(summary["pixels"]),
    ]


def left_out_lines(skipped: Mapping[str, int], firsts: Mapping[str, str]) -> list[str]:
    """What did not reach the map, by reason, and the first of each reason in full where it is known."""
    counts = {reason: n for reason, n in skipped.items() if n}
    if not counts:
        return []
    told = [f"  {reason}, the first: {firsts[reason]}" for reason in counts if reason in firsts]
    return ["left out: " + ", ".join(f"{n} x {reason}" for reason, n in counts.items()), *told]


def pose_lines(poses: Any) -> list[str]:
    """How the poses were found: frames, topics and the largest gap; nothing if the source does not say."""
    if not isinstance(poses, dict):
        return []
    found = f"poses: {poses.get('from', 'of the recording')} {poses.get('frames', '')}".rstrip()
    if poses.get("topics"):
        found += f", of {', '.join(poses['topics'])}"
    if gaps := poses.get("largest_gap_ms"):
        edge = max(gaps, key=gaps.__getitem__)
        found += f", gaps of {gaps[edge]:g} ms at most ({edge}; {poses['tolerance_ms']:g} allowed)"
    return [found]


def pairing_lines(pairing: Any) -> list[str]:
    """How far the images of a pair are apart in time; nothing if there are none."""
    if not isinstance(pairing, dict) or not pairing.get("pairs"):
        return []
    apart = f"{pairing['median_ms']:g} ms apart (median), {pairing['worst_ms']:g} at most"
    return [f"colour and depth are {apart}"]


def _watched(watchdog: Mapping[str, Any]) -> list[str]:
    """What the watchdog left out and doubted: how often, and the first of each kind."""
    lines = []
    if watchdog["refused"]:
        first = _firsts({k: v for k, v in watchdog["first"].items() if k not in MAPPED})
        lines.append(f"not mapped, as the node would not: {refused_by_fault(watchdog)} (first: {first})")
    strange = watchdog["faults"].get(Fault.UNFAMILIAR, 0)
    if strange:
        lines.append(
            f"unfamiliar to the network: {strange} frames cleared nothing "
            f"(first: {watchdog['first'][Fault.UNFAMILIAR]})"
        )
    return lines


def _firsts(first: Mapping[str, str]) -> str:
    return ", ".join(dict.fromkeys(first.values()))


def pixel_lines(pixels: Mapping[str, int]) -> list[str]:
    """Where the pixels went, if most of them are not in the map."""
    total = pixels.get("pixels", 0)
    if not total or pixels["used"] >= MOST * total:
        return []
    lost = [(pixels[name], text) for name, text in LOST_PIXELS if pixels[name] >= 0.01 * total]
    shares = ", ".join(f"{100 * count / total:.0f} % {text}" for count, text in sorted(lost, reverse=True))
    return [f"{100 * pixels['used'] / total:.0f} % of the pixels are in the map; {shares}"]
