"""Gardens from a seed: the ground, what stands and moves on it, and the lanes of a mower."""

from swardmap.synth.scene.camera_path import Rig, mowing_run, random_rig
from swardmap.synth.scene.garden import build_garden

__all__ = ["Rig", "build_garden", "mowing_run", "random_rig"]
