"""Convert a verdict to typed ROS messages, for tools that show JSON as plain text only: PlotJuggler, rqt, Foxglove.

PlotJuggler names a series of a DiagnosticArray `TOPIC/HARDWARE_ID/NAME/KEY`, without the hardware where that is empty:
so one name for all welds and no hardware make one series of each number over all welds, such as
`criteria/weld/peak_force/ratio`. Text becomes a series of text, `level` a number.
"""

import math

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from msgspec import UNSET

from weld_force_ros.assessment.judge import permitted_kmh
from weld_force_ros.assessment.limits import ratio
from weld_force_ros.messages import Decision, Verdict

RAIL_FRAME = "rail"
NAME = "weld"

_LEVELS: dict[Decision, bytes] = {
    "accept": DiagnosticStatus.OK,
    "grind": DiagnosticStatus.WARN,
    "reject": DiagnosticStatus.ERROR,
    "undecided": DiagnosticStatus.STALE,
}


def peak_force(verdict: Verdict) -> WrenchStamped:
    """Return the peak force as a wrench; z is up."""
    wrench = WrenchStamped()
    wrench.header.frame_id = RAIL_FRAME
    wrench.header.stamp.sec, wrench.header.stamp.nanosec = verdict.stamp.sec, verdict.stamp.nanosec
    wrench.wrench.force.z = verdict.peak_force_n
    return wrench


def criteria(verdict: Verdict) -> DiagnosticArray:
    """Return all numbers of a verdict as one status: SI units, speeds in km/h; what is not known is absent."""
    numbers: dict[str, float] = {"peak_force_n": verdict.peak_force_n, "judged_speed_kmh": verdict.judged_speed_kmh}
    if (permitted := permitted_kmh(verdict)) is not None:
        numbers["permitted_speed_kmh"] = permitted
    if verdict.chainage_m is not UNSET:
        numbers["chainage_m"] = verdict.chainage_m
    for criterion in sorted(verdict.criteria, key=ratio):  # of two limits for the same, the stricter stays
        numbers |= {f"{criterion.name}/value": criterion.value, f"{criterion.name}/limit": criterion.limit}
        numbers[f"{criterion.name}/ratio"] = ratio(criterion)
    texts = {"weld_id": verdict.weld_id, "decision": verdict.decision}
    texts |= {key: repr(float(number)) for key, number in numbers.items() if math.isfinite(number)}
    array = DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=_LEVELS[verdict.decision],
                name=NAME,
                message=verdict.reason,
                values=[KeyValue(key=key, value=value) for key, value in texts.items()],
            )
        ]
    )
    array.header.frame_id = RAIL_FRAME
    array.header.stamp.sec, array.header.stamp.nanosec = verdict.stamp.sec, verdict.stamp.nanosec
    return array
