"""`swardmap ros --demo`: the node in this process, and a mower in a garden as another."""

import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from swardmap.config import Config
from swardmap.errors import InputError, SwardmapError
from swardmap.runs.interrupts import interrupts_wait

if TYPE_CHECKING:
    from swardmap.ros.parameters import Parameters
    from swardmap.ros.simulated_mower import MowerWorld

AUTO, RENDERED, SOLIDS = "auto", "rendered", "solids"
SIMULATED = (
    "-p",
    "use_sim_time:=true",
    "-r",
    "/clock:=clock",
    "-r",
    "/tf:=tf",
    "-r",
    "/tf_static:=tf_static",
)


def run_demo(config: Config, arguments: Sequence[str], garden: str, rounds: int | None, pace: float) -> None:
    """Run node and mower until Ctrl-C, or until so many rounds are driven.

    Args:
        config: of the node; mount, poses and inscribed radius are the mower's.
        arguments: `--ros-args` and what follows, of both.
        garden: auto, rendered or solids.
        rounds: None = for ever.
        pace: of the mower's clock, at most.

    Raises:
        InputError: if the mower ended by itself before it had driven its rounds.
        SwardmapError: as `run_node`; of the renderer, if it is asked for and cannot draw.
    """
    from swardmap.ros.run import run_node
    from swardmap.ros.topics import rclpy_module

    rclpy_module()
    kind, both = garden_kind(garden), [*arguments, *SIMULATED]
    parameters = demo_parameters(config, kind)
    mower = multiprocessing.get_context("spawn").Process(
        target=_drive, args=(kind, both, rounds, pace), daemon=True
    )
    with interrupts_wait():  # the mower ends with the node
        mower.start()
    try:
        run_node(parameters, both, mower.is_alive)
    finally:
        ended = not mower.is_alive()
        mower.terminate()
        mower.join(timeout=10.0)
        mower.kill()
    if (ended or rounds is not None) and mower.exitcode != 0:
        raise InputError("the simulated mower ended early: see above")


def garden_kind(wanted: str) -> str:
    """The garden to drive in: where nothing draws the rendered one, `auto` is that of simple solids."""
    if wanted == SOLIDS:
        return SOLIDS
    try:
        from swardmap.synth.assets import open_assets
        from swardmap.synth.render.context import open_context

        open_assets()
        open_context().release()
    except SwardmapError as error:
        if wanted == RENDERED:
            raise
        print(f"the garden is one of simple solids; a rendered one needs more: {error}")
        return SOLIDS
    return RENDERED


def open_garden(kind: str) -> "MowerWorld":
    """A garden of a kind that `garden_kind` has found."""
    if kind == SOLIDS:
        from swardmap.synth.live_garden import SolidGarden

        return SolidGarden()
    from swardmap.synth.rendered_garden import RenderedGarden

    return RenderedGarden()


def demo_parameters(config: Config, kind: str) -> "Parameters":
    """Parameters of the node for the mower of a garden; the network was not trained on simple solids."""
    from swardmap.ros.driver import INSCRIBED_M
    from swardmap.ros.parameters import NodeConfig, Parameters
    from swardmap.synth.live_garden import FORWARD_M, HEIGHT_M, PITCH_DEG, SOLIDS_NETWORK

    own = kind == SOLIDS and config.segmenter.name == AUTO
    config = replace(
        config,
        segmenter=replace(config.segmenter, name=str(SOLIDS_NETWORK)) if own else config.segmenter,
        mount=replace(config.mount, height_m=HEIGHT_M, pitch_deg=PITCH_DEG, x_m=FORWARD_M),
        source=replace(config.source, odometry_topic="odom"),
        costmap=replace(config.costmap, inscribed_radius_m=INSCRIBED_M),
        # images may come slowly, by a clock that waits for them
        watchdog=replace(config.watchdog, stopped_s=2.0, stale_s=1.0, min_rate_hz=0.0),
    )
    node = NodeConfig(
        start_area_at_start=True, start_area_radius_m=0.6, start_area_ahead_m=1.2, map_rate_hz=10.0,
        pose_wait_ms=2000.0,
    )  # fmt: skip
    return Parameters(node, config)


def _drive(kind: str, arguments: Sequence[str], rounds: int | None, pace: float) -> None:
    """The mower's process."""
    from swardmap.ros.simulated_mower import run_mower

    run_mower(open_garden(kind), arguments, rounds, pace)
