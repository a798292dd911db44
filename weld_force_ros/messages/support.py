"""Supports that differ from the track's at a weld: how people state them, and how messages hold them."""

import re
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import UNSET, Meta, UnsetType

from weld_force_ros.errors import InputError

FURTHEST_SLEEPER = 8
MAX_GAP_M = 0.02
MAX_SHARE = 100.0
HANGING_SHARE = 0.02
"""Of its stiffness and damping, what is left beneath a sleeper that hangs."""

_REMEDY = (
    "write SLEEPER=SHARE such as 0=0.02,1=0.5, SLEEPER=gap:0.8mm, SLEEPER=missing, SLEEPER=pad:2, or FIRST:LAST=4;"
    " sleeper 0 is the last before the weld's centre"
)
_ENTRY = re.compile(r"(-?\d+)(?::(-?\d+))?=(.+)")
_GAP = re.compile(r"gap:([0-9.eE+-]+)(mm|m)")

_Share = Annotated[float, Meta(ge=0.0, le=MAX_SHARE)]


class SupportState(msgspec.Struct, kw_only=True, frozen=True):
    """One support that differs from the track's.

    Attributes:
        sleeper: 0 is the last before the weld's centre, 1 the next, -1 the one before, with rising x.
        share: of the track's stiffness and damping beneath the sleeper; 0 hangs free.
        pad_share: of the track's pad; 0 is no support at all.
        gap_m: how far the sleeper has to come down until it rests.
    """

    sleeper: Annotated[int, Meta(ge=-FURTHEST_SLEEPER, le=FURTHEST_SLEEPER + 1)]
    share: _Share = 1.0
    pad_share: _Share = 1.0
    gap_m: Annotated[float, Meta(description="m", gt=0.0, le=MAX_GAP_M)] | UnsetType = UNSET


def parse_support(text: str) -> list[SupportState]:
    """Read supports as people state them, `0=0.02,1=0.5`, in order along the rail; nothing, or `none`: all as usual.

    Raises:
        InputError: not of that form, a sleeper twice or too far away, a share or gap out of its range.
    """
    if text.strip() in ("", "none"):
        return []
    states: dict[int, SupportState] = {}
    for entry in text.split(","):
        match = _ENTRY.fullmatch(entry.strip().replace(" ", ""))
        if match is None:
            raise InputError(f"support {entry.strip()!r} cannot be read", _REMEDY)
        first, last = int(match[1]), int(match[2] or match[1])
        if not -FURTHEST_SLEEPER <= first <= last <= FURTHEST_SLEEPER + 1:
            raise InputError(
                f"support {entry.strip()!r}: sleepers {-FURTHEST_SLEEPER} to {FURTHEST_SLEEPER + 1} can be stated",
                "name sleepers near the weld, the first of a range first; what lies further away is not felt there",
            )
        for sleeper in range(first, last + 1):
            if sleeper in states:
                raise InputError(f"support: sleeper {sleeper} is stated twice", "state it once")
            states[sleeper] = _state(sleeper, match[3], entry.strip())
    return [states[sleeper] for sleeper in sorted(states)]


def _state(sleeper: int, said: str, entry: str) -> SupportState:
    if said == "missing":
        return SupportState(sleeper=sleeper, pad_share=0.0)
    try:
        if gap := _GAP.fullmatch(said):
            gap_m = float(gap[1]) * (1e-3 if gap[2] == "mm" else 1.0)
            if not 0.0 < gap_m <= MAX_GAP_M:
                raise InputError(
                    f"support {entry!r}: a gap of {gap_m * 1e3:g} mm",
                    f"give more than 0 and at most {MAX_GAP_M * 1e3:g} mm; SLEEPER=0 hangs free",
                )
            return SupportState(sleeper=sleeper, gap_m=gap_m)
        of_pad = said.startswith("pad:")
        share = float(said.removeprefix("pad:"))
    except ValueError:
        raise InputError(f"support {entry!r} cannot be read", _REMEDY) from None
    if not 0.0 <= share <= MAX_SHARE:
        raise InputError(f"support {entry!r}: a share of {share:g}", f"give a number from 0 to {MAX_SHARE:g}")
    return SupportState(sleeper=sleeper, pad_share=share) if of_pad else SupportState(sleeper=sleeper, share=share)


def support_text(states: Sequence[SupportState]) -> str:
    """Return supports as `parse_support` reads them; `none` where all are as usual."""
    return ",".join(f"{state.sleeper}={_said(state)}" for state in states) or "none"


def _said(state: SupportState) -> str:
    if isinstance(state.gap_m, float):
        return f"gap:{state.gap_m!r}m"
    if state.pad_share != 1.0:
        return "missing" if state.pad_share == 0.0 else f"pad:{state.pad_share!r}"
    return repr(state.share)


def mirrored_support(states: Sequence[SupportState]) -> list[SupportState]:
    """Return supports as they are met in the opposite direction: sleeper 1 is the last before the weld then."""
    return [msgspec.structs.replace(state, sleeper=1 - state.sleeper) for state in reversed(states)]


def support_in_words(states: Sequence[SupportState] | UnsetType) -> str:
    """Return supports as people read them; nothing where all are as usual."""
    if isinstance(states, UnsetType):
        return ""
    return "; ".join(f"sleeper {state.sleeper} {_what(state)}" for state in states)


def _what(state: SupportState) -> str:
    if isinstance(state.gap_m, float):
        return f"hangs over a gap of {state.gap_m * 1e3:g} mm"
    if state.pad_share == 0.0:
        return "missing"
    parts = []
    if state.share == 0.0:
        parts.append("hangs free")
    elif state.share != 1.0:
        parts.append(f"with {state.share * 100:g} % of its support")
    if state.pad_share != 1.0:
        parts.append(f"with {state.pad_share * 100:g} % of its pad")
    return " and ".join(parts) or "as usual"
