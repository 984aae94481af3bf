"""swardmap: from RGB-D to an obstacle map a mowing robot can trust.

The names below are the whole of the core; they load NumPy and nothing heavier. Sources, files,
networks and pictures live in `swardmap.io`, `swardmap.models` and `swardmap.viz`.
"""

__version__ = "0.1.0"
