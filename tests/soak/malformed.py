"""Malformed input: mutated messages, files, recordings and DDS samples, each read as the package reads it.

    python -m tests.soak.malformed [--count 100000] [--seed 1] [--json FILE]

An input may be refused by the package's own error (one line, with a remedy) or be accepted and then be valid by rules
written here anew. Whatever else happens is a failure: another exception, a dead process, two seconds of processor time.
The inputs are read in a process of its own, which the kernel ends when one takes too long, even inside compiled code.
Each input follows from seed, kind and index alone: `--show KIND INDEX` writes one to standard output.
"""

import argparse
import hashlib
import importlib.util
import io
import itertools
import json
import math
import multiprocessing
import multiprocessing.connection
import os
import re
import resource
import signal
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from functools import lru_cache, partial
from importlib import resources
from pathlib import Path
from random import Random
from typing import Any, NamedTuple, NoReturn

import msgspec
import numpy as np
import yaml
from mcap.writer import CompressionType, Writer
from msgspec import UNSET

from weld_force_ros.assessment.judge import Assessment, assess, judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.errors import InputError, WeldForceError
from weld_force_ros.measurement import profile_file
from weld_force_ros.measurement.instruments import InstrumentFormat
from weld_force_ros.messages import (
    TOPICS,
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Inquiry,
    Message,
    RailSurface,
    Rejection,
    Settled,
    SimulationSettings,
    Verdict,
    WeldMarker,
    WeldProfile,
    decode,
    encode,
    read_header,
)
from weld_force_ros.recording import STRING, contract_messages, open_bag, string_cdr
from weld_force_ros.ros.parameters import default_parameter_text, read_parameter_file
from weld_force_ros.simulation import simulator, track_file
from weld_force_ros.simulation.settings import simulation_settings

from ..harness.foreign_forms import all_forms
from . import mutations
from .mutations import Mutation, mutated

PROCESSOR_LIMIT_S = 4.0  # tables for a step that no weld before it had take a good part of that on a busy machine
STALL_LIMIT_S = 60.0
MEMORY_LIMIT_BYTES = 4 * 2**30
ASSESSED_ONE_IN = 5
_JOB = 100
_DEMO = Path(__file__).parents[2] / "bags" / "demo"


class DefectError(AssertionError):
    """The package accepted what is invalid, or refused in a form that helps nobody."""


class Reading(NamedTuple):
    """Outcome of one input: a plain parser reads it, the package used it, it led to a verdict."""

    parsed: bool
    accepted: bool
    judged: bool = False


class Kind(NamedTuple):
    """A kind of input: valid seeds, mutations that keep its form, its reader, its share in per cent."""

    name: str
    seeds: Callable[[], list[bytes]]
    keeping_form: tuple[Mutation, ...]
    read: Callable[[bytes], Reading]
    share: int


# Rules, written from design.md


def check_refusal(error: InputError) -> None:
    """Raise DefectError unless the error is one printable line with reason and remedy."""
    text = str(error)
    if len(text.splitlines()) != 1 or not text.isprintable():
        raise DefectError(f"not one printable line: {text[:300]!r}")
    if not error.reason.strip() or not error.remedy.strip():
        raise DefectError(f"no reason or no remedy: {text[:300]!r}")
    if len(text) > 1000:
        raise DefectError(f"{len(text)} characters: {text[:300]!r}")


def check_profile(x_m: list[float], z_m: list[float], sha256: str) -> None:
    """Raise DefectError unless a weld profile is within its bounds, but for the last digits of a sum."""
    slack = 1 + 1e-9
    steps = [after - before for before, after in itertools.pairwise(x_m)]
    rules = {
        "finite": all(map(math.isfinite, [*x_m, *z_m])),
        "a height for every position": len(x_m) == len(z_m),
        "20 samples": len(x_m) >= 20,
        "increasing": min(steps, default=0.0) > 0.0,
        "10 mm spacing": max(steps, default=0.0) <= 0.010 * slack,
        "10 mm amplitude": max(z_m, default=0.0) - min(z_m, default=0.0) <= 0.010 * slack,
        "5 m length": x_m[-1:] <= [x_m[0] + 5.0 * slack] if x_m else False,
        "hash": sha256 in (_sha256_of_bytes(x_m, z_m), _sha256_until_1_5(x_m, z_m)),
    }
    if broken := [rule for rule, kept in rules.items() if not kept]:
        raise DefectError(f"an invalid profile was accepted: {', '.join(broken)}")


