"""Bodies in any pose, clothed, standing still or walking."""

from swardmap.synth.people.figure import GROUPS, Person, figure_of, person
from swardmap.synth.people.poses import POSES

__all__ = ["GROUPS", "POSES", "Person", "figure_of", "person"]
