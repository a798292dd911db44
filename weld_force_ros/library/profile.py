"""A weld's profile of arrays or files."""

import warnings
from collections.abc import Callable, Iterable, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import msgspec
import numpy as np
import xarray as xr
from msgspec import UNSET
from numpy.typing import ArrayLike

from weld_force_ros.assessment.criteria import gradient_norm_rad
from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.library.notebook import table
from weld_force_ros.measurement import profile_file
from weld_force_ros.measurement.centre import chosen_centre, levelled
from weld_force_ros.measurement.instruments import InstrumentFormat, format_of
from weld_force_ros.messages import (
    MAX_MEASURED_SPACING_M,
    MAX_PROFILE_SPACING_M,
    MeasurementNoise,
    WeldProfile,
    known,
    parse_support,
    profile_problem,
    profile_sha256,
)
from weld_force_ros.physics.analysis.gaussian_filter import smoothed
from weld_force_ros.physics.analysis.geometry import inclinations
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.profile_measures import profile_measures
from weld_force_ros.simulation.running import mirror_image

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_DECIMALS = 12  # of m, as files are read
_ARRAYS = "arrays"
_REMEDIES = (  # by what `profile_problem` says
    ("heights", "give a height for each position"),
    ("finite", "leave out samples without a number"),
    ("increase", "sort the samples by x_m"),
    ("are needed", "give the whole weld, at a spacing of 10 mm or finer"),
    ("", "give x_m and z_m in metres, samples at most 10 mm apart"),
)