def _sha256_of_bytes(*columns: list[float]) -> str:
    """Return the contract's hash, worked by NumPy."""
    return hashlib.sha256((np.concatenate(columns).astype("<f8") + 0.0).tobytes()).hexdigest()


def _sha256_until_1_5(*columns: list[float]) -> str:
    """Return the hash of older recordings: of the shortest decimals, in JSON."""
    return hashlib.sha256(msgspec.json.encode([[float(n) for n in column] for column in columns])).hexdigest()


def check_message(message: Message) -> None:
    """Raise DefectError unless a message can be sent, holds finite numbers only, and reads back the same."""
    data = encode(message)
    json.loads(data, parse_constant=_not_finite, parse_float=_finite)
    if decode(type(message), data) != message:
        raise DefectError("reads back differently")
    if broken := [name for name, text in _identities(message) if not re.fullmatch("[0-9a-f]{64}", text)]:
        raise DefectError(f"no SHA-256: {', '.join(broken)}")
    if not re.fullmatch(r"1\.[0-9]+", message.schema_version):
        raise DefectError(f"schema version {message.schema_version!r}")
    header = read_header(data.decode())
    if header is None or (header.publisher, header.sequence) != (message.publisher, message.sequence):
        raise DefectError("its header reads differently")


def check_same_numbers(message: Message, data: bytes) -> None:
    """Raise DefectError if a second reader finds other numbers in what was sent, e.g. where a key stands twice."""
    second = json.loads(data.decode())
    for name in message.__struct_fields__:
        values = getattr(message, name)
        numbers = [values] if isinstance(values, float) else values
        if isinstance(numbers, list) and numbers and isinstance(numbers[0], float):
            others = second[name] if isinstance(values, list) else [second[name]]
            if list(map(float, others)) != numbers:
                raise DefectError(f"{name} reads differently")


def _identities(message: Message) -> Iterator[tuple[str, str]]:
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if name.endswith("_sha256") or name.startswith("profile_id"):
            yield from ((name, text) for text in (value if isinstance(value, list) else [value]) if text is not UNSET)


def _not_finite(name: str) -> NoReturn:
    raise DefectError(f"{name} in a message that was accepted")


def _finite(text: str) -> float:
    return float(text) if math.isfinite(float(text)) else _not_finite(text)


# Valid inputs


@lru_cache
def _simulator() -> simulator.Simulator:
    return simulator.Simulator(simulation_settings(speeds_kmh=[40.0, 160.0, 300.0], positions=2))


@lru_cache
def _limits() -> AssessmentSettings:
    return load_limits()


@lru_cache
def _profile() -> WeldProfile:
    """Return a short weld, so that mutations hit something else than samples too."""
    x_m = [i * 0.005 - 0.1 for i in range(41)]
    z_m = [-1e-4 * math.cos(math.pi * x / 0.2) ** 2 for x in x_m]
    return WeldProfile(
        weld_id="KM12-L-004", source="weld.csv", x_m=x_m, z_m=z_m, profile_id="a" * 64,
        source_sha256="b" * 64, rail="left", instrument="straightedge", chainage_m=12_004.25, line_speed_kmh=160.0,
        weld_position_m=0.3, conditioning=["centred on the weld"], publisher="/profile_node#1", sequence=7,
    )  # fmt: skip


@lru_cache
def _assessment() -> Assessment:
    return assess(_profile(), _simulator(), _limits())


