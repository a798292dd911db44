"""Write the causal twin of a track as a track file."""

from typing import Any

import yaml

from weld_force_ros.physics.track.causal_twin import CausalTwin
from weld_force_ros.physics.track.support import TabulatedSpring
from weld_force_ros.simulation.track_file import TrackDefinition

_DIGITS = 6


def causal_track_text(definition: TrackDefinition, twin: CausalTwin, *, name: str, at_hz: float) -> str:
    """Return the text of a track's file with tables over frequency in place of its loss factors.

    Args:
        definition: the track with loss factors.
        twin: its causal twin.
        name: of the new track.
        at_hz: where stiffness stayed what it was.
    """
    document: dict[str, Any] = yaml.safe_load(definition.text)
    source = (
        f"derived: the causal spring nearest to that of {definition.track.name}, of the same stiffness at {at_hz:g} Hz"
        " (weld-force track causal)"
    )
    supports = document["supports"]
    layers = [layer for layer in supports.get("layers", []) if "spring" in layer]
    places = [(layer, "spring") for layer in layers] or [(supports, "pad"), (supports, "ballast")]
    for (holder, key), old, new in zip(
        places, definition.track.support.springs, twin.track.support.springs, strict=True
    ):
        if new is not old and isinstance(new, TabulatedSpring):
            rows = [[_rounded(hz), _rounded(k * 1e-6), _rounded(loss)] for hz, k, loss in new.rows]
            holder[key] = {"table": {"value": rows, "source": source}}
    document["name"] = name
    document["description"] = f"The causal twin of {definition.track.name}: {document.get('description', '')}".strip()
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
