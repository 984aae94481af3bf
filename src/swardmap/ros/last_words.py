"""What a run of the node came to, line by line: what `swardmap map` says at its end."""

from dataclasses import asdict
from statistics import median

from swardmap.ros.live_pipeline import LivePipeline
from swardmap.runs.summary import left_out_lines, pairing_lines, pixel_lines, pixel_warnings


def last_words(pipeline: LivePipeline) -> list[str]:
    """Frames mapped and left out, poses, pairing of colour and depth, where the pixels went if they are lost.

    Args:
        pipeline: of the run that ends.
    """
    intake, mapped = pipeline.intake, pipeline.mapper.mapped
    lines = ["frames mapped: " + (", ".join(f"{n} of {name}" for name, n in mapped.items()) or "none")]
    lines += left_out_lines(pipeline.skipped, intake.first)
    lines.append(_poses(pipeline))
    offsets_ns = [offset for camera in intake.inputs.values() for offset in camera.offsets_ns]
    if offsets_ns:
        middle_ms, worst_ms = (round(ns / 1e6, 3) for ns in (median(offsets_ns), max(offsets_ns)))
        pairing = {"pairs": len(offsets_ns), "median_ms": middle_ms, "worst_ms": worst_ms}
        lines += pairing_lines(pairing)
    if pipeline.pixels is not None:
        pixels = asdict(pipeline.pixels)
        lines += pixel_lines(pixels) + [f"warning: {text}" for text in pixel_warnings(pixels)]
    return lines


def _poses(pipeline: LivePipeline) -> str:
    poses = pipeline.intake.poses
    if not poses.posed:
        return "poses: none, each frame is a map of its own"
    by = "odometry" if poses.from_odometry else "tf"
    refused = sum(poses.live.refused.values())
    wrong = f"; {refused} transforms that are none" if refused else ""
    return f"poses: {by}, in the frame '{poses.live.map_frame}'{wrong}"
