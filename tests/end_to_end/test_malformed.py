"""Malformed input, the short version; the long one is `python -m tests.soak.malformed`."""

import json
import math
import os
import signal
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.soak import malformed
from tests.soak.malformed import DefectError, Kind, Reading, Report, check_profile, check_refusal
from tests.soak.mutations import ANYWHERE, JSON, LINES, MEASUREMENTS, RECORDING, YAML
from weld_force_ros.errors import InputError
from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import TOPICS, RailSurface, WeldProfile, decode, profile_sha256, read_header
from weld_force_ros.simulation import track_file

pytestmark = pytest.mark.slow

COUNT, SEED = 600, 1


@pytest.fixture(scope="module")
def report() -> Report:
    return malformed.run(malformed.available(), COUNT, SEED)


@pytest.mark.parametrize("name", [kind.name for kind in malformed.available()])
def test_every_mutated_input_is_refused_or_valid(report, name):
    assert report.by_kind[name].failures == []


def test_mutations_reach_what_is_behind_the_parsers(report):
    total, tallies = malformed.Tally(), report.by_kind.values()
    for tally in tallies:
        assert tally.refused + tally.accepted + len(tally.failures) == tally.mutated
        assert tally.accepted or tally.mutated < 40  # of DDS samples one in thirty or so is still valid
        total.add(tally)
    assert total.mutated >= 0.95 * COUNT
    assert 0.5 < total.past_parsing / total.mutated < 0.95
    assert total.judged > 10


# The run itself notices what it is there to notice


def _crash(_: bytes) -> Reading:
    raise KeyError("x")


def _hang(_: bytes) -> Reading:
    while True:
        pass


def _die(data: bytes) -> Reading:
    if data == malformed.malformed_input(_kind(_die), 3, SEED):
        os.kill(os.getpid(), signal.SIGSEGV)
    return Reading(True, True)


def _one_seed() -> list[bytes]:
    return [b"a seed that is long enough to be spoilt in many ways"]


def _kind(read) -> Kind:
    return Kind(read.__name__, _one_seed, ANYWHERE, read, 1)


def test_a_crash_a_hang_and_a_death_are_found_and_the_run_goes_on():
    kinds = [_kind(_crash), _kind(_die), _kind(_hang)._replace(share=0)]
    found = malformed.run(kinds, 12, SEED, limit_s=1.0)
    assert [(f.number, f.what) for f in found.by_kind["_crash"].failures] == [(i, "KeyError: 'x'") for i in range(6)]
    assert [(f.number, f.what) for f in found.by_kind["_die"].failures] == [(3, "the process died with exit code -11")]
    assert found.by_kind["_die"].mutated == 6
    assert [f.what for f in found.by_kind["_hang"].failures] == ["hangs: more than 1 s of processor time"]


GOOD_X = [i * 0.005 for i in range(40)]
GOOD_Z = [0.001 * math.sin(x) for x in GOOD_X]


@pytest.mark.parametrize(
    ("x_m", "z_m", "rule"),
    [
        (GOOD_X[:19], GOOD_Z[:19], "20 samples"),
        (GOOD_X, GOOD_Z[:-1], "a height for every position"),
        (GOOD_X, [*GOOD_Z[:-1], math.nan], "finite"),
        ([*GOOD_X[:-1], GOOD_X[-2]], GOOD_Z, "increasing"),
        ([2.1 * x for x in GOOD_X], GOOD_Z, "10 mm spacing"),
        (GOOD_X, [*GOOD_Z[:-1], 0.0101], "10 mm amplitude"),
        ([i * 0.005 for i in range(1002)], [0.0] * 1002, "5 m length"),
    ],
)
def test_the_oracle_knows_an_invalid_profile(x_m, z_m, rule):
    good = profile_sha256(GOOD_X, GOOD_Z)
    check_profile(GOOD_X, GOOD_Z, good)
    with pytest.raises(DefectError, match="hash"):
        check_profile(GOOD_X, GOOD_Z, good[::-1])
    digest = profile_sha256(x_m, z_m) if rule != "finite" else good
    with pytest.raises(DefectError, match=rule):
        check_profile(x_m, z_m, digest)


@pytest.mark.parametrize("reason", ["two\nlines", "a terminal's \x1b[2J", "x" * 2000, " "])
def test_the_oracle_knows_an_unhelpful_refusal(reason):
    check_refusal(InputError("a reason", "a remedy"))
    with pytest.raises(DefectError):
        check_refusal(InputError(reason, "a remedy"))


