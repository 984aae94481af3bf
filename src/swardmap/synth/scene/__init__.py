"""Gardens from a seed: the ground, what stands and moves on it, and the lanes of a mower."""

from swardmap.synth.scene.garden import build_garden

__all__ = ["build_garden"]
