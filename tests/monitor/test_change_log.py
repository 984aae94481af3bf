"""One line for each change, none without."""

from swardmap.monitor.change_log import ChangeLog
from swardmap.monitor.diagnostics import Diagnosis, Fault, HealthReport, Severity

TENTH_NS = 100_000_000


def report(i: int, stop: bool, *faults: tuple[str, Fault, str]) -> HealthReport:
    return HealthReport(i * TENTH_NS, tuple(Diagnosis.named(*f) for f in faults), stop, None, {}, None)


def test_a_day_in_lines() -> None:
    log, lines = ChangeLog(), []
    stopped, slow = ("camera", Fault.STOPPED, "no frame for 0.6 s"), ("camera", Fault.SLOW, "3.1 frames/s")

    def tell(i: int, stop: bool, *faults: tuple[str, Fault, str]) -> None:
        line = log.line(report(i, stop, *faults))
        if line is not None:
            lines.append((i, *line))

    for i in range(20):
        tell(i, True)
    for i in range(20, 40):
        tell(i, False)
    for i in range(40, 60):
        tell(i, True, stopped)
    for i in range(60, 80):
        tell(i, True)
    for i in range(80, 100):
        tell(i, False, *([slow] if i % 3 == 0 else []))
    for i in range(100, 120):
        tell(i, False)
    assert [(i, severity, text) for i, severity, text in lines] == [
        (0, Severity.WARN, ChangeLog.FIRST),
        (20, Severity.OK, "go: the stop flag is taken back"),
        (40, Severity.STOP, "stop: camera: stopped, no frame for 0.6 s"),
        (70, Severity.OK, "camera: stopped is over"),
        (80, Severity.OK, "go: the stop flag is taken back"),
        (81, Severity.WARN, "camera: slow, 3.1 frames/s"),
        (110, Severity.OK, "camera: slow is over"),
    ]


def test_another_fault_while_it_stands_is_told() -> None:
    log = ChangeLog()
    log.line(report(0, True))
    one, two = ("pose", Fault.LOST_POSE, "the last is 0.6 s old"), ("camera", Fault.BLACK, "for 0.3 s")
    assert log.line(report(1, True, one)) == (Severity.STOP, "pose: lost pose, the last is 0.6 s old")
    assert log.line(report(2, True, one)) is None
    assert log.line(report(3, True, one, two)) == (Severity.STOP, "camera: black, for 0.3 s")


def test_a_clock_that_goes_back_does_not_silence_it() -> None:
    log = ChangeLog()
    fault = ("camera", Fault.STOPPED, "no frame")
    log.line(report(1000, True, fault))
    assert log.line(report(10, True)) == (Severity.OK, "camera: stopped is over")
    assert log.line(report(11, True, fault)) is not None
