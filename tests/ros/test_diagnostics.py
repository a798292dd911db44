"""The state of a node in /diagnostics: a problem is reported for a stated time, what persists stays."""

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from tests.harness.ros import Probe
from weld_force_ros.ros import diagnostics, qos
from weld_force_ros.ros.diagnostics import RECOVERY_S, NodeDiagnostics
from weld_force_ros.ros.node_suite import NodeSuite

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Watch:
    """A monotonic clock that is set by hand."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Watch:
    watch = Watch()
    monkeypatch.setattr(diagnostics.time, "monotonic", watch)
    monkeypatch.setattr(diagnostics.time, "time", lambda: 1_700_000_000 + watch.now_s)
    return watch


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def test_problem_is_reported_with_its_time_and_passes_after_the_stated_time(watch: Watch) -> None:
    node = NodeDiagnostics("/node", "/node#1")
    assert node.status().level == OK
    node.report_problem("a.csv: no number")
    watch.now_s += RECOVERY_S - 1
    status = node.status()
    assert status.level == WARN
    assert status.message == "a.csv: no number (at 2023-11-14 22:30:00 UTC; OK again in 1 s without another)"
    watch.now_s += 1
    status = node.status()
    assert (status.level, status.message) == (OK, "running")
    assert values(status)["last error"] == "a.csv: no number"
    assert values(status)["last error at"] == "2023-11-14 22:30:00 UTC"
    assert values(status)["problems since"] == ""


def test_problem_that_persists_stays_and_says_since_when(watch: Watch) -> None:
    node = NodeDiagnostics("/node", "/node#1")
    for _ in range(20):
        node.report_problem("the folder cannot be read")
        watch.now_s += RECOVERY_S / 2
        status = node.status()
        assert status.level == WARN
    assert "last of 20 problems since 2023-11-14 22:30:00 UTC" in status.message
    assert values(status)["problems since"] == "2023-11-14 22:30:00 UTC"


def test_lost_messages_are_a_problem_when_they_are_noticed_and_counted_for_ever(watch: Watch) -> None:
    node = NodeDiagnostics("/node", "/node#1")
    node.gaps = lambda: 2
    status = node.status()
    assert (status.level, status.message.startswith("2 messages were lost on the way (")) == (WARN, True)
    watch.now_s += RECOVERY_S
    status = node.status()
    assert (status.level, values(status)["sequence gaps"]) == (OK, "2")
    node.gaps = lambda: 3
    assert node.status().message.startswith("3 messages were lost on the way (")


def test_what_keeps_a_node_from_its_work_does_not_pass(watch: Watch) -> None:
    node = NodeDiagnostics("/node", "/node#1")
    node.fail(ValueError("no fit"))
    watch.now_s += 10 * RECOVERY_S
    assert (node.status().level, node.status().message) == (ERROR, "no fit")


def test_node_recovers_after_a_rejected_file(
    domain_id: int, probe: Probe, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrays = probe.collect("/diagnostics", DiagnosticArray, qos.DIAGNOSTICS)
    (folder / "bad.csv").write_text("# x_unit: mm\nx,z\n0,nonsense\n")
    with NodeSuite(
        ("profile",), parameters={"profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3}}
    ):
        (warned, *_) = arrays.wait(1, lambda a: a.status[0].level == WARN)
        assert warned.status[0].message.startswith("bad.csv: ")
        monkeypatch.setattr(diagnostics, "RECOVERY_S", 0.0)  # not before a warning has come, however late it comes
        (recovered, *_) = arrays.wait(
            1, lambda a: a.status[0].level == OK and values(a.status[0]).get("published rejection") == "1"
        )
    assert recovered.status[0].message == "running"
    assert values(recovered.status[0])["last error"].startswith("bad.csv: ")