def _messages(kind: type[Message]) -> list[Message]:
    found = _assessment()
    history = found.history
    short = {name: getattr(history, name)[:60] for name in ("x_m", "force_n", "wheel_m", "rail_m", "irregularity_m")}
    ids = ["c" * 64, "d" * 64]
    surface = RailSurface(
        chainage=[1000.0 + i for i in range(40)], height=[0.01 * i for i in range(40)], chainage_unit="mm",
        height_unit="um", height_positive="up",
    )  # fmt: skip
    messages: list[Message] = [
        _profile(),
        WeldProfile(
            weld_id="w", source="s", x_m=_profile().x_m, z_m=_profile().z_m, profile_sha256=_profile().profile_sha256
        ),
        found.force_map,
        msgspec.structs.replace(history, **short),
        found.verdict,
        _simulator().settings,
        _limits(),
        Rejection(source="weld.csv", reason="no samples", remedy="measure again", raw_text="x,z\n", profile_id=ids[0]),
        surface,
        WeldMarker(chainage_m=12_004.2, weld_id="KM12", line_speed_kmh=120.0, weld_position_m=0.1),
        WeldMarker(),
        Inquiry(profile_ids=ids),
        Settled(profile_ids=ids, asked_by="/profile_node#1", asked_sequence=3),
    ]
    return [message for message in messages if type(message) is kind]


def _message_seeds(kind: type[Message]) -> list[bytes]:
    return [encode(message) for message in _messages(kind)]


def _dip_um(i: int) -> float:
    """Return the height of a weld at the i-th of 81 samples."""
    return -100 * math.sin(math.pi * i / 80) ** 4


@lru_cache
def _profile_files() -> list[bytes]:
    rows = "\n".join(f"{i * 5},{_dip_um(i):.1f}" for i in range(81))
    head = "# weld_id: KM12-L-004\n# x_unit: mm\n# z_unit: um\n# z_positive: up\n"
    more = "# rail: left\n# chainage_m: 12004.25\n# line_speed_kmh: 160\n# weld_position_m: 0.3\n# detrend: none\n"
    shipped = profile_file.shipped()["cosine-dip-48mm"].read_bytes()
    return [
        f"{head}x,z\n{rows}\n".encode(),
        f"{head}{more}# noise: none\n# centre: 100\n# free text\n{rows}\n".encode(),
        shipped,
    ]


@lru_cache
def _instrument_files() -> list[bytes]:
    """Return short records in the forms that instruments and people write."""
    wanted = {
        *("windows-1252.csv", "utf-16-tab.txt", "utf-16-unmarked.txt", "key-value-block.csv", "toa5.dat", "jcamp.jdx"),
        *(
            "weld-blocks.txt",
            "weld-column.csv",
            "footer.csv",
            "percent-comments.txt",
            "units-row.csv",
            "missing-bad.csv",
        ),
        *("fixed-width-glued.txt", "thousands-comma-quoted.csv", "chainage-plus.csv", "railprof.txt", "bars.txt"),
        *("graw-series.csv", "one.zip", "protocol.xlsx", "off-centre.csv", "sections.txt"),
    }
    return [form.data for form in all_forms() if form.name in wanted]


_FORMS = (
    InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up"),
    InstrumentFormat(x_unit="mm", z_unit="um", z_positive="down", spacing=5.0, skip_rows=1, weld_id="W1", noise="none"),
    InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", noise=5e-6, centre=200.0, line_speed_kmh=80.0),
    InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", columns={"x": 1, "z": 2}, decimal="point"),
    InstrumentFormat(x_unit="mm", z_unit="um", z_positive="up", spacing=float("nan")),
    InstrumentFormat(x_unit="furlong", z_unit="um", z_positive="sideways", skip_rows=-1),
)


