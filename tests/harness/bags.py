"""What the tests of recordings share."""

from pathlib import Path

from rosbags.highlevel import AnyReader

from weld_force_ros import recording
from weld_force_ros.messages import Rejection, WeldProfile, encode, profile_sha256

EPOCH_NS = 1_700_000_000_000_000_000


def record(directory: Path, messages: list[tuple[str, str, int]]) -> Path:
    """Record a closed bag of strings: (topic, text, log time after the epoch)."""
    with recording.Recorder(directory) as recorder:
        write(recorder, messages)
    return directory


def write(recorder: recording.Recorder, messages: list[tuple[str, str, int]]) -> None:
    for topic, text, time_ns in messages:
        recorder.write(
            topic,
            recording.STRING,
            recording.string_cdr(text),
            log_time_ns=EPOCH_NS + time_ns,
            publish_time_ns=EPOCH_NS + time_ns - 1,
        )


def texts(path: Path) -> list[str]:
    return [m.content.data for m in recording.open_bag(path).messages()]


def read_by_rosbags(directory: Path) -> list[tuple[str, int, object]]:
    with AnyReader([directory]) as reader:
        return [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


def numbered(count: int, topic: str = "/notes") -> list[tuple[str, str, int]]:
    return [(topic, f"message {i} " + "x" * (i % 50), i * 1000) for i in range(count)]


def rejection(reason: str, sequence: int = 0) -> str:
    message = Rejection(source="weld.csv", reason=reason, remedy="measure again", sequence=sequence)
    return encode(message).decode()


def profile() -> str:
    x_m = [0.005 * i for i in range(-50, 51)]
    z_m = [1e-4 * (1 - abs(x) / 0.25) for x in x_m]
    sha256 = profile_sha256(x_m, z_m)
    message = WeldProfile(weld_id="KM12", source="weld.csv", x_m=x_m, z_m=z_m, profile_sha256=sha256)
    return encode(message).decode()