@pytest.mark.parametrize("kind", ["WeldProfile", "profile file", "recording", "track file"])
def test_an_input_follows_from_seed_and_index(kind):
    made = [malformed.malformed_input(malformed.KINDS[kind], i, SEED) for i in range(20)]
    assert made == [malformed.malformed_input(malformed.KINDS[kind], i, SEED) for i in range(20)]
    assert made != [malformed.malformed_input(malformed.KINDS[kind], i, SEED + 1) for i in range(20)]
    assert len(set(made)) > 15


def test_every_mutation_changes_something():
    seeds = {"message": (JSON, "WeldProfile"), "file": ((*LINES, *MEASUREMENTS), "profile file")}
    seeds |= {"yaml": (YAML, "track file"), "recording": (RECORDING, "recording"), "any": (ANYWHERE, "Verdict")}
    for mutations, name in seeds.values():
        data, other = (malformed.KINDS[name].seeds() * 2)[:2]
        for mutation in mutations:
            assert any(mutation(Random(i), data, other) != data for i in range(50)), (name, mutation)  # noqa: S311


# What hypothesis finds by itself

_JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
    max_leaves=8,
)


@given(st.sampled_from(list(TOPICS)), st.data())
@settings(max_examples=200, deadline=None)
def test_messages_with_any_value_in_any_field_are_refused_or_valid(kind, data):
    fields = {name: data.draw(_JSON_VALUES) for name in data.draw(st.sets(st.sampled_from(kind.__struct_fields__)))}
    (seed, *_) = malformed.KINDS[kind.__name__].seeds() if kind.__name__ in malformed.KINDS else [b"{}"]
    raw = json.dumps(json.loads(seed) | fields).encode("utf-8", "surrogatepass")
    malformed.read_message(kind, raw)


@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8", "surrogatepass")))
@settings(max_examples=200, deadline=None)
def test_any_bytes_are_refused(data):
    read_header(data.decode("utf-8", "replace"))
    for read in (
        lambda: decode(WeldProfile, data),
        lambda: profile_file.parse_profile(data, "measured.csv"),
        lambda: track_file.parse(data.decode("utf-8", "replace"), "track.yaml"),
    ):
        with pytest.raises(InputError) as refusal:
            read()
        check_refusal(refusal.value)


# Defects that the run found


@pytest.mark.parametrize(
    "rows",
    [b"1" * 100_000 + b"x,1\n", b"1,2\n" * 1_000_000, b"# note: x\n" * 400_000],
    ids=["digits", "rows", "comments"],
)
def test_a_large_file_is_refused_at_once(rows):
    def refused(data: bytes) -> Reading:
        return malformed.read_profile_file(lambda _: None, data)

    signal.signal(signal.SIGPROF, _too_slow)
    signal.setitimer(signal.ITIMER_PROF, malformed.PROCESSOR_LIMIT_S)
    try:
        assert not refused(b"# x_unit: mm\n# z_unit: um\n# z_positive: up\n" + rows).accepted
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, signal.SIG_DFL)


def _too_slow(*_: object) -> None:
    raise DefectError("too slow")


@pytest.mark.parametrize("row", [b"# chainage_m: 1e999\n", b"# weld_position_m: 9e400\n", b"5e-324,65.4\n"])
def test_a_number_out_of_the_range_of_floats_is_refused(row):
    (file, *_) = malformed.KINDS["profile file"].seeds()
    assert malformed.read_profile_file(lambda _: None, file).accepted
    assert not malformed.read_profile_file(lambda _: None, file + row).accepted


@pytest.mark.parametrize("field", ["profile_sha256", "profile_id", "schema_version"])
def test_an_identity_with_a_line_break_after_it_is_none(field):
    seed = json.loads(malformed.KINDS["WeldProfile"].seeds()[0])
    with pytest.raises(InputError, match=field):
        decode(WeldProfile, json.dumps(seed | {field: seed[field] + "\n"}))


@pytest.mark.parametrize("field", ["schema_version", "chainage_unit"])
def test_a_refusal_does_not_repeat_a_long_value(field):
    seed = json.loads(malformed.KINDS["RailSurface"].seeds()[0])
    with pytest.raises(InputError) as refusal:
        decode(RailSurface, json.dumps(seed | {field: "x\x1b\n" * 20_000}))
    check_refusal(refusal.value)
    assert len(str(refusal.value)) < 500