@lru_cache
def _plain_files() -> list[bytes]:
    heights = [f"{_dip_um(i):.1f}" for i in range(81)]
    pairs = [(f"{i * 5}.0", z) for i, z in enumerate(heights)]
    return [
        "\n".join(f"{x},{z}" for x, z in pairs).encode(),
        "\n".join(["Straightedge 7", *heights]).encode(),
        "\r\n".join(f"{x};{z}".replace(".", ",") for x, z in pairs).encode(),
        "\n".join(f"{x}\t{z}" for x, z in pairs).encode(),
        _profile_files()[0],
    ]


def _track_files() -> list[bytes]:
    return [track_file.load(name).text.encode() for name in track_file.shipped()]


def _limit_files() -> list[bytes]:
    one = b"- {name: peak_force, limit: 200e+3, reject_limit: 350e+3, unit: N, source: s}\n"
    folder = resources.files("weld_force_ros.data").joinpath("limits")
    return [*(folder.joinpath(f"{name}.yaml").read_bytes() for name in ("force", "banenor-531")), one]


def _node_parameters() -> list[bytes]:
    return [default_parameter_text().encode()]


def _bag_metadata() -> list[bytes]:
    return [(_DEMO / "metadata.yaml").read_bytes()]


@lru_cache
def _recordings() -> list[bytes]:
    return [
        _recording(compression, chunked)
        for compression, chunked in (
            (CompressionType.NONE, False),
            (CompressionType.ZSTD, True),
            (CompressionType.LZ4, True),
        )
    ]


def _recording(compression: CompressionType, chunked: bool) -> bytes:
    stream = io.BytesIO()
    writer = Writer(stream, chunk_size=4000, compression=compression, use_chunking=chunked)
    writer.start("ros2")
    schema = writer.register_schema(STRING.name, "ros2msg", STRING.text.encode())
    for topic in (WeldProfile, Verdict, Inquiry, Rejection):
        channel = writer.register_channel(f"/left/{TOPICS[topic].name}", "cdr", schema)
        for ordinal, data in enumerate(_message_seeds(topic)):
            writer.add_message(channel, 1_000 + ordinal, string_cdr(data.decode()), 1_000)
    writer.finish()
    return stream.getvalue()


# How each kind is read


def read_message(kind: type[Message], data: bytes) -> Reading:
    """Read a message as a node or the replay does."""
    read_header(data.decode("utf-8", "replace"))
    try:
        message = decode(kind, data)
    except InputError as error:
        check_refusal(error)
        return Reading(_is_json(data), False)
    if parsed := _is_json(data):
        check_same_numbers(message, data)
    return Reading(parsed, True, _use(message, data))


def _is_json(data: bytes) -> bool:
    try:
        return isinstance(json.loads(data.decode()), dict)
    except (ValueError, RecursionError):
        return False


def _use(message: Message, data: bytes) -> bool:
    """Check and use a message that was accepted; return whether that gave a verdict."""
    check_message(message)
    try:
        match message:
            case WeldProfile():
                check_profile(message.x_m, message.z_m, message.profile_sha256)
                if zlib.crc32(data) % ASSESSED_ONE_IN == 0:
                    check_message(assess(message, _simulator(), _limits()).verdict)
                    return True
            case ForceMap():
                check_message(judge(message, _limits()))
                return True
            case AssessmentSettings():
                check_message(judge(_assessment().force_map, message))
                return True
            case SimulationSettings():
                track_file.parse(message.track_definition, message.track)
    except InputError as error:
        check_refusal(error)
    except WeldForceError:
        pass  # computed, and found not to give a number: no verdict
    return False


def read_profile_file(form_of: Callable[[bytes], InstrumentFormat | None], data: bytes) -> Reading:
    """Read a measurement file as `profile_node` does."""
    form = form_of(data)
    try:
        profile, *others = (found.profile for found in profile_file.parse_profiles(data, "measured.csv", form))
        profile_file.is_complete(data, form)
    except InputError as error:
        check_refusal(error)
        return Reading(_holds_rows(data), False)
    for other in others:
        check_profile(other.x_m, other.z_m, other.profile_sha256)
    if profile.source_sha256 != hashlib.sha256(data).hexdigest():
        raise DefectError("source_sha256 is not that of the file")
    return Reading(_holds_rows(data), True, _use(profile, data))