class Profile:
    """A weld's profile: the height of the rail's running surface along it, about the weld's centre.

    Heights of arrays are taken as they are, as the rail's geometry; where they are measured with noise, say so with
    `noise`. Beyond the profile the rail is level at height 0, and is joined to it without a step.

    Args:
        x_m: (n,), m along the rail, increasing; 20 samples or more, at most 10 mm apart.
        z_m: (n,), m, positive up.
        weld_id: its name.
        centre_m: the weld's centre in `x_m`; if not given, the arrays' own zero where it lies well inside them, else
            the defect.
        noise: `none`; `auto`: estimated and taken out, as of files; or its standard deviation in m.
        line_speed_kmh: the line's speed: the weld is judged up to it.
        weld_position_m: the weld's centre after the preceding sleeper, m; unknown if not given, and any may be it.
        running: how trains run: `with` rising x, `against` it or `both`; as the model says if not given.
        chainage_m: of the weld, m.
        rail: which rail, such as left.
        support: supports that differ from the track's: `0=0.02` lets the sleeper before the weld hang.
        instrument: that measured.
        measured_on: date, as text.

    Raises:
        ProfileError: the arrays are not those of a weld; says which sample and what to do.

    Examples:
        >>> import numpy as np
        >>> import weld_force_ros as wf
        >>> x = np.linspace(-0.5, 0.5, 201)
        >>> profile = wf.Profile(x, -2e-4 * np.exp(-((x / 0.05) ** 2)), weld_id="dip", line_speed_kmh=160)
        >>> profile
        <Profile 'dip': 201 samples over 1 m, -0.20 to 0.00 mm, line 160 km/h>
    """

    def __init__(
        self,
        x_m: ArrayLike,
        z_m: ArrayLike,
        *,
        weld_id: str = "weld",
        centre_m: float | None = None,
        noise: str | float = "none",
        line_speed_kmh: float | None = None,
        weld_position_m: float | None = None,
        running: str | None = None,
        chainage_m: float | None = None,
        rail: str | None = None,
        support: str | None = None,
        instrument: str | None = None,
        measured_on: str | None = None,
    ) -> None:
        x, z = _checked(weld_id, x_m, z_m, MAX_PROFILE_SPACING_M if noise == "none" else MAX_MEASURED_SPACING_M)
        if centre_m is None:
            centre_m = chosen_centre(x, levelled(x, z))[0]
        stated = {
            "line_speed_kmh": line_speed_kmh, "weld_position_m": weld_position_m, "running": running,
            "chainage_m": chainage_m, "rail": rail, "support": support, "instrument": instrument,
            "measured_on": measured_on,
        }  # fmt: skip
        samples = WeldProfile(
            weld_id=weld_id,
            source=_ARRAYS,
            x_m=(np.round(x - centre_m, _DECIMALS) if centre_m else x).tolist(),
            z_m=z.tolist(),
            conditioning=[f"centred on x = {centre_m:.12g} m"] if centre_m else [],
            noise=MeasurementNoise(method="none", noise_m=0.0),
        )
        geometry = samples if noise == "none" else _estimated(samples, noise)
        self.message = _with_statements(geometry, stated)

    @classmethod
    def from_message(cls, message: WeldProfile) -> Self:
        """Make a profile of the message that nodes publish.

        Args:
            message: a WeldProfile of `weld_force_ros.messages`.

        Examples:
            >>> import weld_force_ros as wf
            >>> weld = wf.read_profile("weld-1-dip")
            >>> wf.Profile.from_message(weld.message).profile_sha256 == weld.profile_sha256
            True
        """
        made = cls.__new__(cls)
        made.message = message
        return made

    @property
    def weld_id(self) -> str:
        """Return the weld's name.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.read_profile("weld-1-dip").weld_id
            'weld-1-dip'
        """
        return self.message.weld_id

    @property
    def x_m(self) -> FloatArray:
        """Return positions along the rail, (n,), m, 0 at the weld's centre.

        Examples:
            >>> import weld_force_ros as wf
            >>> float(wf.read_profile("weld-1-dip").x_m[0])
            -0.5
        """
        return np.array(self.message.x_m)

    @property
    def z_m(self) -> FloatArray:
        """Return heights of the running surface, (n,), m, positive up.

        Examples:
            >>> import weld_force_ros as wf
            >>> f"{wf.read_profile('weld-1-dip').z_m.min() * 1e3:.2f} mm"
            '-0.19 mm'
        """
        return np.array(self.message.z_m)

    @property
    def line_speed_kmh(self) -> float | None:
        """Return the line's speed in km/h; None if it is not stated.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.read_profile("weld-1-dip", line_speed_kmh=160).line_speed_kmh
            160.0
        """
        return known(self.message.line_speed_kmh)

    @property
    def weld_position_m(self) -> float | None:
        """Return the weld's centre after the preceding sleeper in m; None if it is not known.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.read_profile("weld-1-dip").assign(weld_position_m=0.3).weld_position_m
            0.3
        """
        return known(self.message.weld_position_m)

    @property
    def profile_sha256(self) -> str:
        """Return the identity of the geometry, as verdicts and recordings give it.

        Examples:
            >>> import weld_force_ros as wf
            >>> len(wf.read_profile("weld-1-dip").profile_sha256)
            64
        """
        return self.message.profile_sha256

    @property
    def conditioning(self) -> list[str]:
        """Return what was done to the samples when they were read, a line each.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Profile([0.01 * i for i in range(101)], [0.0] * 101).conditioning
            ['centred on x = 0.5 m']
        """
        return list(self.message.conditioning)

    def assign(self, **statements: Any) -> "Profile":
        """Return the same geometry with other statements: any keyword of `Profile` after `noise`, and `weld_id`.

        Args:
            statements: None takes one back.

        Raises:
            ProfileError: there is no such statement, or its value cannot be.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.read_profile("weld-1-dip").assign(line_speed_kmh=120, running="with").line_speed_kmh
            120.0
        """
        return Profile.from_message(_with_statements(self.message, statements))

    def reversed(self) -> "Profile":
        """Return the weld turned round about its centre: what trains meet that run the other way.

        Where a few supports are stated, they are turned with it; all other statements stay.

        Examples:
            >>> import weld_force_ros as wf
            >>> weld = wf.read_profile("weld-4-steep-ramp")
            >>> bool((weld.reversed().z_m == weld.z_m[::-1]).all())
            True
        """
        turned = mirror_image(self.message)
        return Profile.from_message(
            msgspec.structs.replace(
                turned,
                profile_sha256=profile_sha256(turned.x_m, turned.z_m),
                profile_id=UNSET,
                source_sha256=UNSET,
                conditioning=_also(turned.conditioning, "turned round about the weld's centre"),
            )
        )

    def detrended(self) -> "Profile":
        """Return the profile less the line between its two ends, as files are read by default.

        Examples:
            >>> import numpy as np
            >>> import weld_force_ros as wf
            >>> x = np.linspace(-0.5, 0.5, 101)
            >>> bool(abs(wf.Profile(x, 1e-3 * x).detrended().z_m).max() < 1e-15)
            True
        """
        return self._reshaped(levelled(self.x_m, self.z_m), "line between the ends removed")

    def smoothed(self, wavelength_m: float) -> "Profile":
        """Return the profile without short waves, by the Gaussian filter of ISO 16610-21.

        Args:
            wavelength_m: the cut-off length: waves of it keep half their amplitude, of half of it 6 %, of twice 84 %.

        Raises:
            InputError: not a positive length.

        Examples:
            >>> import weld_force_ros as wf
            >>> weld = wf.read_profile("weld-1-dip")
            >>> bool(abs(weld.smoothed(0.2).z_m).max() < abs(weld.z_m).max())
            True
        """
        heights = smoothed(self.x_m, self.z_m, wavelength_m)
        return self._reshaped(heights, f"smoothed by a Gaussian filter, cut-off {wavelength_m:g} m (ISO 16610-21)")

    def gradient(self) -> xr.DataArray:
        """Return the rail's inclination along the weld, rad, as the quality index is defined.

        Over 25 mm, relative to the chord of 1 m over the weld.

        Returns:
            Dimension `x_m`, every 0.5 mm from -0.4875 to 0.4875 m.

        Examples:
            >>> import weld_force_ros as wf
            >>> slope = wf.read_profile("weld-4-steep-ramp").gradient()
            >>> f"{float(abs(slope).max()) * 1e3:.1f} mrad"
            '6.1 mrad'
        """
        places, slopes = inclinations(self.x_m, self.z_m)
        return xr.DataArray(
            slopes,
            dims="x_m",
            coords={"x_m": ("x_m", places, _ALONG)},
            name="gradient_rad",
            attrs={"units": "rad", "long_name": "inclination", **self._provenance()},
        )

    def quality_index(self, line_speed_kmh: float | None = None) -> xr.DataArray:
        """Return the quality index along the weld: its inclination over what the norm allows at the line's speed.

        The weld's index is the largest; over 1 it has to be ground. The norm is linear from 3.2 mrad at 40 km/h to
        1.0 mrad at 300 km/h (Steenbergen and Esveld); it was not checked against the standard.

        Args:
            line_speed_kmh: the profile's own if not given.

        Returns:
            Dimension `x_m`, as `gradient`.

        Raises:
            ProfileError: the line's speed is not known.

        Examples:
            >>> import weld_force_ros as wf
            >>> index = wf.read_profile("weld-4-steep-ramp").quality_index(line_speed_kmh=160)
            >>> f"{float(index.max()):.1f}"
            '2.8'
        """
        line_kmh = self.line_speed_kmh if line_speed_kmh is None else line_speed_kmh
        if line_kmh is None:
            raise ProfileError(f"{self.weld_id}: the line's speed is not known", "give line_speed_kmh")
        index = abs(self.gradient()) / gradient_norm_rad(line_kmh, [])
        return index.rename("quality_index").assign_attrs(
            units="1", long_name="quality index", line_speed_kmh=float(line_kmh), **self._provenance()
        )

    def plot(self, ax: "Axes | None" = None) -> "Axes":
        """Draw the profile by matplotlib, measured samples beside it, and return the axes.

        Args:
            ax: where to draw; the current axes if not given.

        Raises:
            InputError: matplotlib is not installed.

        Examples:
            >>> import weld_force_ros as wf
            >>> from matplotlib.figure import Figure
            >>> wf.read_profile("weld-1-dip").plot(Figure().subplots()).get_ylabel()
            'height, µm'
        """
        from weld_force_ros.report.figures import current_axes, draw_profile

        axes = current_axes() if ax is None else ax
        draw_profile(axes, self.message)
        return axes

    def __repr__(self) -> str:
        line = "" if self.line_speed_kmh is None else f", line {self.line_speed_kmh:g} km/h"
        x, z_mm = self.x_m, np.round(self.z_m * 1e3, 2) + 0.0
        return (
            f"<Profile {self.weld_id!r}: {len(x)} samples over {np.ptp(x):.4g} m, "
            f"{z_mm.min():.2f} to {z_mm.max():.2f} mm{line}>"
        )

    def _repr_html_(self) -> str:
        measures, noise = profile_measures(self.message), known(self.message.noise)
        facts = {
            "geometry": f"{measures.kind}; dip {measures.dip_m * 1e3:.2f} mm, "
            f"protrusion {measures.protrusion_m * 1e3:.2f} mm",
            "samples": f"{len(self.message.x_m)} over {np.ptp(self.x_m):.4g} m",
            "noise": f"{noise.noise_m * 1e6:.2g} µm" if noise and noise.noise_m else None,
            "line speed": None if self.line_speed_kmh is None else f"{self.line_speed_kmh:g} km/h",
            "after the sleeper": None if self.weld_position_m is None else f"{self.weld_position_m:g} m",
            "trains run": known(self.message.running),
            "chainage": known(self.message.chainage_m),
            "source": self.message.source,
        }
        return table(f"Profile {self.weld_id}", facts)

    def _provenance(self) -> dict[str, str]:
        return {"weld_id": self.weld_id, "profile_sha256": self.profile_sha256}

    def _reshaped(self, z_m: FloatArray, done: str) -> "Profile":
        """Return the profile with other heights, which are then its geometry; measured samples are left behind."""
        conditioning = _also(self.message.conditioning, done)
        return Profile.from_message(
            with_geometry(self.message, self.message.x_m, z_m.tolist(), conditioning=conditioning)
        )


