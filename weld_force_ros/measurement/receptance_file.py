"""Read the receptance of a track as hammer tests give it: the rail's response over a sleeper, mid-span, or both.

    # unit: m/s2/N
    frequency_hz, sleeper_real, sleeper_imag, midspan_magnitude, midspan_phase_deg

The unit says whether it is receptance (m/N), mobility (m/s/N) or accelerance (m/s2/N); the phase is that of
exp(+i w t), so that a displacement lags its force.
"""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from weld_force_ros.errors import InputError, ProfileError, os_errors_as
from weld_force_ros.measurement.text_file import MAX_FILE_BYTES, Line, quoted, text_file
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.identification import MeasuredReceptance

FREQUENCY = "frequency_hz"
PLACES = {"sleeper": 0.0, "midspan": 0.5}
"""Spans after a sleeper, by the names of columns."""
_PARTS = (("real", "imag"), ("magnitude", "phase_deg"))
_GRAVITY = 9.80665
# Time derivatives of displacement, and the unit's size.
_UNITS = {
    "m/N": (0, 1.0), "mm/N": (0, 1e-3), "um/N": (0, 1e-6), "nm/N": (0, 1e-9), "mm/kN": (0, 1e-6), "um/kN": (0, 1e-9),
    "m/s/N": (1, 1.0), "mm/s/N": (1, 1e-3), "mm/s/kN": (1, 1e-6),
    "m/s2/N": (2, 1.0), "1/kg": (2, 1.0), "g/N": (2, _GRAVITY), "g/kN": (2, _GRAVITY * 1e-3),
}  # fmt: skip
LEAST_FREQUENCIES = 10
_EXAMPLE = "write `# unit: m/N` (receptance), m/s/N (mobility) or m/s2/N (accelerance) above the columns"
_FORWARDS = 0.05  # mean sine of the phase that noise may leave on the wrong side


def read_receptance(path: Path) -> MeasuredReceptance:
    """Read a measured receptance.

    Raises:
        InputError: the file cannot be read or used; one line with the file, the line and what to do.
    """
    with os_errors_as(InputError, path, "give the path of a readable file"), path.open("rb") as file:
        raw = file.read(MAX_FILE_BYTES + 1)
    try:
        return _receptance(text_file(raw).lines)
    except ProfileError as error:
        raise InputError(f"{path}: {error.reason}", error.remedy) from None


def _receptance(lines: Sequence[Line]) -> MeasuredReceptance:
    rows = [line for line in lines if line.text and not line.text.startswith("#")]
    if not rows:
        raise ProfileError("no columns", f"name them: {FREQUENCY},sleeper_real,sleeper_imag")
    derivatives, size = _unit([line for line in lines if line.text.startswith("#")])
    separator = next((one for one in ("\t", ";") if one in rows[0].text), ",")
    names = [name.strip().lower() for name in rows[0].text.split(separator)]
    values = _numbers(rows[1:], names, separator)
    if FREQUENCY not in names:
        raise ProfileError(f"no column {FREQUENCY}", f"the columns are {quoted(', '.join(names))}")
    frequency_hz = values[:, names.index(FREQUENCY)]
    if frequency_hz[0] <= 0 or np.any(np.diff(frequency_hz) <= 0):
        raise ProfileError("frequencies do not rise from above 0", "sort the rows, each frequency once, without 0 Hz")
    places = {place: _complex(place, names, values) for place in PLACES}
    found = {place: response for place, response in places.items() if response is not None}
    if not found:
        raise ProfileError(
            f"no response among the columns {quoted(', '.join(names))}",
            "give sleeper_real and sleeper_imag, or sleeper_magnitude and sleeper_phase_deg; midspan_ likewise",
        )
    displacement = size * np.stack(list(found.values())) / (2j * np.pi * frequency_hz) ** derivatives
    _refuse_energy_from_nowhere(displacement)
    return MeasuredReceptance(frequency_hz, np.array([PLACES[place] for place in found]), displacement)


def _unit(comments: Sequence[Line]) -> tuple[int, float]:
    stated = [line.text.partition(":")[2] for line in comments if line.text.lstrip("# ").lower().startswith("unit:")]
    if len(stated) != 1:
        raise ProfileError("its unit is not stated" if not stated else "its unit is stated twice", _EXAMPLE)
    plain = stated[0].translate(str.maketrans("µμ²", "uu2", " ()^*·"))
    if plain not in _UNITS:
        raise ProfileError(f"unit {quoted(stated[0].strip())} is not known", f"state one of {', '.join(_UNITS)}")
    return _UNITS[plain]


def _numbers(rows: Sequence[Line], names: Sequence[str], separator: str) -> FloatArray:
    """Return the cells of all rows, (n_row, n_column)."""
    values = []
    for line in rows:
        cells = line.text.split(separator)
        if len(cells) != len(names):
            raise ProfileError(f"line {line.number} has {len(cells)} cells, not {len(names)}", "give one a column")
        try:
            row = [float(cell.replace(",", ".") if separator != "," else cell) for cell in cells]
        except ValueError:
            raise ProfileError(f"line {line.number}: {quoted(line.text)} are no numbers", "correct them") from None
        if not all(math.isfinite(value) for value in row):
            raise ProfileError(f"line {line.number} holds a value that is not finite", "leave the row out")
        values.append(row)
    if len(values) < LEAST_FREQUENCIES:
        raise ProfileError(f"{len(values)} frequencies", f"give {LEAST_FREQUENCIES} at least")
    return np.array(values)


def _complex(place: str, names: Sequence[str], values: FloatArray) -> ComplexArray | None:
    """Return the response at a place, (n_row,), or None where no column is of it."""
    for first, second in _PARTS:
        columns = [f"{place}_{part}" for part in (first, second)]
        given = [name for name in columns if name in names]
        if len(given) == 1:
            (missing,) = set(columns) - set(given)
            raise ProfileError(f"column {given[0]} without {missing}", "give both")
        if given:
            one, other = (values[:, names.index(name)] for name in columns)
            response = one + 1j * other if first == "real" else one * np.exp(1j * np.radians(other))
            if np.any(response == 0):
                raise ProfileError(f"{columns[0]}: a response of 0", "leave out what was not measured")
            return np.asarray(response)
    return None


def _refuse_energy_from_nowhere(m_per_n: ComplexArray) -> None:
    """Refuse a displacement that leads its force: the other sign of phase, the wrong unit or sensors in opposition."""
    if np.mean(np.sin(np.angle(m_per_n))) > _FORWARDS:
        raise ProfileError(
            "the rail's displacement leads its force at most frequencies",
            "check the unit, give phases of exp(+i w t), and accelerations in the direction of the force",
        )
