"""Say what a hanging sleeper would do to a verdict: the usual companion of a bad weld, and seldom known.

Welds batter the ballast below them. Where nothing is stated about the support, the weld is simulated again with the
sleeper before it hanging, and with those on both sides: their ballast is left with `HANGING_SHARE` of its stiffness.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace as changed

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.probability import SLEEPERS, influences
from weld_force_ros.messages import (
    HANGING_SHARE,
    AssessmentSettings,
    ForceMap,
    HangingOutcome,
    SimulationSettings,
    SupportState,
    UncertaintyResult,
    Verdict,
    WeldProfile,
    config_sha256,
    parse_support,
    support_in_words,
)
from weld_force_ros.physics.track.beam import StripRail
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.simulator import Simulator

_SCENARIOS = (f"0={HANGING_SHARE}", f"0={HANGING_SHARE},1={HANGING_SHARE}")
UNKNOWN = (
    "All sleepers are taken to rest on their ballast; one that hangs beside the weld commonly adds 10 to 30 % to the"
    " peak: look under it"
)
_WHO = dict(zip(_SCENARIOS, ("the sleeper before the weld hangs", "the sleepers on both sides hang"), strict=True))
_WHAT = {"accept": "still acceptable", "undecided": "undecided", "grind": "grind", "reject": "replace"}


class HangingSleepers:
    """Simulates what hanging sleepers would do to welds under some settings, by the fast engine, without samples.

    Args:
        settings: that the verdicts were made with.
        limits: by which they were judged.
        on_fit: called with a line of text if a fit has to be made.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        limits: AssessmentSettings,
        *,
        on_fit: Callable[[str], None] | None = None,
    ) -> None:
        self._settings, self._limits, self._on_fit = settings, limits, on_fit
        track = track_file.parse(settings.track_definition, settings.track).track
        single = not track.continuous and not isinstance(track.rail, StripRail)
        self._unstated = single and isinstance(settings.support, UnsetType)

    @cached_property
    def _simulator(self) -> Simulator:
        nominal = changed(self._settings, engine="common-poles", uncertainty=UNSET)
        return Simulator(changed(nominal, config_sha256=config_sha256(nominal)), on_fit=self._on_fit, curves=False)

    def outcomes(self, profile: WeldProfile) -> list[HangingOutcome]:
        """Return what each scenario comes to; nothing where the support is stated, or no single one can differ.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        if not self._unstated or not isinstance(profile.support, UnsetType):
            return []
        found = []
        for support in _SCENARIOS:
            hung = changed(profile, support=parse_support(support))
            verdict = judge(self._simulator.force_map(hung), self._limits)
            found.append(
                HangingOutcome(
                    support=support,
                    peak_force_n=verdict.peak_force_n,
                    worst_speed_kmh=verdict.worst_speed_kmh,
                    decision=verdict.decision if isinstance(verdict.force, UnsetType) else verdict.force.decision,
                )
            )
        return found


def support_sentences(verdict: Verdict, stated: Sequence[SupportState] | UnsetType) -> list[str]:
    """Return what a verdict knows of the sleepers beside the weld, and what it may hide, a sentence each."""
    if not isinstance(stated, UnsetType):
        return [f"Simulated with {support_in_words(stated)}; sleeper 0 is the last before the weld"]
    return hanging_in_words(verdict) or [UNKNOWN]


def sleeper_share_sentences(force_map: ForceMap) -> list[str]:
    """Return how much of the peak force's variance comes from sleeper to sleeper; nothing where that was not drawn."""
    spread = force_map.spread
    if not isinstance(spread, UncertaintyResult) or isinstance(spread.sleeper_effect, UnsetType):
        return []
    peaks = np.array(spread.peak_force_n).reshape(len(spread.sleeper_effect), -1)
    share = influences(peaks, spread).get(SLEEPERS, 0.0)
    return [
        f"What lies beneath each sleeper differs by itself in the samples: {share:.0%} of the peak force's variance"
    ]


def hanging_in_words(verdict: Verdict) -> list[str]:
    """Return what hanging sleepers would do, a sentence each; nothing where that was not asked for."""
    sentences = []
    for outcome in verdict.hanging:
        who = _WHO.get(outcome.support, "sleepers hang")
        more = outcome.peak_force_n / verdict.peak_force_n - 1
        change = f"{abs(more) * 100:.0f} % {'more' if more > 0 else 'less'}" if abs(more) >= 0.005 else "as much"
        sentences.append(
            f"If {who}: {outcome.peak_force_n / 1e3:.0f} kN at {outcome.worst_speed_kmh:g} km/h, {change};"
            f" forces: {_WHAT.get(outcome.decision, outcome.decision)}"
        )
    if sentences:
        sentences.append("Look under the sleepers: whether they hang, no measurement of the rail's surface tells")
    return sentences
