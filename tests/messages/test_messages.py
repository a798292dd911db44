import hashlib
import json
import math
import re
from collections.abc import Iterator
from typing import Any

import jsonschema
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from weld_force_ros.errors import MessageError
from weld_force_ros.messages import (
    MAX_MESSAGE_BYTES,
    SCHEMAS,
    TOPICS,
    AssessmentSettings,
    Criterion,
    ForceHistory,
    ForceMap,
    GrindingAdvice,
    HollowBand,
    Inquiry,
    Limit,
    Message,
    NormPoint,
    PositionOutcome,
    ProfileMeasures,
    RailSurface,
    Rejection,
    Restriction,
    Rules,
    Settled,
    SimulationSettings,
    SpeedBand,
    SpeedCurve,
    Stamp,
    Uncertainty,
    UncertaintyResult,
    Verdict,
    WeldMarker,
    WeldProfile,
    config_sha256,
    decode,
    encode,
    json_schema,
    limits_sha256,
    profile_problem,
    profile_sha256,
)

KINDS = list(SCHEMAS)
each_kind = pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)

texts = st.text(st.characters(codec="utf-8"), max_size=30)
names = st.text(st.characters(codec="utf-8"), min_size=1, max_size=30)
numbers = st.floats(allow_nan=False, allow_infinity=False)
positive = st.floats(0.1, 1e9)
speeds = st.floats(0.1, 1000.0)
metres = st.floats(-1e3, 1e3)
chainages = st.floats(-1e8, 1e8)
hashes = st.text("0123456789abcdef", min_size=64, max_size=64)
header = {
    "schema_version": st.integers(0, 99).map(lambda minor: f"1.{minor}"),
    "publisher": texts,
    "sequence": st.integers(0, 2**53 - 1),
    "stamp": st.builds(Stamp, sec=st.integers(-(2**31), 2**31 - 1), nanosec=st.integers(0, 10**9 - 1)),
}


def maybe(values: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.just(UNSET) | values


def axis(values: st.SearchStrategy[float]) -> st.SearchStrategy[list[float]]:
    return st.lists(values, min_size=1, max_size=4, unique=True).map(sorted)


def cells(count: int) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-1e12, 1e12), min_size=count, max_size=count)


@st.composite
def weld_profiles(draw: st.DrawFn) -> WeldProfile:
    count = draw(st.integers(20, 40))
    steps = draw(st.lists(st.floats(1e-4, 9.9e-3), min_size=count, max_size=count))
    x = [sum(steps[:i], start=-0.1) for i in range(count)]
    z = draw(st.lists(st.floats(-4e-3, 4e-3), min_size=count, max_size=count))
    return draw(
        st.builds(
            WeldProfile, weld_id=names, source=names, x_m=st.just(x), z_m=st.just(z),
            profile_sha256=st.just(profile_sha256(x, z)), source_sha256=maybe(hashes), rail=maybe(names),
            instrument=maybe(names), chainage_m=maybe(chainages), line_speed_kmh=maybe(speeds),
            weld_position_m=maybe(st.floats(0.0, 2.0)), conditioning=st.lists(texts, max_size=3), **header,
        )
    )  # fmt: skip


def _hashed(settings: SimulationSettings) -> SimulationSettings:
    settings.config_sha256 = config_sha256(settings)
    return settings


share = st.floats(0.0, 1.0)
uncertainty = st.builds(
    Uncertainty, samples=st.integers(2, 10_000), noise_m=st.floats(0.0, 1e-3), noise_length_m=st.floats(1e-3, 1.0),
    support_spread=share, hertz_spread=share, radius_low_m=st.floats(0.1, 0.4), radius_high_m=st.floats(0.4, 0.6),
    source=texts,
)  # fmt: skip


simulation_settings = st.builds(
    SimulationSettings, config_sha256=hashes, track=names, track_definition=names,
    engine=st.sampled_from(["common-poles", "rfp", "reference"]), speeds_kmh=axis(speeds), positions_m=axis(metres),
    wheel_mass_kg=positive, static_load_n=positive, wheel_radius_m=st.floats(0.1, 1.9), hertz_n_per_m15=positive,
    uncertainty=maybe(uncertainty), **header,
).map(_hashed)  # fmt: skip