def _holds_rows(data: bytes) -> bool:
    """Return whether the last line that is not a comment is made of one or two numbers."""
    try:
        lines = [line for line in data.decode("utf-8-sig").split("\n") if line.strip() and not line.startswith("#")]
        fields = lines[-1].replace(";", " ").replace("\t", " ")
        fields = fields.replace(",", "." if " " in fields.strip() else " ")
        return len([float(part) for part in fields.split()]) in (1, 2)
    except (ValueError, IndexError):
        return False


def _form_of(data: bytes) -> InstrumentFormat:
    return _FORMS[zlib.crc32(data) % len(_FORMS)]


def _stated_form(data: bytes) -> InstrumentFormat:
    unit = ("mm", "um", "m")[zlib.crc32(data) % 3]
    return InstrumentFormat(x_unit="mm", z_unit=unit if zlib.crc32(data) % 4 == 0 else "mm", z_positive="up")


def _no_form(_: bytes) -> None:
    return None


def read_track(data: bytes) -> Reading:
    """Read a user's own track file."""
    return _read_file(data, "track.yaml", lambda path: track_file.load(str(path)))


def read_limits(data: bytes) -> Reading:
    """Read a user's own limits; those that are accepted must give a verdict or be refused."""
    return _read_file(data, "limits.yaml", lambda path: _use(load_limits(path), data))


def read_node_config(data: bytes) -> Reading:
    """Read node parameters as `weld-force up --config` does."""
    return _read_file(data, "config.yaml", read_parameter_file)


def _read_file(data: bytes, name: str, use: Callable[[Path], object]) -> Reading:
    path = _folder() / name
    path.write_bytes(data)
    try:
        use(path)
    except InputError as error:
        check_refusal(error)
        return Reading(_is_yaml(data), False)
    return Reading(_is_yaml(data), True)


def _is_yaml(data: bytes) -> bool:
    if len(data) > 20_000:  # the second reader is slow
        return False
    try:
        return yaml.compose(data, Loader=yaml.SafeLoader) is not None
    except (yaml.YAMLError, ValueError, RecursionError):
        return False


@lru_cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="malformed-"))


def read_recording(data: bytes) -> Reading:
    """Read a recording as the replay does."""
    path = _folder() / "recording.mcap"
    path.write_bytes(data)
    return _read_bag(path)


def read_bag_metadata(data: bytes) -> Reading:
    """Read a folder with such a `metadata.yaml` as the replay does."""
    folder = _folder() / "bag"
    folder.mkdir(exist_ok=True)
    (folder / "bag_0.mcap").write_bytes(_recordings()[1])
    (folder / "metadata.yaml").write_bytes(data)
    return _read_bag(folder)


def _read_bag(path: Path) -> Reading:
    messages = 0
    try:
        bag = open_bag(path)
        bag.summary()
        for found in contract_messages(bag):
            if isinstance(found.message, InputError):
                check_refusal(found.message)
            else:
                messages += 1
                _use(found.message, b"")
    except InputError as error:
        check_refusal(error)
        return Reading(messages > 0, False)
    return Reading(messages > 0, True)


@lru_cache
def _live_node() -> tuple[Any, type, list[Rejection]]:
    """Return the topics of a node without subscribers, the type of its samples, and its rejections."""
    import rclpy
    from rclpy.logging import LoggingSeverity
    from std_msgs.msg import String

    from weld_force_ros.ros.contract_topics import ContractTopics

    rclpy.init(args=[], signal_handler_options=rclpy.signals.SignalHandlerOptions.NO)
    node = rclpy.create_node("malformed")
    node.get_logger().set_level(LoggingSeverity.FATAL)
    return ContractTopics(node, [Rejection]), String, []


