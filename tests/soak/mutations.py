"""Mutate a valid input. Each mutation takes a random source, the input and another valid one, and returns new bytes.

Some change any byte, some keep the form (JSON, lines, records) so that the code behind the parser is reached too.
"""

import json
import math
import re
import struct
import zlib
from collections.abc import Callable
from functools import partial
from random import Random
from typing import Any

import msgspec
import zstandard
from mcap.writer import MCAP0_MAGIC

from weld_force_ros.messages import AssessmentSettings, SimulationSettings, config_sha256, limits_sha256, profile_sha256

Mutation = Callable[[Random, bytes, bytes], bytes]

ODD_NUMBERS = (
    "NaN", "Infinity", "-Infinity", "1e999", "-1e999", "1e308", "5e-324", "-0", "-0.0", "0", "1e-300", "0x10", "1_000",
    "9" * 19, "9" * 400, "9" * 5000, "1." + "3" * 400, "2147483648", "-1", "18446744073709551616", "1,5", ".",
    "1e", "+1",
)  # fmt: skip
ODD_BYTES = (
    b"\x00", b"\xff\xfe", b"\xed\xa0\x80", b"\xc0\xaf", b"\xef\xbb\xbf", b"\r", b"\x1b[2J", b"\xe2\x80\xa8", b"\x85",
    b"\\ud800", b"\\u0000", b'"', b"\\", b"{", b"]", b",", b"#", b": ", b"\t", b"&a ", b"*a", b"!!python/none ",
    b"<<: ",
)  # fmt: skip
ODD_VALUES: tuple[Any, ...] = (
    None, True, "", "0", "NaN", "\ud800", "\x00\x1b[2J", "x" * 70_000, [], {}, [[]], [None], {"a": {}}, 0, -1, 0.5,
    -0.0, 1e308, 5e-324, 2**31, 2**63, 2**64, 10**400, math.nan, math.inf, -math.inf, "../../etc/passwd", "1.0",
    "2.0", "99999.1",
)  # fmt: skip
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
_FACTORS = (1e-6, 1e-3, 0.1, 10.0, 1e3, 1e6, -1.0)


def _span(rng: Random, data: bytes) -> tuple[int, int]:
    start = rng.randrange(len(data) + 1)
    return start, min(len(data), start + int(2 ** rng.uniform(0, 10)))


# Anywhere


def flip_bits(rng: Random, data: bytes, _: bytes) -> bytes:
    spoilt = bytearray(data)
    for _flip in range(rng.choice((1, 1, 2, 8, 64))):
        if spoilt:
            spoilt[rng.randrange(len(spoilt))] ^= 1 << rng.randrange(8)
    return bytes(spoilt)


def truncate(rng: Random, data: bytes, _: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def cut_out(rng: Random, data: bytes, _: bytes) -> bytes:
    start, end = _span(rng, data)
    return data[:start] + data[end:]


def repeat_part(rng: Random, data: bytes, _: bytes) -> bytes:
    start, end = _span(rng, data)
    return data[:start] + data[start:end] * rng.choice((2, 2, 3, 100)) + data[end:]


def splice(rng: Random, data: bytes, other: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)] + other[rng.randrange(len(other) + 1) :]


def insert_odd_bytes(rng: Random, data: bytes, _: bytes) -> bytes:
    at = rng.choice((0, len(data), rng.randrange(len(data) + 1)))
    return data[:at] + rng.choice(ODD_BYTES) + data[at:]


def encode_otherwise(rng: Random, data: bytes, _: bytes) -> bytes:
    if rng.random() < 0.5:
        return b"\xef\xbb\xbf" + data
    return data.decode("utf-8", "replace").encode(rng.choice(("utf-16", "utf-32", "utf-16-be", "utf-7")))


def replace_number(rng: Random, data: bytes, _: bytes) -> bytes:
    numbers = list(_NUMBER.finditer(data))
    if not numbers:
        return data
    number = rng.choice(numbers)
    return data[: number.start()] + rng.choice(ODD_NUMBERS).encode() + data[number.end() :]


def nest_deeply(rng: Random, data: bytes, _: bytes) -> bytes:
    opening, closing = rng.choice(((b"[", b"]"), (b'{"a":', b"}"), (b"- ", b""), (b"(", b")")))
    at, depth = rng.randrange(len(data) + 1), rng.choice((10, 1000, 20_000))
    return data[:at] + opening * depth + (b"1" + closing * depth if rng.random() < 0.5 else b"") + data[at:]


