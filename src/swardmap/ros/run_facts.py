"""What a run of the node has come to so far, by the names of the summary.json of `swardmap map`."""

from dataclasses import asdict
from typing import Any

from swardmap.io.sources.pairing import pairing_facts
from swardmap.io.sources.source import Tally, tally_facts
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.runs.warnings import pixel_warnings


def run_facts(pipeline: LivePipeline) -> dict[str, Any]:
    """Frames, what was left out and why, poses, pairing of colour and depth, where the pixels went.

    Args:
        pipeline: of the run; asked in the thread of the callbacks.
    """
    intake = pipeline.intake
    offsets_ns = [offset for camera in intake.inputs.values() for offset in camera.offsets_ns]
    facts: dict[str, Any] = {"pairing": pairing_facts(offsets_ns)}
    if (poses := intake.poses.facts(intake.optical_frames)) is not None:
        facts["poses"] = poses | {"refused": intake.poses.live.refused}
    skipped = pipeline.skipped
    tally = Tally(facts=facts, first=intake.first)
    tally.skipped.update(skipped)
    pixels = {} if pipeline.pixels is None else asdict(pipeline.pixels)
    return {
        "frames": dict(pipeline.mapper.mapped),
        "skipped": skipped,
        "source": tally_facts(tally),
        "pixels": pixels,
        "warnings": pixel_warnings(pixels),
    }
