"""The verdict on a weld."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import pandas as pd
import xarray as xr

from weld_force_ros.assessment.assessor import Assessor
from weld_force_ros.assessment.judge import Assessment, permitted_kmh
from weld_force_ros.errors import InputError
from weld_force_ros.library import datasets, frames
from weld_force_ros.library.fits import announce
from weld_force_ros.library.last_few import LastFew
from weld_force_ros.library.limits import Limits
from weld_force_ros.library.model import POSITIONS, Model
from weld_force_ros.library.notebook import table
from weld_force_ros.library.profile import Profile
from weld_force_ros.messages import Answer, SimulationSettings, known
from weld_force_ros.simulation.settings import DEFAULT_UNCERTAINTY_SAMPLES


class Verdict:
    """The decision on a weld, its reasons, and what it rests on; made by `assess`.

    Attributes:
        message: the verdict as recordings and `weld-force assess --json` give it.

    Examples:
        >>> import weld_force_ros as wf
        >>> weld = wf.read_profile("weld-4-steep-ramp", line_speed_kmh=200)
        >>> model = wf.Model("bilbao-continuous")
        >>> verdict = wf.assess(weld, model, speeds_kmh=[100, 200], positions=1, uncertainty_samples=0)
        >>> verdict
        <Verdict 'weld-4-steep-ramp': grind (geometry not assessed, force grind); 176 kN at 200 km/h>
    """

    def __init__(self, found: Assessment, settings: SimulationSettings) -> None:
        self._found, self._settings = found, settings
        self.message = found.verdict

    @property
    def weld_id(self) -> str:
        """Return the weld's name.

        Examples:
            >>> verdict.weld_id
            'weld-4-steep-ramp'
        """
        return self.message.weld_id

    @property
    def decision(self) -> str:
        """Return what to do with the weld: `accept`, `grind`, `reject` or `undecided`.

        Examples:
            >>> verdict.decision
            'grind'
        """
        return self.message.decision

    @property
    def reason(self) -> str:
        """Return why, in a sentence.

        Examples:
            >>> "peak_force" in verdict.reason
            True
        """
        return self.message.reason

    @property
    def geometry(self) -> str:
        """Return what the chosen rule books say about the profile itself; `not assessed` if none of them does.

        Examples:
            >>> verdict.geometry
            'not assessed'
        """
        return _decision(known(self.message.geometry))

    @property
    def force(self) -> str:
        """Return what the simulated forces say.

        Examples:
            >>> verdict.force
            'grind'
        """
        return _decision(known(self.message.force))

    @property
    def criteria(self) -> pd.DataFrame:
        """Return every criterion with its value, limit, margin, source and the passage it is from, a row each.

        Examples:
            >>> print(verdict.criteria.loc[:1, ["name", "value", "limit", "unit", "passed"]])
                     name      value     limit unit  passed
            0  peak_force  176191.50  150000.0    N   False
            1    p2_force  122042.44  150000.0    N    True
        """
        return frames.of("criteria", [self.message])

    @property
    def advice(self) -> list[str]:
        """Return advice on speed in words, the most useful first.

        Examples:
            >>> len(verdict.advice) > 0
            True
        """
        return list(self.message.advice)

    @property
    def permitted_speed_kmh(self) -> float | None:
        """Return the highest computed speed with all forces within limits, km/h; 0 if none is, None if nothing is said.

        Examples:
            >>> verdict.permitted_speed_kmh
            114.0
        """
        return permitted_kmh(self.message)

    @property
    def force_map(self) -> xr.Dataset:
        """Return the force map that was judged, of the vehicle that decides; as `Model.force_map` returns it.

        Examples:
            >>> dict(verdict.force_map.sizes)
            {'speed_kmh': 2, 'position_m': 1, 'running': 2}
        """
        return datasets.of_force_map(self._found.force_map, self._settings)

    @property
    def force_curve(self) -> xr.Dataset:
        """Return the worst force against speed, as `Model.force_curve` returns it.

        Where `estimated`, it was not simulated but lies between speeds that were: the verdict does not depend on it.

        Examples:
            >>> verdict.force_curve.sizes["speed_kmh"]
            101
        """
        return datasets.of_curve(self._found.force_map, self._settings)

    @property
    def passage(self) -> xr.Dataset:
        """Return the passage that decided, as `Model.passage` returns it, to 10 cm behind its peak or the weld's end.

        Examples:
            >>> verdict.passage.attrs["speed_kmh"]
            200.0
        """
        return datasets.of_history(self._found.history, self._settings)

    def __repr__(self) -> str:
        return (
            f"<Verdict {self.weld_id!r}: {self.decision} (geometry {self.geometry}, force {self.force}); "
            f"{self.message.peak_force_n / 1e3:.0f} kN at {self.message.worst_speed_kmh:g} km/h>"
        )

    def _repr_html_(self) -> str:
        verdict = self.message
        facts: Mapping[str, object] = {
            "why": verdict.reason,
            "geometry, by standard": self.geometry,
            "force, by model": self.force,
            "peak force": f"{verdict.peak_force_n / 1e3:.0f} kN at {verdict.worst_speed_kmh:g} km/h, "
            f"{verdict.worst_position_m:g} m after the sleeper",
            "vehicle": known(verdict.vehicle),
            "judged up to": f"{verdict.judged_speed_kmh:g} km/h",
        }
        return table(f"{self.weld_id}: {self.decision}", facts)


def assess(
    profile: Profile,
    model: Model | Sequence[Model],
    limits: Limits | str | Path = "force",
    *,
    speeds_kmh: Sequence[float] | None = None,
    positions: int | Sequence[float] = POSITIONS,
    uncertainty_samples: int = DEFAULT_UNCERTAINTY_SAMPLES,
) -> Verdict:
    """Simulate a weld and judge it, as `weld-force assess` does: the same verdict, to the last bit.

    Args:
        profile: the weld; it is judged up to its `line_speed_kmh`, or up to the highest speed if that is not stated.
        model: a vehicle on a track; of several, which each are simulated, the one that decides is named.
        limits: Limits, or what `Limits` takes.
        speeds_kmh: as of `Model.force_map`.
        positions: as of `Model.force_map`.
        uncertainty_samples: Monte-Carlo samples for probabilities; 0: values are compared with limits.

    Raises:
        InputError: speeds, positions or limits that cannot be used, or no limit holds for a line of that speed.
        NumericalError: a passage did not stay finite.

    Examples:
        >>> import weld_force_ros as wf
        >>> weld = wf.read_profile("weld-4-steep-ramp", line_speed_kmh=120)
        >>> vehicles = [wf.Model("bilbao-continuous", name) for name in ("metro", "freight-22.5t")]
        >>> verdict = wf.assess(weld, vehicles, speeds_kmh=[80, 120], positions=1, uncertainty_samples=0)
        >>> verdict.decision, verdict.message.vehicle
        ('undecided', 'metro')
    """
    models = [model] if isinstance(model, Model) else list(model)
    if not models:
        raise InputError("no model to assess by", "give a Model, or several")
    applied = limits if isinstance(limits, Limits) else Limits(limits)
    settings = [one.settings(speeds_kmh, positions, uncertainty_samples=uncertainty_samples) for one in models]
    assessor = _assessor(settings, applied, models[0].threads)
    found = assessor.assess(profile.message)
    return Verdict(found, assessor.settings_of(found))


_kept = LastFew[Assessor](4)


def _assessor(settings: Sequence[SimulationSettings], limits: Limits, threads: int | None) -> Assessor:
    """Return what assesses by settings and limits; the last few are kept, as making one loads fits."""
    key = (threads, limits.message.limits_sha256, *(one.config_sha256 for one in settings))
    return _kept.get(key, lambda: Assessor(settings, limits.message, on_fit=announce, threads=threads))


def _decision(answer: Answer | None) -> str:
    return "not assessed" if answer is None else answer.decision
