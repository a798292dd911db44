"""Peak forces by the `reference` engine, which takes a second a passage, computed once and stored in a folder."""

import contextlib
import hashlib
import inspect
import io
import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import msgspec
import numpy as np

from weld_force_ros import __version__, _files
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines import greens_function
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track import beam
from weld_force_ros.simulation.track_file import TrackDefinition


@dataclass(frozen=True)
class ReferencePeaks:
    """A folder with a file for each track, wheel, speed and set of positions; in it, an entry for each weld.

    A damaged file is ignored, and so is one that another version of the engine has made.
    """

    folder: Path

    def at_speed(
        self, definition: TrackDefinition, wheel_paths: Sequence[WheelPath], speed_kmh: float, positions_m: FloatArray
    ) -> FloatArray:
        """Return peak force (N) and its location (m) of every passage at one speed, (n_path, 2, n_position).

        Raises:
            InputError: the folder cannot be written; a speed or position that cannot be simulated.
        """
        path = self.folder / f"{_key(definition, speed_kmh, positions_m)}.npz"
        welds = [_digest(t.start_m, t.height_m) for t in wheel_paths]
        known = _read(path)
        missing = {weld: t for weld, t in zip(welds, wheel_paths, strict=True) if weld not in known}
        if missing:
            vehicle_track = greens_function.GreensFunctionModel(definition.track, definition.wheel)
            peak_maps = vehicle_track.peak_maps(list(missing.values()), [speed_kmh], positions_m)
            known |= {
                weld: np.concatenate([s.peak_force_n, s.peak_x_m]) for weld, s in zip(missing, peak_maps, strict=True)
            }
            _write(path, known)
        return np.stack([known[weld] for weld in welds])


def _key(definition: TrackDefinition, speed_kmh: float, positions_m: FloatArray) -> str:
    numbers = [_engine(), asdict(definition.track) | {"name": ""}, asdict(definition.wheel), float(speed_kmh)]
    return _digest(msgspec.json.encode(numbers, order="sorted").decode(), positions_m)


def _digest(number: float | str, array: FloatArray) -> str:
    return hashlib.sha256(repr(number).encode() + np.asarray(array, dtype=np.float64).tobytes()).hexdigest()[:32]


@cache
def _engine() -> str:
    """Return a digest of the engine's source: its constants decide on the result as much as its formulas."""
    sources = [inspect.getsource(module) for module in (greens_function, beam)]
    return hashlib.sha256("".join([__version__, *sources]).encode()).hexdigest()


def _read(path: Path) -> dict[str, FloatArray]:
    # Opened here: of a damaged file, np.load leaves the handle open.
    with contextlib.suppress(OSError, ValueError, EOFError, zipfile.BadZipFile), path.open("rb") as file:
        entries = np.load(file)
        return {name: entries[name] for name in entries.files}
    return {}


def _write(path: Path, entries: dict[str, FloatArray]) -> None:
    """Write the whole file or none, also if the run is stopped."""
    content = io.BytesIO()
    np.savez(content, **entries)  # type: ignore[arg-type]  # keywords are arrays, not allow_pickle
    _files.write_whole(path, content.getvalue())