_ALONG = {"units": "m", "long_name": "distance from the weld's centre"}
_STATEMENTS = (
    "weld_id", "line_speed_kmh", "weld_position_m", "running", "chainage_m", "rail", "support", "instrument",
    "measured_on",
)  # fmt: skip


def read_profile(
    name_or_path: str | PathLike[str],
    *,
    format: str | None = None,
    x_unit: str | None = None,
    z_unit: str | None = None,
    z_positive: str | None = None,
    noise: str | float | None = None,
    spacing: float | None = None,
    skip_rows: int | None = None,
    line_speed_kmh: float | None = None,
) -> Profile:
    """Read the measurement file of one weld, or a bundled profile by its name.

    Args:
        name_or_path: the file; or a bundled profile such as `weld-1-dip`.
        format: a bundled instrument format or the path of a descriptor (YAML); recognised if not given.
        x_unit: unit of positions that the file does not state: m, cm, mm or um.
        z_unit: unit of heights that the file does not state.
        z_positive: where the file does not state it: `up` if a protrusion is positive, or `down`.
        noise: `auto`: estimated and taken out (default); `none`: samples as they are; or its standard deviation in m.
        spacing: of the samples in `x_unit`, for files with heights only.
        skip_rows: lines to skip at the top.
        line_speed_kmh: where the file does not state it.

    Returns:
        The profile, with what was done to the samples in `conditioning`.

    Raises:
        ProfileError: the file cannot be read or used, or holds several welds; says where and what to do.
        InputError: an option that does not exist.

    Examples:
        >>> import weld_force_ros as wf
        >>> wf.read_profile("weld-1-dip", line_speed_kmh=160)
        <Profile 'weld-1-dip': 501 samples over 1 m, -0.19 to 0.07 mm, line 160 km/h>
    """
    form = format_of(
        format, x_unit=x_unit, z_unit=z_unit, z_positive=z_positive, noise=noise, spacing=spacing,
        skip_rows=skip_rows, line_speed_kmh=line_speed_kmh,
    )  # fmt: skip
    return Profile.from_message(profile_file.read_profile(profile_file.find(name_or_path), form))