limits = st.builds(
    Limit, name=names, limit=st.floats(-1e6, 0.0), reject_limit=st.floats(0.0, 1e6), unit=st.just("N"), source=texts,
    applies=maybe(texts), above_kmh=maybe(st.floats(0.0, 400.0)), to_kmh=maybe(st.floats(0.0, 400.0)),
)  # fmt: skip


def _sealed(settings: AssessmentSettings) -> AssessmentSettings:
    settings.limits_sha256 = limits_sha256(settings)
    return settings


assessment_settings = st.builds(
    AssessmentSettings, limits_sha256=hashes, limits=st.lists(limits, min_size=1, max_size=4),
    rules=maybe(st.builds(Rules, unknown_position=st.sampled_from(["worst", "undecided"]), resolved_hz=positive)),
    gradient_norm=st.just([]) | axis(speeds).map(lambda v: [NormPoint(speed_kmh=s, gradient_rad=1e-3) for s in v]),
    **header,
).map(_sealed)  # fmt: skip

measures = st.builds(
    ProfileMeasures, kind=st.sampled_from(["dip", "protrusion"]), dip_m=share, protrusion_m=share, gradient_rad=share,
    straightedge_m=share, spacing_m=positive,
)  # fmt: skip


@st.composite
def speed_curves(draw: st.DrawFn) -> SpeedCurve:
    speeds_kmh = draw(axis(speeds))
    values = cells(len(speeds_kmh))
    return draw(
        st.builds(
            SpeedCurve, speeds_kmh=st.just(speeds_kmh), peak_force_n=values, min_force_n=values, contact_loss_s=values,
            at_m=values, p2_force_n=maybe(values), force_20hz_n=maybe(values), limits_sha256=maybe(hashes),
            estimated=maybe(st.lists(st.booleans(), min_size=len(speeds_kmh), max_size=len(speeds_kmh))),
        )
    )  # fmt: skip


@st.composite
def spreads(draw: st.DrawFn) -> UncertaintyResult:
    count, positions_m = draw(st.integers(1, 3)), draw(axis(metres))
    values, inputs = cells(count * len(positions_m)), cells(count)
    return draw(
        st.builds(
            UncertaintyResult, positions_m=st.just(positions_m), peak_force_n=values,
            min_force_n=values, contact_loss_s=values,
            p2_force_n=maybe(values), force_20hz_n=maybe(values), gradient_rad=inputs, straightedge_m=inputs,
            support_factor=inputs, hertz_factor=inputs, wheel_radius_m=inputs,
        )
    )  # fmt: skip


@st.composite
def force_maps(draw: st.DrawFn) -> ForceMap:
    speeds_kmh, positions_m = draw(axis(speeds)), draw(axis(metres))
    values = cells(len(speeds_kmh) * len(positions_m))
    return draw(
        st.builds(
            ForceMap, weld_id=names, profile_sha256=hashes, config_sha256=hashes, track=names,
            engine=st.just("common-poles"), speeds_kmh=st.just(speeds_kmh), positions_m=st.just(positions_m),
            peak_force_n=values, peak_x_m=values, min_force_n=values, contact_loss_s=values, p2_force_n=maybe(values),
            force_20hz_n=maybe(values), measures=maybe(measures), curve=maybe(speed_curves()),
            spread=maybe(spreads()), static_load_n=positive, span_m=st.floats(0.2, 2.0),
            elapsed_s=st.floats(0.0, 1e6), line_speed_kmh=maybe(speeds),
            weld_position_m=maybe(metres), chainage_m=maybe(chainages), rail=maybe(names), **header,
        )
    )  # fmt: skip


