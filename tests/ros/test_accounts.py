"""Gaps in sequence numbers and repeated messages."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.ros.accounts import GapCounter, Header, Repeats, header_of


def header(sequence: int, publisher: str = "/a#1") -> Header:
    return Header(publisher=publisher, sequence=sequence)


@given(st.integers(1, 50), st.sets(st.integers(0, 49)), st.integers(1, 3))
def test_missing_numbers_are_counted_for_each_publisher(count: int, lost: set[int], publishers: int) -> None:
    gaps = GapCounter()
    arrived = [n for n in range(count) if n not in lost]
    for sequence, who in itertools.product(arrived, range(publishers)):
        gaps.note("topic", header(sequence, f"/{who}"))
    missing_before_the_last = (max(arrived) + 1 - len(arrived)) if arrived else 0
    assert gaps.missed == publishers * missing_before_the_last


def test_topics_are_counted_apart() -> None:
    gaps = GapCounter()
    for topic in ("a", "b"):
        for sequence in range(3):
            gaps.note(topic, header(sequence))
    assert gaps.missed == 0
    assert (gaps.next_from("a", "/a#1"), gaps.next_from("c", "/a#1")) == (3, 0)


def test_nameless_publisher_may_start_again() -> None:
    gaps = GapCounter()
    for sequence in (0, 1, 2, 0, 1):
        gaps.note("topic", header(sequence, ""))
    assert gaps.missed == 0


@given(st.text())
def test_header_of_anything_is_a_header_or_none(text: str) -> None:
    assert header_of(text) is None or isinstance(header_of(text), Header)


def test_header_is_read_of_a_broken_message() -> None:
    assert header_of('{"sequence": 7, "publisher": "/p", "x_m": null, "later": {}}') == header(7, "/p")
    assert header_of('{"sequence": -1}') is None


def test_same_message_is_new_once() -> None:
    repeats = Repeats()
    assert [repeats.is_new("weld", "/a", 4) for _ in range(3)] == [True, False, False]


def test_publisher_may_repeat_itself_on_purpose() -> None:
    repeats = Repeats()
    assert [repeats.is_new("weld", "/a", n) for n in (1, 2)] == [True, True]


@given(st.lists(st.sampled_from("xyz"), max_size=12), st.integers(1, 4))
def test_restarts_add_nothing_to_what_was_sent_first(contents: list[str], starts: int) -> None:
    repeats = Repeats()
    new = [
        content
        for start in range(starts)
        for sequence, content in enumerate(contents)
        if repeats.is_new(content, f"/node#{start}", sequence)
    ]
    assert new == contents
