"""Order and mend the samples of a record: direction, repeated samples, missing values, several welds one after another.

Everything that is done to the samples is said in the record's notes. Positions and heights are exact decimals in m.
"""

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from decimal import Decimal

import numpy as np
import scipy  # loads its slow parts, such as interpolate, where they are first used

from weld_force_ros.errors import InputError, ProfileError
from weld_force_ros.measurement.weld_detection import detect
from weld_force_ros.messages import MAX_PROFILE_SPACING_M

LONGEST_GAP_M = 0.030
"""Rail without samples that is bridged by a cubic: 30 mm change a peak by less than 2 %."""
WIDEST_SPACING_M = 0.020
"""Spacing of samples between which heights are put by a cubic."""
_BESIDE_M = 0.75  # of a weld that is cut out of a long record
_RESTART_M = 0.05  # back along the rail: another record, not a sample that slipped
_STEP_BACK_M = Decimal("0.0021")
_ALL_NINES = re.compile(r"-?0*(9{2,}(\.9*|\.0*)?|9\.9{2,})")
_NINES_BEYOND = 3.0  # ranges of the other heights


@dataclass
class Sample:
    """A sample: its line in the file, position and heights of each pass in m; None where a value is missing."""

    line: int
    x: Decimal
    z: list[Decimal | None]
    texts: list[str] = field(default_factory=list)


@dataclass
class Record:
    """Samples of one weld in the order of x, and what was done to them."""

    samples: list[Sample]
    notes: list[str] = field(default_factory=list)


def divide(samples: Sequence[Sample]) -> list[list[Sample]]:
    """Return the records of a table: a new one begins where x goes back by 50 mm or more, against the way before."""
    if len(samples) < 3:
        return [list(samples)]
    rising = sum(b.x > a.x for a, b in itertools.pairwise(samples))
    sign = 1 if 2 * rising >= len(samples) - 1 else -1
    records = [[samples[0]]]
    for before, after in itertools.pairwise(samples):
        if sign * float(before.x - after.x) >= _RESTART_M:
            records.append([])
        records[-1].append(after)
    return records


def cut_into_welds(samples: Sequence[Sample]) -> list[list[Sample]]:
    """Return the samples about each weld that stands out of a long record.

    Raises:
        ProfileError: none does, or the samples are too far apart to tell.
    """
    x, z = (np.array([float(v or 0) for v in values]) for values in zip(*((s.x, s.z[0]) for s in samples), strict=True))
    length = f"{x[-1] - x[0]:.4g} m"
    try:
        welds = detect(x - x[0], z)
    except InputError:
        raise ProfileError(
            f"{length} of rail, of which 5 m can be read as one weld",
            "give the rail about each weld, or samples every 5 mm or closer without gaps, to look for welds in",
        ) from None
    if not welds:
        raise ProfileError(f"no weld stands out in {length} of rail", "cut the record to the rail about each weld")
    return [
        [s for s, at in zip(samples, x - x[0], strict=True) if abs(at - weld.centre_m) <= _BESIDE_M] for weld in welds
    ]