force_histories = st.integers(1, 5).flatmap(
    lambda n: st.builds(
        ForceHistory, weld_id=names, profile_sha256=hashes, config_sha256=hashes, speed_kmh=speeds, position_m=metres,
        x_m=cells(n), force_n=cells(n), wheel_m=cells(n), rail_m=cells(n), irregularity_m=cells(n), **header,
    )
)  # fmt: skip

criteria = st.builds(
    Criterion, name=names, value=numbers, limit=numbers, unit=st.just("kN"), passed=st.booleans(), source=texts,
    reject_limit=maybe(numbers), margin=maybe(numbers), applies=maybe(texts), speed_kmh=maybe(speeds),
    position_m=maybe(metres), x_m=maybe(metres), exceeding=maybe(share), exceeding_reject=maybe(share),
    driver=maybe(texts), driver_share=maybe(share),
)  # fmt: skip
decisions = st.sampled_from(["accept", "grind", "reject", "undecided"])
few = {"max_size": 3}
verdicts = st.builds(
    Verdict, weld_id=names, profile_sha256=hashes, config_sha256=hashes, limits_sha256=hashes, software=names,
    decision=decisions, reason=texts,
    criteria=st.lists(criteria, min_size=1, max_size=3), peak_force_n=numbers, static_load_n=numbers,
    worst_speed_kmh=speeds, worst_position_m=metres, worst_x_m=metres, judged_speed_kmh=positive,
    chainage_m=maybe(chainages), rail=maybe(names), unjudged=st.lists(names, **few),
    by_position=st.lists(st.builds(PositionOutcome, position_m=metres, decision=decisions), **few),
    geometry_kind=maybe(st.sampled_from(["dip", "protrusion"])),
    curve_class=maybe(st.sampled_from(["rises", "hollow"])),
    maxima_kmh=st.lists(speeds, **few), permitted_speed_kmh=maybe(speeds), advice=st.lists(texts, **few),
    hollows=st.lists(
        st.builds(HollowBand, from_kmh=speeds, lowest_kmh=speeds, to_kmh=speeds, depth_n=positive), **few
    ),
    avoid=st.lists(st.builds(SpeedBand, from_kmh=speeds, to_kmh=speeds), **few),
    restrictions=st.lists(
        st.builds(Restriction, speed_kmh=speeds, peak_force_n=numbers, change=numbers, within_limits=st.booleans()),
        **few,
    ),
    advice_step_kmh=maybe(positive), samples=st.integers(0, 10_000), **header,
)  # fmt: skip
grinding = st.integers(1, 5).flatmap(
    lambda n: st.builds(
        GrindingAdvice, weld_id=names, profile_sha256=hashes, config_sha256=hashes, limits_sha256=hashes,
        software=names, reached=st.booleans(), reason=texts, x_m=cells(n), z_m=cells(n), removal_m=cells(n),
        most_removed_m=positive, removed_m2=positive, band_limit_m=positive, stone_radius_m=positive,
        decision_before=decisions, decision_after=decisions, before=st.lists(criteria, **few),
        after=st.lists(criteria, **few), speeds_kmh=st.just([10.0, 20.0]), peak_before_n=cells(2),
        peak_after_n=cells(2), reference_checked=st.integers(0, 99), reference_within=st.integers(0, 99),
        reference_peak_n=maybe(numbers), elapsed_s=positive, **header,
    )
)  # fmt: skip

rejections = st.builds(
    Rejection, source=names, reason=texts, remedy=texts, raw_text=texts, raw_truncated=st.booleans(),
    source_sha256=maybe(hashes), profile_sha256=maybe(hashes), **header,
)  # fmt: skip

rail_surfaces = st.integers(1, 5).flatmap(
    lambda n: st.builds(
        RailSurface, chainage=cells(n), height=cells(n), chainage_unit=st.sampled_from(["m", "cm", "mm", "um"]),
        height_unit=st.sampled_from(["m", "cm", "mm", "um"]), height_positive=st.sampled_from(["up", "down"]), **header,
    )
)  # fmt: skip
weld_markers = st.builds(
    WeldMarker, chainage_m=maybe(chainages), weld_id=maybe(names), line_speed_kmh=maybe(speeds),
    weld_position_m=maybe(st.floats(0.0, 2.0)), **header,
)  # fmt: skip
inquiries = st.builds(Inquiry, profile_ids=st.lists(hashes, max_size=3), **header)
settled = st.builds(
    Settled, profile_ids=st.lists(hashes, max_size=3), asked_by=names, asked_sequence=st.integers(0, 2**40), **header
)

