"""Models and textures for swardmap's gardens: bundles (*.zip) that `swardmap.synth.assets` reads.

Who made them and under which licence: ATTRIBUTION.md beside this file.
"""

__version__ = "1.0.0"
