"""Study `spectrum`: frequencies of the force come from the weld, their amplitudes from the track (Figs. 5, 25, 26)."""

import numpy as np

from weld_force_ros.physics.analysis.spectra import (
    CUT_HZ,
    resonances_hz,
    spectral_peaks,
    wheelset_track_receptance,
)
from weld_force_ros.physics.arrays import ComplexArray
from weld_force_ros.physics.track import beam
from weld_force_ros.studies import passage_records
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.spectrum_figures import Excitation, dip_picture, receptance_picture, weld_pictures
from weld_force_ros.studies.study_context import (
    BILBAO,
    CONTINUOUS,
    DIP_48,
    WELDS,
    Profile,
    Quantities,
    StudyContext,
    StudyResult,
    as_rows,
)

SPEEDS_KMH = (55.0, 120.0, 145.0, 220.0)
DIP_KMH = 120.0
_FREQUENCIES_HZ = np.arange(10.0, 1500.5, 1.0)
FIG_5_POSITIONS = np.array([32, 40, 44, 52, 60]) / 60  # of the paper's Fig. 5, relative to its span of 60 cm
_SHOWN_HZ = 2000.0
_EVERY = 8  # the record's own resolution, of which the spectrum has some eight times as many
_NEAR = 0.1  # of a frequency
_SHORT_M = 0.4  # shorter wavelengths show how the peaks of the weld's spectrum move


def run(context: StudyContext) -> StudyResult:
    """Compute receptances of the track and of the wheelset on it, and spectra of the force and of the weld."""
    receptances = _receptances(context)
    weld = context.welds(WELDS[0])[0]
    excitations = [_excitation(context, weld, speed) for speed in SPEEDS_KMH]
    over_dip = [_excitation(context, DIP_48, DIP_KMH)] if context.own_weld is None else []
    wheelset = (_FREQUENCIES_HZ, np.abs(receptances["wheelset_track"][0]))
    positions_m = FIG_5_POSITIONS * context.track(BILBAO).track.spacing_m
    where = "continuous support" if context.track(CONTINUOUS).track.continuous else "over a sleeper"
    pictures = [
        receptance_picture(_FREQUENCIES_HZ, receptances, positions_m, where),
        *weld_pictures(weld, excitations, wheelset),
        *(dip_picture(DIP_48, dip, wheelset, CUT_HZ) for dip in over_dip),
    ]
    tables = {"receptance": _receptance_table(receptances), "spectra": _spectra_table([*excitations, *over_dip])}
    measured = _claim_quantities(context, receptances, excitations, over_dip[0]) if context.uses_paper_inputs else {}
    return StudyResult("spectrum", "Wavelengths and resonances", pictures, tables, measured)


def _receptances(context: StudyContext) -> dict[str, ComplexArray]:
    """Compute receptances at the positions of Fig. 5, over the span, of the simulated track, and with the wheelset."""
    discrete, continuous = context.track(BILBAO).track, context.track(CONTINUOUS)
    span = beam.receptance(discrete, _FREQUENCIES_HZ, beam.sections(discrete, 15))
    return {
        "positions": beam.receptance(discrete, _FREQUENCIES_HZ, FIG_5_POSITIONS * discrete.spacing_m),
        "span_mean": span.mean(axis=0, keepdims=True),
        "simulated_track": beam.receptance(continuous.track, _FREQUENCIES_HZ, 0.0),
        "wheelset_track": wheelset_track_receptance(continuous.track, continuous.wheel, _FREQUENCIES_HZ, 0.0),
    }


def quantities_over_weld_1(context: StudyContext, weld: Profile) -> Quantities:
    """Return what claims ask for of weld 1, over a profile in its place."""
    return _weld_1([_excitation(context, WELDS[0], speed, weld) for speed in SPEEDS_KMH])


def _excitation(context: StudyContext, weld: str, speed_kmh: float, profile: Profile | None = None) -> Excitation:
    wheel_path = context.wheel_path(weld if profile is None else profile, CONTINUOUS)
    stride = context.stride(CONTINUOUS, speed_kmh)
    passage = passage_records.record(context.vehicle_track(CONTINUOUS), wheel_path, speed_kmh, stride)
    force, irregularity = (
        of(passage, speed_kmh) for of in (passage_records.force_spectrum, passage_records.irregularity_spectrum)
    )
    return Excitation(weld, speed_kmh, force, irregularity)


def _receptance_table(receptances: dict[str, ComplexArray]) -> Table:
    names = ("span_mean", "simulated_track", "wheelset_track")
    return Table(
        "Magnitude of receptance",
        (Column("frequency_hz", "Hz", 0), Column("span_mean_m_per_n", "mean over the span, m/N"),
         Column("simulated_track_m_per_n", "simulated track, m/N"),
         Column("wheelset_track_m_per_n", "with the wheelset, m/N")),
        as_rows(_FREQUENCIES_HZ, *(np.abs(receptances[name][0]) for name in names)),
    )  # fmt: skip