MESSAGES: dict[type[Message], st.SearchStrategy[Any]] = {
    RailSurface: rail_surfaces,
    WeldMarker: weld_markers,
    Inquiry: inquiries,
    Settled: settled,
    WeldProfile: weld_profiles(),
    SimulationSettings: simulation_settings,
    AssessmentSettings: assessment_settings,
    ForceMap: force_maps(),
    ForceHistory: force_histories,
    Verdict: verdicts,
    Rejection: rejections,
    GrindingAdvice: grinding,
}


def sample(kind: type[Message], **changes: Any) -> dict[str, Any]:
    """A plain valid message as a JSON object."""
    x = [i * 1e-3 for i in range(20)]
    z = [1e-5 * (i % 3) for i in range(20)]
    sha, one = "0" * 64, [1.0]
    row = {"name": "peak_force", "limit": 1.0, "unit": "N", "source": "hand"}
    content: dict[type[Message], dict[str, Any]] = {
        WeldProfile: {"source": "s", "x_m": x, "z_m": z, "profile_sha256": profile_sha256(x, z)},
        ForceMap: {"engine": "rfp", "track": "t", "speeds_kmh": [1.0, 2.0], "positions_m": [0.0], "static_load_n": 1.0,
                   "span_m": 0.6, "elapsed_s": 0.0, "peak_force_n": [1.0, 2.0], "peak_x_m": [1.0, 2.0],
                   "min_force_n": [1.0, 2.0], "contact_loss_s": [0.0, 0.0]},
        ForceHistory: {"speed_kmh": 80.0, "position_m": 0.0, "x_m": one, "force_n": one, "wheel_m": one, "rail_m": one,
                       "irregularity_m": one},
        Verdict: {"limits_sha256": sha, "software": "s", "decision": "grind", "reason": "r", "peak_force_n": 1.0,
                  "criteria": [row | {"value": 2.0, "passed": False}], "static_load_n": 1.0, "worst_speed_kmh": 1.0,
                  "worst_position_m": 0.0, "worst_x_m": 0.0, "judged_speed_kmh": 1.0},
        Rejection: {"source": "s", "reason": "r", "remedy": "m"},
        SimulationSettings: {"track": "t", "track_definition": "d", "engine": "rfp", "speeds_kmh": [1.0],
                             "positions_m": [0.0], "wheel_mass_kg": 1.0, "static_load_n": 1.0, "wheel_radius_m": 0.4,
                             "hertz_n_per_m15": 1.0},
        AssessmentSettings: {"limits": [row | {"reject_limit": 2.0, "verified": False}]},
        RailSurface: {"chainage": [0.0, 1.0], "height": [0.0, 1.0], "chainage_unit": "mm", "height_unit": "um",
                      "height_positive": "up"},
        WeldMarker: {"chainage_m": 1.0, "weld_id": "w"},
        Inquiry: {"profile_ids": [sha]},
        Settled: {"profile_ids": [sha]},
        GrindingAdvice: {"limits_sha256": sha, "software": "s", "reached": True, "reason": "r", "x_m": one, "z_m": one,
                         "removal_m": one, "most_removed_m": 1.0, "removed_m2": 1.0, "band_limit_m": 1.0,
                         "stone_radius_m": 1.0, "decision_before": "grind", "decision_after": "accept",
                         "before": [row | {"value": 2.0, "passed": False}],
                         "after": [row | {"value": 1.0, "passed": True}], "speeds_kmh": one,
                         "peak_before_n": one, "peak_after_n": one, "elapsed_s": 1.0},
    }  # fmt: skip
    common = {"weld_id": "w", "profile_sha256": sha, "config_sha256": sha}
    fields = {field.name for field in msgspec.structs.fields(kind)}
    message = {k: v for k, v in common.items() if k in fields} | {"schema_version": "1.0"} | content[kind] | changes
    if kind is SimulationSettings:
        message["config_sha256"] = sha256_of_json(content[kind] | changes)
    if kind is AssessmentSettings:
        message["limits_sha256"] = sha256_of_json(message["limits"])
    return message


