"""The ROS 2 node: a lifecycle shell that wires topics, services and two threads to a `LivePipeline`."""

import threading
import time
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from swardmap.errors import SwardmapError, one_line
from swardmap.models import build_segmenter
from swardmap.monitor.diagnostics import Severity
from swardmap.ros.bond import Bond
from swardmap.ros.last_words import last_words
from swardmap.ros.lifecycle import refuse_wrong_transitions
from swardmap.ros.live_pipeline import LivePipeline
from swardmap.ros.map_outputs import Layer, MapOutputs
from swardmap.ros.node_parameters import NodeParameters
from swardmap.ros.outputs import Outputs
from swardmap.ros.parameters import Parameters
from swardmap.ros.services import serve
from swardmap.ros.subscriptions import Subscriptions
from swardmap.ros.topics import find_types
from swardmap.ros.warm_up import warm_up

CHECKS_HZ = 10.0
"""How often the watchdog is asked, and the stop flag published."""

WORKER_WAITS_S = 0.2

LAST_WORD_S = 1.0
"""So long at most the node waits, when it stops, until each of its last words has been heard."""


class RobotNode:
    """One node: unconfigured, inactive, active, as Nav2's own.

    Configured, it has subscriptions, publishers and a loaded network; active, it maps and publishes.
    Deactivated it forgets the map, and the last it says is: stop, nothing is free.

    Args:
        defaults: what parameters are unless ROS says otherwise.
        name: of the node.
    """

    def __init__(self, defaults: Parameters | None = None, name: str = "swardmap") -> None:
        from rclpy.lifecycle import LifecycleNode

        self.node = LifecycleNode(name)
        refuse_wrong_transitions(self.node)
        self.pipeline: LivePipeline | None = None
        self._types = find_types()
        self._active = threading.Event()
        self._ended = threading.Event()
        self._outputs: Outputs | None = None
        self._threads: list[threading.Thread] = []
        self._held: list[Callable[[], object]] = []
        self._bond: Bond | None = None
        self._parameters = NodeParameters(
            self.node, defaults or Parameters(), self._take, lambda: self.pipeline is not None
        )
        self.node.add_managed_entity(self._managed())

    @property
    def log(self) -> Any:
        """The node's logger."""
        return self.node.get_logger()

    @property
    def parameters(self) -> Parameters:
        """What they are now."""
        return self._parameters.now

    def start(self) -> bool:
        """Configure and activate, unless a lifecycle manager is to do it; returns whether all went well."""
        from rclpy.lifecycle import TransitionCallbackReturn

        if not self.parameters.node.autostart:
            return True
        good = TransitionCallbackReturn.SUCCESS
        return bool(self.node.trigger_configure() == good and self.node.trigger_activate() == good)

    def close(self) -> None:
        """Stop the threads, say stop once more, and destroy the node."""
        self._deactivate()
        self._cleanup()
        self.node.destroy_node()

    def _now_ns(self) -> int:
        return int(self.node.get_clock().now().nanoseconds)

    def _take(self, parameters: Parameters) -> None:
        if self.pipeline is not None:
            self.pipeline.configure(parameters)

    def _managed(self) -> Any:
        """What rclpy's lifecycle calls on each transition."""
        from rclpy.lifecycle import ManagedEntity

        def of(action: Callable[[], None]) -> Callable[[Any, Any], Any]:
            return lambda _, __: self._transition(action)

        actions = {
            "on_configure": of(self._configure), "on_activate": of(self._activate),
            "on_deactivate": of(self._deactivate), "on_cleanup": of(self._cleanup),
            "on_shutdown": of(self._shutdown), "on_error": of(self._shutdown),
        }  # fmt: skip
        return type("Transitions", (ManagedEntity,), actions)()

    def _transition(self, action: Callable[[], None]) -> Any:
        from rclpy.lifecycle import TransitionCallbackReturn

        try:
            action()
        except SwardmapError as error:
            self.log.error(str(error))
            return TransitionCallbackReturn.FAILURE
        except Exception:
            self.log.fatal(traceback.format_exc())
            raise
        return TransitionCallbackReturn.SUCCESS

    def _configure(self) -> None:
        from swardmap.rig.rig import read_rig

        for sentence in self._types.without:
            self.log.info(sentence)
        node = self.parameters.node
        rig = None if node.rig_file is None else read_rig(node.rig_file)
        self._parameters.take_network(rig)
        self._parameters.take_margin()
        segmenter = build_segmenter(self.parameters.config.segmenter)
        pipeline = LivePipeline(self.parameters, segmenter, rig)
        began = time.monotonic()
        warm_up(pipeline.mapper.config, segmenter)
        self.log.info(f"{segmenter.name} is ready after {time.monotonic() - began:.1f} s; waiting for images")
        of_map = MapOutputs(self.node, self._types, pipeline.mapper.area)
        label_set, depth = segmenter.label_set, node.image_depth
        self._outputs = Outputs(self.node, self._types, pipeline.intake.inputs, label_set, depth, of_map)
        self.pipeline = pipeline
        try:
            heard = Subscriptions(self.node, self._types, pipeline.intake, self._active.is_set)
        except BaseException:
            self._cleanup()
            raise
        self._held.append(heard.destroy)
        self._serve(pipeline)
        self.log.info(f"cameras: {', '.join(pipeline.intake.inputs)}; segmenter: {segmenter.name}")

    def _activate(self) -> None:
        assert self.pipeline is not None  # noqa: S101 - it is made when the node is configured
        self.pipeline.begin()
        self._active.set()
        # of this activation alone: a thread that outlives it must not come back with the next
        self._ended = threading.Event()
        if self._types["bond"] is not None:
            self._bond = Bond(self.node, self._types["bond"])
        for target in (self._map_frames, self._publish_maps):
            thread = threading.Thread(target=self._guarded, args=(target, self._ended), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _deactivate(self) -> None:
        if not self._active.is_set():
            return
        self._active.clear()
        self._ended.set()
        if self._bond is not None:
            self._bond.break_()
            self._bond = None
        for thread in self._threads:
            thread.join(timeout=2.0)
        self._threads.clear()
        pipeline, outputs = self.pipeline, self._outputs
        if pipeline is None or outputs is None:
            return
        pipeline.fail("the node is not active")
        self._said("stop flag", self._check)
        if not self._said("map", partial(self._publish_map, pipeline, outputs, nothing_free=True)):
            pipeline.clear()  # where the last one lay all is unknown: that needs nothing of the map
            self._said("map, all unknown", partial(self._publish_map, pipeline, outputs, nothing_free=True))
        outputs.wait_until_heard(LAST_WORD_S)
        self._said("report", partial(self._tell_run, pipeline))
        pipeline.failure = ""
        pipeline.clear()

    def _said(self, what: str, say: Callable[[], object]) -> bool:
        """Say one of the last things, and return whether it was: a failure must not take the others away."""
        try:
            say()
        except Exception as error:  # noqa: BLE001 - whatever it is: the robot must hear the others
            self.log.error(f"the last {what} was not published: {one_line(error)}")
            return False
        return True

    def _tell_run(self, pipeline: LivePipeline) -> None:
        for line in last_words(pipeline):
            self.log.info(line)

    def _cleanup(self) -> None:
        for destroy in self._held:
            destroy()
        self._held.clear()
        if self._outputs is not None:
            self._outputs.destroy()
        self.pipeline = self._outputs = None

    def _shutdown(self) -> None:
        self._deactivate()
        self._cleanup()

    def _serve(self, pipeline: LivePipeline) -> None:
        from rclpy.clock import Clock, ClockType

        steady = Clock(clock_type=ClockType.STEADY_TIME)  # a simulation that pauses must not silence the flag
        timer = self.node.create_timer(1 / CHECKS_HZ, self._check, clock=steady)
        self._held.append(partial(self.node.destroy_timer, timer))
        if self._types["services"] is not None:
            self._held += serve(self.node, pipeline)

    def _check(self) -> None:
        pipeline, outputs = self.pipeline, self._outputs
        if pipeline is None or outputs is None or not (self._active.is_set() or pipeline.failure):
            return
        report = pipeline.check(self._now_ns())
        self._log(pipeline)
        outputs.publish_health(report, pipeline.facts)

    def _log(self, pipeline: LivePipeline) -> None:
        """What the pipeline has to say; one line each."""
        while pipeline.events:
            severity, text = pipeline.events.popleft()
            if severity == Severity.STOP:  # rclpy allows a line of code one severity
                self.log.error(text)
            elif severity == Severity.WARN:
                self.log.warning(text)
            else:
                self.log.info(text)

    def _guarded(self, target: Callable[[threading.Event], None], ended: threading.Event) -> None:
        """A thread that fails says so: from then on the flag is stop and the map turns unknown."""
        try:
            target(ended)
        except Exception:  # noqa: BLE001 - a thread has nobody above it; it is logged, and the robot stops
            self.log.fatal(traceback.format_exc())
            if self.pipeline is not None and not ended.is_set():
                self.pipeline.fail(traceback.format_exc(limit=1).strip().splitlines()[-1])

    def _map_frames(self, ended: threading.Event) -> None:
        pipeline, outputs = self.pipeline, self._outputs
        while pipeline is not None and outputs is not None and not ended.is_set():
            mapped = pipeline.process(WORKER_WAITS_S)
            if mapped is not None and not ended.is_set():
                pipeline.mapped(mapped, self._now_ns())
                node = pipeline.parameters.node
                with pipeline.stages.measured("publish"):
                    outputs.publish_frame(
                        mapped, pipeline.mapper.config, node.cloud_stride, node.organised_cloud
                    )

    def _publish_maps(self, ended: threading.Event) -> None:
        pipeline, outputs = self.pipeline, self._outputs
        while pipeline is not None and outputs is not None and not ended.is_set():
            with pipeline.stages.measured("maps"):
                self._publish_map(pipeline, outputs, ended=ended)
            ended.wait(1 / pipeline.parameters.node.map_rate_hz)

    def _publish_map(
        self,
        pipeline: LivePipeline,
        outputs: Outputs,
        nothing_free: bool = False,
        ended: threading.Event | None = None,
    ) -> None:
        report = pipeline.report
        forget_ns = 2**62 if nothing_free else None if report is None else report.forget_before_ns
        grid = pipeline.given_out(forget_ns, nothing_free)
        if grid is not None:
            costmap = pipeline.mapper.costmap(grid)
            if ended is not None and ended.is_set():  # it took long: the last word has been said
                return
            node = pipeline.parameters.node
            full_s = 0.0 if nothing_free else node.full_map_s  # who comes later is given the last whole one
            outputs.publish_map(grid, costmap, time.monotonic(), full_s)
            pipeline.load.published(grid.stamp_ns, self._now_ns())
            around_m, range_m = pipeline.mapper.viewpoint_m, node.obstacle_cells_range_m
            outputs.publish_cells(grid, around_m, range_m, pipeline.robot_z_m)
            heights = partial(pipeline.mapper.heights, base_z_m=pipeline.robot_z_m)
            layers: dict[str, Layer] = {"layers/evidence": pipeline.mapper.evidence, "layers/height": heights}
            outputs.of_map.publish(grid, layers, pipeline.T_map_base, node)
