"""What a log is told of health reports: one line when something changes, and why."""

from swardmap.monitor.diagnostics import Diagnosis, Fault, HealthReport, Severity, in_ns

QUIET_S = 1.0
"""A fault is over when it has not been there for so long; one that comes and goes is told once."""

Key = tuple[str, Fault]


class ChangeLog:
    """Compares each report with those before it.

    The first report is no change: the flag is stop from the start, which is told by `FIRST`.
    """

    FIRST = "stop: from the start, until all has been well for a while"

    def __init__(self) -> None:
        self._stop: bool | None = None
        self._last_ns: dict[Key, int] = {}

    def line(self, report: HealthReport) -> tuple[Severity, str] | None:
        """What has changed, in one line, and how grave it is; None if nothing has."""
        present = {(d.subject, d.fault): d for d in report.diagnoses}
        come = [d for key, d in present.items() if key not in self._last_ns]
        for key in present:
            self._last_ns[key] = report.stamp_ns
        ages_ns = {key: report.stamp_ns - at for key, at in self._last_ns.items()}
        over = [key for key, age in ages_ns.items() if age > in_ns(QUIET_S) or age < 0]  # < 0: another clock
        for key in over:
            del self._last_ns[key]
        was, self._stop = self._stop, report.stop
        if was is None:
            return Severity.WARN, "; ".join([self.FIRST, *map(_told, come)])
        if report.stop and not was:
            reasons = [d for d in report.diagnoses if d.severity == Severity.STOP] or come
            return Severity.STOP, f"stop: {_joined(reasons)}"
        texts = ["go: the stop flag is taken back"] if was and not report.stop else []
        texts += [f"{subject}: {fault} is over" for subject, fault in over]
        texts += map(_told, come)
        worst = max((d.severity for d in come), default=Severity.OK)
        return (worst, "; ".join(texts)) if texts else None


def _told(diagnosis: Diagnosis) -> str:
    return f"{diagnosis.subject}: {diagnosis.fault}, {diagnosis.message}"


def _joined(diagnoses: list[Diagnosis]) -> str:
    return "; ".join(map(_told, diagnoses)) or "no reason is known"
