"""The map as others are given it: the robot lies in its extent, and what the operator granted is free."""

from collections.abc import Callable

from swardmap.errors import SwardmapError
from swardmap.geometry import Pose
from swardmap.grid import GridSpec, OccupancyGrid
from swardmap.monitor.diagnostics import Severity
from swardmap.ros.extent import enlarged, extent_around
from swardmap.ros.parameters import NodeConfig
from swardmap.ros.start_area import StartArea, gap_m, start_area, with_start_area

Tell = Callable[[Severity, str], None]


class GivenMap:
    """Remembers how far the map reached, and the start area while there is one.

    The map itself is not changed: what is saved, and what frames are put into, holds what was seen.

    Args:
        tell: is given what belongs into the log.

    Attributes:
        area: the start area, while there is one.
        to_grant: whether to grant one as soon as the robot's pose is known.
    """

    def __init__(self, tell: Tell) -> None:
        self.area: StartArea | None = None
        self.to_grant = False
        self._tell = tell
        self._spec: GridSpec | None = None

    def of(
        self, grid: OccupancyGrid, robot_xy_m: tuple[float, float] | None, radius_m: float, nothing_free: bool
    ) -> OccupancyGrid:
        """The map to give out.

        Args:
            grid: what was seen.
            robot_xy_m: the robot's base in the grid's frame; None where it is not known.
            radius_m: of the circle that holds the robot.
            nothing_free: leave the start area out.
        """
        if robot_xy_m is not None:
            self._spec = extent_around(grid.spec, robot_xy_m, radius_m, self._spec)
            grid = enlarged(grid, self._spec)
        area = self.area  # another thread may end it
        return grid if area is None or nothing_free else with_start_area(grid, area)

    def grant(self, T_map_base: Pose, node: NodeConfig, seen: OccupancyGrid | None, now_ns: int) -> str:
        """Take that a person sees the ground under and ahead of the robot to be free; what to tell them.

        Args:
            T_map_base: pose of the robot's base.
            node: size and duration.
            seen: the map so far, or None.
            now_ns: the time.
        """
        width_m, ahead_m, lasts_s = 2 * node.start_area_radius_m, node.start_area_ahead_m, node.start_area_s
        self.area = start_area(T_map_base, node.start_area_radius_m, ahead_m, lasts_s, now_ns)
        x, y = self.area.from_m
        told = (
            f"start area granted at ({x:.2f}, {y:.2f}): {width_m:g} m wide, {ahead_m:g} m ahead, for "
            f"{lasts_s:g} s at most; nobody but you has seen it"
        )
        gap = None if seen is None else gap_m(seen, self.area)
        if gap:
            told += f"; what cameras see begins {gap:.2f} m beyond it: start_area_ahead_m is too small"
        self._tell(Severity.WARN, told)
        return told

    def check(
        self,
        now_ns: int,
        robot_xy_m: tuple[float, float] | None,
        stopped: bool,
        grant: Callable[[], object],
    ) -> None:
        """End the start area when it is due; grant it once where the parameters say so.

        Args:
            now_ns: the time.
            robot_xy_m: the robot's base, or None.
            stopped: whether the stop flag was set just now.
            grant: grants it.
        """
        if self.to_grant and robot_xy_m is not None:
            self.to_grant = False
            try:
                grant()
            except SwardmapError as error:  # a timer calls this: what leaves it ends the node
                self._tell(Severity.WARN, str(error))
        if self.area is not None:
            self.end("the stop flag was set" if stopped else self.area.ended(now_ns, robot_xy_m))

    def end(self, reason: str) -> None:
        """End the start area, if there is one and a reason."""
        if reason and self.area is not None:
            self.area = None
            self._tell(Severity.OK, f"start area ended: {reason}")
