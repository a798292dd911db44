"""What the bogie's other wheel changes: peak forces by two wheels on one rail against those by one.

`python -m benchmarks.second_wheel [TRACK ...]` prints the table of docs/validation/accuracy.md, ten minutes for its two
tracks. Both wheels run over the exact track of the `reference` engine. The rail under each moves by its own forces and,
through the transfer receptance h(x(t) + d, x(t')) along a contact at a fixed distance, by the other's; both are
solved in the same steps, as no wave is at the other wheel within one.
"""

import argparse

import numpy as np
from numba import njit
from numpy.typing import NDArray

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines import greens_function
from weld_force_ros.physics.engines.greens_function import GreensFunctionModel
from weld_force_ros.physics.passage import _convolution
from weld_force_ros.physics.passage._contact import FAST_MATH, contact_force
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.physics.threads import executor
from weld_force_ros.simulation import track_file

TRACKS = ("bilbao-viscous", "johansson-nielsen")
SPEEDS_KMH = (80.0, 160.0, 250.0)
DISTANCES_M = (1.8, 2.5, 3.0)
POSITIONS_SPANS = (0.0, 0.25, 0.5)
SHAPES_M = {"dip 0.2 mm, 200 mm": (0.2e-3, 0.2), "rise 0.2 mm, 120 mm": (-0.2e-3, 0.12)}


class TwoWheels:
    """Two equal wheels on one rail at one speed; the first's peak is asked for.

    Args:
        name: of a causal track.
        speed_kmh: of both.
    """

    def __init__(self, name: str, speed_kmh: float) -> None:
        definition = track_file.load(name)
        if not definition.track.causal:
            raise ValueError(f"{name} answers before it is pushed")
        self.track, self.wheel = definition.track, definition.wheel
        self.speed_m_s = speed_kmh / 3.6
        model = GreensFunctionModel(self.track, self.wheel)
        with executor(None) as pool:
            self.own = model._responses(speed_kmh, False, pool)
        self.step_m = self.track.spacing_m / self.own.grid
        self._spectrum = greens_function._Spectrum(self.track, self.own.dt, None)
        at = self.step_m * np.arange(self.own.grid)
        # By grid point: (grid, n_wave, n_frequency).
        self._ahead, self._behind = (
            np.ascontiguousarray(self._spectrum.shape(places).transpose(1, 0, 2)) for places in (at, -at)
        )
        count = len(self.own.rows)
        self._nodes = self.own.grid // count * np.arange(count)
        self._transfers: dict[int, FloatArray] = {}

    def responses(self, offset: int) -> FloatArray:
        """Return displacements of a contact `offset` steps ahead of unit pulses at the nodes, (n_node, n_lag), m/N."""
        if offset not in self._transfers:
            rows = np.empty(self.own.rows.shape)
            ahead = _parts(self._ahead)
            with executor(None) as pool:
                list(pool.map(lambda n: self._respond(int(self._nodes[n]), offset, ahead, rows[n]), range(len(rows))))
            lag_s = self.own.dt * np.arange(rows.shape[1])
            self._transfers[offset] = rows * np.exp(self._spectrum.alpha * lag_s)
        return self._transfers[offset]

    def _respond(self, node: int, offset: int, ahead: tuple[FloatArray, FloatArray], row: FloatArray) -> None:
        """Fill the response to a pulse at grid point `node`: while the contact is behind it, then ahead of it."""
        spectrum = self._spectrum
        step = 1j * spectrum.omega * self.own.dt
        sources = spectrum.pulse * spectrum.strength
        behind = min(max(-offset, 0), len(row))
        _approach(sources * self._ahead[node], spectrum.multiplier, self._behind, step, node + offset, row[:behind])
        spans, place = divmod(node + offset + behind, self.own.grid)
        waves = sources * self._behind[node] * spectrum.multiplier**spans * np.exp(step * behind)
        _convolution.moving_response(
            *_parts(waves), *ahead, *_parts(spectrum.multiplier), *_parts(np.exp(step)), place, row[behind:]
        )

    def peak(self, path: WheelPath, position_m: float, steps_ahead: int = 0) -> float:
        """Return the first wheel's peak force over a weld, the second `steps_ahead` of it; 0: without a second."""
        own, memory = self.own, self.own.rows.shape[1]
        settling = int(np.ceil(greens_function.LEAD_IN_S / own.dt)) + max(steps_ahead, 0)
        first = int(np.floor((position_m + path.start_m) / self.step_m))
        begin = first - settling - memory
        run_out = max(self.track.spacing_m, greens_function.RUN_OUT_S * self.speed_m_s)
        steps = int(np.ceil((position_m + path.end_m + run_out) / self.step_m)) + 1 - begin
        begins = np.array([begin, begin + steps_ahead] if steps_ahead else [begin])
        down = np.array([-path.at(self.step_m * (at + np.arange(steps)) - position_m) for at in begins])
        rows = [[own.rows]]
        if steps_ahead:
            rows = [[own.rows, self.responses(steps_ahead)], [self.responses(-steps_ahead), own.rows]]
        physics = np.array([self.wheel.mass_kg, self.wheel.static_load_n, self.wheel.hertz_n_per_m15])
        force = np.empty_like(down)
        _run(np.array(rows), own.nodes, own.weights, begins % own.grid, memory, down, physics, own.dt, force)
        return float(force[0, settling + memory :].max())


