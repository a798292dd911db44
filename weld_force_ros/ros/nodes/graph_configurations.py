"""Tell what the simulators of this graph computed from what is played from a recording of another configuration."""

import msgspec

from weld_force_ros.messages import ForceHistory, ForceMap, Rejection, SimulationSettings
from weld_force_ros.ros.contract_topics import Incoming


class _Configured(msgspec.Struct):
    config_sha256: str = ""


class GraphConfigurations:
    """The configurations of the simulators on this graph, by the settings that they publish.

    While none is known, as on a graph without a simulator, everything counts: a recording may be judged by playing it.
    """

    def __init__(self) -> None:
        self._known: set[str] = set()
        self._reported: set[str] = set()

    def note(self, incoming: Incoming) -> None:
        """Take note of settings that a simulator published; of those that are played from a recording none."""
        if incoming.kind is SimulationSettings and not incoming.replayed:
            self._known.add(_config(incoming))

    def is_foreign(self, incoming: Incoming) -> bool:
        """Return whether a message is played from a recording and is no result of a configuration of this graph."""
        if not (self._known and incoming.replayed):
            return False
        return incoming.kind is Rejection or (
            incoming.kind in (ForceMap, ForceHistory) and _config(incoming) not in self._known
        )

    def first_report(self, incoming: Incoming) -> str | None:
        """Return what to say of a foreign message; None if the same was said of its publisher before."""
        about = f"{incoming.publisher} {incoming.kind.__name__}"
        if about in self._reported:
            return None
        self._reported.add(about)
        if incoming.kind is Rejection:
            return f"{incoming.description} is played from a recording and settles nothing here"
        return (
            f"{incoming.description} is played from a recording of another configuration ({_config(incoming)[:8]}) "
            "than the simulator's here: such are neither judged nor recorded; play weld_profile alone "
            "(`replay publish BAG --topics weld_profile`)"
        )


def _config(incoming: Incoming) -> str:
    try:
        return msgspec.json.decode(incoming.text, type=_Configured).config_sha256
    except (msgspec.DecodeError, UnicodeError, RecursionError):
        return ""
