"""A track by name, file or parts."""

from pathlib import Path
from typing import Any, Self

import numpy as np
import xarray as xr
import yaml
from numpy.typing import ArrayLike

from weld_force_ros._files import write_whole
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.library.fits import announce
from weld_force_ros.library.notebook import table
from weld_force_ros.physics.track.beam import pinned_pinned_hz
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.receptances import EXACT, point_receptance
from weld_force_ros.simulation.settings import DEFAULT_TRACK

_FREQUENCY = {"units": "Hz", "long_name": "frequency"}
_AT = {"units": "m", "long_name": "place after a sleeper"}
_DEFAULT_WHEEL = {"mass_kg": 600.0, "static_load_kn": 100.0, "radius_m": 0.45, "hertz_gn_per_m15": 93.7}


class Track:
    """A rail on its supports, and the wheel that runs on it where no vehicle is named.

    Args:
        name_or_path: a bundled track (`Track.bundled()`), or the path of a track file (YAML).

    Raises:
        TrackError: there is no such track, or the file does not describe one.

    Examples:
        >>> import weld_force_ros as wf
        >>> track = wf.Track("bilbao-viscous")
        >>> track.spacing_m
        0.6
    """

    def __init__(self, name_or_path: str | Path = DEFAULT_TRACK) -> None:
        self.definition = track_file.load(str(name_or_path))

    @classmethod
    def from_parts(
        cls,
        *,
        pad_stiffness_n_per_m: float,
        ballast_stiffness_n_per_m: float,
        half_sleeper_mass_kg: float,
        pad_damping_ns_per_m: float = 0.0,
        pad_loss_factor: float = 0.0,
        ballast_damping_ns_per_m: float = 0.0,
        ballast_loss_factor: float = 0.0,
        rail: str = "60E1",
        spacing_m: float = 0.6,
        name: str = "own track",
    ) -> Self:
        """Make a track of a rail, pads, sleepers and ballast; per rail, so half a sleeper and what is below it.

        A model fits it once for simulation in time, which takes some ten seconds, and keeps the fit on this machine.
        Its wheel is that of the bundled track `bilbao` (600 kg, 100 kN); name a vehicle for another. What has more
        layers than these is written in a track file, see `bilbao.yaml`.

        Args:
            pad_stiffness_n_per_m: of a rail pad, N/m.
            ballast_stiffness_n_per_m: below half a sleeper, N/m.
            half_sleeper_mass_kg: kg.
            pad_damping_ns_per_m: viscous, N s/m. Each layer needs this or a loss factor.
            pad_loss_factor: of hysteretic damping.
            ballast_damping_ns_per_m: viscous, N s/m.
            ballast_loss_factor: of hysteretic damping.
            rail: name of a bundled cross-section, such as 60E1 or CHN60.
            spacing_m: of the sleepers, m.
            name: of the track, as results give it.

        Raises:
            TrackError: a number out of its range, or a layer without damping.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Track.from_parts(
            ...     pad_stiffness_n_per_m=120e6, pad_damping_ns_per_m=50e3, half_sleeper_mass_kg=150.0,
            ...     ballast_stiffness_n_per_m=60e6, ballast_damping_ns_per_m=80e3, rail="54E1", name="branch line",
            ... )
            Track('branch line', spacing_m=0.6)
        """
        pad = _spring(pad_stiffness_n_per_m, pad_damping_ns_per_m, pad_loss_factor)
        ballast = _spring(ballast_stiffness_n_per_m, ballast_damping_ns_per_m, ballast_loss_factor)
        supports = {"kind": "periodic", "spacing_m": float(spacing_m), "pad": pad}
        supports |= {"half_sleeper_mass_kg": float(half_sleeper_mass_kg), "ballast": ballast}
        document = {"name": name, "rail": {"section": rail}, "supports": supports, "wheel": _DEFAULT_WHEEL}
        made = cls.__new__(cls)
        made.definition = track_file.parse(yaml.safe_dump(document, sort_keys=False), name)
        return made

    @staticmethod
    def bundled() -> list[str]:
        """Return the names of the tracks that come with the package.

        Examples:
            >>> import weld_force_ros as wf
            >>> "johansson-nielsen" in wf.Track.bundled()
            True
        """
        return track_file.shipped()

    @property
    def name(self) -> str:
        """Return the track's name, as results give it.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Track("bilbao").name
            'bilbao'
        """
        return self.definition.track.name

    @property
    def spacing_m(self) -> float:
        """Return the sleeper spacing in m.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Track("johansson-nielsen").spacing_m
            0.65
        """
        return self.definition.track.spacing_m

    @property
    def pinned_pinned_hz(self) -> float:
        """Return the first pinned-pinned frequency in Hz: half a bending wave between fixed sleepers.

        Examples:
            >>> import weld_force_ros as wf
            >>> round(wf.Track("bilbao").pinned_pinned_hz)
            1068
        """
        return pinned_pinned_hz(self.definition.track)

    def receptance(self, frequency_hz: ArrayLike, at_m: ArrayLike = 0.0, *, engine: str = EXACT) -> xr.DataArray:
        """Return the point receptance of the rail: displacement per force, complex, m/N.

        Args:
            frequency_hz: (n_frequency,) or scalar, positive, Hz.
            at_m: (n_at,) or scalar, m after a sleeper.
            engine: `exact`; or `common-poles` or `rfp`, as they fit the track.

        Returns:
            Dimensions `at_m` and `frequency_hz`; a scalar is a coordinate without a dimension.

        Raises:
            InputError: a frequency that is not positive, or an engine without receptances.

        Examples:
            >>> import weld_force_ros as wf
            >>> h = wf.Track("bilbao").receptance([100.0, 1000.0], at_m=[0.0, 0.3])
            >>> h.dims, h.attrs["units"]
            (('at_m', 'frequency_hz'), 'm/N')
            >>> f"{abs(h.sel(at_m=0.3, frequency_hz=1000.0)).item():.1e}"
            '1.5e-09'
        """
        found = point_receptance(self.definition, frequency_hz, at_m, engine=engine, on_fit=announce)
        array = xr.DataArray(
            found,
            dims=("at_m", "frequency_hz"),
            coords={
                "at_m": ("at_m", np.atleast_1d(at_m), _AT),
                "frequency_hz": ("frequency_hz", np.atleast_1d(frequency_hz), _FREQUENCY),
            },
            name="receptance",
            attrs={"units": "m/N", "long_name": "receptance", "track": self.name, "engine": engine},
        )
        scalars = {"at_m": np.ndim(at_m) == 0, "frequency_hz": np.ndim(frequency_hz) == 0}
        return array.squeeze([name for name, is_scalar in scalars.items() if is_scalar])

    def save(self, path: str | Path) -> None:
        """Write the track file, for `--track` of the command line and the parameter `track` of the nodes.

        Args:
            path: of the file, ending in .yaml.

        Raises:
            InputError: the ending is another, or the file cannot be written.

        Examples:
            >>> import tempfile, pathlib
            >>> import weld_force_ros as wf
            >>> with tempfile.TemporaryDirectory() as folder:
            ...     file = pathlib.Path(folder) / "mine.yaml"
            ...     wf.Track("bilbao").save(file)
            ...     wf.Track(file)
            Track('bilbao', spacing_m=0.6)
        """
        target = Path(path)
        if target.suffix.lower() not in (".yaml", ".yml"):
            raise InputError(f"track file {target}: no ending .yaml", "name a .yaml file")
        with os_errors_as(InputError, target, "name a file in a writable folder"):
            write_whole(target, self.definition.text.encode())

    def __repr__(self) -> str:
        return f"Track({self.name!r}, spacing_m={self.spacing_m:g})"

    def _repr_html_(self) -> str:
        track, wheel = self.definition.track, self.definition.wheel
        rail = track.rail
        facts = {
            "what": self.definition.description.strip() or None,
            "supports": "continuous" if track.continuous else f"every {track.spacing_m:g} m",
            "rail": f"{rail.mass_kg_per_m:g} kg/m, {rail.area_m2 * 1e4:g} cm², {rail.second_moment_m4 * 1e8:g} cm⁴",
            "pad": f"{track.support.pad.stiffness_n_per_m / 1e6:g} kN/mm",
            "wheel": f"{wheel.static_load_n / 1e3:g} kN, {wheel.mass_kg:g} kg unsprung, radius {wheel.radius_m:g} m",
        }
        return table(f"Track {self.name}", facts)


def _spring(stiffness_n_per_m: float, damping_ns_per_m: float, loss_factor: float) -> dict[str, Any]:
    given = {
        "stiffness_kn_per_mm": stiffness_n_per_m / 1e6,
        "damping_kns_per_m": damping_ns_per_m / 1e3,
        "loss_factor": loss_factor,
    }
    return {name: float(value) for name, value in given.items() if value}