def read_profiles(
    source: str | PathLike[str] | Iterable[str | PathLike[str]],
    *,
    on_problem: Callable[[ProfileError], None] | None = None,
    **stated: Any,
) -> list[Profile]:
    """Read all welds of a file, of the files of a folder, or of several files.

    Args:
        source: a file, a folder, or files; of a folder those inside that are finished and not hidden, by name.
        on_problem: called with the error of each file that cannot be read; the others are read all the same. If not
            given, each is a warning. To stop at the first, raise it.
        stated: as of `read_profile`.

    Returns:
        The profiles, in the order of the files and of the welds in each.

    Raises:
        InputError: an option that does not exist, or a source that is not there.

    Examples:
        >>> import weld_force_ros as wf
        >>> [weld.weld_id for weld in wf.read_profiles(["weld-1", "weld-2"])]
        ['weld-1', 'weld-2']
    """
    form = format_of(stated.pop("format", None), **stated)
    found: list[Profile] = []
    for path in _files(source):
        try:
            found += [Profile.from_message(weld) for weld in profile_file.read_profiles(path, form)]
        except ProfileError as error:
            if on_problem is not None:
                on_problem(error)
            else:
                warnings.warn(str(error), stacklevel=2)
    return found


def with_geometry(
    message: WeldProfile, x_m: Sequence[float], z_m: Sequence[float], *, conditioning: Sequence[str]
) -> WeldProfile:
    """Return a weld with other samples, taken as they are: what was measured of it, and when, is no longer its own."""
    return msgspec.structs.replace(
        message,
        x_m=list(x_m),
        z_m=list(z_m),
        profile_sha256=profile_sha256(x_m, z_m),
        profile_id=UNSET,
        source_sha256=UNSET,
        measured_x_m=UNSET,
        measured_z_m=UNSET,
        noise=MeasurementNoise(method="none", noise_m=0.0),
        conditioning=list(conditioning),
    )


