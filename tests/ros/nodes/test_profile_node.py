"""profile_node: what becomes of each file."""

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import String

from tests.harness.ros import Outcomes, Probe, profile_text
from weld_force_ros.messages import Rejection, WeldProfile, decode
from weld_force_ros.ros import qos
from weld_force_ros.ros.node_suite import NodeSuite


@pytest.fixture
def published(probe: Probe) -> Outcomes:
    collected = Outcomes()
    for topic, kind in (("weld_profile", WeldProfile), ("rejection", Rejection)):
        raw = probe.collect(topic, String, qos.CONTRACT)
        raw.forward = lambda message, kind=kind: collected(decode(kind, message.data))
    return collected


@contextmanager
def profile_node(folder: Path, **parameters: Any) -> Iterator[None]:
    with NodeSuite(("profile",), parameters={"profile": {"folder": str(folder), "settle_s": 0.05, **parameters}}):
        yield


def test_profile_carries_the_identity_of_its_file(folder: Path, published: Outcomes) -> None:
    text = profile_text(weld_id="KM12-L-004")
    (folder / "a.csv").write_text(text)
    with profile_node(folder):
        (profile,) = published.wait(1)
    assert (profile.weld_id, profile.source) == ("KM12-L-004", "a.csv")
    assert profile.source_sha256 == hashlib.sha256(text.encode()).hexdigest()


def test_same_content_is_published_once_and_new_content_again(folder: Path, published: Outcomes) -> None:
    file = folder / "a.csv"
    file.write_text(profile_text(100))
    with profile_node(folder):
        published.wait(1)
        file.write_text(profile_text(100))  # touched, not changed
        (folder / "b.csv").write_text(profile_text(100))
        published.wait(2)
        file.write_text(profile_text(200))
        published.wait(3)
    assert [(p.source, round(-min(p.z_m) * 1e6)) for p in published.messages] == [
        ("a.csv", 100),
        ("b.csv", 100),
        ("a.csv", 200),
    ]


@pytest.mark.parametrize(
    "content",
    [b"", b"\x00\xff\xfe binary \x80", b"x,z\n1,2\n", profile_text().replace("-", "nan", 1).encode(), b"7" * 5_000_000],
    ids=["empty", "binary", "no units", "not a number", "too large"],
)
def test_bad_file_among_good_ones_is_rejected_with_its_text(folder: Path, published: Outcomes, content: bytes) -> None:
    (folder / "a.csv").write_text(profile_text())
    (folder / "b.csv").write_bytes(content)
    (folder / "c.csv").write_text(profile_text())
    with profile_node(folder):
        published.wait(3)
    (rejection,) = published.of(Rejection)
    assert [p.source for p in published.of(WeldProfile)] == ["a.csv", "c.csv"]
    assert rejection.source == "b.csv"
    assert rejection.raw_text == content.decode("utf-8", "replace")[:65_536]
    assert rejection.raw_truncated == (len(content) > 65_536)
    assert rejection.remedy
    assert "\n" not in rejection.reason


def test_file_name_of_unknown_encoding_is_no_obstacle(folder: Path, published: Outcomes) -> None:
    (folder / b"weld-\xe9.csv".decode("utf-8", "surrogateescape")).write_text(profile_text())
    with profile_node(folder):
        (profile,) = published.wait(1)
    assert profile.source.startswith("weld-")


def test_plain_export_is_read_as_the_parameters_state(folder: Path, published: Outcomes) -> None:
    (folder / "plain.txt").write_text("\n".join(f"{10 * i} {0.1 * (i == 15)}" for i in range(31)))
    (folder / "stated.csv").write_text(profile_text(200))  # has units of its own
    with profile_node(folder, x_unit="mm", z_unit="mm", z_positive="down"):
        plain, stated = published.wait(2)
    assert min(plain.z_m) == pytest.approx(-0.1e-3)
    assert (plain.x_m[0], plain.x_m[-1]) == pytest.approx((-0.150, 0.150))
    assert min(stated.z_m) == pytest.approx(-0.2e-3)


def test_heights_only_need_a_spacing(folder: Path, published: Outcomes) -> None:
    (folder / "heights.txt").write_text("\n".join(str(0.05 * (i == 10)) for i in range(21)))
    with profile_node(folder, x_unit="m", z_unit="mm", z_positive="up", spacing=0.005):
        (profile,) = published.wait(1)
    assert profile.x_m[1] - profile.x_m[0] == pytest.approx(0.005)
    assert max(profile.z_m) == pytest.approx(0.05e-3)
