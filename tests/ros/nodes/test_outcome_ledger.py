"""The ledger, by itself and out of a recording."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.messages import TOPICS, ForceMap, Message, Rejection, Settled, Verdict, WeldProfile
from weld_force_ros.recording import STRING, Recorder, string_cdr
from weld_force_ros.ros.nodes.outcome_ledger import RESEND_BATCH, Ledger, read_ledger

IDS = [f"{n:064x}" for n in range(40)]


def bag_of(path: Path, *messages: tuple[type[Message], str]) -> Path:
    with Recorder(path) as recorder:
        for number, (kind, text) in enumerate(messages):
            recorder.write(
                f"/left/{TOPICS[kind].name}", STRING, string_cdr(text), log_time_ns=number, publish_time_ns=number
            )
    return path


def about(profile_id: str, **more: object) -> str:
    import json

    return json.dumps({"profile_id": profile_id, **more})


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 9)), max_size=40))
def test_open_is_what_was_accepted_and_not_settled(steps: list[tuple[bool, int]]) -> None:
    ledger, accepted, settled = Ledger(), set(), set()
    for accept, n in steps:
        if accept:
            ledger.accept(IDS[n], b"")
            accepted |= {n} - settled
        else:
            ledger.settle(IDS[n])
            settled.add(n)
            accepted.discard(n)
    assert ledger.open_count == len(accepted)
    assert ledger.settled_count == len(settled)
    assert ledger.settled_of(IDS[:10]) == [IDS[n] for n in range(10) if n in settled]


def test_every_open_measurement_is_sent_again_in_its_turn() -> None:
    ledger = Ledger()
    for n in range(40):
        ledger.accept(IDS[n], bytes([n]))
    sent = [cdr[0] for _ in range(5) for cdr in ledger.oldest_open()]
    assert sent[:40] == list(range(40))
    assert len(sent) == 5 * RESEND_BATCH


def test_recording_tells_what_is_open_settled_and_unfinished(tmp_path: Path) -> None:
    done, refused, killed_before_confirming, mapped, only_taken = IDS[:5]
    bag = bag_of(
        tmp_path / "bag",
        *((WeldProfile, about(i)) for i in (done, killed_before_confirming, mapped, only_taken)),
        (ForceMap, about(done)),
        (Verdict, about(done)),
        (Settled, '{"profile_ids": ["' + done + '"]}'),
        (Rejection, about(refused)),
        (Settled, '{"profile_ids": ["' + refused + '"]}'),
        (ForceMap, about(killed_before_confirming)),
        (Verdict, about(killed_before_confirming)),
        (ForceMap, about(mapped)),
        (ForceMap, about(mapped, vehicle="another")),
        (
            Settled,
            '{"profile_ids": ["' + only_taken + '"], "asked_by": "/profile_node#1"}',
        ),  # an answer settles nothing
        (WeldProfile, "{broken"),
    )
    noted = []
    ledger = read_ledger(bag, lambda kind, text: noted.append(kind))
    assert ledger.settled_of(IDS) == [done, refused, killed_before_confirming]
    assert ledger.open_count == 3, "what broke the contract awaits its rejection, too"
    assert list(ledger.waiting_maps) == [mapped]
    assert len(ledger.waiting_maps[mapped]) == 2
    assert [(i, kept.kind) for i, kept in ledger.unfinished.items()] == [(killed_before_confirming, Verdict)]
    assert noted.count(WeldProfile) == 4


def a_map(config: str, *judged_together: str, profile_id: str = IDS[0]) -> ForceMap:
    return ForceMap(
        weld_id="w", profile_sha256="0" * 64, profile_id=profile_id, config_sha256=config, track="t",
        engine="common-poles", speeds_kmh=[40.0], positions_m=[0.0], peak_force_n=[1.0], peak_x_m=[0.0],
        min_force_n=[1.0], contact_loss_s=[0.0], static_load_n=1.0, span_m=0.6, elapsed_s=0.0,
        judged_together=list(judged_together),
    )  # fmt: skip


def test_maps_are_gathered_until_every_vehicle_s_is_there() -> None:
    ledger, (a, b, c) = Ledger(), IDS[:3]
    both = [a_map(a, a, b), a_map(b, a, b)]
    assert ledger.gather(both[1]) == []
    assert ledger.gather(both[1]) == [], "the same again is no other vehicle's"
    assert ledger.gather(a_map(a, a, b, profile_id=IDS[9])) == [], "nor is another measurement's"
    assert ledger.gather(both[0]) == both, "in the order of the vehicles"
    ledger.settle(IDS[0])
    assert ledger.gather(both[0]) == [], "a settled measurement's maps are let go"
    assert ledger.gather(a_map(c)) == [a_map(c)], "of a simulator that was set anew in between"


def test_old_recording_without_identities_settles_by_weld_and_geometry(tmp_path: Path) -> None:
    text = '{"weld_id": "w", "profile_sha256": "' + "0" * 64 + '"}'
    bag = bag_of(tmp_path / "bag", (WeldProfile, text), (ForceMap, text), (Verdict, text))
    ledger = read_ledger(bag, lambda kind, text: None)
    assert (ledger.settled_count, ledger.open_count) == (1, 0)


def test_a_profile_that_comes_after_its_outcome_is_noted_and_not_open() -> None:
    ledger = Ledger()
    ledger.settle(IDS[0])
    assert not ledger.has_profile(IDS[0])
    ledger.accept(IDS[0], b"")
    assert ledger.has_profile(IDS[0])
    assert ledger.open_count == 0


def test_the_name_in_a_broken_profile_stays_free_for_the_corrected_one(tmp_path: Path) -> None:
    bag = bag_of(tmp_path / "bag", (WeldProfile, about(IDS[0], weld_id="w")))
    ledger = read_ledger(bag, lambda kind, text: None)
    assert ledger.open_count == 1
    assert not ledger.has_profile(IDS[0])
