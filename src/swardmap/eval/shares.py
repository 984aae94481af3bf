"""Shares as people say them."""

import math

PLAIN_SHARES = (0.99, 0.95, 0.9, 0.8, 0.75, 0.5)
"""Shares that can be said without a number after the comma: 9 of 10, half."""


def told_share(share: float) -> float:
    """A share as people say it: whole percent, never more than it is; as it is where that were nothing.

    >>> told_share(0.846), told_share(0.004)
    (0.84, 0.004)
    """
    whole = math.floor(round(100 * share, 6)) / 100
    return whole or share


def plain_share(carried: float) -> float | None:
    """The largest of PLAIN_SHARES that is not above what can be carried; None if none is.

    >>> plain_share(0.84)
    0.8
    """
    return next((share for share in PLAIN_SHARES if share <= carried + 1e-9), None)


def share_text(share: float) -> str:
    """A share in percent, without more digits than it has.

    >>> share_text(0.99), share_text(0.999)
    ('99 %', '99.9 %')
    """
    return f"{100 * share:.4g} %"
