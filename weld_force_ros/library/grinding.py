"""The least grinding that brings a weld within its limits."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import xarray as xr

from weld_force_ros.assessment.grinding import advise
from weld_force_ros.assessment.grinding_search import Grinder
from weld_force_ros.library.limits import Limits
from weld_force_ros.library.model import POSITIONS, Model
from weld_force_ros.library.notebook import table
from weld_force_ros.library.profile import Profile, with_geometry
from weld_force_ros.messages import GrindingAdvice, WeldProfile, known

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SPOT = ("from_m", "to_m", "depth_m", "deepest_m", "side")


class GrindingPlan:
    """Where a weld is ground and how deep, and what that does to its forces; made by `grind`.

    Attributes:
        message: the advice as `weld-force grind --json` gives it.

    Examples:
        >>> import numpy as np
        >>> import weld_force_ros as wf
        >>> x = np.linspace(-0.15, 0.15, 61)
        >>> weld = wf.Profile(x, 2e-4 * (1 + np.cos(2 * np.pi * x / 0.3)), weld_id="rise", line_speed_kmh=120)
        >>> model = wf.Model("bilbao-continuous")
        >>> plan = wf.grind(
        ...     weld, model, "prorail-qi", speeds_kmh=[120], positions=1, band_limit_m=0.2, hand_margin_m=0.0
        ... )
        >>> plan
        <GrindingPlan 'rise': grind -> undecided, at most 0.27 mm removed>
    """

    def __init__(self, advice: GrindingAdvice, profile: WeldProfile) -> None:
        self.message, self._profile = advice, profile

    @property
    def reached(self) -> bool:
        """Return whether a removal was found that brings the weld within its limits, and that the exact track confirms.

        Examples:
            >>> plan.reached
            True
        """
        return self.message.reached

    @property
    def reason(self) -> str:
        """Return what was found, in a sentence.

        Examples:
            >>> plan.reason.partition(" from ")[0]
            'up to 0.27 mm removed between -23 and 23 cm'
        """
        return self.message.reason

    @property
    def most_removed_m(self) -> float:
        """Return the largest depth that is removed, m.

        Examples:
            >>> f"{plan.most_removed_m * 1e3:.2f} mm"
            '0.27 mm'
        """
        return self.message.most_removed_m

    @property
    def removal(self) -> xr.Dataset:
        """Return what is removed along the rail.

        Returns:
            Dimension `x_m`, m from the weld's centre; variables `before_m`, `removal_m` and `after_m`.

        Examples:
            >>> sorted(plan.removal.data_vars)
            ['after_m', 'before_m', 'removal_m']
        """
        advice = self.message
        before, removal = np.array(advice.z_m), np.array(advice.removal_m)
        columns = {
            "before_m": (before, "height before"),
            "removal_m": (removal, "depth removed"),
            "after_m": (before - removal, "height after"),
        }
        variables = {
            name: ("x_m", values, {"units": "m", "long_name": words}) for name, (values, words) in columns.items()
        }
        along = ("x_m", np.array(advice.x_m), {"units": "m", "long_name": "distance from the weld's centre"})
        return xr.Dataset(variables, {"x_m": along}, self._provenance())

    @property
    def peaks(self) -> xr.Dataset:
        """Return the peak force at the worst position against speed, before and after.

        Returns:
            Dimension `speed_kmh`; variables `before_n` and `after_n`.

        Examples:
            >>> bool((plan.peaks.after_n < plan.peaks.before_n).all())
            True
        """
        advice = self.message
        variables = {
            "before_n": ("speed_kmh", np.array(advice.peak_before_n), {"units": "N", "long_name": "peak force before"}),
            "after_n": ("speed_kmh", np.array(advice.peak_after_n), {"units": "N", "long_name": "peak force after"}),
        }
        speeds = ("speed_kmh", np.array(advice.speeds_kmh), {"units": "km/h", "long_name": "speed"})
        return xr.Dataset(variables, {"speed_kmh": speeds}, self._provenance())

    @property
    def spots(self) -> pd.DataFrame:
        """Return the stretches that are ground, a row each: from, to, depth and where it is deepest, m; and which side.

        Examples:
            >>> plan.spots.columns.tolist()
            ['from_m', 'to_m', 'depth_m', 'deepest_m', 'side']
        """
        rows = [[known(getattr(spot, name)) for name in _SPOT] for spot in self.message.spots]
        return pd.DataFrame(rows, columns=list(_SPOT))

    @property
    def profile(self) -> Profile:
        """Return the weld as it is after grinding, with all that was stated of it.

        Examples:
            >>> plan.profile.line_speed_kmh
            120.0
        """
        advice = self.message
        after = (np.array(advice.z_m) - np.array(advice.removal_m)).tolist()
        conditioning = self._profile.conditioning
        return Profile.from_message(with_geometry(self._profile, advice.x_m, after, conditioning=conditioning))

    def plot(self, figure: "Figure | None" = None) -> "Figure":
        """Draw where metal comes off, the quality index along the rail and the force, before and after.

        Args:
            figure: an empty figure of matplotlib to draw in; pyplot's next one if not given.

        Raises:
            InputError: matplotlib is not installed.

        Examples:
            >>> from matplotlib.figure import Figure
            >>> len(plan.plot(Figure()).axes)
            3
        """
        from weld_force_ros.report import figures

        return figures.grinding(self.message, figure or figures.next_figure(11, 6.4))

    def __repr__(self) -> str:
        advice = self.message
        return (
            f"<GrindingPlan {advice.weld_id!r}: {advice.decision_before} -> {advice.decision_after}, "
            f"at most {advice.most_removed_m * 1e3:.2f} mm removed>"
        )

    def _repr_html_(self) -> str:
        advice = self.message
        facts = {
            "decision": f"{advice.decision_before} → {advice.decision_after}",
            "deepest": f"{advice.most_removed_m * 1e3:.3f} mm",
            "peak force": f"{max(advice.peak_before_n) / 1e3:.0f} → {max(advice.peak_after_n) / 1e3:.0f} kN",
            "why": advice.reason,
        }
        return table(f"Grinding of {advice.weld_id}", facts)

    def _provenance(self) -> dict[str, str]:
        names = ("weld_id", "profile_sha256", "config_sha256", "limits_sha256", "software")
        return {name: getattr(self.message, name) for name in names}


def grind(
    profile: Profile,
    model: Model,
    limits: Limits | str | Path = "force",
    *,
    speeds_kmh: Sequence[float] | None = None,
    positions: int | Sequence[float] = POSITIONS,
    band_limit_m: float = Grinder.band_limit_m,
    stone_radius_m: float = Grinder.stone_radius_m,
    hand_margin_m: float = Grinder.hand_margin_m,
) -> GrindingPlan:
    """Search the least removal of metal that brings a weld within its limits, and check it on the exact track.

    The same as `weld-force grind` does; it takes seconds.

    Args:
        profile: the weld.
        model: a vehicle on a track.
        limits: Limits, or what `Limits` takes.
        speeds_kmh: as of `Model.force_map`.
        positions: as of `Model.force_map`.
        band_limit_m: shortest wavelength that is ground, m.
        stone_radius_m: of the grinding stone, m: hollows are no sharper.
        hand_margin_m: by how much the depth may come out too large or too small, m; 0: ground by a machine.

    Raises:
        InputError: limits or a grinder that cannot be used, or no limit holds for a line of that speed.
        NumericalError: a passage did not stay finite.

    Examples:
        >>> import weld_force_ros as wf
        >>> weld = wf.read_profile("weld-5", line_speed_kmh=60)
        >>> wf.grind(weld, wf.Model("bilbao-continuous"), speeds_kmh=[60], positions=1).reason
        'within its limits: nothing to grind'
    """
    applied = limits if isinstance(limits, Limits) else Limits(limits)
    grinder = Grinder(band_limit_m=band_limit_m, stone_radius_m=stone_radius_m, hand_margin_m=hand_margin_m)
    settings = model.settings(speeds_kmh, positions)
    return GrindingPlan(advise(profile.message, settings, applied.message, grinder), profile.message)
