"""Judge welds under fixed settings and limits, with what hanging sleepers would do: command line and library alike."""

from collections.abc import Callable, Sequence

from weld_force_ros.assessment.hanging import HangingSleepers
from weld_force_ros.assessment.judge import Assessment, assess_vehicles
from weld_force_ros.messages import AssessmentSettings, SimulationSettings, WeldProfile
from weld_force_ros.simulation.simulator import Simulator


class Assessor:
    """Assesses many welds under the same vehicles and limits; making one loads the track's fits.

    Args:
        settings: of the simulation, one for each vehicle.
        limits: to judge by.
        on_fit: called with a line of text if a fit has to be made.
        threads: that compute; one a core, if not given.

    Raises:
        InputError: settings that this version cannot simulate.
    """

    def __init__(
        self,
        settings: Sequence[SimulationSettings],
        limits: AssessmentSettings,
        *,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
    ) -> None:
        self.limits = limits
        self._simulators = [Simulator(one, on_fit=on_fit, threads=threads) for one in settings]
        self._settings = {one.config_sha256: one for one in settings}
        self._hanging = {one.config_sha256: HangingSleepers(one, limits, on_fit=on_fit) for one in settings}

    def assess(self, profile: WeldProfile) -> Assessment:
        """Simulate a weld and judge it by the vehicle that decides.

        Raises:
            NumericalError: a passage did not stay finite.
            InputError: no limit holds for a line of that speed.
        """
        found = assess_vehicles(profile, self._simulators, self.limits)
        found.verdict.hanging = self._hanging[found.verdict.config_sha256].outcomes(profile)
        return found

    def settings_of(self, found: Assessment) -> SimulationSettings:
        """Return the settings of the vehicle that decided."""
        return self._settings[found.verdict.config_sha256]