def read_sample(data: bytes) -> Reading:
    """Take a DDS sample as a live node does: as a message, or a Rejection is published."""
    from weld_force_ros.ros import qos
    from weld_force_ros.ros.serialized_messages import SerializedMessage

    topics, string, rejections = _live_node()
    rejections.clear()
    kinds = list(TOPICS)
    kind = kinds[zlib.crc32(data) % len(kinds)] if zlib.crc32(data) % 4 == 0 else WeldProfile
    incoming = topics.receive(kind, SerializedMessage("/malformed", string, qos.CONTRACT, data, 0, 0))
    message = topics.decode_or_reject(kind, incoming, rejections.append)
    parsed = _is_json(incoming.text.encode("utf-8", "replace"))
    if message is not None:
        return Reading(parsed, True, _use(message, data))
    if len(rejections) != 1:
        raise DefectError(f"{len(rejections)} rejections of one message")
    check_message(rejections[0])
    return Reading(parsed, False)


def _messages_of(kind: type[Message], share: int) -> Kind:
    return Kind(kind.__name__, partial(_message_seeds, kind), mutations.JSON, partial(read_message, kind), share)


def _sample_seeds() -> list[bytes]:
    return [mutations.cdr_of(data) for kind in (WeldProfile, ForceMap, Verdict) for data in _message_seeds(kind)]


KINDS: dict[str, Kind] = {
    kind.name: kind
    for kind in (
        _messages_of(WeldProfile, 16),
        _messages_of(ForceMap, 6),
        _messages_of(ForceHistory, 4),
        _messages_of(RailSurface, 4),
        _messages_of(WeldMarker, 3),
        _messages_of(Inquiry, 3),
        _messages_of(Settled, 3),
        _messages_of(Verdict, 4),
        _messages_of(Rejection, 3),
        _messages_of(SimulationSettings, 4),
        _messages_of(AssessmentSettings, 4),
        Kind(
            "profile file",
            _profile_files,
            (*mutations.MEASUREMENTS, *mutations.LINES),
            partial(read_profile_file, _no_form),
            12,
        ),
        Kind(
            "plain columns",
            _plain_files,
            (*mutations.MEASUREMENTS, *mutations.LINES),
            partial(read_profile_file, _form_of),
            8,
        ),
        Kind(
            "instrument file",
            _instrument_files,
            (*mutations.MEASUREMENTS, *mutations.LINES),
            partial(read_profile_file, _stated_form),
            12,
        ),
        Kind("limits file", _limit_files, (*mutations.YAML, *mutations.LINES), read_limits, 4),
        Kind("track file", _track_files, (*mutations.YAML, *mutations.LINES), read_track, 4),
        Kind(
            "node parameters",
            _node_parameters,
            (*mutations.YAML, *mutations.LINES),
            read_node_config,
            3,
        ),
        Kind("recording", _recordings, mutations.RECORDING, read_recording, 8),
        Kind(
            "metadata.yaml",
            _bag_metadata,
            (*mutations.YAML, *mutations.LINES),
            read_bag_metadata,
            2,
        ),
        Kind("DDS sample", _sample_seeds, mutations.CDR, read_sample, 5),
    )
}


# The run


class Failure(NamedTuple):
    """Input `number` of a kind, which was neither refused nor rightly accepted."""

    kind: str
    number: int
    what: str


@dataclass
class Tally:
    """Outcomes of the inputs of one kind; times are of the processor."""

    mutated: int = 0
    past_parsing: int = 0
    refused: int = 0
    accepted: int = 0
    judged: int = 0
    slowest_s: float = 0.0
    failures: list[Failure] = field(default_factory=list)

    def add(self, other: "Tally") -> None:
        """Add the outcomes of another job."""
        for name in ("mutated", "past_parsing", "refused", "accepted", "judged"):
            setattr(self, name, getattr(self, name) + getattr(other, name))
        self.slowest_s = max(self.slowest_s, other.slowest_s)
        self.failures += other.failures


