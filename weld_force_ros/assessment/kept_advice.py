"""Keep advice on grinding in the user's cache: a search takes seconds, and the same question has the same answer.

Kept under a digest of all that the answer depends on: the weld, the settings, the limits, and this software's files.
"""

import hashlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

from msgspec.structs import replace

import weld_force_ros
from weld_force_ros import _files
from weld_force_ros.errors import MessageError
from weld_force_ros.messages import AssessmentSettings, GrindingAdvice, SimulationSettings, Stamp, WeldProfile
from weld_force_ros.messages.codec import decode, encode

Advise = Callable[[WeldProfile], GrindingAdvice]


def advice_of(
    profile: WeldProfile, settings: SimulationSettings, limits: AssessmentSettings, advise: Advise
) -> GrindingAdvice:
    """Return the advice that is kept for a weld; search for it where there is none, and keep it.

    A cache that cannot be read or written changes nothing but the time that it takes.

    Args:
        profile: the weld.
        settings: of its force map.
        limits: that it is to come within.
        advise: searches under these settings and limits.

    Raises:
        WeldForceError: of the search.
    """
    file = _files.cache_folder("grinding") / f"{_key(profile, settings, limits)}.json"
    try:
        return decode(GrindingAdvice, file.read_bytes())
    except (OSError, MessageError):
        found = advise(profile)
    with suppress(OSError):
        _files.write_whole(file, encode(found))
    return found


def _key(profile: WeldProfile, settings: SimulationSettings, limits: AssessmentSettings) -> str:
    # Who published the weld, and when, makes no difference to it.
    weld = replace(profile, publisher="", sequence=0, stamp=Stamp(), profile_id="0" * 64)
    parts = (encode(weld), settings.config_sha256.encode(), limits.limits_sha256.encode(), _software().encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


@cache
def _software() -> str:
    root = Path(weld_force_ros.__file__).parent
    digest = hashlib.sha256()
    for file in sorted(path for path in root.rglob("*") if path.suffix in {".py", ".yaml", ".json"}):
        digest.update(f"{file.relative_to(root)}\0".encode() + file.read_bytes())
    return digest.hexdigest()