def ordered(samples: Sequence[Sample]) -> Record:
    """Return the samples with x increasing.

    Raises:
        ProfileError: x goes back by more than 2 mm, or goes to and fro.
    """
    record = Record(list(samples))
    steps = [b.x - a.x for a, b in itertools.pairwise(samples)]
    if steps and sum(step < 0 for step in steps) > 0.9 * len(steps):
        record.samples.reverse()
        steps = [-step for step in reversed(steps)]
        record.notes.append("x descends: turned round, so that it increases in the running direction")
    back = [i for i, step in enumerate(steps) if step < 0]
    if len(back) > max(1, len(steps) // 100) or any(-steps[i] > _STEP_BACK_M for i in back):
        first, second = record.samples[back[0]].line, record.samples[back[0] + 1].line
        raise ProfileError(
            f"x does not increase from line {first} to {second}",
            "give columns x,z with x in the running direction, without repeated or reversed samples",
        )
    if back:
        line = record.samples[back[0] + 1].line
        record.samples.sort(key=lambda sample: sample.x)
        record.notes.append(f"{_count(len(back), 'step')} back of at most 2 mm put in order, first at line {line}")
    _merge_repeated(record)
    return record


def _merge_repeated(record: Record) -> None:
    kept, repeated = list[Sample](), list[int]()
    for sample in record.samples:
        if kept and sample.x == kept[-1].x:
            same = sample.z == kept[-1].z
            if not same and _differ_much(kept[-1], sample):
                raise ProfileError(
                    f"x does not increase from line {kept[-1].line} to {sample.line}",
                    "two heights are stated for one place: remove the wrong one",
                )
            repeated.append(sample.line)
        else:
            kept.append(sample)
    if len(repeated) > max(2, len(record.samples) // 50):
        raise ProfileError(
            f"{len(repeated)} positions are repeated, the first at line {repeated[0]}", "give each position once"
        )
    if repeated:
        record.samples = kept
        record.notes.append(f"{_count(len(repeated), 'repeated position')} left out, first at line {repeated[0]}")


def _differ_much(a: Sample, b: Sample) -> bool:
    pairs = [(p, q) for p, q in zip(a.z, b.z, strict=True) if p is not None and q is not None]
    return any(abs(p - q) > Decimal("0.0001") for p, q in pairs)


def without_nines(record: Record) -> None:
    """Take numbers that are nothing but nines, far beyond all other heights, for marks of missing values."""
    if not any(_ALL_NINES.fullmatch(text) for sample in record.samples for text in sample.texts):
        return
    others = [
        float(z)
        for sample in record.samples
        for z, text in zip(sample.z, sample.texts, strict=False)
        if z is not None and not _ALL_NINES.fullmatch(text)
    ]
    if not others:
        return
    low, high = min(others), max(others)
    reach = _NINES_BEYOND * max(high - low, 1e-6)
    marks = list[str]()
    for sample in record.samples:
        for i, (z, text) in enumerate(zip(sample.z, sample.texts, strict=False)):
            beyond = z is not None and not low - reach <= float(z) <= high + reach
            if beyond and _ALL_NINES.fullmatch(text):
                sample.z[i] = None
                marks.append(text)
    if marks:
        record.notes.append(f"{_count(len(marks), 'height')} {marks[0]} taken as missing")


def bridged(record: Record) -> None:
    """Put heights where they are missing, and between samples more than 10 mm apart, by a cubic through the others.

    Raises:
        ProfileError: a gap is longer than `LONGEST_GAP_M`, or a value is missing at an end.
    """
    passes = range(len(record.samples[0].z))
    missing = [sample for sample in record.samples if None in sample.z]
    whole = [sample for sample in record.samples if None not in sample.z]
    if len(whole) < 4:
        raise ProfileError(f"{len(whole)} samples with a height", "measure the whole weld")
    steps = np.diff([float(sample.x) for sample in whole])
    usual, widest = float(np.median(steps)), int(np.argmax(steps))
    limit = WIDEST_SPACING_M if usual > MAX_PROFILE_SPACING_M * (1 + 1e-9) else LONGEST_GAP_M
    cut = len(record.samples) - len(whole) - sum(whole[0].x < s.x < whole[-1].x for s in missing)
    if cut:
        record.samples = [s for s in record.samples if whole[0].x <= s.x <= whole[-1].x]
        missing = [s for s in missing if whole[0].x < s.x < whole[-1].x]
        record.notes.append(f"{_count(cut, 'sample')} without a height at the ends left out")
    if not missing and steps[widest] <= MAX_PROFILE_SPACING_M * (1 + 1e-9):
        return
    if steps[widest] > limit * (1 + 1e-6):
        raise ProfileError(
            f"spacing {steps[widest] * 1e3:.3g} mm from line {whole[widest].line} to {whole[widest + 1].line}, "
            f"at most {limit * 1e3:g} mm",
            "check x_unit, or measure at 10 mm or finer without gaps",
        )
    x = [float(sample.x) for sample in whole]
    cubics = [scipy.interpolate.CubicSpline(x, [float(sample.z[i] or 0) for sample in whole]) for i in passes]

    def put(at: Decimal) -> list[Decimal | None]:
        return [Decimal(repr(round(float(cubic(float(at))), 12))) for cubic in cubics]

    filled = 0
    for sample in missing:
        sample.z, filled = put(sample.x), filled + 1
    between = list[Sample]()
    for before, after in itertools.pairwise(record.samples):
        parts = int(np.ceil(float(after.x - before.x) / MAX_PROFILE_SPACING_M - 1e-9))
        for k in range(1, parts):
            at = before.x + (after.x - before.x) * k / parts
            between.append(Sample(before.line, at, put(at)))
    record.samples = sorted([*record.samples, *between], key=lambda sample: sample.x)
    if filled:
        record.notes.append(
            f"{_count(filled, 'missing height')} put by a cubic, longest gap {steps.max() * 1e3:.3g} mm"
        )
    if between and usual > MAX_PROFILE_SPACING_M * (1 + 1e-9):
        record.notes.append(f"samples {usual * 1e3:.3g} mm apart: heights put between them by a cubic")
    elif between:
        record.notes.append(f"{_count(len(between), 'sample')} put by a cubic, longest gap {steps.max() * 1e3:.3g} mm")


def _count(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"
