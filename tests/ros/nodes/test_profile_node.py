"""profile_node: what becomes of each file."""

import hashlib
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
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
    profile = {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3, **parameters}
    with NodeSuite(("profile",), parameters={"profile": profile}):
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
    with profile_node(folder, x_unit="mm", z_unit="mm", z_positive="down", noise="none"):
        plain, stated = sorted(published.wait(2), key=lambda profile: profile.source)
    assert min(plain.z_m) == pytest.approx(-0.1e-3)
    assert (plain.x_m[0], plain.x_m[-1]) == pytest.approx((-0.150, 0.150))
    assert min(stated.z_m) == pytest.approx(-0.2e-3)


def test_heights_only_need_a_spacing(folder: Path, published: Outcomes) -> None:
    (folder / "heights.txt").write_text("\n".join(str(0.05 * (i == 10)) for i in range(21)))
    with profile_node(folder, x_unit="m", z_unit="mm", z_positive="up", spacing=0.005, noise="none"):
        (profile,) = published.wait(1)
    assert profile.x_m[1] - profile.x_m[0] == pytest.approx(0.005)
    assert max(profile.z_m) == pytest.approx(0.05e-3)


def dip_text(*, first_mm: int = -600, last_mm: int = 600) -> str:
    """A dip of 0.40 mm over 300 mm, as an instrument writes it: +-600 mm every 5 mm, or a part of that."""
    x = np.arange(first_mm, last_mm + 1, 5)
    z = np.where(np.abs(x) < 150, -0.2 * (1 + np.cos(2 * np.pi * x / 300)), 0.0)
    rows = "".join(f"{at};{height:.3f}\n".replace(".", ",") for at, height in zip(x, z, strict=True))
    return f"Position [mm];Höhe [mm]\n{rows}"


def test_file_that_arrives_in_pieces_is_one_measurement(folder: Path, published: Outcomes) -> None:
    raw = dip_text().encode("cp1252")
    with profile_node(folder, unfinished_s=3.0), (folder / "slow.csv").open("wb") as file:
        for begin in range(0, len(raw), 1200):
            file.write(raw[begin : begin + 1200])
            file.flush()
            time.sleep(0.6)  # far longer than settle_s
        (profile,) = published.wait(1)
        time.sleep(0.5)
    assert len(published.messages) == 1
    assert min(profile.z_m) == pytest.approx(-0.4e-3, abs=2e-6)
    assert len(profile.measured_x_m) == 241
    assert profile.noise.noise_m < 1e-6


def test_a_newer_version_of_a_file_supersedes_the_older(folder: Path, published: Outcomes) -> None:
    file = folder / "w.csv"
    with profile_node(folder):
        file.write_text(dip_text(last_mm=400))  # left alone for longer than unfinished_s: taken
        (half,) = published.wait(1)
        file.write_text(dip_text())
        half, whole = published.wait(2)
    assert half.file_version_of == whole.file_version_of == "w.csv"
    assert half.weld_id == whole.weld_id
    assert half.profile_id != whole.profile_id


def test_several_welds_of_a_file_are_several_measurements(folder: Path, published: Outcomes) -> None:
    (folder / "two.csv").write_text(dip_text() + dip_text().partition("\n")[2])
    with profile_node(folder):
        welds = published.wait(2)
    assert [weld.weld_id for weld in welds] == ["two-1", "two-2"]
    assert len({weld.profile_id for weld in welds}) == 2


@pytest.mark.parametrize("name", ["a.dat", "b.xlsx", "c"])
def test_any_file_that_cannot_be_read_gets_a_line(folder: Path, published: Outcomes, name: str) -> None:
    (folder / name).write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(20)))
    with profile_node(folder):
        (rejection,) = published.wait(1)
    assert rejection.source == name


def test_a_refused_file_is_another_try_when_it_is_read_by_other_options(folder: Path, published: Outcomes) -> None:
    file = folder / "heights.txt"
    file.write_text("\n".join(str(0.05 * (i == 10)) for i in range(21)))
    stated = {"z_unit": "mm", "z_positive": "up", "spacing": 5.0, "noise": "none"}
    with profile_node(folder, **stated):
        (no_unit,) = published.wait(1)
    with profile_node(folder, **stated):
        published.wait(2)
    with profile_node(folder, **stated, x_unit="mm", skip_rows=10):
        _, _, too_short = published.wait(3)
    with profile_node(folder, **stated, x_unit="mm"):
        *_, profile = published.wait(4)
    same = published.messages[1]
    assert [type(m) for m in published.messages] == [Rejection, Rejection, Rejection, WeldProfile]
    assert same.profile_id == no_unit.profile_id
    assert len({no_unit.profile_id, too_short.profile_id, profile.profile_id}) == 3
    assert {m.file_version_of for m in published.messages} == {"heights.txt"}