def repeat_one_byte(rng: Random, data: bytes, _: bytes) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + data[at : at + 1] * rng.choice((10, 1000, 100_000)) + data[at:]


ANYWHERE: tuple[Mutation, ...] = (
    flip_bits, truncate, cut_out, repeat_part, splice, insert_odd_bytes, encode_otherwise, replace_number, nest_deeply,
    repeat_one_byte,
)  # fmt: skip


# Lines: measurement files and YAML


def _change_lines(
    change: Callable[[Random, list[bytes], list[bytes]], None], rng: Random, data: bytes, other: bytes
) -> bytes:
    lines = data.split(b"\n")
    change(rng, lines, other.split(b"\n"))
    return b"\n".join(lines)


def _drop_line(rng: Random, lines: list[bytes], _: list[bytes]) -> None:
    del lines[rng.randrange(len(lines))]


def _repeat_line(rng: Random, lines: list[bytes], _: list[bytes]) -> None:
    lines.insert(rng.randrange(len(lines) + 1), rng.choice(lines))


def _swap_lines(rng: Random, lines: list[bytes], _: list[bytes]) -> None:
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]


def _foreign_line(rng: Random, lines: list[bytes], other: list[bytes]) -> None:
    lines[rng.randrange(len(lines))] = rng.choice(other)


def _indent_line(rng: Random, lines: list[bytes], _: list[bytes]) -> None:
    i = rng.randrange(len(lines))
    lines[i] = rng.choice((b" ", b"  ", b"\t")) + lines[i] if rng.random() < 0.5 else lines[i].lstrip()


