"""Fits on disk, looked up by the content that they depend on.

First among the shipped ones, then in the user's cache folder; else a fit is made and kept there.
"""

import contextlib
import hashlib
from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Literal, overload

import msgspec
import numpy as np
from threadpoolctl import threadpool_limits

from weld_force_ros import __version__, _files
from weld_force_ros.errors import InputError
from weld_force_ros.physics.engines import moving_fit, rational_search, window_fit, window_signs
from weld_force_ros.physics.engines.common_poles import (
    BAND_HZ,
    REPORT_BANDS,
    ErrorBand,
    PoleModel,
    default_fit,
    relative_error,
)
from weld_force_ros.physics.engines.moving_poles import MovingPoleModel
from weld_force_ros.physics.engines.rational_fractions import RfpModel
from weld_force_ros.physics.track.beam import StripRail, Track
from weld_force_ros.physics.track.causality import acausal
from weld_force_ros.physics.track.local_support import LocalSupports
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation.fit_file import AnyFit, MovingPolesFit, PolesFit, RfpFit, read, write
from weld_force_ros.simulation.track_file import TrackDefinition

# Part of every fit's key: raise it when the fit of the same track would come out differently.
FIT_VERSION = 2
_WINDOW_VERSION = 1
_SIGNS_VERSION = 1
_MOVING_VERSION = 3

FittedEngine = Literal["common-poles", "rfp"]

_DATA = resources.files("weld_force_ros.data")


class Search(msgspec.Struct, frozen=True):
    """Settings of the search for a track's rational fractions."""

    degree: int = rational_search.DEGREE
    section_count: int = rational_search.SECTIONS
    seed: int = 1
    generations: int = rational_search.GENERATIONS
    population: int = rational_search.POPULATION


class _Interrupted(msgspec.Struct):
    """A search's state between two generations."""

    key: str
    generation: int
    genes: list[list[float]]


def key_of(definition: TrackDefinition, engine: FittedEngine = "common-poles", searched: Search | None = None) -> str:
    """Return the identity of a fit: of the numbers it depends on, not of the text they came in."""
    content = [FIT_VERSION, engine, _identity(definition.track), asdict(definition.wheel)]
    if engine == "rfp":
        content.append(msgspec.to_builtins(searched or Search()))
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _identity(track: Track) -> dict[str, Any]:
    """Return what tells tracks apart, in the words of before a support was a chain: keys made then still hold."""
    fields: dict[str, Any] = asdict(track) | {"name": ""}
    if not track.pad_width_m:
        del fields["pad_width_m"]
    match track.support:
        case Support(springs=(Spring() as pad, Spring() as ballast), masses_kg=(float() as sleeper_mass_kg,)):
            del fields["support"]
            fields |= {"pad": asdict(pad), "sleeper_mass_kg": sleeper_mass_kg, "ballast": asdict(ballast)}
    return fields


@overload
def fitted(
    definition: TrackDefinition, engine: Literal["common-poles"] = ..., *, on_fit: Callable[[str], None] | None = ...
) -> PolesFit: ...


@overload
def fitted(
    definition: TrackDefinition, engine: FittedEngine, *, on_fit: Callable[[str], None] | None = ...
) -> AnyFit: ...


def fitted(
    definition: TrackDefinition,
    engine: FittedEngine = "common-poles",
    *,
    on_fit: Callable[[str], None] | None = None,
) -> AnyFit:
    """Return the fit of a track: shipped, cached, or made now and cached.

    Args:
        definition: the track and its own wheel, by which errors are weighed.
        engine: which kind of fit.
        on_fit: called with a line of text if the fit has to be made: which, and how long it takes.
    """
    name, how_long = definition.track.name, "some minutes" if engine == "rfp" else "some seconds"
    announcement = f"fitting track {name} for engine {engine}, once: {how_long}"
    return _kept(
        key_of(definition, engine), lambda: make(definition, engine), announcement, on_fit, bundled=f"{name}.{engine}"
    )