@njit(nogil=True, fastmath=FAST_MATH)
def _run(rows, nodes, weights, starts, at_rest, down, physics, dt, result):  # type: ignore[no-untyped-def]
    """Fill the wheels' forces, (n_wheel, n_step), as `passage_by_convolution` does for one.

    `rows` is (n_wheel, n_wheel, n_node, n_lag): [a, b] is how b's rail answers a's pulses.
    """
    mass, load, hertz = physics
    wheels, steps = down.shape
    memory, grid = rows.shape[3], len(nodes)
    answer = np.zeros((wheels, steps + memory))
    height, velocity, own = np.zeros(wheels), np.zeros(wheels), dt * dt / (6.0 * mass)
    for n in range(steps):
        for a in range(wheels):
            j = (starts[a] + n) % grid
            here = 0.0
            for q in range(nodes.shape[1]):
                here += weights[j, q] * rows[a, a, nodes[j, q], 0]
            if n < at_rest:
                force = load
                height[a] = answer[a, n] + here * load + (load / hertz) ** (2.0 / 3.0) + down[a, n]
            else:
                old = result[a, n - 1]
                free = height[a] + dt * (velocity[a] + dt * (0.5 * load - old / 3.0) / mass)
                force = contact_force(free - answer[a, n] - down[a, n], here + own, hertz)
                height[a] = free - own * force
                velocity[a] += dt * (load - 0.5 * (old + force)) / mass
            result[a, n] = force
        for a in range(wheels):
            j = (starts[a] + n) % grid
            for b in range(wheels):
                for q in range(nodes.shape[1]):
                    scale, row = weights[j, q] * result[a, n], rows[a, b, nodes[j, q]]
                    for m in range(1, memory):
                        answer[b, n + m] += scale * row[m]


@njit(nogil=True)
def _approach(from_pulse, multiplier, behind, step, place, row):  # type: ignore[no-untyped-def]
    """Fill `row` with the response under a contact at grid point `place` that comes from behind; arrays by wave."""
    grid, waves, frequencies = behind.shape
    phase_step, phase = np.exp(step), np.ones(frequencies, np.complex128)
    current = from_pulse
    for n in range(len(row)):
        spans, j = (place + n) // grid, (place + n) % grid
        if n == 0 or j == 0:
            current = from_pulse * multiplier**-spans
        total = 0.0
        for w in range(waves):
            for k in range(frequencies):
                total += (current[w, k] * behind[j, w, k] * phase[k]).real
        phase *= phase_step
        row[n] = total


def _parts(values: NDArray[np.complex128]) -> tuple[FloatArray, FloatArray]:
    return np.ascontiguousarray(values.real), np.ascontiguousarray(values.imag)


def wheel_path(shape: str, radius_m: float) -> WheelPath:
    depth_m, length_m = SHAPES_M[shape]
    x = np.linspace(-length_m / 2, length_m / 2, 401)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), radius_m)


def changes(two: TwoWheels, shape: str) -> FloatArray:
    """Return by how much a second wheel changes the peak, a share, (n_distance, ahead or behind, n_position)."""
    path = wheel_path(shape, two.wheel.radius_m)
    ahead = [sign * round(distance_m / two.step_m) for distance_m in DISTANCES_M for sign in (1, -1)]
    for steps in ahead:
        two.responses(steps)
    positions_m = two.track.spacing_m * np.array(POSITIONS_SPANS)
    cells = [(steps, float(position_m)) for steps in (0, *ahead) for position_m in positions_m]
    with executor(None) as pool:
        peaks = np.array(list(pool.map(lambda cell: two.peak(path, cell[1], cell[0]), cells)))
    alone, *beside = peaks.reshape(-1, len(positions_m))
    return (np.array(beside) / alone - 1).reshape(len(DISTANCES_M), 2, -1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tracks", nargs="*", default=TRACKS)
    headings = [f"{distance:g} m {side}" for distance in DISTANCES_M for side in ("ahead", "behind")]
    print(f"| track | weld | km/h | {' | '.join(headings)} |\n|{'---|' * (3 + len(headings))}")
    every: list[FloatArray] = []
    for name in parser.parse_args().tracks:
        for speed_kmh in SPEEDS_KMH:
            two = TwoWheels(name, speed_kmh)
            for shape in SHAPES_M:
                found = changes(two, shape)
                every.append(found)
                cells = " | ".join(f"{100 * _largest(one):+.2f} %" for side in found for one in side)
                print(f"| `{name}` | {shape} | {speed_kmh:g} | {cells} |", flush=True)
    sizes = 100 * np.abs(every).ravel()
    print(f"at most {sizes.max():.2f} %, median {np.median(sizes):.2f} %, {np.mean(sizes < 0.5):.0%} below 0.5 %")


def _largest(shares: FloatArray) -> float:
    """Return the largest change over positions, with its sign."""
    return float(shares[np.abs(shares).argmax()])


if __name__ == "__main__":
    main()
