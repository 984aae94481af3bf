"""What a run of the node came to, line by line: what `swardmap map` says at its end."""

from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.run_facts import run_facts
from swardmap.runs.told import seen_lines


def last_words(pipeline: LivePipeline) -> list[str]:
    """Frames mapped and left out, poses, pairing of colour and depth, where the pixels went if they are lost.

    Args:
        pipeline: of the run that ends.
    """
    told = run_facts(pipeline)
    mapped = ", ".join(f"{n} of {name}" for name, n in told["frames"].items())
    poses = told["source"].get("poses")
    none = ["poses: none, each frame is a map of its own"] if poses is None else []
    refused = 0 if poses is None else sum(poses["refused"].values())
    wrong = [f"transforms left out: {refused}"] if refused else []
    warnings = [f"warning: {text}" for text in told["warnings"]]
    return [f"frames mapped: {mapped or 'none'}", *seen_lines(told), *none, *wrong, *warnings]