class Job(NamedTuple):
    """Inputs `start` to `stop` of a kind, each with so much time of the processor."""

    kind: Kind
    start: int
    stop: int
    seed: int
    limit_s: float


def malformed_input(kind: Kind, index: int, seed: int) -> bytes:
    """Return one spoilt input, the same for the same seed."""
    rng = Random(f"{seed} {kind.name} {index}")  # noqa: S311
    return mutated(rng, _seeds(kind.name, kind.seeds), kind.keeping_form)


@lru_cache
def _seeds(_: str, seeds: Callable[[], list[bytes]]) -> list[bytes]:
    return seeds()


def _judge(kind: Kind, index: int, data: bytes, tally: Tally) -> None:
    began = time.process_time()
    try:
        reading = kind.read(data)
        tally.past_parsing += reading.parsed
        tally.accepted += reading.accepted
        tally.refused += not reading.accepted
        tally.judged += reading.judged
    except Exception as error:  # finding these is what the run is for
        tally.failures.append(Failure(kind.name, index, f"{type(error).__name__}: {error}"[:300]))
    tally.mutated += 1
    tally.slowest_s = max(tally.slowest_s, time.process_time() - began)


@lru_cache
def _warm_up() -> None:
    """Import, compile and tabulate what is read with: that takes longer than an input may."""
    _assessment()
    assess(msgspec.structs.replace(_profile(), weld_position_m=UNSET), _simulator(), _limits())
    for kind in (KINDS["profile file"], KINDS["limits file"]):
        kind.read(kind.seeds()[0])


def _serve(connection: multiprocessing.connection.Connection, current: Any, folder: str) -> None:
    """Work through jobs; the kernel ends this process at an input that takes too long."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_LIMIT_BYTES, MEMORY_LIMIT_BYTES))
    tempfile.tempdir = folder
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_LOG_DIR": str(_folder())}
    for limit in (signal.SIGPROF, signal.SIGALRM):
        signal.signal(limit, signal.SIG_DFL)
    while (job := connection.recv()) is not None:
        tally = Tally()
        if job.kind.name in KINDS:
            _warm_up()
        if job.kind.name == "DDS sample":
            _live_node()
        for index in range(job.start, job.stop):
            data = malformed_input(job.kind, index, job.seed)
            current.value = index
            signal.setitimer(signal.ITIMER_PROF, job.limit_s)
            signal.setitimer(signal.ITIMER_REAL, STALL_LIMIT_S)
            _judge(job.kind, index, data, tally)
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
        connection.send((tally, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))
    if "rclpy" in sys.modules:
        sys.modules["rclpy"].try_shutdown()


class _Reader:
    """The process that reads."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._folder = tempfile.TemporaryDirectory(prefix="malformed-")  # outlives a process that is killed
        self._connection, theirs = context.Pipe()
        self._current = context.Value("q", 0)
        self._process = context.Process(target=_serve, args=(theirs, self._current, self._folder.name), daemon=True)
        self._process.start()
        theirs.close()

    def read(self, job: Job) -> tuple[Tally, int] | Failure:
        """Return the outcomes of a job's inputs and the memory used; a failure if the process died at one."""
        self._current.value = -1
        self._connection.send(job)
        try:
            outcome: tuple[Tally, int] = self._connection.recv()
            return outcome
        except EOFError:
            self._end()
            index = self._current.value
            if index < 0:
                raise RuntimeError("the reading process died before its first input") from None
            return Failure(job.kind.name, index, _cause(self._process.exitcode or 0, job.limit_s))

    def close(self) -> None:
        """End the process."""
        self._connection.send(None)
        self._end()

    def _end(self) -> None:
        self._process.join()
        self._connection.close()
        self._folder.cleanup()


def _cause(exit_code: int, limit_s: float) -> str:
    reasons = {
        -signal.SIGPROF: f"hangs: more than {limit_s:g} s of processor time",
        -signal.SIGALRM: f"hangs: more than {STALL_LIMIT_S:g} s",
    }
    return reasons.get(exit_code, f"the process died with exit code {exit_code}")


