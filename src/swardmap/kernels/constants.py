"""What the compiled kernels and their plain twins both go by, said once; no numba here."""

import numpy as np

FAR_AWAY = np.float32(-1e6)
"""Stands for "no reading" where neighbours are compared: nothing is about as far away as this."""

PER_METRE = np.float32(10000)
"""Heights are summed as whole tenths of millimetres: sums in any order are the same to the last digit."""

HIGHEST = 2**31 - 1
"""Lowest height of a cell without points."""

NOT_IN_RANGE, NOT_CONSISTENT, OUTSIDE = -1, -2, -3
"""In place of a cell: why a pixel has none."""

DROPPED = -4
"""DROPPED - i in place of a cell: the reading is not consistent, and would have fallen into cell i."""

UNSURE, GRASS, OBSTACLE, PERSON, VOID = range(5)
"""What a pixel of the mask counts as; the first four have a counter in each cell."""

LOW_SHARE = 0.3  # of the cells of a block are taken to be ground, where an obstacle covers the rest
LOWEST_PART_M = 0.05  # of a cell's points above its lowest is ground, where the rest is a trunk or a roof
STEP_CELLS = 2  # a step is looked for this many cells around
DENT_M = 0.05  # a block this much below those around it is a hole, not the ground
FEWEST_CELLS = 12  # less ground than that is no ground
LANES = 64  # sums over cells run in so many lanes, so that they vectorise