def _files(source: str | PathLike[str] | Iterable[str | PathLike[str]]) -> list[Path]:
    if not isinstance(source, str | PathLike):
        return [profile_file.find(one) for one in source]
    path = Path(source)
    return profile_file.files_in(path) if path.is_dir() else [profile_file.find(source)]


def _checked(weld_id: str, x_m: ArrayLike, z_m: ArrayLike, spacing_m: float) -> tuple[FloatArray, FloatArray]:
    x, z = np.asarray(x_m, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
    if x.ndim != 1 or z.ndim != 1:
        raise ProfileError(
            f"{weld_id}: x_m of shape {x.shape} and z_m of shape {z.shape}", "give one position and one height a sample"
        )
    if problem := profile_problem(x.tolist(), z.tolist(), spacing_m=spacing_m):
        remedy = next(remedy for word, remedy in _REMEDIES if word in problem)
        raise ProfileError(f"{weld_id}: {problem}", remedy)
    return x, z


def _estimated(samples: WeldProfile, noise: str | float) -> WeldProfile:
    """Return what a file with these samples is read as, its noise taken out."""
    if isinstance(noise, str) and noise != "auto":
        raise ProfileError(f"{samples.weld_id}: noise {noise!r} cannot be read", "state auto, none, or metres: 5e-6")
    text = profile_file.samples_csv(samples, noise=noise if isinstance(noise, str) else repr(float(noise)))
    found = profile_file.parse_profile(text, samples.weld_id, InstrumentFormat())
    return msgspec.structs.replace(found, source=_ARRAYS, source_sha256=UNSET, format=UNSET)


def _with_statements(message: WeldProfile, stated: dict[str, Any]) -> WeldProfile:
    if unknown := ", ".join(sorted(stated.keys() - set(_STATEMENTS))):
        raise ProfileError(f"{message.weld_id}: {unknown} cannot be stated", f"use {', '.join(_STATEMENTS)}")
    values: dict[str, Any] = {name: UNSET if value is None else value for name, value in stated.items()}
    for name in ("line_speed_kmh", "weld_position_m", "chainage_m"):
        if values.get(name, UNSET) is not UNSET:
            values[name] = float(values[name])
    try:
        if isinstance(values.get("support"), str):
            values["support"] = parse_support(values["support"]) or UNSET
        changed = msgspec.structs.replace(message, **values)
        return msgspec.convert(msgspec.to_builtins(changed), WeldProfile)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$.")
        raise ProfileError(f"{message.weld_id}: {where.rstrip('`')}: {problem}", "correct this statement") from None
    except (InputError, ValueError) as error:
        raise ProfileError(f"{message.weld_id}: {error}", "correct this statement") from None


def _also(conditioning: list[str], done: str) -> list[str]:
    return [*conditioning, done][-50:]
