"""Bodies in any pose, clothed, standing still or walking."""

from swardmap.synth.people.figure import GROUPS, Person, figure_of, person
from swardmap.synth.people.path import Mover, Path, Walker, cyclist, walker
from swardmap.synth.people.poses import POSES

__all__ = ["GROUPS", "POSES", "Mover", "Path", "Person", "Walker", "cyclist", "figure_of", "person", "walker"]
