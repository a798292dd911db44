"""The live report without ROS: what it keeps, and whom its server answers."""

import gzip
import http.client
import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from msgspec.structs import replace

from tests.cli.test_show import force_map
from tests.harness.limits import by_value
from weld_force_ros._words import Words
from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError
from weld_force_ros.messages import (
    ForceHistory,
    Message,
    Rejection,
    SimulationSettings,
    WeldProfile,
    config_sha256,
    profile_sha256,
)
from weld_force_ros.recording.weld_records import Record
from weld_force_ros.report import live_report
from weld_force_ros.report.live_report import LiveReport
from weld_force_ros.report.live_server import Server, _Http
from weld_force_ros.report.weld_section import section

PAGE = "<!doctype html><title>page</title>"
LIMITS = by_value()


def settings() -> SimulationSettings:
    found = SimulationSettings(
        config_sha256="",
        track="bilbao",
        track_definition="x",
        engine="common-poles",
        speeds_kmh=[40.0],
        positions_m=[0.3],
        wheel_mass_kg=700.0,
        static_load_n=100e3,
        wheel_radius_m=0.46,
        hertz_n_per_m15=9e10,
    )
    return replace(found, config_sha256=config_sha256(found))


def parts(weld_id: str) -> list[Message]:
    """Profile, map, history and verdict of a weld."""
    x = [0.005 * i for i in range(-30, 31)]
    z = [-1e-4 * (1 - abs(i) / 30) for i in range(-30, 31)]
    sha256, config = profile_sha256(x, z), settings().config_sha256
    profile = WeldProfile(weld_id=weld_id, source=f"{weld_id}.csv", x_m=x, z_m=z, profile_sha256=sha256)
    found = replace(force_map(weld_id), profile_sha256=sha256, config_sha256=config)
    column = [0.0, 1.0]
    history = ForceHistory(
        weld_id=weld_id, profile_sha256=sha256, config_sha256=config, speed_kmh=40.0, position_m=0.3,
        x_m=column, force_n=column, wheel_m=column, rail_m=column, irregularity_m=column,
    )  # fmt: skip
    return [profile, found, history, judge(found, LIMITS)]


def rows(report: LiveReport, after: int = 0) -> list[dict]:
    return json.loads(report.rows_after(after))


def part(report: LiveReport, number: int) -> str:
    return gzip.decompress(report.detail(number)).decode()


@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2)])
@pytest.mark.parametrize("settings_first", [True, False])
def test_details_are_whole_in_whatever_order_messages_come(tmp_path, order, settings_first):
    report, messages = LiveReport(tmp_path), parts("KM12")
    in_force = [settings(), LIMITS]
    for message in [*(in_force if settings_first else []), *(messages[i] for i in order)]:
        report.add(message)
    if not settings_first:
        for message in in_force:
            report.add(message)
    (row,) = rows(report)
    assert (row["n"], row["weld"]) == (1, "KM12")
    found = part(report, 1)
    for heading in ("Geometry and quality index", "Peak force over speed", "Peak force by speed", "One passage at"):
        assert heading in found
    assert 'class="wheel"' in found  # which needs the settings


def test_a_row_is_there_before_its_map(tmp_path):
    report = LiveReport(tmp_path)
    report.add(parts("KM12")[3])
    assert [row["weld"] for row in rows(report)] == ["KM12"]
    assert ">KM12</h2>" in part(report, 1)


@pytest.mark.parametrize("verdict_at", range(6))
def test_of_several_vehicles_the_one_that_decides_is_shown(tmp_path, verdict_at):
    profile, force_map, history, verdict = parts("KM12")
    heavier = [replace(one, config_sha256="0" * 64) for one in (force_map, history)]
    heavier[0].peak_force_n = [2 * peak for peak in force_map.peak_force_n]
    several = [profile, heavier[0], force_map, heavier[1], history]
    several.insert(verdict_at, verdict)
    shown = []
    for number, messages in enumerate((several, parts("KM12"))):
        (tmp_path / str(number)).mkdir()
        report = LiveReport(tmp_path / str(number))
        for message in [settings(), LIMITS, *messages]:
            report.add(message)
        shown.append(part(report, 1))
    assert shown[0] == shown[1]