def fitted_moving(
    definition: TrackDefinition, *, on_fit: Callable[[str], None] | None = None
) -> PolesFit | MovingPolesFit:
    """Return the fit that serves a moving contact: that of `fitted` where it is good enough, else one of its own.

    Its `error` is how far peak forces are off, relative to their dynamic part.

    Raises:
        NumericalError: no usable fit was found.
    """
    if not definition.moving:
        return fitted(definition, on_fit=on_fit)
    name = definition.track.name
    fit = _kept(
        _moving_key(definition),
        lambda: make_moving(definition, fitted(definition, on_fit=on_fit)),
        f"fitting track {name} for a wheel that moves, once: some ten seconds",
        on_fit,
        bundled=f"{name}.moving-poles",
    )
    assert not isinstance(fit, RfpFit), "moving contacts are fitted by poles"  # noqa: S101
    return fit


def _moving_key(definition: TrackDefinition) -> str:
    return hashlib.sha256(msgspec.json.encode([_MOVING_VERSION, key_of(definition)])).hexdigest()


def make_moving(definition: TrackDefinition, usual: PolesFit) -> PolesFit | MovingPolesFit:
    """Fit common poles to what a moving contact finds; see `fitted_moving`."""
    with _one_blas_thread():
        model, off = moving_fit.moving_fit(definition.track, definition.wheel, usual.model())
    if isinstance(model, PoleModel):
        return msgspec.structs.replace(usual, key=_moving_key(definition), error=off)
    account = _account(definition, _moving_key(definition), model, _error_of(definition, model))
    return MovingPolesFit(
        **{**account, "error": off},
        rates_re=model.rates.real.tolist(),
        rates_im=model.rates.imag.tolist(),
        rate_changes_re=model.rate_changes.real.tolist(),
        rate_changes_im=model.rate_changes.imag.tolist(),
        strengths=model.strengths.tolist(),
        strength_changes_re=model.strength_changes.real.tolist(),
        strength_changes_im=model.strength_changes.imag.tolist(),
        series_re=model.series.real.ravel().tolist(),
        series_im=model.series.imag.ravel().tolist(),
        symmetries=model.symmetries.tolist(),
    )


def fitted_window(
    definition: TrackDefinition,
    supports: LocalSupports,
    *,
    moving: bool = False,
    on_fit: Callable[[str], None] | None = None,
) -> PolesFit:
    """Return the fit of a track near supports that differ: cached, or made now and cached; see `fitted`.

    Args:
        definition: the track and its own wheel.
        supports: those that differ.
        moving: whether signs of shapes are chosen by a load that moves, where the track can have that.
        on_fit: called with a line of text if the fit has to be made.

    Raises:
        InputError: the track or the supports have no such fit.
        NumericalError: no usable fit was found.
    """
    check_window(definition.track, supports)
    signed, name = moving and definition.moving, definition.track.name
    if signed and (measured := _found(_window_key(definition, supports, "error"), _window_name(definition, supports))):
        assert isinstance(measured, PolesFit), "windows are fitted by common poles"  # noqa: S101
        return measured
    key = _window_key(definition, supports, "signs" if signed else None)
    announcement = f"fitting track {name} with supports of its own, once: some ten seconds"
    fit = _kept(key, lambda: _make_window(definition, supports, key, signed=signed), announcement, on_fit)
    assert isinstance(fit, PolesFit), "windows are fitted by common poles"  # noqa: S101
    return fit


def fitted_moving_window(
    definition: TrackDefinition, supports: LocalSupports, *, on_fit: Callable[[str], None] | None = None
) -> PolesFit:
    """Return the fit of a window that serves a moving contact: bundled, cached, or made now and cached.

    Its `error` is how far peak forces are off, relative to their dynamic part, where the track can have such a fit.

    Raises:
        InputError: the track or the supports have no such fit.
        NumericalError: no usable fit was found.
    """
    check_window(definition.track, supports)
    if not definition.moving:
        return fitted_window(definition, supports, on_fit=on_fit)
    key, track, wheel = _window_key(definition, supports, "error"), definition.track, definition.wheel

    def make_fit() -> PolesFit:
        fit = fitted_window(definition, supports, moving=True, on_fit=on_fit)
        with _one_blas_thread():
            off = moving_fit.peaks_off(fit.model(), track, wheel, supports)
        return msgspec.structs.replace(fit, key=key, error=off)

    announcement = f"comparing track {track.name} with supports of its own with the reference, once: half a minute"
    fit = _kept(key, make_fit, announcement, on_fit, bundled=_window_name(definition, supports))
    assert isinstance(fit, PolesFit), "windows are fitted by common poles"  # noqa: S101
    return fit


