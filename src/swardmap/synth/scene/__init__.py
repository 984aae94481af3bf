"""Gardens from a seed: the ground, what stands and moves on it, and the lanes of a mower."""

from swardmap.synth.scene.camera_path import MowerCamera, mowing_run, random_rig
from swardmap.synth.scene.garden import build_garden

__all__ = ["MowerCamera", "build_garden", "mowing_run", "random_rig"]
