"""The one composition: profile -> force map -> verdict. Nodes, command line, replay and campaign all call it."""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from typing import Any, cast, get_args

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from weld_force_ros import __version__, _yaml, fits, tracks
from weld_force_ros.core.advice import Advice, advise
from weld_force_ros.core.causality import acausal
from weld_force_ros.core.criteria import CRITERIA, Passages, passages
from weld_force_ros.core.geometry import classify, largest_gradient, straightedge_gap
from weld_force_ros.core.passage import Rig
from weld_force_ros.core.poles import BAND_HZ
from weld_force_ros.core.reference import GreenRig
from weld_force_ros.core.surface import Surface
from weld_force_ros.core.verdict import WORST_POSITION, counted_positions, find, judged_part
from weld_force_ros.core.weld import Trajectory, wheel_trajectory
from weld_force_ros.core.wheel import Wheel
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.messages import (
    AssessmentSettings,
    Engine,
    ForceHistory,
    ForceMap,
    Limit,
    NormPoint,
    ProfileMeasures,
    Rules,
    SimulationSettings,
    SpeedCurve,
    Spread,
    Uncertainty,
    Verdict,
    WeldProfile,
    config_sha256,
    encode,
    legible,
    limits_sha256,
)
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.spread import Sampler

SOFTWARE = f"weld_force_ros {__version__}"
DEFAULT_SPEEDS = "20:300:5"
DEFAULT_POSITIONS = "15"
ENGINES: tuple[str, ...] = get_args(get_args(Engine)[0])
_AFTER_PEAK_M = 0.1

# Messages keep what means something: 0.01 N is a ten-millionth of a wheel load, 0.1 nm far below any roughness.
_FORCE_DECIMALS = 2
_PLACE_DECIMALS = 6
_TIME_DECIMALS = 9
_DISPLACEMENT_DECIMALS = 10
_HISTORY_STEP_M = 1e-3


@dataclass(frozen=True)
class Assessment:
    """Everything found out about one weld."""

    force_map: ForceMap
    history: ForceHistory
    verdict: Verdict


def parse_speeds(text: str) -> list[float]:
    """Speeds in km/h from `FIRST:LAST:STEP` (the last included) or a list `40,80`.

    Raises:
        InputError: not of that form, or not positive and increasing.
    """
    remedy = "write FIRST:LAST:STEP or a list such as 40,80, in km/h, increasing"
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            if not step > 0 or not last >= first or (last - first) / step > 1e4:
                raise ValueError
            speeds = [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]
        else:
            speeds = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"speeds {text!r} cannot be read", remedy) from None
    if not all(np.isfinite(speeds)) or speeds[0] <= 0 or np.any(np.diff(speeds) <= 0):
        raise InputError(f"speeds {text!r} are not positive and increasing", remedy)
    return speeds


def parse_positions(text: str) -> int | list[float]:
    """Positions: one whole number N for N equal steps over a span, else metres after the sleeper, `0.15,0.30`.

    Raises:
        InputError: not of that form, or not increasing.
    """
    remedy = "write a whole number of steps over the span, or metres after the sleeper such as 0.15,0.30, increasing"
    if text.strip().isdecimal():
        count = int(text) if len(text) < 10 else 0
        if not 1 <= count <= 1000:
            raise InputError(f"positions {text!r}: 1 to 1000 steps can be computed", remedy)
        return count
    try:
        positions = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"positions {text!r} cannot be read", remedy) from None
    if not all(np.isfinite(positions)) or np.any(np.diff(positions) <= 0):
        raise InputError(f"positions {text!r} are not finite and increasing", remedy)
    return positions