def _spectra_table(excitations: list[Excitation]) -> Table:
    columns = (
        Column("weld", "weld"), Column("speed_kmh", "km/h", 0), Column("frequency_hz", "Hz", 1),
        Column("wavelength_m", "m", 3), Column("force_n", "N", 1), Column("irregularity_m", "m"),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for excitation in excitations:
        force, irregularity = excitation.force, excitation.irregularity
        shown = slice(_EVERY - 1, int(np.searchsorted(force.frequency_hz, _SHOWN_HZ)), _EVERY)
        cells = (force.frequency_hz, force.wavelength_m, force.amplitude, irregularity.amplitude)
        rows += [(excitation.weld, excitation.speed_kmh, *row) for row in as_rows(*(c[shown] for c in cells))]
    return Table("Spectra of force and irregularity", columns, rows)


def _claim_quantities(
    context: StudyContext, receptances: dict[str, ComplexArray], excitations: list[Excitation], over_dip: Excitation
) -> Quantities:
    first, second, *_ = [*resonances_hz(_FREQUENCIES_HZ, receptances["wheelset_track"][0]), np.nan, np.nan]
    dip_first, dip_second = passage_records.first_two_hz(spectral_peaks(over_dip.force, passage_records.CLEAR))
    return {
        "spectrum.receptance_first_peak_hz": float(first),
        "spectrum.receptance_second_peak_hz": float(second),
        "spectrum.dip_48mm_first_peak_hz": dip_first,
        "spectrum.dip_48mm_second_peak_hz": dip_second,
        **_track_alone(context, receptances),
        **_weld_1(excitations),
    }


def _track_alone(context: StudyContext, receptances: dict[str, ComplexArray]) -> Quantities:
    pinned_hz = beam.pinned_pinned_hz(context.track(BILBAO).track)
    magnitude = np.abs(receptances["positions"])
    ratio = magnitude.max(axis=0) / magnitude.min(axis=0)
    near_pinned = np.abs(_FREQUENCIES_HZ / pinned_hz - 1) <= _NEAR
    largest_at_hz = _FREQUENCIES_HZ[np.argmax(ratio)]
    shared = (_FREQUENCIES_HZ >= 20) & (_FREQUENCIES_HZ <= 800)
    mean, continuous = (np.abs(receptances[name][0][shared]) for name in ("span_mean", "simulated_track"))
    return {
        "spectrum.position_ratio_pinned_pinned": float(ratio[near_pinned].max()),
        "spectrum.largest_position_ratio_over_pinned_pinned": float(largest_at_hz / pinned_hz),
        "spectrum.position_ratio_300hz": float(np.interp(300.0, _FREQUENCIES_HZ, ratio)),
        "spectrum.continuous_difference": float(np.sqrt(np.mean((continuous / mean - 1) ** 2))),
        "spectrum.rfp_error_bilbao": context.rfp_error(BILBAO),
        "spectrum.rfp_error_continuous": context.rfp_error(CONTINUOUS),
    }


def _weld_1(excitations: list[Excitation]) -> Quantities:
    at_55, at_120, at_145, at_220 = (excitation.force for excitation in excitations)
    short = [passage_records.strongest_hz(e.irregularity, e.speed_kmh / 3.6 / _SHORT_M, np.inf) for e in excitations]
    return {
        "spectrum.irregularity_speed_exponent": passage_records.exponent(SPEEDS_KMH, short),
        "spectrum.force_peak_match_share": _match_share(excitations),
        "spectrum.force_peak_55kmh_hz": passage_records.strongest_hz(at_55, 0, 150),
        "spectrum.force_peak_120kmh_hz": passage_records.strongest_hz(at_120, 0, 150),
        "spectrum.largest_peak_145kmh_hz": passage_records.strongest_hz(at_145, 0, np.inf),
        "spectrum.force_peak_220kmh_hz": passage_records.strongest_hz(at_220, 150, CUT_HZ),
    }


def _match_share(excitations: list[Excitation]) -> float:
    """Return the share of the force's large peaks that have one of the weld near them."""
    matched: list[bool] = []
    for excitation in excitations:
        weld_hz = [peak.frequency_hz for peak in spectral_peaks(excitation.irregularity, passage_records.CLEAR)]
        force_hz = [peak.frequency_hz for peak in passage_records.large_peaks(excitation.force)]
        matched += [any(abs(near / at - 1) <= _NEAR for near in weld_hz) for at in force_hz]
    return float(np.mean(matched)) if matched else float("nan")
