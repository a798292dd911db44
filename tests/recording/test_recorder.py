import errno
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml

from tests.harness.bags import numbered, read_by_rosbags, record, texts, write
from tests.soak.second_reader import check_bag
from weld_force_ros import recording
from weld_force_ros.errors import BagError, DiskFullError
from weld_force_ros.recording import recorder as recorder_module
from weld_force_ros.recording.disk_space import DiskSpace

MB = 10**6
SECOND_NS = 10**9


def stored_texts(path: Path) -> list[str]:
    return [r.content.data for r in recording.stored(path)]


def listed(directory: Path) -> dict[str, int]:
    """Files and how many messages each, as metadata.yaml has it, its sums checked."""
    content = yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    files = {file["path"]: file["message_count"] for file in content["files"]}
    assert content["relative_file_paths"] == list(files)
    assert content["message_count"] == sum(files.values())
    assert content["message_count"] == sum(t["message_count"] for t in content["topics_with_message_count"])
    return files


def eventually(condition: Callable[[], bool], within_s: float = 20.0) -> None:
    ends_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < ends_s
        time.sleep(0.005)


# One recording in several files


def test_recording_is_split_by_size_and_metadata_is_true_at_each_split(tmp_path):
    with recording.Recorder(tmp_path / "run", split_bytes=3000) as recorder:
        for count in range(1, 101):
            write(recorder, numbered(count)[-1:])
            files = listed(tmp_path / "run")
            assert list(files)[-1] == recorder.path.name
            assert sum(files.values()) == count - len(stored_texts(recorder.path))
    assert len(files) > 3
    assert check_bag(tmp_path / "run") == {"/notes": 100}
    assert texts(tmp_path / "run") == [text for _, text, _ in numbered(100)]
    found = recording.summary(tmp_path / "run")
    assert (found.damage, found.indexed) == (None, True)
    assert {file.name: file.message_count for file in found.files} == listed(tmp_path / "run")


def test_recording_is_split_by_time(tmp_path):
    clock = Clock()
    with clock.patched(), recording.Recorder(tmp_path / "run", split_s=60.0) as recorder:
        for seconds in (500, 30, 29, 2, 30, 30):  # a file's time runs from its first message
            clock.pass_s(seconds)
            write(recorder, numbered(1))
    assert listed(tmp_path / "run") == {"run_0.mcap": 3, "run_1.mcap": 2, "run_2.mcap": 1}


def test_clock_set_back_begins_a_file_and_log_order_is_kept(tmp_path):
    times_s = [100, 101, 50, 51, 102]
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, [("/n", str(t), t * SECOND_NS) for t in times_s])
    assert listed(tmp_path / "run") == {"run_0.mcap": 2, "run_1.mcap": 3}
    assert texts(tmp_path / "run") == ["50", "51", "100", "101", "102"]
    assert check_bag(tmp_path / "run") == {"/n": 5}


