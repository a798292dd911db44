"""Wheel-rail contact forces over measured rail welds: simulate every speed and position, judge, record to MCAP.

The public names below are imported when they are first used, so that `import weld_force_ros` costs nothing.

    import weld_force_ros as wf

    simulator = wf.Simulator(wf.simulation_settings(track="bilbao", speeds_kmh=[80.0, 120.0, 160.0]))
    assessment = wf.assess(wf.shipped_profile("weld-1-dip"), simulator, wf.load_limits())
    assessment.verdict.decision
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0"
SOFTWARE = f"weld_force_ros {__version__}"
"""Name of this software in verdicts, plans and studies."""

if TYPE_CHECKING:
    from weld_force_ros.assessment.judge import Assessment as Assessment
    from weld_force_ros.assessment.judge import assess as assess
    from weld_force_ros.assessment.judge import judge as judge
    from weld_force_ros.assessment.rule_books import load_limits as load_limits
    from weld_force_ros.errors import BagError as BagError
    from weld_force_ros.errors import DiskFullError as DiskFullError
    from weld_force_ros.errors import InputError as InputError
    from weld_force_ros.errors import MessageError as MessageError
    from weld_force_ros.errors import NumericalError as NumericalError
    from weld_force_ros.errors import ProfileError as ProfileError
    from weld_force_ros.errors import TrackError as TrackError
    from weld_force_ros.errors import WeldForceError as WeldForceError
    from weld_force_ros.measurement.profile_file import read_profile as read_profile
    from weld_force_ros.measurement.profile_file import shipped_profile as shipped_profile
    from weld_force_ros.messages import AssessmentSettings as AssessmentSettings
    from weld_force_ros.messages import Criterion as Criterion
    from weld_force_ros.messages import ForceHistory as ForceHistory
    from weld_force_ros.messages import ForceMap as ForceMap
    from weld_force_ros.messages import GrindingAdvice as GrindingAdvice
    from weld_force_ros.messages import Inquiry as Inquiry
    from weld_force_ros.messages import Limit as Limit
    from weld_force_ros.messages import RailSurface as RailSurface
    from weld_force_ros.messages import Rejection as Rejection
    from weld_force_ros.messages import Rules as Rules
    from weld_force_ros.messages import Settled as Settled
    from weld_force_ros.messages import SimulationSettings as SimulationSettings
    from weld_force_ros.messages import Uncertainty as Uncertainty
    from weld_force_ros.messages import Verdict as Verdict
    from weld_force_ros.messages import WeldMarker as WeldMarker
    from weld_force_ros.messages import WeldProfile as WeldProfile
    from weld_force_ros.recording.recording import Recording as Recording
    from weld_force_ros.recording.recording import open_recording as open_recording
    from weld_force_ros.recording.replay import replay as replay
    from weld_force_ros.simulation.settings import simulation_settings as simulation_settings
    from weld_force_ros.simulation.simulator import Simulator as Simulator

_NAMES_BY_MODULE = {
    "assessment.judge": ("Assessment", "assess", "judge"),
    "assessment.rule_books": ("load_limits",),
    "errors": (
        "BagError", "DiskFullError", "InputError", "MessageError", "NumericalError", "ProfileError", "TrackError",
        "WeldForceError",
    ),
    "measurement.profile_file": ("read_profile", "shipped_profile"),
    "messages": (
        "AssessmentSettings", "Criterion", "ForceHistory", "ForceMap", "GrindingAdvice", "Inquiry", "Limit",
        "RailSurface", "Rejection", "Rules", "Settled", "SimulationSettings", "Uncertainty", "Verdict", "WeldMarker",
        "WeldProfile",
    ),
    "recording.recording": ("Recording", "open_recording"),
    "recording.replay": ("replay",),
    "simulation.settings": ("simulation_settings",),
    "simulation.simulator": ("Simulator",),
}  # fmt: skip
_MODULE_OF = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}


def __getattr__(name: str) -> object:
    """Import a public name from the module that defines it."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    found: object = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """List the public names beside what is loaded already."""
    return sorted({*globals(), *_MODULE_OF})
