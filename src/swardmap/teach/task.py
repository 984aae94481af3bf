"""What is to be taught: drives, settings, and the network file that comes of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from swardmap.config import Config
from swardmap.errors import ConfigError, ModelError
from swardmap.io import FrameSource
from swardmap.mapping.work_area import WorkArea
from swardmap.models import bundled_network
from swardmap.teach.plan import TeachPlan


@dataclass(frozen=True, eq=False)
class Task:
    """What is taught.

    Attributes:
        sources: the recordings.
        files: where each of them lies, in the same order.
        out: the network file.
        start: the network it begins from; None = the package's.
        config: mount, ranges, ground, work area.
        plan: footprint, spans, limits, learning.
        area: work area, or None.
        unwanted: areas that nothing is learnt in.
        replay: recordings with true labels to replay.
        command: that goes on after a look at the page.
        replace: whether a network that other drives or settings taught may be written over.
    """

    sources: Sequence[FrameSource]
    files: Sequence[Path]
    out: Path
    config: Config
    plan: TeachPlan
    start: Path | None = None
    area: WorkArea | None = None
    unwanted: tuple[WorkArea, ...] = ()
    replay: tuple[Path, ...] = ()
    command: str = ""
    replace: bool = False

    @property
    def folder(self) -> Path:
        """Where labels, page and checkpoints are kept."""
        return self.out.with_suffix(".teach")

    @property
    def start_file(self) -> Path:
        """The network it begins from.

        Raises:
            ModelError: if this package holds none, and none was named.
        """
        found = self.start or bundled_network()
        if found is None:
            raise ModelError("this package holds no network to begin from; name one with --start")
        if _same_file(found, self.out):
            raise ConfigError(
                f"{self.out}: the new network must not replace the one it begins from; name another file"
            )
        return found

    @property
    def names(self) -> list[str]:
        """Of the drives, each once: two recordings may have the same."""
        given = [s.name for s in self.sources]
        return [n if given.count(n) == 1 else f"{n} ({i})" for i, n in enumerate(given, 1)]


def _same_file(one: Path, two: Path) -> bool:
    """Whether two names, of which the second need not be there, lead to one file."""
    return one.resolve() == two.resolve() or (one.exists() and two.exists() and one.samefile(two))
