"""The paper's kind of investigation as a workload: seven welds at 48 speeds and 15 positions, 5,040 passages."""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.settings import parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

TRACK = "bilbao"
SPEEDS = "20:255:5"
POSITIONS = 15
WELDS = (  # the one that needs the shortest steps first, so that no thread is left alone with it
    "wheel-flat-0.9mm",
    "weld-1-dip",
    "weld-2-rise-between-shrinkages",
    "weld-3-long-ground-dip",
    "weld-4-steep-ramp",
    "weld-5-ramp-protrusion",
    "cosine-dip-48mm",
)


@dataclass(frozen=True)
class Study:
    """The study's welds and a simulator for them."""

    simulator: Simulator
    welds: dict[str, WeldProfile]
    wheel_paths: dict[str, WheelPath]

    @property
    def speeds_kmh(self) -> FloatArray:
        """Return the speeds, (48,)."""
        return np.array(self.simulator.settings.speeds_kmh)

    @property
    def positions_m(self) -> FloatArray:
        """Return the positions over one span, (15,)."""
        return np.array(self.simulator.settings.positions_m)

    @property
    def passages(self) -> int:
        """Return the number of passages of all welds."""
        return len(self.welds) * len(self.speeds_kmh) * POSITIONS

    def simulate(self, vehicle_track: VehicleTrackModel | None = None, times: int = 1) -> None:
        """Simulate every passage so many times, in one stream, by the simulator's own model or another."""
        simulated = (vehicle_track or self.simulator.vehicle_track).peak_maps(
            times * list(self.wheel_paths.values()), self.speeds_kmh, self.positions_m
        )
        list(simulated)


def study(engine: str = "common-poles") -> Study:
    """Return the study with an engine."""
    settings = simulation_settings(
        track=TRACK, engine=engine, speeds_kmh=parse_speeds(SPEEDS), positions=POSITIONS, running="with"
    )
    simulator = Simulator(settings)
    welds = {name: profile_file.read_profile(profile_file.find(name)) for name in WELDS}
    return Study(simulator, welds, {name: simulator.wheel_path(weld) for name, weld in welds.items()})


def vehicle_track(threads: int | None = None) -> VehicleTrackModel:
    """Return the study's wheel and track on so many threads, or one a core."""
    definition = track_file.load(TRACK)
    return VehicleTrackModel(model(), definition.wheel, threads=threads)


def model() -> PoleModel:
    """Return the study's track as common poles."""
    return fit_store.fitted(track_file.load(TRACK)).model()
