import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.errors import InputError
from weld_force_ros.messages import SupportState, mirrored_support, parse_support, support_in_words, support_text

STATES = st.dictionaries(
    st.integers(-8, 9),
    st.one_of(
        st.floats(0.0, 100.0).map(lambda share: {"share": share}),
        st.floats(0.0, 100.0).map(lambda share: {"pad_share": share}),
        st.floats(1e-6, 0.02).map(lambda gap_m: {"gap_m": gap_m}),
    ),
    max_size=6,
).map(lambda said: [SupportState(sleeper=sleeper, **said[sleeper]) for sleeper in sorted(said)])


@given(STATES)
def test_what_is_written_is_read_again(states):
    assert parse_support(support_text(states)) == states


@given(STATES)
def test_met_twice_from_the_other_side_supports_are_as_stated(states):
    assert mirrored_support(mirrored_support(states)) == states


def test_supports_are_read_as_people_state_them():
    assert parse_support("1=gap:0.8mm, 0=0.02,-1=missing") == [
        SupportState(sleeper=-1, pad_share=0.0),
        SupportState(sleeper=0, share=0.02),
        SupportState(sleeper=1, gap_m=0.0008),
    ]
    assert [state.sleeper for state in parse_support("1:4=3")] == [1, 2, 3, 4]
    assert parse_support("none") == parse_support("") == []
    assert support_in_words(parse_support("0=0.02,1=gap:0.8mm,2=0")) == (
        "sleeper 0 with 2 % of its support; sleeper 1 hangs over a gap of 0.8 mm; sleeper 2 hangs free"
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("0=-0.5", "a share of -0.5"),
        ("0=nan", "a share of nan"),
        ("0=gap:21mm", "a gap of 21 mm"),
        ("0=gap:0mm", "a gap of 0 mm"),
        ("12=0.5", "-8 to 9"),
        ("4:1=0.5", "-8 to 9"),
        ("0=0.5,0=0.6", "stated twice"),
        ("half", "cannot be read"),
        ("0=gap:few mm", "cannot be read"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(text, said):
    with pytest.raises(InputError) as caught:
        parse_support(text)
    assert said in caught.value.reason
    assert "\n" not in f"{caught.value.reason}{caught.value.remedy}"
