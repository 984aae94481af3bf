"""What the claims for a margin come to: the margin itself, and what it promises in words."""

from swardmap.eval.margin import Claim
from swardmap.io.maps.margin_file import Margin


def margin_of(everything: Claim, person: Claim | None = None) -> Margin | None:
    """The margins that the claims carry; None if the claim for all cells was refused.

    Growing persons by more than the rest leaves the claim for all cells true.

    Args:
        everything: the claim for all missed cells.
        person: the claim for those nearest to a cell mapped as a person.
    """
    if everything.margin_m is None:
        return None
    if person is None or person.margin_m is None:
        return Margin(everything.margin_m)
    return Margin(everything.margin_m, max(everything.margin_m, person.margin_m))


def statement_of(everything: Claim, person: Claim | None, not_covered: str, where: str) -> str:
    """What the margin promises and what it does not, in words.

    Args:
        everything: the claim for all missed cells.
        person: the claim for those nearest to a cell mapped as a person.
        not_covered: obstacles that no margin covers.
        where: data, segmenter and map that it was measured with.
    """
    lines = [f"Measured with {where}.", _sentence(everything)]
    if person is not None:
        lines.append(
            f"Persons: {_sentence(person)}" if person.margin_m is not None else f"Persons: {person.reason}."
        )
    lines += [
        not_covered,
        "It holds for frames like those it was measured on, and for maps of this resolution.",
    ]
    return "\n".join(lines)


def _sentence(claim: Claim) -> str:
    if claim.margin_m is None:
        return f"No margin: {claim.reason}."
    return (
        f"In a {claim.unit} with missed cells, on average at least {100 * claim.share:.4g} % of them lie "
        f"within {claim.margin_m:.3f} m of a found cell, at {100 * claim.confidence:.4g} % confidence "
        f"({claim.misses} missed cells in {claim.units} {claim.unit}s, taken as independent)."
    )