def _window_name(definition: TrackDefinition, supports: LocalSupports) -> str:
    sleepers = ", ".join(f"{change.sleeper} x {change.below:g}" for change in supports.changes)
    return f"{definition.track.name}, sleepers {sleepers}.moving-poles"


def _window_key(
    definition: TrackDefinition, supports: LocalSupports, by_moving: Literal["signs", "error"] | None
) -> str:
    """Return the identity of a window's fit: without, with the signs, and with the error too of a moving contact."""
    content = [_WINDOW_VERSION, key_of(definition), asdict(supports)]
    if by_moving is not None:
        content.append([_SIGNS_VERSION, by_moving])
    return hashlib.sha256(msgspec.json.encode(content, order="sorted")).hexdigest()


def _kept(
    key: str,
    make_fit: Callable[[], AnyFit],
    announcement: str,
    on_fit: Callable[[str], None] | None,
    *,
    bundled: str | None = None,
) -> AnyFit:
    """Return the fit of that key: bundled, from the user's cache, or made now, announced, and kept there."""
    if (found := _found(key, bundled)) is not None:
        return found
    if on_fit:
        on_fit(announcement)
    fit = make_fit()
    keep(fit)
    return fit


def _found(key: str, bundled: str | None) -> AnyFit | None:
    """Return the fit of that key, bundled under a name or from the user's cache, if there is one."""
    if bundled is not None and (found := read(_DATA / "fits" / f"{bundled}.json", key)) is not None:
        return found
    return read(_files.cache_folder("fits") / f"{key}.json", key)


def check_window(track: Track, supports: LocalSupports) -> None:
    """Raise an InputError where supports that differ cannot be told, or a gap by a linear model."""
    check_local_supports(track)
    if supports.hanging:
        raise InputError(
            "a sleeper over a gap is not linear: engine common-poles cannot have it",
            "use --engine reference, or bound it: SLEEPER=0 hangs free, SLEEPER=1 always rests",
        )


def check_local_supports(track: Track) -> None:
    """Raise an InputError where a track has no single supports to change."""
    if track.continuous:
        raise InputError(
            f"track {track.name} is supported continuously: no single support can differ", "use a track on sleepers"
        )
    if isinstance(track.rail, StripRail):
        raise InputError(
            f"track {track.name}: supports that differ need a rail that is a beam", "write `model: timoshenko`"
        )


def keep(fit: AnyFit) -> None:
    """Put a fit into the user's cache."""
    with contextlib.suppress(OSError):  # a read-only home costs time at the next start, nothing else
        write(fit, _files.cache_folder("fits") / f"{fit.key}.json")


def make(definition: TrackDefinition, engine: FittedEngine = "common-poles") -> AnyFit:
    """Fit a track now.

    Raises:
        InputError: the search for rational fractions needs a package that is missing.
        NumericalError: no usable fit was found.
    """
    return make_rfp(definition) if engine == "rfp" else make_poles(definition)


def make_poles(definition: TrackDefinition) -> PolesFit:
    """Fit common poles to a track."""
    with _one_blas_thread():
        model = default_fit(definition.track, definition.wheel.compliance)
    return _poles_fit(definition, key_of(definition), model, _error_of(definition, model))


def _make_window(definition: TrackDefinition, supports: LocalSupports, key: str, *, signed: bool) -> PolesFit:
    """Fit common poles to a track near supports that differ."""
    track, wheel = definition.track, definition.wheel
    with _one_blas_thread():
        model = window_fit.window_fit(track, supports, wheel.compliance)
        if signed:
            model = window_signs.with_signs(model, track, supports, wheel)
    return _poles_fit(
        definition, key, model, partial(window_fit.window_error, model, track, supports, wheel.compliance)
    )


def _one_blas_thread() -> threadpool_limits:
    """Return a context for many small factorisations, which a second thread slows many times on a busy machine."""
    return threadpool_limits(limits=1, user_api="blas")


