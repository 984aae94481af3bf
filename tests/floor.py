"""A floor on the number of tests that ran: what silently skips turns the run red.

`pytest --least-executed 2600` fails where fewer tests passed or failed, however many were collected.
"""

from collections.abc import Iterator

import pytest


class ExecutedTests:
    """Counts tests whose body ran; a skipped one, or one whose set-up failed, did not."""

    def __init__(self, least: int) -> None:
        self.least = least
        self.count = 0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Count one test; under xdist the main process hears the reports of all workers."""
        self.count += report.when == "call" and report.outcome in ("passed", "failed")

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_sessionfinish(self, session: pytest.Session) -> Iterator[None]:
        """Turn a run that was green by skipping red, before its result is shown."""
        if self.count < self.least and session.exitstatus == pytest.ExitCode.OK:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED
        yield

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        """Say how many ran, and how many were expected."""
        verdict = "as expected" if self.count >= self.least else "too few: see which were skipped (-rs)"
        terminalreporter.write_line(f"{self.count} tests executed, at least {self.least} {verdict}")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --least-executed."""
    parser.addoption("--least-executed", type=int, default=0, help="fail if fewer tests were executed")


def pytest_configure(config: pytest.Config) -> None:
    """Count in the process that hears of all tests."""
    least: int = config.getoption("--least-executed")
    if least and not hasattr(config, "workerinput"):
        config.pluginmanager.register(ExecutedTests(least), "executed-tests")