def test_a_newer_version_of_a_file_names_the_row_that_it_supersedes(tmp_path):
    report = LiveReport(tmp_path)
    for weld, file in (("KM12", "a.csv"), ("KM13", "b.csv"), ("KM12", "a.csv")):
        profile, *_, verdict = parts(weld)
        for message in (profile, verdict):
            message.profile_id = f"{report.count:064x}"
        profile.file_version_of = file
        report.add(profile)
        report.add(verdict)
    assert [row.get("supersedes") for row in rows(report)] == [None, None, [1]]
    refused = Rejection(source="a.csv", reason="no units", remedy="state them", file_version_of="a.csv")
    report.add(refused)
    report.add(refused)
    for message in (profile, verdict):
        message.profile_id = f"{report.count:064x}"
        report.add(message)
    assert [row.get("supersedes") for row in rows(report)][3:] == [[3], [4], [5]]


def test_rejections_are_rows(tmp_path):
    report = LiveReport(tmp_path)
    report.add(Rejection(source="a.csv", reason="no units", remedy="state them"))
    assert rows(report)[0]["decision"] == "unusable"
    assert "Because: No units." in part(report, 1)


@pytest.mark.parametrize(
    "message", [parts("KM12")[3], Rejection(source="a.csv", reason="no units", remedy="state them")]
)
def test_details_are_there_before_the_row_that_leads_to_them(tmp_path, monkeypatch, message):
    report, kept = LiveReport(tmp_path), []

    def note_rows(record: Record, words: Words) -> str:
        kept.append(rows(report))
        return section(record, words)

    monkeypatch.setattr(live_report, "section", note_rows)
    report.add(message)
    assert kept == [[]]
    assert len(rows(report)) == report.count == 1


def test_a_row_is_kept_though_its_details_cannot_be_written(tmp_path):
    report = LiveReport(tmp_path / "gone")
    for number, message in enumerate([parts("KM12")[3], Rejection(source="a.csv", reason="x", remedy="y")], 1):
        with pytest.raises(OSError, match="gone"):
            report.add(message)
        assert [row["n"] for row in rows(report)][-1] == number


def test_only_the_newest_are_kept_in_memory_and_on_disk(tmp_path):
    report = LiveReport(tmp_path, newest=3)
    for i in range(10):
        for message in parts(f"weld-{i}"):
            report.add(message)
    assert [row["n"] for row in rows(report)] == [8, 9, 10]
    assert [row["n"] for row in rows(report, 9)] == [10]
    assert rows(report, 10) == rows(report, 10**9) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["10.gz", "8.gz", "9.gz"]
    assert report.detail(7) is None
    assert report.count == 10


def test_what_never_gets_its_verdict_is_given_up(tmp_path):
    report = LiveReport(tmp_path)
    for i in range(300):
        report.add(parts(f"weld-{i}")[0])
    assert len(report._partial) == 256
    report.add(parts("weld-0")[3])
    assert "Geometry and quality index" not in part(report, 1)


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Server]:
    report = LiveReport(tmp_path)
    for message in parts("KM12"):
        report.add(message)
    server = Server(report, PAGE, 0)
    yield server
    server.close()


def ask(server: Server, path: str, method: str = "GET", **headers: str) -> tuple[http.client.HTTPResponse, bytes]:
    port = urlsplit(server.url).port
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as connection:
        connection.request(method, path, headers=headers)
        answer = connection.getresponse()
        return answer, answer.read()


def test_what_is_served(served):
    for path, kind, expected in (
        ("/", "text/html; charset=utf-8", PAGE.encode()),
        ("/rows", "application/json", None),
        ("/rows?after=1", "application/json", b"[]"),
        ("/weld/1", "application/gzip", None),
    ):
        answer, data = ask(served, path)
        assert (answer.status, answer.headers["Content-Type"]) == (200, kind)
        assert expected in (None, data)
        head, nothing = ask(served, path, "HEAD")
        assert (head.status, head.headers["Content-Length"], nothing) == (200, str(len(data)), b"")
    assert json.loads(ask(served, "/rows?after=0")[1])[0]["weld"] == "KM12"
    assert ">KM12</h2>" in gzip.decompress(ask(served, "/weld/1")[1]).decode()
    assert "Measured on" in ask(served, "/header")[1].decode()