def simulation_settings(
    *,
    track: str = "bilbao",
    engine: str = "common-poles",
    speeds_kmh: Sequence[float] | None = None,
    positions: int | Sequence[float] = int(DEFAULT_POSITIONS),
    wheel_mass_kg: float | None = None,
    static_load_n: float | None = None,
    wheel_radius_m: float | None = None,
    hertz_n_per_m15: float | None = None,
    uncertainty: Uncertainty | None = None,
) -> SimulationSettings:
    """Settings of a simulation, complete and checked; what is not given for the wheel is the track file's.

    Args:
        track: a shipped track's name or the path of a track file.
        engine: how the track is represented in time.
        speeds_kmh: increasing; default 20 to 300 in steps of 5.
        positions: number of equal steps over the span, or metres after the sleeper.
        wheel_mass_kg: half a wheelset.
        static_load_n: static wheel load.
        wheel_radius_m: rolling radius.
        hertz_n_per_m15: Hertz constant.
        uncertainty: what is drawn for verdicts with probabilities; none if not given.

    Raises:
        InputError: anything that cannot be simulated.
    """
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r} is not available", f"use {', '.join(ENGINES)}")
    definition = tracks.load(track)
    wheel = definition.wheel
    given = {
        "mass_kg": wheel_mass_kg,
        "static_load_n": static_load_n,
        "radius_m": wheel_radius_m,
        "hertz_n_per_m15": hertz_n_per_m15,
    }
    for name, value in given.items():
        if value is not None:
            if not np.isfinite(value) or value <= 0:
                raise InputError(f"wheel {name} is {value:g}", "give a positive number")
            wheel = replace(wheel, **{name: float(value)})
    spacing = definition.track.spacing_m
    at = [i * spacing / positions for i in range(positions)] if isinstance(positions, int) else list(positions)
    settings = SimulationSettings(
        config_sha256="0" * 64,
        track=definition.track.name,
        track_definition=definition.text,
        engine=cast(Engine, engine),
        speeds_kmh=list(map(float, speeds_kmh)) if speeds_kmh is not None else parse_speeds(DEFAULT_SPEEDS),
        positions_m=list(map(float, at)),
        wheel_mass_kg=wheel.mass_kg,
        static_load_n=wheel.static_load_n,
        wheel_radius_m=wheel.radius_m,
        hertz_n_per_m15=wheel.hertz_n_per_m15,
        uncertainty=uncertainty or UNSET,
    )
    settings.config_sha256 = config_sha256(settings)
    try:
        encode(settings)
    except MessageError as error:
        raise InputError(error.reason, "check track, grid and wheel") from None
    return settings