def sha256_of_json(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


@each_kind
@given(data=st.data())
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
def test_message_survives_the_wire_and_its_schema_accepts_it(kind: type[Message], data: st.DataObject):
    message = data.draw(MESSAGES[kind])
    wire = encode(message)
    assert decode(kind, wire) == message
    assert decode(kind, wire.decode()) == message
    plain = json.loads(wire)
    jsonschema.Draft202012Validator(json_schema(kind)).validate(plain)
    for field in msgspec.structs.fields(kind):
        assert (field.name in plain) == (getattr(message, field.name) is not UNSET)
    assert b":null" not in wire


@each_kind
def test_reader_of_today_reads_tomorrows_minor_version(kind: type[Message]):
    now = decode(kind, json.dumps(sample(kind)))
    later = sample(kind) | {"schema_version": "1.99", "new_field": {"nested": [1, None]}}
    assert msgspec.structs.replace(decode(kind, json.dumps(later)), schema_version="1.0") == now


@each_kind
@pytest.mark.parametrize("version", ["2.0", "0.9", "", "one", "11.0", 1.0, None])
def test_unknown_major_version_is_refused(kind: type[Message], version: object):
    with pytest.raises(MessageError, match=rf"^{kind.__name__}: .*(version|Expected `str`)"):
        decode(kind, json.dumps(sample(kind, schema_version=version)))


@each_kind
def test_message_without_version_is_refused(kind: type[Message]):
    message = sample(kind)
    del message["schema_version"]
    with pytest.raises(MessageError, match="schema_version"):
        decode(kind, json.dumps(message))


@each_kind
def test_optional_field_may_be_absent_but_not_null(kind: type[Message]):
    optional = [f.name for f in msgspec.structs.fields(kind) if f.default is UNSET]
    for name in optional:
        assert name not in sample(kind) or kind in (Rejection, WeldMarker)
        with pytest.raises(MessageError, match="null"):
            decode(kind, json.dumps(sample(kind) | {name: None}))


def _with_number(value: Any, number: object, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every copy of a JSON value in which one float is replaced."""
    if isinstance(value, dict):
        for key, item in value.items():
            for where, changed in _with_number(item, number, f"{path}.{key}"):
                yield where, value | {key: changed}
    elif isinstance(value, list):
        for where, changed in _with_number(value[-1], number, f"{path}[]"):
            yield where, [*value[:-1], changed]
    elif isinstance(value, float):
        yield path, number


@each_kind
@pytest.mark.parametrize("text", ["NaN", "Infinity", "-Infinity", "1e999", "null", "1" + "0" * 400])
def test_number_that_is_not_finite_is_refused_wherever_it_stands(kind: type[Message], text: str):
    for _, changed in _with_number(sample(kind), "@"):
        with pytest.raises(MessageError, match=r"^\w+: "):
            decode(kind, json.dumps(changed).replace('"@"', text))


@each_kind
@pytest.mark.parametrize("number", [math.nan, math.inf])
def test_number_that_is_not_finite_is_never_sent(kind: type[Message], number: float):
    message = decode(kind, json.dumps(sample(kind)))
    for field in msgspec.structs.fields(kind):
        value = getattr(message, field.name)
        if isinstance(value, float):
            changed: Any = number
        elif isinstance(value, list) and value and isinstance(value[0], float):
            changed = [*value[:-1], number]
        else:
            continue
        with pytest.raises(MessageError, match=field.name):
            encode(msgspec.structs.replace(message, **{field.name: changed}))


@pytest.mark.parametrize(
    ("kind", "changes", "complaint"),
    [
        (ForceMap, {"peak_force_n": [1.0]}, "peak_force_n has 1 values, the axes make 2"),
        (ForceMap, {"speeds_kmh": [2.0, 1.0]}, "must increase"),
        (ForceMap, {"speeds_kmh": [0.0, 1.0]}, "speeds_kmh"),
        (ForceHistory, {"rail_m": [1.0, 2.0]}, "differ in length"),
        (RailSurface, {"height": [1.0]}, "2 chainages but 1 heights"),
        (RailSurface, {"height_unit": "inch"}, "inch"),
        (WeldMarker, {"weld_position_m": -0.1}, "weld_position_m"),
        (Inquiry, {"profile_ids": ["../x"]}, "profile_ids"),
        (Settled, {"profile_ids": ["0" * 64] * 1001}, "profile_ids"),
        (WeldProfile, {"z_m": [0.0] * 21}, "20 positions but 21 heights"),
        (WeldProfile, {"z_m": [0.0] * 20}, "but x_m and z_m make"),
        (WeldProfile, {"weld_id": ""}, "weld_id"),
        (SimulationSettings, {"positions_m": [0.0, 0.0]}, "must increase"),
        (
            SimulationSettings,
            {"speeds_kmh": [1.0 + i / 2 for i in range(1000)], "positions_m": [i / 1e3 for i in range(201)]},
            "200000 passages",
        ),
        (SimulationSettings, {"speeds_kmh": [1.0 + i / 2 for i in range(1001)]}, "speeds_kmh"),
        (Verdict, {"decision": "perhaps"}, "perhaps"),
        (Verdict, {"criteria": []}, "criteria"),
        (Rejection, {"raw_text": "x" * 65_537}, "raw_text"),
        (Rejection, {"profile_sha256": "ABC"}, "profile_sha256"),
        (Rejection, {"sequence": -1}, "sequence"),
        (Rejection, {"sequence": 2**53}, "sequence"),
        (Rejection, {"stamp": {"sec": 0, "nanosec": 10**9}}, "nanosec"),
    ],
)
def test_message_against_the_contract_is_refused(kind: type[Message], changes: dict[str, Any], complaint: str):
    with pytest.raises(MessageError, match=complaint):
        decode(kind, json.dumps(sample(kind, **changes)))


def test_settings_with_another_content_than_their_hash_are_refused():
    with pytest.raises(MessageError, match="hash of the settings"):
        decode(SimulationSettings, json.dumps(sample(SimulationSettings) | {"wheel_mass_kg": 2.0}))
    with pytest.raises(MessageError, match="hash of the limits"):
        decode(AssessmentSettings, json.dumps(sample(AssessmentSettings) | {"limits_sha256": "0" * 64}))


def test_reject_limit_below_limit_is_refused():
    row = sample(AssessmentSettings)["limits"][0] | {"limit": 3.0}
    with pytest.raises(MessageError, match="peak_force: reject_limit is below limit"):
        decode(AssessmentSettings, json.dumps(sample(AssessmentSettings, limits=[row])))


@pytest.mark.parametrize(
    "data",
    [
        b"", b"{", b"[]", b"null", b"x_m,z_m\n0,0", b"\xff\xfe{}", b"\x00" * 100, '"\ud800"',
        b'{"schema_version": "1.0", "source": "\xed\xa0\x80", "reason": "r", "remedy": "m"}',
        '{"schema_version": "1.0", "new": ' + "[" * 200_000,
        '{"schema_version": "1.0", "new": ' + "[" * 200_000 + "]" * 200_000 + "}",
        b" " * (MAX_MESSAGE_BYTES + 1),
    ],
    ids=lambda data: repr(data[:25]),
)  # fmt: skip
def test_what_is_no_message_is_refused_with_one_line(data: bytes | str):
    with pytest.raises(MessageError, match=r"^Rejection: ") as caught:
        decode(Rejection, data)
    assert "\n" not in str(caught.value)


@given(st.binary(max_size=200) | st.text(max_size=200))
@settings(deadline=None)
def test_arbitrary_input_never_raises_anything_else(data: bytes | str):
    with pytest.raises(MessageError, match=r"^Rejection: "):
        decode(Rejection, data)


def test_text_that_utf8_cannot_hold_is_not_sent():
    with pytest.raises(MessageError, match="UTF-8"):
        encode(Rejection(source="weld-\udcff.csv", reason="r", remedy="m"))


def _properties(schema: dict[str, Any]) -> Iterator[dict[str, Any]]:
    yield schema
    for child in schema.get("properties", {}).values():
        yield from _properties(child)
    if "items" in schema:
        yield from _properties(schema["items"])


@each_kind
def test_schema_is_valid_and_readable_for_lichtblick(kind: type[Message]):
    schema = json_schema(kind)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["type"] == "object"
    for part in _properties(schema):
        assert isinstance(part["type"], str), part
        assert part["type"] != "null"
        assert not {"$ref", "$defs", "oneOf", "anyOf", "allOf"} & part.keys()
        if part["type"] == "array":
            assert part["items"]["type"] != "array", "nested arrays"
            assert not any(p["type"] in ("object", "array") for p in part["items"].get("properties", {}).values())


@each_kind
def test_schema_refuses_what_the_reader_refuses(kind: type[Message]):
    validator = jsonschema.Draft202012Validator(json_schema(kind))
    for where, changed in _with_number(sample(kind), "many"):
        assert not validator.is_valid(changed), where
    assert not validator.is_valid({})


def line(count: int, spacing: float, height: float = 0.0) -> tuple[list[float], list[float]]:
    return [i * spacing for i in range(count)], [height * (i % 2) for i in range(count)]


@pytest.mark.parametrize(
    ("x", "z", "problem"),
    [
        (*line(20, 0.010), None),
        (*line(501, 0.010, 0.010), None),
        (*line(19, 0.005), "19 samples, 20 are needed"),
        (*line(502, 0.010), "length"),
        (*line(30, 0.0101), "spacing 10.1 mm after sample"),
        (*line(30, 0.005, 0.0101), "amplitude 10.1 mm"),
        (*line(30, -0.005), "x does not increase from sample 1 to 2"),
        (*line(30, 0.0), "x does not increase from sample 1 to 2"),
        (line(30, 0.005)[0], [*[0.0] * 29, math.nan], "sample 30: z is not a finite number"),
    ],
)
def test_geometry_bounds_are_those_of_the_design(x: list[float], z: list[float], problem: str | None):
    found = profile_problem(x, z)
    assert found is None if problem is None else found is not None and problem in found


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=9), st.integers(0, 8))
@settings(deadline=None)
def test_profile_hash_sees_the_last_bit(heights: list[float], which: int):
    places = [float(i) for i in range(len(heights))]
    i = which % len(heights)
    changed = [*heights[:i], math.nextafter(heights[i], 2.0), *heights[i + 1 :]]
    assert profile_sha256(places, heights) == profile_sha256(list(places), list(heights))
    assert profile_sha256(places, changed) != profile_sha256(places, heights)


def test_topic_names_are_unique_and_every_message_has_one():
    assert len({topic.name for topic in TOPICS.values()}) == len(TOPICS)
    assert set(SCHEMAS) == set(Message.__subclasses__()) == set(MESSAGES)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("positions_m", [1e308]),
        ("positions_m", [-2e3]),
        ("span_m", 1e308),
        ("weld_position_m", 1e308),
        ("chainage_m", -1e308),
        ("model_error", 1e308),
        ("peak_force_n", [1.0, 1e308]),
        ("peak_x_m", [1.0, -1e308]),
    ],
)
def test_no_weld_has_such_a_place_or_such_a_force(field: str, value: Any):
    with pytest.raises(MessageError) as refused:
        decode(ForceMap, json.dumps(sample(ForceMap, **{field: value})))
    assert re.fullmatch(rf"ForceMap: Expected `float` [<>]= \S+ - at `\$\.{field}(\[.\])?`; .*", str(refused.value))