@dataclass
class Report:
    """Result of a run."""

    seed: int
    elapsed_s: float
    peak_memory_bytes: int
    by_kind: dict[str, Tally]

    @property
    def failures(self) -> list[Failure]:
        """Failures of all kinds."""
        return [failure for tally in self.by_kind.values() for failure in tally.failures]


def run(
    kinds: list[Kind],
    count: int,
    seed: int,
    *,
    limit_s: float = PROCESSOR_LIMIT_S,
    on_job: Callable[[Job], None] = lambda _: None,
) -> Report:
    """Spoil and read about `count` inputs, shared out among `kinds`; at least one of each."""
    began, peak_bytes = time.monotonic(), 0
    report = Report(seed, 0.0, 0, {kind.name: Tally() for kind in kinds})
    reader = _Reader()
    shares = sum(kind.share for kind in kinds)
    for kind in kinds:
        total = max(1, round(count * kind.share / shares))
        jobs = [Job(kind, start, min(start + _JOB, total), seed, limit_s) for start in range(0, total, _JOB)]
        while jobs:
            job = jobs.pop(0)
            on_job(job)
            outcome = reader.read(job)
            if isinstance(outcome, Failure):
                report.by_kind[kind.name].add(Tally(mutated=1, failures=[outcome]))
                around = (job._replace(stop=outcome.number), job._replace(start=outcome.number + 1))
                jobs[:0] = [part for part in around if part.start < part.stop]
                reader = _Reader()
            else:
                report.by_kind[kind.name].add(outcome[0])
                peak_bytes = max(peak_bytes, outcome[1])
    reader.close()
    report.elapsed_s, report.peak_memory_bytes = time.monotonic() - began, peak_bytes
    return report


def available() -> list[Kind]:
    """The kinds that can be read here: DDS samples need ROS."""
    return [k for k in KINDS.values() if k.name != "DDS sample" or importlib.util.find_spec("rclpy") is not None]


def table(report: Report) -> str:
    """The counts by kind, and each sort of failure with its first input."""
    columns = f"{'kind':20}{'mutated':>9}{'past parsing':>14}{'refused':>9}{'valid':>8}{'verdicts':>10}{'slowest':>10}"
    lines = [f"{columns}{'failures':>10}"]
    total = Tally()
    for name, tally in report.by_kind.items():
        lines.append(_row(name, tally))
        total.add(tally)
    lines.append(_row("all", total))
    lines.append(f"{report.elapsed_s:.0f} s, peak memory {report.peak_memory_bytes / 1e6:.0f} MB, seed {report.seed}")
    sorts = Counter((failure.kind, failure.what[:80]) for failure in report.failures)
    first = {(failure.kind, failure.what[:80]): failure for failure in reversed(report.failures)}
    lines += [f"{count} x {kind} (first: {first[kind, what].number}): {what}" for (kind, what), count in sorts.items()]
    return "\n".join(lines)


def _row(name: str, tally: Tally) -> str:
    return (
        f"{name:20}{tally.mutated:>9}{tally.past_parsing:>14}{tally.refused:>9}{tally.accepted:>8}{tally.judged:>10}"
        f"{tally.slowest_s:>8.2f} s{len(tally.failures):>10}"
    )


def main() -> int:
    """Run, print the table; 1 if anything failed."""
    parser = argparse.ArgumentParser(description="Read mutated messages and files.")
    parser.add_argument("--count", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--show", nargs=2, metavar=("KIND", "INDEX"), help="write one input to standard output")
    options = parser.parse_args()
    if options.show:
        kind, index = options.show
        sys.stdout.buffer.write(malformed_input(KINDS[kind], int(index), options.seed))
        return 0
    report = run(available(), options.count, options.seed)
    print(table(report))
    if options.json:
        options.json.write_text(json.dumps(asdict(report), indent=1) + "\n")
    return 1 if report.failures else 0


if __name__ == "__main__":
    sys.exit(main())