@pytest.mark.parametrize(
    "path",
    [
        "/weld/2", "/weld/", "/weld/-1", "/weld/../../etc/passwd", "/weld/1.gz",
        "/weld/%31", "/weld/" + "9" * 5000, "/nowhere", "/rows?after=",
        "/rows?after=x", "/rows?after=-1", "/rows?after=" + "9" * 5000, "/rows?after=%D9%A1",
    ],
)  # fmt: skip
def test_what_is_not_there(served, path):
    assert ask(served, path)[0].status == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "PATCH", "DELETE", "OPTIONS"])
def test_it_is_to_be_read_only(served, method):
    answer, _ = ask(served, "/rows", method)
    assert (answer.status, answer.headers["Allow"]) == (405, "GET, HEAD")


@pytest.mark.parametrize(
    ("host", "status"),
    [
        ("localhost", 200), ("LocalHost:{port}", 200), ("127.0.0.1:{port}", 200), ("[::1]:{port}", 200),
        ("rebound.example", 403), ("rebound.example:{port}", 403), ("127.0.0.1:1", 403), ("", 403),
        ("localhost.example:{port}", 403), ("127.0.0.1.example", 403), ("localhost@rebound.example", 403),
        ("192.168.1.7:{port}", 403), ("0.0.0.0:{port}", 403),
    ],
)  # fmt: skip
@pytest.mark.parametrize("path", ["/", "/rows", "/weld/1"])
def test_only_who_asks_this_machine_is_answered(served, host, status, path):
    port = served.url.rstrip("/").rpartition(":")[2]
    answer, data = ask(served, path, Host=host.format(port=port))
    assert answer.status == status
    if status == 403:
        assert b"KM12" not in data
        assert PAGE.encode() not in data


def test_two_hosts_or_none_are_refused(served):
    port = int(served.url.rstrip("/").rpartition(":")[2])
    for hosts in ("", f"Host: localhost:{port}\r\nHost: rebound.example\r\n"):
        with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
            connection.sendall(f"GET /rows HTTP/1.1\r\n{hosts}Connection: close\r\n\r\n".encode())
            assert connection.recv(100).startswith(b"HTTP/1.1 403 ")


@pytest.mark.parametrize("path", ["/", "/rows", "/weld/1", "/nowhere"])
def test_headers_are_strict(served, path):
    headers = ask(served, path)[0].headers
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Resource-Policy"] == headers["Cross-Origin-Opener-Policy"] == "same-origin"
    assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
    assert "Access-Control-Allow-Origin" not in headers
    assert "Python" not in headers["Server"]


def test_nonsense_is_refused_with_the_same_headers(served):
    port = int(served.url.rstrip("/").rpartition(":")[2])
    for line in (b"\x16\x03\x01 TLS?\r\n\r\n", b"BREW /rows HTTP/1.1\r\nHost: localhost\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", port), timeout=10) as connection:
            connection.sendall(line)
            answer = connection.recv(10_000)
        assert b" 400 " in answer or b" 501 " in answer
        assert b"Python" not in answer


def test_it_listens_on_this_machine_only(served):
    port = int(served.url.rstrip("/").rpartition(":")[2])
    with closing(socket.socket()) as other, pytest.raises(ConnectionRefusedError):
        other.connect(("127.0.0.2", port))


@pytest.mark.slow
def test_too_many_connections_are_turned_away_and_room_comes_again(served):
    port = int(served.url.rstrip("/").rpartition(":")[2])
    held = [socket.create_connection(("127.0.0.1", port), timeout=10) for _ in range(70)]
    assert held[-1].recv(1) == b""
    for connection in held:
        connection.close()
    for _ in range(100):
        try:
            assert ask(served, "/rows")[0].status == 200
        except (ConnectionError, http.client.HTTPException):
            continue
        break
    else:
        pytest.fail("no room after all have gone")


