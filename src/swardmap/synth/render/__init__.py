"""OpenGL through moderngl and EGL: colour, exact depth and classes.

One renderer for Mesa's software driver and for a GPU, OpenGL 3.3 core. A frame is drawn in these passes:
shadow maps (kept while garden and light stay), truth (depth, label and thing at pixel centres, without
anti-aliasing), radiance (anti-aliased), finish (ambient occlusion). `renderer` reads like that.
"""

from swardmap.synth.render.renderer import GardenRenderer

__all__ = ["GardenRenderer"]