def _blow_up(rng: Random, lines: list[bytes], _: list[bytes]) -> None:
    if rng.random() < 0.05:  # the largest are slow to make and to refuse
        line = rng.choice(lines) or b"x"
        lines[-1:-1] = [line] * (rng.choice((60_000, 3_000_000, 5_000_000)) // (len(line) + 1))


def end_lines_otherwise(rng: Random, data: bytes, _: bytes) -> bytes:
    return data.replace(b"\n", rng.choice((b"\r\n", b"\r", b"\n\r", b"\n\n", b"\x0b", b"\xe2\x80\xa8")))


LINES: tuple[Mutation, ...] = (
    *(
        partial(_change_lines, change)
        for change in (_drop_line, _repeat_line, _swap_lines, _foreign_line, _indent_line, _blow_up)
    ),
    end_lines_otherwise,
    replace_number,
)


# Measurement files


def state_otherwise(rng: Random, data: bytes, _: bytes) -> bytes:
    values = (
        b"m",
        b"cm",
        b"mm",
        b"um",
        b"in",
        b"\xc2\xb5m",
        b"up",
        b"down",
        b"line",
        b"none",
        b"0",
        b"1e9",
        b"nan",
        b"",
    )
    keys = rb"# (x_unit|z_unit|z_positive|detrend|centre|chainage_m|line_speed_kmh|weld_position_m): [^\n]*"
    stated = list(re.finditer(keys, data))
    if stated and rng.random() < 0.7:
        line = rng.choice(stated)
        return data[: line.start()] + b"# " + line[1] + b": " + rng.choice(values) + data[line.end() :]
    key = rng.choice(
        (b"detrend", b"centre", b"chainage_m", b"line_speed_kmh", b"weld_position_m", b"weld_id", b"xunit")
    )
    return b"# " + key + b": " + rng.choice(values) + b"\n" + data


def change_column(rng: Random, data: bytes, _: bytes) -> bytes:
    """Scale or offset both numbers of every row, so that the rows stay well-formed."""
    column, factor, offset = rng.randrange(2), rng.choice((1.0, *_FACTORS)), rng.choice((0.0, 0.0, 1.0, -1e3, 1e9))

    def changed(row: re.Match[bytes]) -> bytes:
        fields = [float(row[1]), float(row[2])]
        fields[column] = fields[column] * factor + offset
        return b"%r,%r" % (fields[0], fields[1])

    return re.sub(rb"(?m)^(-?\d+(?:\.\d+)?),(-?\d+(?:\.\d+)?)$", changed, data)


def delimit_otherwise(rng: Random, data: bytes, _: bytes) -> bytes:
    return data.replace(b",", rng.choice((b";", b"\t", b" ", b", ", b",,", b"|"))).replace(
        b".", rng.choice((b".", b".", b","))
    )


MEASUREMENTS: tuple[Mutation, ...] = (state_otherwise, change_column, delimit_otherwise)


# YAML


def add_yaml_bomb(rng: Random, data: bytes, _: bytes) -> bytes:
    aliases = b"a0: &a0 [x, x]\n" + b"".join(
        b"a%d: &a%d [%s]\n" % (i, i, b", ".join([b"*a%d" % (i - 1)] * 9)) for i in range(1, 12)
    )
    merges = b"m0: &m0 {x: 1}\n" + b"".join(
        b"m%d: &m%d {<<: [%s]}\n" % (i, i, b", ".join([b"*m%d" % (i - 1)] * 9)) for i in range(1, 8)
    )
    long_list = b"list: [" + b"1," * 30_000 + b"]\n"
    bomb = rng.choice((aliases, merges, long_list, b"self: &s [*s]\n", b"? {a: b}\n: c\n", b"--- x\n--- y\n"))
    return bomb + data if rng.random() < 0.5 else data + b"\n" + bomb


def replace_yaml_value(rng: Random, data: bytes, _: bytes) -> bytes:
    odd = (
        b"2001-99-99", b"2001-01-01", b"1:2:3", b".nan", b".inf", b"-.inf", b"~", b"yes", b"[]", b"{}", b"=", b"0o7",
        b"!!binary aGk=", b"!!python/object/apply:os.getcwd []", b"{value: 1}", b"{value: 1, source: x, y: 2}",
        b'"\\ud800"',        b"|\n  text", b"'", b'"', b"\xef\xbf\xbe", b"9" * 5000,
    )  # fmt: skip
    values = list(re.finditer(rb"(?<=: )[^,}\n]+", data))
    if not values:
        return data
    value = rng.choice(values)
    return data[: value.start()] + rng.choice(odd) + data[value.end() :]


YAML: tuple[Mutation, ...] = (add_yaml_bomb, replace_yaml_value, replace_yaml_value)


# JSON that stays JSON


def _change_tree(
    change: Callable[[Random, dict[str, Any], dict[str, Any]], None], rng: Random, data: bytes, other: bytes
) -> bytes:
    try:
        tree, others = json.loads(data), json.loads(other)
        if not isinstance(tree, dict) or not isinstance(others, dict) or not tree or not others:
            return flip_bits(rng, data, other)
        change(rng, tree, others)
        if rng.random() < 0.6:
            _seal(tree)
        return json.dumps(tree, ensure_ascii=rng.random() < 0.7).encode("utf-8", "surrogatepass")
    except (ValueError, RecursionError, OverflowError):  # an earlier mutation left no JSON
        return flip_bits(rng, data, other)


def _seal(tree: dict[str, Any]) -> None:
    """Correct the hash of the content, so that the checks behind it are reached."""
    try:
        if "conditioning" in tree:
            tree["profile_sha256"] = profile_sha256(tree["x_m"], tree["z_m"])
        elif "limits" in tree:
            tree["limits_sha256"] = limits_sha256(msgspec.convert(tree, AssessmentSettings))
        elif "track_definition" in tree:
            tree["config_sha256"] = config_sha256(msgspec.convert(tree, SimulationSettings))
    except (KeyError, TypeError, ValueError, OverflowError, msgspec.ValidationError):
        return  # nothing that could be hashed


def _replace_value(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    tree[rng.choice(list(tree))] = rng.choice(ODD_VALUES)


def _replace_element(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    held = [value for value in tree.values() if isinstance(value, list | dict) and value]
    if held:
        within = rng.choice(held)
        if isinstance(within, list) and isinstance(within[0], dict) and within[0] and rng.random() < 0.8:
            within = rng.choice(within)
        key = rng.choice(list(within)) if isinstance(within, dict) else rng.randrange(len(within))
        within[key] = rng.choice(ODD_VALUES)


def _remove_key(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    del tree[rng.choice(list(tree))]


def _swap_values(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    a, b = rng.choice(list(tree)), rng.choice(list(tree))
    tree[a], tree[b] = tree[b], tree[a]


def _foreign_value(rng: Random, tree: dict[str, Any], other: dict[str, Any]) -> None:
    key = rng.choice(list(other))
    tree[key] = other[key]


def _change_type(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    key = rng.choice(list(tree))
    tree[key] = rng.choice((str, lambda v: f"{v}\n", lambda v: [v], lambda v: {"value": v}, bool, json.dumps))(
        tree[key]
    )


def _scale_number(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    numbers = [k for k, v in tree.items() if isinstance(v, float | int) and not isinstance(v, bool)]
    if numbers:
        tree[rng.choice(numbers)] *= rng.choice(_FACTORS)


def _change_column(rng: Random, tree: dict[str, Any], _: dict[str, Any]) -> None:
    """Make an error of measurement: units, order, offsets, samples lost or repeated, one sample off."""
    columns = [v for v in tree.values() if isinstance(v, list) and v and all(isinstance(e, float | int) for e in v)]
    if not columns:
        return
    column = rng.choice(columns)
    i, j = rng.randrange(len(column)), rng.randrange(len(column))
    match rng.randrange(10):
        case 0:
            column.reverse()
        case 1:
            column[i], column[j] = column[j], column[i]
        case 2:
            column[:] = [v * factor for factor in [rng.choice(_FACTORS)] for v in column]
        case 3:
            column[:] = [v + offset for offset in [rng.choice((1.0, -5.0, 1e3, 1e9, 1e-9))] for v in column]
        case 4:
            del column[i]
        case 5:
            column.insert(i, column[j])
        case 6:
            column[i] += rng.choice((-1.0, 1.0)) * 10.0 ** rng.randint(-12, 0)
        case 7:
            for other in columns:  # every column, so that they stay equally long
                del other[i:j]
        case 8:
            for other in columns:
                del other[rng.choice((1, 19, 20, 21)) :]
        case 9:
            column[:] = [column[i]] * len(column)


_KEEPING_JSON = (
    _replace_value, _replace_element, _remove_key, _swap_values, _foreign_value, _change_type, _scale_number,
    _change_column, _change_column, _change_column,
)  # fmt: skip


def repeat_key(rng: Random, data: bytes, other: bytes) -> bytes:
    """Repeat a key: readers differ in which value they take."""
    key = rng.choice(
        (b"x_m", b"profile_sha256", b"schema_version", b"sequence", b"weld_id", b"peak_force_n", b"limits")
    )
    value = rng.choice((b"[]", b"0", b'"1.0"', b'"9.0"', b"null", b"[1,2,3]"))
    head, brace, tail = data.rpartition(b"}")
    return head + b',"' + key + b'":' + value + brace + tail if brace else flip_bits(rng, data, other)


JSON: tuple[Mutation, ...] = (*(partial(_change_tree, change) for change in _KEEPING_JSON), repeat_key)


# Recordings


def _records(data: bytes) -> list[tuple[int, bytes]]:
    """Return (opcode, content) of an MCAP file, of a spoilt one as far as it can be read."""
    records, at = [], len(MCAP0_MAGIC)
    while at + 9 <= len(data) - len(MCAP0_MAGIC):
        opcode, size = struct.unpack_from("<BQ", data, at)
        records.append((opcode, data[at + 9 : at + 9 + size]))
        at += 9 + size
    return records


def _file_of(records: list[tuple[int, bytes]]) -> bytes:
    body = b"".join(struct.pack("<BQ", opcode, len(content)) + content for opcode, content in records)
    return MCAP0_MAGIC + body + MCAP0_MAGIC


def _sized(data: bytes) -> bytes:
    return struct.pack("<I", len(data)) + data


def _chunk(content: bytes, *, size: int | None = None, crc: int | None = None) -> tuple[int, bytes]:
    packed = zstandard.ZstdCompressor().compress(content)
    head = struct.pack(
        "<QQQI", 0, 0, len(content) if size is None else size, zlib.crc32(content) if crc is None else crc
    )
    return 0x06, head + _sized(b"zstd") + struct.pack("<Q", len(packed)) + packed


def change_records(rng: Random, data: bytes, other: bytes) -> bytes:
    records, foreign = _records(data), _records(other)
    if not records or not foreign:
        return flip_bits(rng, data, other)
    i, j = rng.randrange(len(records)), rng.randrange(len(records))
    match rng.randrange(6):
        case 0:
            del records[i]
        case 1:
            records.insert(i, records[j])
        case 2:
            records[i], records[j] = records[j], records[i]
        case 3:
            records.insert(i, rng.choice(foreign))
        case 4:
            records[i] = (rng.choice((0, 1, 3, 4, 5, 6, 7, 8, 15, 16, 128, 255)), records[i][1])
        case 5:
            records[i] = (records[i][0], rng.choice(ANYWHERE)(rng, records[i][1], records[j][1]))
    return _file_of(records)


def claim_size(rng: Random, data: bytes, other: bytes) -> bytes:
    """Change a length field to more or less than there is."""
    size = rng.choice((0, 1, 2**16, 2**26, 2**31, 2**32 - 1, 2**63 - 1, 2**63, 2**64 - 1))
    at, records = len(MCAP0_MAGIC), _records(data)
    if not records:
        return flip_bits(rng, data, other)
    for _, content in records[: rng.randrange(len(records))]:
        at += 9 + len(content)
    if rng.random() < 0.5:
        return data[: at + 1] + struct.pack("<Q", size) + data[at + 9 :]
    at += 9 + rng.choice((0, 2, 4, 8, 22))
    return data[:at] + struct.pack("<I", size % 2**32) + data[at + 4 :]


def repack_chunk(rng: Random, data: bytes, other: bytes) -> bytes:
    """Spoil records in a chunk with the right checksum, or make a chunk that contradicts its header."""
    records = [r for r in _records(data) if r[0] in (1, 3, 4, 5)]
    if not records:
        return flip_bits(rng, data, other)
    body = _file_of(records[1:])[len(MCAP0_MAGIC) : -len(MCAP0_MAGIC)]
    if rng.random() < 0.7:
        body = rng.choice(ANYWHERE)(rng, body, body)
    size, crc = rng.choice(((None, None), (None, None), (None, 0), (None, 1), (2**40, None), (1, None), (2**26, 0)))
    return _file_of([records[0], _chunk(body, size=size, crc=crc)] * rng.choice((1, 1, 2)))


def add_bomb(rng: Random, data: bytes, _: bytes) -> bytes:
    """Make a small chunk that inflates to something large."""
    if rng.random() < 0.9:  # slow to make
        return change_records(rng, data, data)
    size, byte = rng.choice((2**20, 2**24, 2**26 + 1)), rng.choice((b"\x00", b"\x05", b"a"))
    return _file_of([*_records(data)[:1], _chunk(byte * size)] * rng.choice((1, 3)))


def redefine_type(rng: Random, data: bytes, other: bytes) -> bytes:
    """Write another definition of the same length under a type's name."""
    texts = (
        b"int32 data\n",
        b"string dat\n",
        b"bool[9] data",
        b"X[] data\n",
        b"string<=1 a",
        b"string[] a\n",
        b"\xff\xfe",
    )
    old = b"string data\n"
    return (
        data.replace(old, rng.choice(texts).ljust(len(old))[: len(old)]) if old in data else flip_bits(rng, data, other)
    )


RECORDING: tuple[Mutation, ...] = (change_records, change_records, claim_size, repack_chunk, add_bomb, redefine_type)


# DDS samples: std_msgs/String as CDR


def text_of_cdr(cdr: bytes) -> bytes:
    return cdr[8:-1]


def cdr_of(text: bytes) -> bytes:
    return b"\x00\x01\x00\x00" + _sized(text + b"\x00")


def spoil_text_of_cdr(rng: Random, data: bytes, other: bytes) -> bytes:
    return cdr_of(rng.choice(JSON + ANYWHERE)(rng, text_of_cdr(data), text_of_cdr(other)))


def claim_length(rng: Random, data: bytes, _: bytes) -> bytes:
    length = rng.choice((0, 1, 4, len(data), len(data) - 7, len(data) - 9, 2**24, 2**31 - 1, 2**31, 2**32 - 1))
    return data[:4] + struct.pack("<I", max(0, length)) + data[8:]


def change_encapsulation(rng: Random, data: bytes, _: bytes) -> bytes:
    return bytes((rng.choice((0, 0, 1, 255)), rng.randrange(16), rng.randrange(4), rng.randrange(4))) + data[4:]


CDR: tuple[Mutation, ...] = (
    spoil_text_of_cdr,
    spoil_text_of_cdr,
    spoil_text_of_cdr,
    claim_length,
    change_encapsulation,
)


def mutated(rng: Random, seeds: list[bytes], keeping_form: tuple[Mutation, ...]) -> bytes:
    """Return one valid input after one to three mutations, most of which keep its form."""
    data = rng.choice(seeds)
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        mutation = rng.choice(keeping_form if rng.random() < 0.65 else ANYWHERE)
        data = mutation(rng, data, rng.choice(seeds))
    return data
