"""Gaps in sequence numbers and repeated messages."""

import itertools

from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.messages import Header, read_header
from weld_force_ros.ros.sequence_tracker import SequenceTracker


def header(sequence: int, publisher: str = "/a#1") -> Header:
    return Header(publisher=publisher, sequence=sequence)


@given(st.integers(1, 50), st.sets(st.integers(0, 49)), st.integers(1, 3))
def test_missing_numbers_are_counted_for_each_publisher(count: int, lost: set[int], publishers: int) -> None:
    gaps = SequenceTracker()
    arrived = [n for n in range(count) if n not in lost]
    for sequence, who in itertools.product(arrived, range(publishers)):
        gaps.note("topic", header(sequence, f"/{who}"))
    missing_between = (max(arrived) + 1 - min(arrived) - len(arrived)) if arrived else 0
    assert gaps.missed == publishers * missing_between


def test_topics_are_counted_apart() -> None:
    gaps = SequenceTracker()
    for topic in ("a", "b"):
        for sequence in range(3):
            gaps.note(topic, header(sequence))
    assert gaps.missed == 0
    assert (gaps.next_expected("a", "/a#1"), gaps.next_expected("c", "/a#1")) == (3, 0)


def test_nameless_publisher_may_start_again() -> None:
    gaps = SequenceTracker()
    for sequence in (0, 1, 2, 0, 1):
        gaps.note("topic", header(sequence, ""))
    assert gaps.missed == 0


@given(st.text())
def test_header_of_anything_is_a_header_or_none(text: str) -> None:
    assert read_header(text) is None or isinstance(read_header(text), Header)


def test_header_is_read_of_a_broken_message() -> None:
    assert read_header('{"sequence": 7, "publisher": "/p", "x_m": null, "later": {}}') == header(7, "/p")
    assert read_header('{"sequence": -1}') is None


def test_message_that_came_before_is_known_again() -> None:
    gaps = SequenceTracker()
    assert [gaps.note("topic", header(n)) for n in (3, 4, 3, 4, 5)] == [False, False, True, True, False]
    assert gaps.missed == 0


def test_what_came_to_a_process_before_is_a_repeat_and_no_gap() -> None:
    gaps = SequenceTracker()
    for sequence in (0, 1, 7):
        gaps.resume("topic", header(sequence))
    assert gaps.missed == 0
    assert [gaps.note("topic", header(n)) for n in (6, 7, 8, 10)] == [True, True, False, False]
    assert gaps.missed == 1
