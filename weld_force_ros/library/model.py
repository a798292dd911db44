"""A vehicle on a track, which is simulated."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from numbers import Integral
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.library import datasets
from weld_force_ros.library.fits import announce
from weld_force_ros.library.last_few import LastFew
from weld_force_ros.library.notebook import table
from weld_force_ros.library.profile import Profile
from weld_force_ros.library.track import Track
from weld_force_ros.library.vehicle import Vehicle
from weld_force_ros.messages import SimulationSettings
from weld_force_ros.simulation.running import DIRECTIONS
from weld_force_ros.simulation.settings import (
    DEFAULT_POSITIONS,
    DEFAULT_RUNNING,
    DEFAULT_TRACK,
    load_uncertainty,
    simulation_settings,
)
from weld_force_ros.simulation.simulator import Simulator

POSITIONS = int(DEFAULT_POSITIONS)
_AT_ONCE = 32  # welds that share the SIMD lanes
_MOST_KEPT = 8  # simulators, of as many grids


class Model:
    """A vehicle on a track: simulates its wheel over welds.

    Args:
        track: a Track, a bundled track's name or the path of a track file.
        vehicle: a Vehicle, a bundled vehicle's name or the path of a vehicle file; the track's own wheel if not given.
        engine: how the track is represented in time: `common-poles` (default, for everyday use), `rfp` (the paper's
            rational fractions) or `reference` (the exact track by Green's functions, a thousand times slower).
        running: how trains run over welds that do not state it: `with` rising x, `against` it, or `both`.
        rolling: `circle`: the wheel's circle rolls over the rail and bridges what is sharper; `none`: it does not.
        contact_patch: `on`: heights are averaged over the contact patch; `off`: not, as in the paper's studies.
        support: supports that differ from the track's at welds that do not state them, such as `0=0.02`: the sleeper
            before the weld hangs.
        crown_radius_m: transverse radius of the rail head, from which the Hertz constant follows; m.
        threads: that compute; one a core if not given.

    Raises:
        InputError: anything that cannot be simulated; says what to give instead.

    Examples:
        >>> import weld_force_ros as wf
        >>> wf.Model("bilbao-causal", "passenger")
        Model('bilbao-causal', 'passenger', engine='common-poles', running='both')
    """

    def __init__(
        self,
        track: Track | str = DEFAULT_TRACK,
        vehicle: Vehicle | str | None = None,
        *,
        engine: str = "common-poles",
        running: str = DEFAULT_RUNNING,
        rolling: str = "circle",
        contact_patch: str = "on",
        support: str = "",
        crown_radius_m: float | None = None,
        threads: int | None = None,
    ) -> None:
        self.track = track if isinstance(track, Track) else Track(track)
        self.vehicle = vehicle if isinstance(vehicle, Vehicle) or vehicle is None else Vehicle(vehicle)
        self.engine, self.running, self.threads = engine, running, threads
        self._options = {
            "engine": engine, "running": running, "rolling": rolling, "contact_patch": contact_patch,
            "support": support,
        }  # fmt: skip
        self._crown_radius_m = crown_radius_m
        self._simulators = LastFew[Simulator](_MOST_KEPT)
        self.settings()

    def settings(
        self,
        speeds_kmh: ArrayLike | None = None,
        positions: int | Sequence[float] = POSITIONS,
        *,
        uncertainty_samples: int = 0,
    ) -> SimulationSettings:
        """Return all that a force map depends on beside the profile, as recordings hold it.

        Args:
            speeds_kmh: as of `force_map`.
            positions: as of `force_map`.
            uncertainty_samples: as of `force_map`.

        Raises:
            InputError: speeds or positions that do not increase, or too many.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Model("bilbao-causal").settings([80, 120], positions=2).positions_m
            [0.0, 0.3]
        """
        speeds = None if speeds_kmh is None else np.atleast_1d(np.asarray(speeds_kmh, dtype=np.float64)).tolist()
        steps: Any = int(positions) if isinstance(positions, Integral) else np.atleast_1d(positions).tolist()
        if isinstance(steps, int) and steps < 1:
            raise InputError(f"positions is {steps}", "give how many steps over the span, or metres after the sleeper")
        options: dict[str, Any] = self._options
        return simulation_settings(
            track=self.track.definition,
            vehicle=None if self.vehicle is None else self.vehicle.definition,
            speeds_kmh=speeds,
            positions=steps,
            crown_radius_m=self._crown_radius_m,
            uncertainty=load_uncertainty(uncertainty_samples),
            **options,
        )

    def force_map(
        self,
        profile: Profile,
        speeds_kmh: ArrayLike | None = None,
        positions: int | Sequence[float] = POSITIONS,
        *,
        uncertainty_samples: int = 0,
    ) -> xr.Dataset:
        """Compute the forces over a weld at every speed, every position in the sleeper span, in each direction.

        Args:
            profile: the weld.
            speeds_kmh: (n_speed,), increasing; 20 to 300 in steps of 5 if not given.
            positions: a number of equal steps over the span, or the weld's centre after the sleeper, m, increasing.
            uncertainty_samples: Monte-Carlo samples of what is uncertain: noise, support, contact and wheel.

        Returns:
            Dimensions `speed_kmh`, `position_m` and `running`; variables `peak_force_n`, `peak_x_m`, `min_force_n`,
            `contact_loss_s`, `p2_force_n` (below 120 Hz) and `force_20hz_n`. With samples, `sampled_peak_force_n` and
            so on over `sample` and `judged_position_m`: the worst over speeds up to the line's. Attributes hold the
            provenance, `model_error` among it: the relative error of the force's dynamic part by fitting the track.

        Raises:
            InputError: speeds or positions that do not increase, or a weld's position beyond the sleeper span.
            NumericalError: a passage did not stay finite.

        Examples:
            >>> import weld_force_ros as wf
            >>> force_map = wf.Model("bilbao-causal").force_map(wf.read_profile("weld-1-dip"), [80, 120], positions=2)
            >>> dict(force_map.sizes)
            {'speed_kmh': 2, 'position_m': 2, 'running': 2}
            >>> f"{float(force_map.peak_force_n.max()) / 1e3:.0f} kN"
            '159 kN'
        """
        settings = self.settings(speeds_kmh, positions, uncertainty_samples=uncertainty_samples)
        return datasets.of_force_map(self._simulator(settings).force_map(profile.message), settings)

    def force_maps(
        self,
        profiles: Iterable[Profile],
        speeds_kmh: ArrayLike | None = None,
        positions: int | Sequence[float] = POSITIONS,
    ) -> Iterator[xr.Dataset]:
        """Yield the force map of each of many welds, in their order: faster than one by one.

        Args:
            profiles: the welds.
            speeds_kmh: as of `force_map`.
            positions: as of `force_map`.

        Raises:
            InputError: as `force_map`.
            NumericalError: a passage over one of them did not stay finite.

        Examples:
            >>> import weld_force_ros as wf
            >>> welds = wf.read_profiles(["weld-1", "weld-4"])
            >>> maps = wf.Model("bilbao-causal").force_maps(welds, [80, 120], positions=1)
            >>> [f"{force_map.weld_id} {float(force_map.peak_force_n.max()) / 1e3:.0f} kN" for force_map in maps]
            ['weld-1 113 kN', 'weld-4 129 kN']
        """
        settings = self.settings(speeds_kmh, positions)
        simulator = self._simulator(settings)
        remaining = iter(profiles)
        while welds := list(itertools.islice(remaining, _AT_ONCE)):
            for force_map in simulator.force_maps([weld.message for weld in welds]):
                yield datasets.of_force_map(force_map, settings)

    def force_curve(
        self,
        profile: Profile,
        speeds_kmh: ArrayLike | None = None,
        positions: int | Sequence[float] = POSITIONS,
    ) -> xr.Dataset:
        """Compute the worst force over a weld against speed: over both directions, and positions where its own is open.

        Args:
            profile: the weld.
            speeds_kmh: of the map below it, as of `force_map`; the engine `common-poles` adds every whole km/h between.
            positions: as of `force_map`.

        Returns:
            Dimension `speed_kmh`; variables as of `force_map`, and `worst_position_m` and `worst_running` of the peak.

        Raises:
            InputError: as `force_map`.
            NumericalError: a passage did not stay finite.

        Examples:
            >>> import weld_force_ros as wf
            >>> curve = wf.Model("bilbao-causal").force_curve(wf.read_profile("cosine-dip-48mm"), [45, 60], positions=2)
            >>> int(curve.peak_force_n.idxmax())
            52
        """
        settings = self.settings(speeds_kmh, positions)
        return datasets.of_curve(self._simulator(settings).force_map(profile.message), settings)

    def passage(
        self, profile: Profile, speed_kmh: float, position_m: float | None = None, *, running: str = "with"
    ) -> xr.Dataset:
        """Compute one passage of the wheel over a weld, along the rail.

        Args:
            profile: the weld.
            speed_kmh: of the wheel.
            position_m: the weld's centre after the sleeper, m; the profile's own if not given.
            running: `with` rising x, or `against` it.

        Returns:
            Dimension `x_m`, m from the sleeper before the weld, every millimetre; variables `force_n`, `wheel_m`,
            `rail_m` and `irregularity_m`, displacements positive up.

        Raises:
            InputError: no position, or a direction that does not exist.
            NumericalError: the passage did not stay finite.

        Examples:
            >>> import weld_force_ros as wf
            >>> passage = wf.Model("bilbao-causal").passage(wf.read_profile("weld-1-dip"), 120, 0.3)
            >>> f"{float(passage.force_n.max()) / 1e3:.0f} kN at {float(passage.force_n.idxmax()):.2f} m"
            '159 kN at 0.35 m'
        """
        at_m = profile.weld_position_m if position_m is None else position_m
        if at_m is None:
            raise InputError(f"{profile.weld_id}: its position in the span is not known", "give position_m")
        if running not in DIRECTIONS:
            raise InputError(f"running {running!r} is not one direction", f"use {' or '.join(DIRECTIONS)}")
        settings = self.settings()
        simulator = self._simulator(settings)
        history = simulator.force_history(profile.message, float(speed_kmh), float(at_m), running=running)
        return datasets.of_history(history, settings)

    def _simulator(self, settings: SimulationSettings) -> Simulator:
        """Return what simulates by settings; kept, as making one loads the track's fit."""
        return self._simulators.get(
            settings.config_sha256, lambda: Simulator(settings, on_fit=announce, threads=self.threads)
        )

    def __repr__(self) -> str:
        vehicle = "" if self.vehicle is None else f"{self.vehicle.name!r}, "
        return f"Model({self.track.name!r}, {vehicle}engine={self.engine!r}, running={self.running!r})"

    def _repr_html_(self) -> str:
        settings = self.settings()
        facts = {
            "track": self.track.name,
            "vehicle": "the track's own wheel" if self.vehicle is None else self.vehicle.name,
            "static wheel load": f"{settings.static_load_n / 1e3:g} kN",
            "unsprung mass": f"{settings.wheel_mass_kg:g} kg",
            "Hertz constant": f"{settings.hertz_n_per_m15 / 1e9:.4g} GN/m^1.5",
            "engine": self.engine,
            "running": self.running,
        }
        return table("Model", facts)