class Simulator:
    """Force maps and histories under fixed settings; making one loads the track's fit and may have to compute it.

    One simulator may be used from several threads.
    """

    def __init__(
        self,
        settings: SimulationSettings,
        *,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
        curves: bool = True,
    ) -> None:
        """Load the fit that `settings` ask for.

        Args:
            settings: what is simulated.
            on_fit: told, in words, if a fit has to be made.
            threads: of a fitted engine; one a core, if not given.
            curves: whether maps carry a curve; without it advice on speed is as fine as the map, which is sooner done.

        Raises:
            InputError: settings that this version cannot simulate.
        """
        self.settings = settings
        # The text, not the name: a recording then holds all that its replay needs.
        definition = tracks.parse(settings.track_definition, settings.track)
        wheel = Wheel(settings.wheel_mass_kg, settings.static_load_n, settings.wheel_radius_m, settings.hertz_n_per_m15)
        self._span_m = definition.track.spacing_m
        self.rig: Rig | GreenRig
        if settings.engine == "reference":
            self.rig = GreenRig(definition.track, wheel)
            self._model_error = acausal(definition.track, self._span_m / 2).floor(wheel.compliance, BAND_HZ)
        else:
            fit = fits.fitted(definition, settings.engine, on_fit=on_fit)
            self.rig = Rig(fit.model(), wheel, threads=threads)
            self._model_error = fit.error
        self._with_curves = curves and settings.engine == "common-poles"
        self._sampler: Sampler | None = None
        if isinstance(settings.uncertainty, Uncertainty):
            self._sampler = Sampler(definition, wheel, settings.uncertainty, on_fit=on_fit)

    def trajectory(self, profile: WeldProfile) -> Trajectory:
        """The wheel centre's trajectory over a profile."""
        return wheel_trajectory(np.array(profile.x_m), np.array(profile.z_m), self.rig.wheel.radius_m)

    def force_map(self, profile: WeldProfile, *, on_speed: Callable[[], None] = lambda: None) -> ForceMap:
        """Peak force at every speed and position of the settings; `on_speed` is called after each speed.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        began, settings, trajectory = time.perf_counter(), self.settings, self.trajectory(profile)
        surface = self.rig.surface(
            trajectory, settings.speeds_kmh, settings.positions_m, low_passed=True, on_speed=on_speed
        )
        return self._mapped(profile, trajectory, surface, began)

    def force_maps(self, profiles: Sequence[WeldProfile]) -> Iterator[ForceMap]:
        """`force_map` of many welds, in their order, sooner done than one by one as they fill the kernel's lanes.

        Raises:
            NumericalError: a passage over one of them did not stay finite.
        """
        began, settings = time.perf_counter(), self.settings
        trajectories = [self.trajectory(profile) for profile in profiles]
        surfaces = self.rig.surfaces(trajectories, settings.speeds_kmh, settings.positions_m, low_passed=True)
        for profile, trajectory, surface in zip(profiles, trajectories, surfaces, strict=True):
            yield self._mapped(profile, trajectory, surface, began)
            began = time.perf_counter()

    def _mapped(self, profile: WeldProfile, trajectory: Trajectory, surface: Surface, began: float) -> ForceMap:
        settings, (below_120hz, below_20hz) = self.settings, _low_passed(surface)
        force_map = ForceMap(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=settings.config_sha256,
            track=settings.track,
            engine=settings.engine,
            speeds_kmh=settings.speeds_kmh,
            positions_m=settings.positions_m,
            peak_force_n=_rounded(surface.peak_force_n, _FORCE_DECIMALS),
            peak_x_m=_rounded(surface.peak_x_m, _PLACE_DECIMALS),
            min_force_n=_rounded(surface.min_force_n, _FORCE_DECIMALS),
            contact_loss_s=_rounded(surface.contact_loss_s, _TIME_DECIMALS),
            p2_force_n=_rounded(below_120hz, _FORCE_DECIMALS),
            force_20hz_n=_rounded(below_20hz, _FORCE_DECIMALS),
            static_load_n=settings.static_load_n,
            span_m=self._span_m,
            model_error=round(self._model_error, 6),
            measures=measured(profile),
            elapsed_s=0.0,
            line_speed_kmh=profile.line_speed_kmh,
            weld_position_m=profile.weld_position_m,
            chainage_m=profile.chainage_m,
            rail=profile.rail,
        )
        return changed(
            force_map,
            curve=self._curve(trajectory, surface, profile.weld_position_m),
            spread=self._spread(profile, force_map),
            elapsed_s=time.perf_counter() - began,
        )

    def _curve(
        self, trajectory: Trajectory, mapped: Surface, weld_position_m: float | UnsetType
    ) -> SpeedCurve | UnsetType:
        """The worst over the positions that count at every whole km/h and every speed of the map.

        Slower engines leave it out: advice on speed is then as fine as the map.
        """
        if not self._with_curves:
            return UNSET
        speeds, positions = np.array(self.settings.speeds_kmh), np.array(self.settings.positions_m)
        counted = counted_positions(positions, weld_position_m, self._span_m)
        between = np.setdiff1d(np.arange(np.ceil(speeds[0]), speeds[-1]), speeds)
        worst = [_worst_positions(mapped, counted, positions)]
        if len(between):
            rolled = self.rig.surface(trajectory, between, positions[counted], low_passed=True)
            worst.append(_worst_positions(rolled, np.arange(len(counted)), positions[counted]))
        all_speeds = np.concatenate([speeds, between])
        order = np.argsort(all_speeds)
        peak, least, loss, at, below_120hz, below_20hz = np.concatenate(worst, axis=1)[:, order]
        return SpeedCurve(
            speeds_kmh=all_speeds[order].tolist(),
            peak_force_n=_rounded(peak, _FORCE_DECIMALS),
            min_force_n=_rounded(least, _FORCE_DECIMALS),
            contact_loss_s=_rounded(loss, _TIME_DECIMALS),
            at_m=_rounded(at, _PLACE_DECIMALS),
            p2_force_n=_rounded(below_120hz, _FORCE_DECIMALS),
            force_20hz_n=_rounded(below_20hz, _FORCE_DECIMALS),
        )

    def _spread(self, profile: WeldProfile, force_map: ForceMap) -> Spread | UnsetType:
        if self._sampler is None:
            return UNSET
        judged = judged_part(force_map)
        return self._sampler.spread(np.array(profile.x_m), np.array(profile.z_m), judged.speeds_kmh, judged.positions_m)

    def force_history(
        self, profile: WeldProfile, speed_kmh: float, position_m: float, *, until_m: float = 0.0
    ) -> ForceHistory:
        """One passage in the space domain, a span before and after the weld, or to `until_m` if that is later."""
        history = self.rig.history(self.trajectory(profile), speed_kmh, position_m, until_m=until_m)
        every = slice(None, None, max(1, round(_HISTORY_STEP_M / (history.x_m[1] - history.x_m[0]))))
        return ForceHistory(
            weld_id=profile.weld_id,
            profile_sha256=profile.profile_sha256,
            config_sha256=self.settings.config_sha256,
            speed_kmh=speed_kmh,
            position_m=position_m,
            x_m=_rounded(history.x_m[every], _PLACE_DECIMALS),
            force_n=_rounded(history.force_n[every], _FORCE_DECIMALS),
            wheel_m=_rounded(history.wheel_m[every], _DISPLACEMENT_DECIMALS),
            rail_m=_rounded(history.rail_m[every], _DISPLACEMENT_DECIMALS),
            irregularity_m=_rounded(history.irregularity_m[every], _DISPLACEMENT_DECIMALS),
        )

    def worst_history(self, profile: WeldProfile, force_map: ForceMap) -> ForceHistory:
        """The passage that decides the verdict on `force_map`."""
        worst = find(force_map, [])
        return self.force_history(
            profile, worst.worst_speed_kmh, worst.worst_position_m, until_m=worst.worst_x_m + _AFTER_PEAK_M
        )


def measured(profile: WeldProfile) -> ProfileMeasures:
    """What a profile's geometry says by itself."""
    x_m, z_m = np.array(profile.x_m), np.array(profile.z_m)
    geometry = classify(x_m, z_m)
    return ProfileMeasures(
        kind=geometry.kind,
        dip_m=geometry.dip_m,
        protrusion_m=geometry.protrusion_m,
        gradient_rad=largest_gradient(x_m, z_m),
        straightedge_m=straightedge_gap(x_m, z_m),
        spacing_m=float(np.diff(x_m).max()),
    )


