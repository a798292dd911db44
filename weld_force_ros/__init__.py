"""Wheel-rail contact forces over measured rail welds: simulate every speed and position, judge, record to MCAP.

    import weld_force_ros as wf

    weld = wf.Profile(x_m, z_m, line_speed_kmh=160)
    force_map = wf.Model("bilbao-causal", "passenger").force_map(weld)
    verdict = wf.assess(weld, wf.Model("bilbao-causal", "passenger"))

NumPy arrays in, xarray and pandas out; everything in SI units but speeds in km/h, units in names and attributes. The
public names are those of `__all__`, imported when they are first used, so that `import weld_force_ros` costs nothing;
the messages of nodes and recordings are in `weld_force_ros.messages`. What leaves this list or changes its meaning is
warned of (DeprecationWarning) for one minor release before, and stands in the changelog; while the version begins with
0, a minor release may do so at once, and the changelog says how to change a program.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0"
SOFTWARE = f"weld_force_ros {__version__}"
"""Name of this software in verdicts, plans and studies."""

if TYPE_CHECKING:
    from weld_force_ros.errors import BagError as BagError
    from weld_force_ros.errors import InputError as InputError
    from weld_force_ros.errors import NumericalError as NumericalError
    from weld_force_ros.errors import ProfileError as ProfileError
    from weld_force_ros.errors import TrackError as TrackError
    from weld_force_ros.errors import WeldForceError as WeldForceError
    from weld_force_ros.library.grinding import GrindingPlan as GrindingPlan
    from weld_force_ros.library.grinding import grind as grind
    from weld_force_ros.library.limits import Limits as Limits
    from weld_force_ros.library.model import Model as Model
    from weld_force_ros.library.profile import Profile as Profile
    from weld_force_ros.library.profile import read_profile as read_profile
    from weld_force_ros.library.profile import read_profiles as read_profiles
    from weld_force_ros.library.recording import Recording as Recording
    from weld_force_ros.library.track import Track as Track
    from weld_force_ros.library.vehicle import Vehicle as Vehicle
    from weld_force_ros.library.verdict import Verdict as Verdict
    from weld_force_ros.library.verdict import assess as assess

_NAMES_BY_MODULE = {
    "errors": ("BagError", "InputError", "NumericalError", "ProfileError", "TrackError", "WeldForceError"),
    "library.grinding": ("GrindingPlan", "grind"),
    "library.limits": ("Limits",),
    "library.model": ("Model",),
    "library.profile": ("Profile", "read_profile", "read_profiles"),
    "library.recording": ("Recording",),
    "library.track": ("Track",),
    "library.vehicle": ("Vehicle",),
    "library.verdict": ("Verdict", "assess"),
}
_MODULE_OF = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}
__all__ = sorted(_MODULE_OF)


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
