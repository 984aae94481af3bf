"""Faults injected one by one into a simulated stream: named in time, alone, and recovered from."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swardmap.config import Config, WatchdogConfig, config_from_dict
from swardmap.errors import InvalidValueError
from swardmap.geometry import Intrinsics, mount_pose
from swardmap.labels import GRASS_OBSTACLE_PERSON, MapClass
from swardmap.mapping.last_observed import LastObserved
from swardmap.models.oracle import open_segmenter as open_oracle
from swardmap.monitor.diagnostics import Fault, FrameStats, HealthReport, Severity, frame_stats
from swardmap.monitor.watchdog import Watchdog
from swardmap.pipeline import ObstacleMapper
from swardmap.synth.analytic import StereoNoise, garden_scene, lane_poses, render, with_sensor_noise
from swardmap.types import Frame, Segmentation

S = 1_000_000_000
CAMERA = Intrinsics(160, 120, 115.0, 115.0, 79.5, 59.5)
MOUNT = mount_pose(0.9, 25.0)
RATE_HZ, LATENCY_S, CHECK_S = 15.0, 0.06, 0.05
BEGIN_S, END_S, RUN_S = 10.0, 14.0, 30.0

Message = tuple[int, FrameStats]
"""Time of arrival, and the frame."""


@cache
def garden() -> tuple[Frame, ...]:
    """Views along a lane, 160 x 120, with the noise of stereo depth; no two alike."""
    rng = np.random.default_rng(1)
    poses = lane_poses(12, height_m=0.9, pitch_deg=25.0)
    frames = [render(garden_scene(0), CAMERA, pose) for pose in poses]
    return tuple(with_sensor_noise(frame, rng, StereoNoise()) for frame in frames)


@cache
def looks(index: int, change: Callable[[Frame], Frame] | None = None) -> FrameStats:
    frame = garden()[index]
    return frame_stats(frame if change is None else change(frame), 0, MOUNT)


def stream(seconds: float, seed: int = 0, hz: float = RATE_HZ) -> list[Message]:
    """A camera with jitter in its clock and in its latency; checksums differ as noise makes them."""
    rng = np.random.default_rng(seed)
    messages, arrival_ns = [], 0
    for i in range(round(seconds * hz)):
        stamp_ns = round((i / hz + rng.uniform(-0.2, 0.2) / hz + 1.0) * S)
        arrival_ns = max(arrival_ns + 1, stamp_ns + round((LATENCY_S + rng.exponential(0.02)) * S))
        base = looks(i % len(garden()))
        stats = replace(base, color_print=base.color_print + i, depth_print=base.depth_print + i)
        stats = replace(stats, position_m=None)  # the lane begins anew at its end
        messages.append((arrival_ns, replace(stats, stamp_ns=stamp_ns, arrival_ns=arrival_ns)))
    return messages


def during(message: Message) -> bool:
    return BEGIN_S * S <= message[0] < END_S * S


def run(
    cameras: dict[str, list[Message]],
    seconds: float = RUN_S,
    poses: Callable[[float], bool] = lambda _: True,
    queue: Callable[[float], int] = lambda _: 0,
    config: WatchdogConfig | None = None,
) -> list[HealthReport]:
    """Play the messages in order of arrival and check every 50 ms."""
    dog = Watchdog(cameras, config)
    arrivals = sorted(((t, name, m) for name, ms in cameras.items() for t, m in ms), key=lambda a: a[0])
    reports, next_message = [], 0
    for k in range(round(1.1 / CHECK_S), round(seconds / CHECK_S)):
        now_ns = round(k * CHECK_S * S)
        while next_message < len(arrivals) and arrivals[next_message][0] <= now_ns:
            at_ns, name, stats = arrivals[next_message]
            if dog.observe_frame(name, replace(stats, arrival_ns=at_ns)):
                dog.observe_mapped(stats.stamp_ns, at_ns)
            next_message += 1
        if poses(now_ns / S):
            dog.observe_pose(now_ns - S // 50)
        dog.observe_queue("frames", queue(now_ns / S), 4, now_ns)
        reports.append(dog.check(now_ns))
    return reports


def changed(**fields: object) -> Callable[[list[Message]], Iterable[Message]]:
    def change(messages: list[Message]) -> Iterable[Message]:
        return [(t, replace(m, **fields)) if during((t, m)) else (t, m) for t, m in messages]  # type: ignore[arg-type]

    return change


def seen_as(spoil: Callable[[Frame], Frame]) -> Callable[[list[Message]], Iterable[Message]]:
    """The frames themselves are spoilt, and their statistics taken anew."""

    def change(messages: list[Message]) -> Iterable[Message]:
        for i, (t, m) in enumerate(messages):
            if during((t, m)):
                new = looks(i % len(garden()), spoil)
                share, level, over = new.depth_share, new.bright_level, new.upside_down
                yield t, replace(m, depth_share=share, bright_level=level, upside_down=over)
            else:
                yield t, m

    return change


def darkened(frame: Frame) -> Frame:
    return replace(frame, rgb=frame.rgb // 32)


def covered(frame: Frame) -> Frame:
    return replace(frame, rgb=np.zeros_like(frame.rgb), depth=np.zeros_like(frame.depth))


def turned_over(frame: Frame) -> Frame:
    return replace(frame, rgb=frame.rgb[::-1, ::-1], depth=frame.depth[::-1, ::-1])


def without_depth(frame: Frame) -> Frame:
    return replace(frame, depth=np.zeros_like(frame.depth))


def stamps_shifted_once(seconds: float) -> Callable[[list[Message]], Iterable[Message]]:
    def change(messages: list[Message]) -> Iterable[Message]:
        first = next(i for i, message in enumerate(messages) if during(message))
        t, m = messages[first]
        shifted = t, replace(m, stamp_ns=m.stamp_ns + round(seconds * S))
        return [*messages[:first], shifted, *messages[first + 1 :]]

    return change


def delayed(messages: list[Message]) -> Iterable[Message]:
    """A queue in front of the watchdog grows by 0.5 s a second, and is emptied at the end."""
    last_ns = 0
    for t, m in messages:
        late_ns = round((t - BEGIN_S * S) * 0.5) if during((t, m)) else 0
        last_ns = max(last_ns + 1_000_000, t + late_ns)
        yield last_ns, m


def thinned(every: int) -> Callable[[list[Message]], Iterable[Message]]:
    return lambda messages: [m for i, m in enumerate(messages) if not during(m) or i % every == 0]


F = Fault
INJECTIONS: dict[str, tuple[Callable[[list[Message]], Iterable[Message]], set[Fault], set[Fault], float]] = {
    # name: (what is done to the messages, faults that must be named, may be named, within seconds)
    "stopped": (lambda ms: [m for m in ms if not during(m)], {F.STOPPED}, {F.STALE}, 0.65),
    "stale": (delayed, {F.STALE}, {F.FALLING_RATE, F.STOPPED}, 1.6),
    "slow": (thinned(4), {F.SLOW}, {F.FALLING_RATE}, 2.0),
    "falling": (thinned(2), {F.FALLING_RATE}, set(), 2.0),
    "frozen": (changed(color_print=5, depth_print=6), {F.FROZEN}, set(), 0.65),
    "frozen colour": (changed(color_print=5), {F.FROZEN}, set(), 0.65),
    "frozen depth": (changed(depth_print=6), {F.FROZEN}, set(), 0.65),
    "black": (seen_as(darkened), {F.BLACK}, set(), 0.45),
    "covered": (seen_as(covered), {F.BLACK, F.NO_DEPTH}, set(), 0.45),
    "flipped": (seen_as(turned_over), {F.FLIPPED}, set(), 0.45),
    "no depth": (seen_as(without_depth), {F.NO_DEPTH}, set(), 0.45),
    "stamp back": (stamps_shifted_once(-3.0), {F.JUMPED_BACK}, {F.STALE, F.JUMPED_AHEAD}, 0.12),
    "stamp ahead": (stamps_shifted_once(3.0), {F.JUMPED_AHEAD}, {F.JUMPED_BACK}, 0.12),
}
LASTING = {F.SLOW: 2.1, F.FALLING_RATE: 2.1, F.STALE: 2.1, F.STOPPED: 2.1}
"""Seconds after the end until the fault is gone, where a window or a queue remembers; 1.1 for all others."""


@pytest.mark.parametrize("name", INJECTIONS)
def test_each_fault_is_named_in_time_alone_and_recovered_from(name: str) -> None:
    inject, wanted, allowed, within_s = INJECTIONS[name]
    reports = run({"left": list(inject(stream(RUN_S))), "right": stream(RUN_S, seed=1)})
    at = {fault: [r.stamp_ns / S for r in reports if fault in r.faults("left")] for fault in Fault}
    for fault in wanted:
        assert at[fault], fault
        assert BEGIN_S <= at[fault][0] <= BEGIN_S + within_s
    for fault in Fault:
        if at[fault]:
            assert fault in wanted | allowed
            assert at[fault][-1] <= END_S + LASTING.get(fault, 1.1)
    for report in reports:
        assert not report.of("right")  # the camera beside it is well
        assert {d.subject for d in report.diagnoses} <= {"left"}
        assert not report.diagnoses or report.stamp_ns / S >= BEGIN_S
    stops = [r.stamp_ns / S for r in reports if r.stop and r.stamp_ns > 5 * S]
    if wanted - {F.SLOW, F.FALLING_RATE}:
        assert BEGIN_S <= stops[0] <= BEGIN_S + within_s
        assert stops[-1] <= END_S + 2.1 + 2.05  # the queue has drained, then `recover_s`
        assert np.diff(stops).max() < 2 * CHECK_S  # one stop, no flutter
    else:
        assert not stops
        assert all(r.severity == Severity.WARN for r in reports if r.diagnoses)
    assert not reports[-1].stop
    assert not reports[-1].diagnoses


def test_a_clean_stream_of_a_thousand_frames_with_jitter_is_well() -> None:
    reports = run({"left": stream(70.0), "right": stream(70.0, seed=2)}, seconds=70.0)
    assert len(stream(70.0)) > 1000
    assert not [d for r in reports for d in r.diagnoses]
    assert {r.stop for r in reports if r.stamp_ns >= 3.2 * S} == {False}  # 1.1 s + 2 s after the start
    assert all(r.forget_before_ns is None for r in reports if not r.stop)
    assert reports[-1].rates_hz["left"] == pytest.approx(15, abs=1)
    assert reports[-1].latency is not None
    assert 60 < reports[-1].latency.p50_ms < 90


def test_it_says_stop_until_all_has_been_well() -> None:
    dog = Watchdog(["front"])
    assert dog.check(0).stop
    assert [d.fault for d in dog.check(2 * S).of("front")] == [Fault.STOPPED]
    assert dog.check(2 * S).faults("pose") == {Fault.LOST_POSE}
    assert dog.check(2 * S).severity == Severity.STOP


def test_a_lost_pose_is_named() -> None:
    reports = run({"left": stream(RUN_S)}, poses=lambda t: not BEGIN_S <= t < END_S)
    lost = [r.stamp_ns / S for r in reports if r.faults() == {Fault.LOST_POSE}]
    assert BEGIN_S + 0.4 < lost[0] <= BEGIN_S + 0.6
    assert lost[-1] < END_S + 0.01
    assert all(not r.diagnoses for r in reports if not lost[0] <= r.stamp_ns / S <= lost[-1])


def test_a_queue_that_stays_full_is_named_and_one_that_fills_for_a_moment_is_not() -> None:
    reports = run({"left": stream(RUN_S)}, queue=lambda t: 4 if BEGIN_S <= t < END_S or t % 1 < 0.5 else 3)
    full = [r for r in reports if r.diagnoses]
    assert {d.fault for r in full for d in r.diagnoses} == {Fault.FULL_QUEUE}
    assert {d.subject for r in full for d in r.diagnoses} == {"frames"}
    assert BEGIN_S + 0.95 < full[0].stamp_ns / S <= BEGIN_S + 1.1
    assert not any(r.stop for r in full)


def test_a_clock_that_goes_back_is_named_and_does_not_make_old_frames_fresh() -> None:
    dog = Watchdog(["left"], WatchdogConfig(pose_s=None))
    for t, stats in stream(10.0):
        dog.observe_frame("left", stats)
        report = dog.check(t)
    assert not report.stop
    now_ns = 2 * S  # the clock is set back; no frame comes any more
    assert dog.check(now_ns).faults("clock") == {Fault.JUMPED_BACK}
    assert dog.check(now_ns).stop
    assert Fault.STOPPED in dog.check(now_ns + S).faults("left")


def test_a_camera_whose_clock_runs_ahead_is_named() -> None:
    ahead = [(t, replace(m, stamp_ns=m.stamp_ns + 5 * S)) for t, m in stream(10.0)]
    reports = run({"left": ahead}, seconds=10.0)
    assert all(r.faults("left") == {Fault.JUMPED_AHEAD} for r in reports[2:])


def test_a_third_of_the_messages_lost_is_no_stop() -> None:
    rng = np.random.default_rng(3)
    reports = run({"left": [m for m in stream(RUN_S) if not during(m) or rng.random() > 0.3]})
    assert {d.fault for r in reports for d in r.diagnoses} <= {Fault.FALLING_RATE}
    assert not any(r.stop for r in reports if r.stamp_ns > 5 * S)


def test_cameras_that_are_not_to_run_are_not_missed_and_get_time_to_start() -> None:
    dog, config = Watchdog(["front", "rear"]), WatchdogConfig()
    front = stream(20.0)
    for t, stats in front:
        dog.observe_pose(t)
        dog.observe_frame("front", stats)
        report = dog.check(t, active=["front"])
        assert not report.of("rear")
    assert not report.stop
    now_ns = front[-1][0]
    assert not dog.check(now_ns, active=["rear"]).diagnoses  # the mower turns back: the rear pair may start
    late_ns = now_ns + round(config.stopped_s * S) + S // 10
    dog.observe_pose(late_ns)
    assert dog.check(late_ns, active=["rear"]).faults() == {Fault.STOPPED}
    assert not dog.check(late_ns, active=["rear"]).of("front")


def test_bad_frames_stay_out_of_the_map_from_the_first_on() -> None:
    dog = Watchdog(["left"])
    good = [m for _, m in stream(2.0)]
    assert dog.observe_frame("left", good[0])
    assert not dog.observe_frame("left", good[0])  # the same stamp
    assert not dog.observe_frame("left", replace(good[1], depth_print=good[0].depth_print))
    assert not dog.observe_frame("left", replace(good[2], bright_level=0.0))
    assert not dog.observe_frame("left", replace(good[3], depth_share=0.0))
    assert not dog.observe_frame("left", replace(good[4], upside_down=True))
    assert not dog.observe_frame("left", replace(good[5], stamp_ns=good[5].stamp_ns + 9 * S))
    assert not dog.observe_frame("left", good[6])  # back from there
    assert dog.observe_frame("left", good[7])
    with pytest.raises(InvalidValueError, match="no camera 'middle'"):
        dog.observe_frame("middle", good[8])


def masks(score: Callable[[int], float | None], **config: float | None) -> list[HealthReport]:
    """A camera whose n-th frame has a mask that is unfamiliar by so much; checked after each."""
    dog = Watchdog(["left", "right"], WatchdogConfig(pose_s=None, **config))  # type: ignore[arg-type]
    labels, reports = np.ones((2, 2), np.uint8), []
    pairs = zip(stream(8.0), stream(8.0, seed=1), strict=True)
    for n, ((t, stats), (_, beside)) in enumerate(pairs):
        for name, looked in (("left", stats), ("right", replace(beside, arrival_ns=t))):
            dog.observe_frame(name, looked)
        dog.observe_mask("left", Segmentation(labels, GRASS_OBSTACLE_PERSON, unfamiliar=score(n)), t)
        dog.observe_mask("right", Segmentation(labels, GRASS_OBSTACLE_PERSON, unfamiliar=0.2), t)
        reports.append(dog.check(t))
    return reports


def test_a_run_of_unfamiliar_images_is_named_and_single_ones_are_not() -> None:
    reports = masks(lambda n: 1.1 if 60 <= n < 90 else 0.9)
    named = [n for n, r in enumerate(reports) if r.faults("left") == {Fault.UNFAMILIAR}]
    assert 60 + 6 <= named[0] <= 60 + 10  # half a second at 15 frames a second
    assert named == list(range(named[0], 90))
    assert all(reports[n].stop for n in named)
    assert not any(r.of("right") for r in reports)
    assert not reports[-1].stop, "taken back when it is over"
    for now_and_then in (lambda n: 5.0 * (n % 5 == 0), lambda n: None, lambda n: 1.0):
        assert not any(Fault.UNFAMILIAR in r.faults() for r in masks(now_and_then))


def test_how_unfamiliar_an_image_may_be_is_a_setting() -> None:
    assert Fault.UNFAMILIAR not in masks(lambda n: 9.0, unfamiliar=None)[-1].faults()
    assert Fault.UNFAMILIAR not in masks(lambda n: 1.4, unfamiliar=1.5)[-1].faults()
    assert Fault.UNFAMILIAR in masks(lambda n: 1.6, unfamiliar=1.5)[-1].faults()
    assert Fault.UNFAMILIAR not in masks(lambda n: 2.0, unfamiliar_s=60.0)[-1].faults()


def test_a_lens_that_is_black_now_and_unfamiliar_then_is_both() -> None:
    dog = Watchdog(["left"], WatchdogConfig(pose_s=None))
    strange = Segmentation(np.ones((2, 2), np.uint8), GRASS_OBSTACLE_PERSON, unfamiliar=3.0)
    for n, (t, stats) in enumerate(stream(2.0)):
        black = n % 2 == 0
        assert dog.observe_frame("left", replace(stats, bright_level=0.0) if black else stats) is not black
        if not black:  # black ones are not segmented
            dog.observe_mask("left", strange, t)
    assert Fault.UNFAMILIAR in dog.check(t).faults("left")
    with pytest.raises(InvalidValueError, match="no camera 'middle'"):
        dog.observe_mask("middle", strange, t)


def test_frozen_images_can_be_allowed_for_simulators_that_stand_still() -> None:
    messages = list(changed(color_print=5, depth_print=6)(stream(RUN_S)))
    reports = run({"left": messages}, config=WatchdogConfig(frozen_s=None))
    assert not [d for r in reports for d in r.diagnoses]


@given(st.lists(st.integers(0, 10**10), min_size=1, max_size=300))
def test_latencies_are_exact_order_statistics(latencies: list[int]) -> None:
    dog = Watchdog([])
    for i, latency in enumerate(latencies):
        dog.observe_mapped(i * 1000 - latency, i * 1000)
    found = dog.check(300_000).latency
    assert found is not None
    values = np.array(latencies)
    assert found.p50_ms * 1e6 == pytest.approx(np.percentile(values, 50, method="inverted_cdf"))
    assert found.p99_ms * 1e6 == pytest.approx(np.percentile(values, 99, method="inverted_cdf"))
    assert found.count == len(latencies)


def test_latencies_are_of_the_window_and_memory_is_bounded() -> None:
    dog = Watchdog([])
    for i in range(20_000):
        dog.observe_mapped(i * S // 100 - 5_000_000, i * S // 100)
    early = dog.check(200 * S).latency
    assert early is not None
    assert (early.count, early.p99_ms) == (4096, 5.0)  # of the last 41 s, although 60 s were asked for
    assert dog.check(300 * S).latency is None


def test_when_a_camera_stops_the_map_turns_unknown_and_obstacles_stay() -> None:
    config: Config = config_from_dict({"grid": {"resolution_m": 0.1}})
    frames = [replace(f, stamp_ns=(i + 1) * S // 15) for i, f in enumerate(garden())]
    mapper, dog = (
        ObstacleMapper(open_oracle(config.segmenter, frames[0].label_set), config),
        Watchdog(["front"]),
    )
    freshness: LastObserved | None = None
    for frame in frames:
        step = mapper.step(frame)
        freshness = freshness or LastObserved(step.observation.spec)
        freshness.integrate(step.observation)
        dog.observe_frame("front", frame_stats(frame, frame.stamp_ns, MOUNT))
        dog.observe_pose(frame.stamp_ns)
        report = dog.check(frame.stamp_ns)
    live = mapper.map
    assert live is not None
    assert freshness is not None
    assert live.count(MapClass.GRASS) > 1000
    for silence_s, share_free in ((0.5, 1.0), (2.0 + 1.0, 0.0)):
        report = dog.check(frames[-1].stamp_ns + round(silence_s * S))
        given_out = freshness.forget_stale(live, report.forget_before_ns)
        assert given_out.count(MapClass.GRASS) == share_free * live.count(MapClass.GRASS)
        np.testing.assert_array_equal(given_out.is_obstacle, live.is_obstacle)
    assert report.stop


def test_a_pose_that_jumps_is_named_and_its_frame_is_left_out() -> None:
    messages = stream(6.0)
    still = [(t, replace(m, position_m=(0.1 * i, 0.0, 0.5))) for i, (t, m) in enumerate(messages)]
    gone = [
        (t, replace(m, position_m=(0.1 * i + 2.0 * (i >= 40), 0, 0))) for i, (t, m) in enumerate(messages)
    ]
    dog = Watchdog(["left"])
    assert all(dog.observe_frame("left", m) for _, m in still)
    dog = Watchdog(["left"])
    fit = [dog.observe_frame("left", m) for _, m in gone]
    assert [i for i, ok in enumerate(fit) if not ok] == [40]
    off = Watchdog(["left"], WatchdogConfig(pose_speed_mps=None))
    assert all(off.observe_frame("left", m) for _, m in gone)


def test_a_pose_that_jumped_is_told_for_a_second() -> None:
    dog, base = Watchdog(["left"]), looks(0)
    for i in range(30):
        at = replace(
            base, stamp_ns=(i + 1) * S // 15, arrival_ns=(i + 1) * S // 15, color_print=i, depth_print=i
        )
        dog.observe_frame("left", replace(at, position_m=(0.1 * i + 2.0 * (i == 29), 0.0, 0.5)))
        report = dog.check(at.arrival_ns)
    assert Fault.JUMPED_POSE in report.faults("left")
    assert Fault.JUMPED_POSE not in dog.check(report.stamp_ns + 2 * S).faults("left")