def _low_passed(surface: Surface) -> FloatArray:
    if surface.low_passed_n is None:
        raise ValueError("low-passed forces were not asked for")
    return surface.low_passed_n


def _worst_positions(surface: Surface, counted: NDArray[np.intp], positions_m: FloatArray) -> FloatArray:
    """The worst over the positions that count, (6, n_speed): the columns of a curve in their order."""
    peak = surface.peak_force_n[:, counted]
    return np.stack(
        [
            peak.max(axis=1),
            surface.min_force_n[:, counted].min(axis=1),
            surface.contact_loss_s[:, counted].max(axis=1),
            positions_m[counted][peak.argmax(axis=1)],
            *_low_passed(surface)[:, :, counted].max(axis=2),
        ]
    )


def _rounded(values: FloatArray, decimals: int) -> list[float]:
    rounded: list[float] = np.round(values, decimals).ravel().tolist()
    return rounded


class _LimitsFile(msgspec.Struct, forbid_unknown_fields=True):
    limits: list[dict[str, Any]]
    rules: Rules | UnsetType = UNSET
    gradient_norm: list[NormPoint] = []


def load_limits(path: Path | None = None) -> AssessmentSettings:
    """Limits and rules from a YAML file of the form of `data/limits/default.yaml`, which is the default.

    A bare list of limits will do: the worst position then counts, and any sampling is good enough.

    Raises:
        InputError: not readable, not of that form, or a limit for a criterion that does not exist.
    """
    source = str(path or "data/limits/default.yaml")
    remedy = "write it after data/limits/default.yaml"
    file = path or resources.files("weld_force_ros.data") / "limits" / "default.yaml"
    try:
        content = _yaml.decode(_yaml.read(file), object)
        stated = msgspec.convert(content if isinstance(content, dict) else {"limits": content}, _LimitsFile)
        limits = [_limit(row) for row in stated.limits]
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(f"limits {source}: {legible(str(error))}", remedy) from None
    for limit in limits:
        if limit.name not in CRITERIA:
            raise InputError(f"limits {source}: {limit.name!r} names no criterion", f"use {', '.join(CRITERIA)}")
    settings = AssessmentSettings(
        limits_sha256="0" * 64, limits=limits, rules=stated.rules, gradient_norm=stated.gradient_norm
    )
    settings.limits_sha256 = limits_sha256(settings)
    try:
        encode(settings)
    except MessageError as error:
        raise InputError(f"limits {source}: {error.reason}", remedy) from None
    return settings


def _limit(row: dict[str, Any]) -> Limit:
    """A limit as a file states it; messages may hold fields of later versions, files no misspelt ones."""
    unknown = row.keys() - set(Limit.__struct_fields__)
    if unknown:
        raise ValueError(f"limit {row.get('name', '')}: {', '.join(sorted(unknown))} is unknown")
    return msgspec.convert(row, Limit)