def test_topic_that_waited_in_a_queue_is_no_clock_set_back(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        for t in range(100, 110):
            write(recorder, [("/verdict", f"v{t}", t * SECOND_NS), ("/force_map", f"m{t}", (t - 5) * SECOND_NS)])
    assert listed(tmp_path / "run") == {"run_0.mcap": 20}


# A recording that exists


def test_recording_is_continued_in_a_new_file(tmp_path):
    directory = record(tmp_path / "run", numbered(10))
    before = (directory / "run_0.mcap").read_bytes()
    with recording.Recorder(directory) as recorder:
        assert listed(directory) == {"run_0.mcap": 10, "run_1.mcap": 0}
        write(recorder, [("/later", "x", 10**6)])
    assert (directory / "run_0.mcap").read_bytes() == before
    assert listed(directory) == {"run_0.mcap": 10, "run_1.mcap": 1}
    assert check_bag(directory) == {"/notes": 10, "/later": 1}


def test_number_of_a_file_that_was_moved_away_is_not_used_again(tmp_path):
    directory = record(tmp_path / "run", numbered(1))
    with recording.Recorder(directory) as recorder:
        write(recorder, numbered(1))
    (directory / "run_1.mcap").rename(tmp_path / "run_1.mcap")
    with recording.Recorder(directory) as recorder:
        assert recorder.path.name == "run_2.mcap"
    assert listed(directory) == {"run_0.mcap": 1, "run_2.mcap": 0}


@pytest.mark.parametrize("there", ["file", "folder"])
def test_something_else_is_not_written_to(tmp_path, there):
    path = tmp_path / "run"
    if there == "file":
        path.write_text("mine")
    else:
        path.mkdir()
        (path / "thesis.mcap").write_text("mine")
    with pytest.raises(BagError, match="exists and is not overwritten"):
        recording.Recorder(path)
    assert [p.read_text() for p in tmp_path.rglob("*") if p.is_file()] == ["mine"]


def test_second_recorder_is_refused_while_the_first_runs(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        with pytest.raises(BagError, match=f"recorded to by process {os.getpid()}, running since 2") as refused:
            recording.Recorder(tmp_path / "run")
        assert "\n" not in str(refused.value)
        write(recorder, numbered(3))
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, numbered(2))
    assert check_bag(tmp_path / "run") == {"/notes": 5}


@pytest.mark.parametrize("torn", [b"", bytes(100), b"\x05" + bytes(7) + b"\x01torn"], ids=["whole", "zeros", "torn"])
def test_file_of_a_killed_process_is_completed_and_the_damaged_original_kept(tmp_path, torn):
    directory = tmp_path / "run"
    directory.mkdir()
    other = recording.Recorder(tmp_path / "other")
    write(other, numbered(20))
    left = other.path.read_bytes() + torn
    other.close()
    (directory / "run_0.mcap").write_bytes(left)
    (directory / "run_1.mcap").write_bytes(b"")  # killed before the first byte
    (directory / "run_2.mcap").write_bytes(b"garbage")
    (directory / "run_0.mcap.part").write_bytes(left[:100])

    with recording.Recorder(directory) as recorder:
        write(recorder, [("/notes", "next", 10**6)])
    assert listed(directory) == {"run_0.mcap": 20, "run_1.mcap": 0, "run_2.mcap": 0, "run_3.mcap": 1}
    assert check_bag(directory) == {"/notes": 21}
    assert texts(directory) == [text for _, text, _ in numbered(20)] + ["next"]
    kept = {path.name: path.read_bytes() for path in directory.glob("*.cut")}
    assert kept == {**({"run_0.mcap.cut": left} if torn else {}), "run_2.mcap.cut": b"garbage"}
    assert not list(directory.glob("*.part"))


WRITES_UNTIL_KILLED = """
    import sys, time
    from pathlib import Path
    from weld_force_ros import recording
    recorder = recording.Recorder(Path(sys.argv[1]), split_bytes=40_000)
    first = int(sys.argv[2])
    for i in range(first, first + 100_000):
        cdr = recording.string_cdr(f"{i} " + "x" * 2000)
        recorder.write("/n", recording.STRING, cdr, log_time_ns=i, publish_time_ns=i)
        print(i, flush=True)
        time.sleep(0.002)
"""


def test_process_killed_at_random_moments_loses_nothing_it_wrote(tmp_path):
    directory = tmp_path / "run"
    moments = random.Random(7)  # noqa: S311
    acknowledged: list[int] = []
    for _ in range(5):
        command = [sys.executable, "-c", textwrap.dedent(WRITES_UNTIL_KILLED), str(directory), str(len(acknowledged))]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            said = [child.stdout.readline() for _ in range(moments.randint(5, 120))]
            time.sleep(moments.uniform(0, 0.01))
            child.send_signal(signal.SIGKILL)
            said += child.stdout.readlines()
        assert child.returncode == -signal.SIGKILL
        acknowledged += [int(line) for line in said if line.endswith("\n")]
        there = [int(text.split()[0]) for text in stored_texts(directory)]
        # The message under way when the process was killed may be there too.
        assert there in (acknowledged, [*acknowledged, len(acknowledged)])
        acknowledged = there
    report = recording.recover(directory)
    assert report.message_count == len(acknowledged)
    assert check_bag(tmp_path / "run-recovered") == {"/n": len(acknowledged)}
    recording.Recorder(directory).close()
    assert check_bag(directory) == {"/n": len(acknowledged)}


# On disk


def test_message_is_forced_to_the_disk_though_none_follows(tmp_path, monkeypatch):
    forced = threading.Event()
    sync = os.fdatasync
    with recording.Recorder(tmp_path / "run") as recorder:
        monkeypatch.setattr(os, "fdatasync", lambda handle: (sync(handle), forced.set()))
        assert recorder.longest_unsynced_s == 0.0
        write(recorder, numbered(1))
        assert forced.wait(timeout=20)
        eventually(lambda: recorder.longest_unsynced_s > 0.0)
        waited_s = recorder.longest_unsynced_s
    assert recorder.longest_unsynced_s >= waited_s


def test_disk_that_fails_is_reported_by_the_next_write(tmp_path, monkeypatch):
    failed = threading.Event()

    def fail(handle: int) -> None:
        failed.set()
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, numbered(1))
        with monkeypatch.context() as patch:
            patch.setattr(os, "fdatasync", fail)
            write(recorder, numbered(1))
            assert failed.wait(timeout=20)

        def refused() -> bool:
            try:
                write(recorder, numbered(1))
            except BagError as error:
                assert not isinstance(error, DiskFullError)  # noqa: PT017
                return "Input/output error" in str(error)
            return False

        eventually(refused)
        write(recorder, [("/n", "last", 0)])
    assert texts(tmp_path / "run").count("last") == 1