def _poles_fit(
    definition: TrackDefinition, key: str, model: PoleModel, error: Callable[[ErrorBand], float]
) -> PolesFit:
    return PolesFit(
        **_account(definition, key, model, error),
        section_m=model.section_m.tolist(),
        poles_re_rad_s=model.poles_rad_s.real.tolist(),
        poles_im_rad_s=model.poles_rad_s.imag.tolist(),
        residues_re=model.residues.real.ravel().tolist(),
        residues_im=model.residues.imag.ravel().tolist(),
        spans=model.spans,
        image_m=model.image_m,
        node_poles=[pole for pole, _ in model.nodes],
        node_m=[at_m for _, at_m in model.nodes],
    )


def make_rfp(
    definition: TrackDefinition,
    searched: Search | None = None,
    *,
    on_generation: Callable[[rational_search.Progress], None] | None = None,
) -> RfpFit:
    """Search rational fractions of a track; what an interrupted search had reached is taken up from the cache.

    Raises:
        InputError: a degree or section count out of range, or pymoo is missing.
        NumericalError: no fit found that is stable and bounded.
    """
    how = searched or Search()
    key = key_of(definition, "rfp", how)
    task = rational_search.FitTask(
        definition.track, definition.wheel, degree=how.degree, section_count=how.section_count
    )
    state_file = _files.cache_folder("fits") / f"search-{key}.json"

    def note(progress: rational_search.Progress) -> None:
        now = progress.population
        with contextlib.suppress(OSError):
            _files.write_whole(
                state_file, msgspec.json.encode(_Interrupted(key, now.generation, now.decision_vectors.tolist()))
            )
        if on_generation:
            on_generation(progress)

    front = rational_search.search(
        task,
        seed=how.seed,
        population=how.population,
        generations=how.generations,
        on_generation=note,
        resume_from=_interrupted(state_file, key),
    )
    with contextlib.suppress(OSError):
        state_file.unlink(missing_ok=True)
    genes = front.decision_vectors[front.chosen]
    model = task.fit_at(genes)
    poles = model.poles()
    return RfpFit(
        **_account(definition, key, model, _error_of(definition, model)),
        **{name: getattr(how, name) for name in ("seed", "generations", "population")},
        section_count=len(model.denominator),
        scale_rad_s=model.scale_rad_s,
        denominator=model.denominator.ravel().tolist(),
        numerator=model.numerator.ravel().tolist(),
        poles_re_rad_s=poles.real.ravel().tolist(),
        poles_im_rad_s=poles.imag.ravel().tolist(),
        genes=genes.tolist(),
        front_error=front.error.tolist(),
        front_variation=front.variation.tolist(),
        knee=front.chosen,
        plain_error=front.unweighted[0],
        plain_variation=front.unweighted[1],
    )


def _interrupted(file: Path, key: str) -> rational_search.Population | None:
    try:
        state = msgspec.json.decode(file.read_bytes(), type=_Interrupted)
    except (OSError, msgspec.DecodeError):
        return None
    return rational_search.Population(state.generation, np.array(state.genes)) if state.key == key else None


def _error_of(
    definition: TrackDefinition, model: PoleModel | MovingPoleModel | RfpModel
) -> Callable[[ErrorBand], float]:
    return partial(relative_error, model, definition.track, definition.wheel.compliance)


def _account(
    definition: TrackDefinition,
    key: str,
    model: PoleModel | MovingPoleModel | RfpModel,
    error: Callable[[ErrorBand], float],
) -> dict[str, Any]:
    """Return the fields that every fit has; `error` is that of `model` over a band."""
    track, compliance = definition.track, definition.wheel.compliance
    before = acausal(track, track.spacing_m / 2)
    return {
        "key": key,
        "track": track.name,
        "software": f"weld_force_ros {__version__}",
        "order": model.order,
        "spacing_m": model.spacing_m,
        "error": error(BAND_HZ),
        "bands_hz": [end for band in REPORT_BANDS for end in band],
        "error_by_band": [error(band) for band in REPORT_BANDS],
        "acausal_energy_share": before.energy_share,
        "acausal_floor_by_band": [before.floor(compliance, band) for band in REPORT_BANDS],
    }