def load_uncertainty(samples: int, path: Path | None = None) -> Uncertainty | None:
    """What is not known, from a YAML file of the form of `data/uncertainty/default.yaml`, which is the default.

    Args:
        samples: how many are rolled, instead of the file's; 0: none.
        path: of the file.

    Raises:
        InputError: not readable or not of that form.
    """
    if samples == 0:
        return None
    source = str(path or "data/uncertainty/default.yaml")
    file = path or resources.files("weld_force_ros.data") / "uncertainty" / "default.yaml"
    try:
        stated = _yaml.decode(_yaml.read(file), dict[str, Any])
        unknown = stated.keys() - set(Uncertainty.__struct_fields__)
        if unknown:
            raise ValueError(f"{', '.join(sorted(unknown))} is unknown")
        return msgspec.convert({**stated, "samples": samples}, Uncertainty)
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(
            f"uncertainty {source}: {legible(str(error))}", "write it after data/uncertainty/default.yaml"
        ) from None


def judge(force_map: ForceMap, limits: AssessmentSettings) -> Verdict:
    """The verdict on a force map.

    Raises:
        InputError: no limit holds for a line of that speed.
    """
    rules = WORST_POSITION if isinstance(limits.rules, UnsetType) else limits.rules
    found = find(force_map, limits.limits, rules, limits.gradient_norm)
    if not found.criteria:
        raise InputError(
            f"no limit can be applied to a line of {found.judged_speed_kmh:g} km/h", "state limits for that speed"
        )
    advice = _advised(force_map, limits)
    return Verdict(
        weld_id=force_map.weld_id,
        profile_sha256=force_map.profile_sha256,
        config_sha256=force_map.config_sha256,
        limits_sha256=limits.limits_sha256,
        software=SOFTWARE,
        decision=found.decision,
        reason=found.reason,
        criteria=list(found.criteria),
        peak_force_n=found.peak_force_n,
        static_load_n=force_map.static_load_n,
        worst_speed_kmh=found.worst_speed_kmh,
        worst_position_m=found.worst_position_m,
        worst_x_m=found.worst_x_m,
        judged_speed_kmh=found.judged_speed_kmh,
        chainage_m=force_map.chainage_m,
        rail=force_map.rail,
        unjudged=list(found.unjudged),
        by_position=list(found.by_position),
        geometry_kind=UNSET if isinstance(force_map.measures, UnsetType) else force_map.measures.kind,
        curve_class="hollow" if advice.hollows else "rises",
        maxima_kmh=list(advice.maxima_kmh),
        hollows=list(advice.hollows),
        permitted_speed_kmh=UNSET if advice.permitted_kmh is None else advice.permitted_kmh,
        avoid=list(advice.avoid),
        restrictions=list(advice.restrictions),
        advice=list(advice.words),
        advice_step_kmh=advice.step_kmh,
        samples=len(force_map.spread.support_factor) if isinstance(force_map.spread, Spread) else 0,
    )


def _advised(force_map: ForceMap, limits: AssessmentSettings) -> Advice:
    """Advice on speed from the curve, or as fine as the map where it has none."""
    if isinstance(force_map.curve, SpeedCurve):
        speeds = np.array(force_map.curve.speeds_kmh)
        line_kmh = force_map.line_speed_kmh if isinstance(force_map.line_speed_kmh, float) else float(speeds[-1])
        count = max(1, int(np.sum(speeds <= line_kmh * (1 + 1e-9))))
        rolled = passages(force_map.curve, force_map.static_load_n, (len(speeds),), slice(count))
        return advise(speeds[:count], rolled, limits.limits)
    judged = judged_part(force_map)
    return advise(judged.speeds_kmh, _over_positions(judged.passages), limits.limits)


def _over_positions(at: Passages) -> Passages:
    return Passages(
        at.static_n,
        at.peak_n.max(axis=1),
        at.min_n.min(axis=1),
        at.contact_loss_s.max(axis=1),
        None if at.p2_n is None else at.p2_n.max(axis=1),
        None if at.below_20hz_n is None else at.below_20hz_n.max(axis=1),
    )


def assess(profile: WeldProfile, simulator: Simulator, limits: AssessmentSettings) -> Assessment:
    """From a profile to its verdict."""
    force_map = simulator.force_map(profile)
    return Assessment(force_map, simulator.worst_history(profile, force_map), judge(force_map, limits))
