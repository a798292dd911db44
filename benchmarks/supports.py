"""Compare peaks over hanging sleepers with those of finite elements, and print by how much they differ.

`python -m benchmarks.supports` takes `common-poles` (a minute); with `--reference`, the other engine on
`bilbao-viscous` (some minutes).
"""

import sys
from collections import defaultdict

import numpy as np

from tests.harness.finite_element_peaks import GAPS, SUPPORTS, Case, read, wheel_path
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import fit_store, track_file

Model = VehicleTrackModel | GreensFunctionModel
_FLAT = WheelPath(0.0, np.zeros(9))


def local_supports(name: str) -> LocalSupports | None:
    """Return the supports of a case by its name; None where all are as built."""
    stated = SUPPORTS[name]
    changes = [SupportChange(sleeper, below=share) for sleeper, share in stated.ballast.items()]
    changes += [SupportChange(sleeper, gap_m=gap_m) for sleeper, gap_m in stated.gap_m.items()]
    return LocalSupports.of(changes) if changes else None


def model(track: str, supports: str, *, reference: bool) -> Model:
    """Return a wheel on a track with the supports of that name."""
    definition, differing = track_file.load(track), local_supports(supports)
    if reference:
        return GreensFunctionModel(definition.track, definition.wheel, differing)
    if differing is None:
        return VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
    return VehicleTrackModel(fit_store.fitted_window(definition, differing, moving=True).model(), definition.wheel)


def error(of: Model, case: Case) -> float:
    """Return by how much a peak differs from that of finite elements, as a share of it."""
    at_m = case.position_spans * track_file.load(case.track).track.spacing_m
    found = of.peak_map(wheel_path(case.shape) or _FLAT, [case.speed_kmh], [at_m])
    return float(found.peak_force_n[0, 0] / read()[case].force_n - 1)


def main(*, reference: bool) -> None:
    """Print RMS and largest difference by track and supports."""
    models: dict[tuple[str, str], Model] = {}
    errors = defaultdict[tuple[str, str], list[tuple[float, Case]]](list)
    for case in read():
        if (not reference and case.supports in GAPS) or (reference and case.track != "bilbao-viscous"):
            continue
        key = case.track, case.supports
        if key not in models:
            models[key] = model(*key, reference=reference)
        errors[key].append((100 * error(models[key], case), case))
    for (track, supports), found in errors.items():
        values = np.array([value for value, _ in found])
        value, worst = max(found, key=lambda pair: abs(pair[0]))
        print(
            f"{track:18} {supports:20} {len(values):3} cases: RMS {np.sqrt(np.mean(values**2)):5.2f} %, largest"
            f" {value:+5.2f} % ({worst.shape}, {worst.speed_kmh:g} km/h, {worst.position_spans:g} of the span);"
            f" up to 200 km/h {max(abs(v) for v, case in found if case.speed_kmh <= 200):.2f} %"
        )


if __name__ == "__main__":
    main(reference="--reference" in sys.argv)