def test_folder_that_is_removed_is_an_error_and_no_silence(tmp_path):
    recorder = recording.Recorder(tmp_path / "run")
    write(recorder, numbered(1))
    shutil.rmtree(tmp_path / "run")
    with pytest.raises(BagError, match="removed while it was written"):
        write(recorder, numbered(1))
    with pytest.raises(BagError, match="No such file"):
        recorder.close()


# A full disk


@contextmanager
def largest_file(size: int) -> Iterator[None]:
    """The kernel refuses to let a file grow beyond `size`, as it does on a full disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_write_that_the_system_refuses_harms_no_other_message(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, numbered(5))
        with (
            largest_file(recorder.path.stat().st_size + 300),
            pytest.raises(BagError, match=r"run_0\.mcap: File too large; check the disk.*/other is kept") as refused,
        ):
            write(recorder, [("/other", "y" * 1000, 6000)])
        assert "\n" not in str(refused.value)
        assert len(texts(tmp_path / "run")) == 5
        assert recording.open_bag(recorder.path).lost_bytes == 0
        write(recorder, [("/other", "space again", 7000)])
    assert [m.data for _, _, m in read_by_rosbags(tmp_path / "run")][4:] == [numbered(5)[4][1], "space again"]


def test_close_that_the_system_refuses_keeps_the_messages(tmp_path):
    recorder = recording.Recorder(tmp_path / "run")
    write(recorder, numbered(5))
    with largest_file(recorder.path.stat().st_size + 10), pytest.raises(BagError, match="weld-force bag recover"):
        recorder.close()
    assert recording.recover(tmp_path / "run").lossy is False
    assert check_bag(tmp_path / "run-recovered") == {"/notes": 5}


@pytest.mark.parametrize("reason", [errno.ENOSPC, errno.EIO])
def test_interrupted_compression_leaves_a_complete_bag(tmp_path, monkeypatch, reason):
    def refuse(*_: object) -> None:
        raise OSError(reason, os.strerror(reason))

    recorder = recording.Recorder(tmp_path / "run")
    write(recorder, numbered(20))
    with monkeypatch.context() as patch:
        patch.setattr("weld_force_ros.recording.compaction.write_mcap", refuse)
        if reason == errno.EIO:
            with pytest.raises(BagError, match="its messages are kept"):
                recorder.close()
        else:
            recorder.close()  # that it is not compressed yet is no harm
    assert check_bag(tmp_path / "run") == {"/notes": 20}
    assert (recording.summary(tmp_path / "run").damage, recording.summary(tmp_path / "run").indexed) == (None, False)
    recording.Recorder(tmp_path / "run").close()
    assert recording.summary(tmp_path / "run").files[0].indexed
    assert check_bag(tmp_path / "run") == {"/notes": 20}


@pytest.fixture
def free(monkeypatch) -> Callable[[int], None]:
    """Let the disk have so many bytes free, as far as the recorder can see."""

    def have(count: int) -> None:
        monkeypatch.setattr(shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10**12, 10**12 - count, count))

    return have


def test_disk_is_announced_before_it_is_full_and_recording_goes_on_in_a_new_file(tmp_path, free):
    free(10_000 * MB)
    now = Clock()
    with now.patched(), recording.Recorder(tmp_path / "run", reserve_bytes=60 * MB) as recorder:
        write(recorder, numbered(3))
        assert (recorder.disk_warning, recorder.free_bytes) == (None, 10_000 * MB)
        free(312 * MB)
        assert re.fullmatch(r"disk nearly full: 312 MB free(, about \d+ min at this rate)?", recorder.disk_warning)
        write(recorder, numbered(4)[3:])
        free(59 * MB)
        for _ in range(2):
            with pytest.raises(DiskFullError, match="run: disk full, 59 MB free; free 120 MB or more"):
                write(recorder, [("/lost", "not recorded", 0)])
        assert recorder.disk_warning == "disk full: 59 MB free, not recording"
        # While it is full, the bag is whole and its metadata true.
        assert check_bag(tmp_path / "run") == {"/notes": 4}
        assert listed(tmp_path / "run") == {"run_0.mcap": 4}
        free(10_000 * MB)
        with pytest.raises(DiskFullError):  # it looks again only so often
            write(recorder, [("/lost", "not recorded", 0)])
        now.pass_s(recorder_module.CHECK_AGAIN_S)
        write(recorder, numbered(5)[4:])
        assert recorder.disk_warning is None
    assert listed(tmp_path / "run") == {"run_0.mcap": 4, "run_1.mcap": 1}
    assert check_bag(tmp_path / "run") == {"/notes": 5}
    assert recording.summary(tmp_path / "run").indexed


def test_recording_may_begin_on_a_full_disk(tmp_path, free):
    free(1 * MB)
    with recording.Recorder(tmp_path / "run", reserve_bytes=2 * MB) as recorder:
        with pytest.raises(DiskFullError):
            write(recorder, numbered(1))
        assert "disk full" in recorder.disk_warning
        free(1000 * MB)
        eventually(lambda: accepted(recorder, "first"))
    assert texts(tmp_path / "run") == ["first"]


class Clock:
    """A monotonic clock that passes as told."""

    def __init__(self) -> None:
        self._now_s = time.monotonic()

    def pass_s(self, seconds: float) -> None:
        self._now_s += seconds

    @contextmanager
    def patched(self) -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(recorder_module, "time", self)
            yield

    def monotonic(self) -> float:
        return self._now_s


def test_time_left_is_told_from_the_rate(tmp_path, free, monkeypatch):
    clock = Clock()
    monkeypatch.setattr("weld_force_ros.recording.disk_space.time", clock)
    free(4_000 * MB)
    space = DiskSpace(tmp_path, reserve_bytes=400 * MB)
    for _ in range(1200):  # 20 MB/s for two minutes
        clock.pass_s(0.1)
        space.wrote(2 * MB)
    assert space.rate_bytes_per_s == pytest.approx(20 * MB, rel=0.01)
    assert space.nearly_full == "disk nearly full: 4000 MB free, about 3 min at this rate"
    free(13_000 * MB)
    assert space.nearly_full is None
    clock.pass_s(600)
    free(4_000 * MB)
    assert space.nearly_full is None  # it writes no more


def accepted(recorder: recording.Recorder, text: str) -> bool:
    try:
        write(recorder, [("/n", text, 0)])
    except DiskFullError:
        return False
    return True


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    mount = tmp_path / "disk"
    mount.mkdir()
    made = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4m", "tmpfs", mount], capture_output=True, text=True, check=False
    )
    if made.returncode:
        pytest.skip(f"no file system can be mounted here: {made.stderr.strip()}")
    yield mount
    subprocess.run(["umount", mount], check=True)


@pytest.mark.parametrize("reserve_bytes", [0, MB], ids=["to the last byte", "with a reserve"])
def test_disk_that_really_fills_loses_nothing_that_was_written(small_disk, reserve_bytes):
    noise = random.Random(3)  # noqa: S311
    filler = small_disk / "filler"
    filler.write_bytes(bytes(2 * MB))
    directory = small_disk / "run"
    written = []
    with recording.Recorder(directory, reserve_bytes=reserve_bytes) as recorder:
        while accepted(recorder, following := f"{len(written)} {noise.randbytes(10_000).hex()}"):
            written.append(following)
        assert len(written) > 20
        assert stored_texts(directory) == written
        if reserve_bytes:
            assert check_bag(directory) == {"/n": len(written)}
        filler.unlink()
        eventually(lambda: accepted(recorder, "space again"))
    assert sorted(texts(directory)) == sorted([*written, "space again"])
    assert check_bag(directory) == {"/n": len(written) + 1}


# Any recording


def test_threads_may_record_at_once(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        threads = [
            threading.Thread(target=write, args=(recorder, [(f"/t{n}", f"{n}-{i}", i) for i in range(100)]))
            for n in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(timeout=30)
    found = read_by_rosbags(tmp_path / "run")
    assert {m.data for _, _, m in found} == {f"{n}-{i}" for n in range(4) for i in range(100)}
    assert [t for _, t, _ in found] == sorted(t for _, t, _ in found)


def test_what_cannot_be_recorded_is_refused_and_the_rest_kept(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, [("/n", "first", 0)])
        with pytest.raises(BagError, match="/n: time -1 or"):
            recorder.write("/n", recording.STRING, b"", log_time_ns=-1, publish_time_ns=0)
        with pytest.raises(BagError, match="record at most"):
            recorder.write("/n", recording.STRING, bytes(2**25 + 1), log_time_ns=0, publish_time_ns=0)
        write(recorder, [("/n", "second", 1)])
    with pytest.raises(BagError, match="after the recording was closed"):
        write(recorder, [("/n", "third", 2)])
    recorder.close()
    assert texts(tmp_path / "run") == ["first", "second"]


def test_empty_recording_is_valid(tmp_path):
    record(tmp_path / "run", [])
    assert read_by_rosbags(tmp_path / "run") == []
    assert (texts(tmp_path / "run"), recording.summary(tmp_path / "run").damage) == ([], None)