def test_a_burst_of_connections_waits_for_its_turn(tmp_path):
    server = _Http(LiveReport(tmp_path), PAGE.encode(), ("127.0.0.1", 0), "")  # listens, and takes no connection yet
    with closing(server.socket), ExitStack() as stack:
        for _ in range(70):  # where there is no room to wait, a client is kept trying until its time is up
            stack.enter_context(socket.create_connection(("127.0.0.1", server.server_port), timeout=3))


@pytest.fixture
def shared(tmp_path: Path) -> Iterator[Server]:
    """A server that others can reach, too."""
    report = LiveReport(tmp_path)
    for message in parts("KM12"):
        report.add(message)
    server = Server(report, PAGE, 0, "0.0.0.0")  # noqa: S104
    yield server
    server.close()


def test_others_are_answered_if_they_know_the_token(shared):
    root = urlsplit(shared.url).path
    assert len(root) >= 16 + 2
    for host in ("192.168.1.7", "tablet.example:8765"):
        assert ask(shared, root, Host=host)[1] == PAGE.encode()
        assert json.loads(ask(shared, f"{root}rows?after=0", Host=host)[1])[0]["weld"] == "KM12"
        assert ask(shared, f"{root}header", Host=host)[0].status == 200
        assert ask(shared, f"{root}weld/1", Host=host)[0].status == 200


def test_who_does_not_know_the_token_learns_nothing(shared):
    root = urlsplit(shared.url).path
    for path in ("/", "/rows", "/weld/1", root[:-1], root[:-2] + "/", root.upper(), "//", root[1:], "/%ff%fe/rows"):
        for host in ("localhost", "192.168.1.7"):
            answer, data = ask(shared, path, Host=host)
            assert answer.status == 404
            assert data == b"There is nothing here.\n"
            assert "default-src 'none'" in answer.headers["Content-Security-Policy"]


def test_every_server_has_a_token_of_its_own(shared, tmp_path):
    with closing(Server(LiveReport(tmp_path), PAGE, 0, "127.0.0.2")) as other:
        assert urlsplit(other.url).hostname == "127.0.0.2"
        assert urlsplit(other.url).path != urlsplit(shared.url).path
        assert ask(shared, urlsplit(other.url).path)[0].status == 404


@pytest.mark.parametrize("host", ["203.0.113.9", "no.such.host.invalid", "a" * 70 + ".example"])
def test_a_host_that_is_not_this_machine_is_one_clear_error(tmp_path, host):
    with pytest.raises(InputError, match=r"is no address of this machine .*--dashboard-host"):
        Server(LiveReport(tmp_path), PAGE, 0, host)


def test_a_used_port_is_one_clear_error(served, tmp_path):
    port = int(served.url.rstrip("/").rpartition(":")[2])
    with pytest.raises(InputError, match=f"port {port} is in use; give another one with --dashboard-port"):
        Server(LiveReport(tmp_path), PAGE, port)


def test_a_closed_server_lets_go_of_its_port(tmp_path):
    first = Server(LiveReport(tmp_path), PAGE, 0)
    port = int(first.url.rstrip("/").rpartition(":")[2])
    kept_open = socket.create_connection(("127.0.0.1", port), timeout=10)
    assert ask(first, "/rows")[0].status == 200  # so the connection before this one was taken
    first.close()
    assert kept_open.recv(1) == b""
    kept_open.close()
    Server(LiveReport(tmp_path), PAGE, port).close()


def test_a_row_names_what_its_verdict_rests_on_as_far_as_it_has_arrived(tmp_path):
    books = load_limits("force,banenor-531")
    profile, found, _, _ = parts("KM12")
    verdict = judge(found, books)
    report = LiveReport(tmp_path)
    report.add(verdict)
    assert rows(report)[0]["basis"] == {
        "rule_books": ["force"], "risk": 0.05, "static_n": 100e3, "unknown": True,
        "software": verdict.software, "limits": verdict.limits_sha256,
    }  # fmt: skip
    report = LiveReport(tmp_path)
    for message in (settings(), books, replace(profile, measured_on="2026-11-20"), found, verdict):
        report.add(message)
    basis = rows(report)[0]["basis"]
    assert (basis["track"], basis["unsprung_kg"], basis["date"]) == ("bilbao", 700.0, "2026-11-20")
    assert "unknown" not in basis
