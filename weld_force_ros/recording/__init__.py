"""Recordings: MCAP in the form that rosbag2 (Jazzy) gives it, written and read without ROS; other forms are read.

While a recording runs, each message is one whole write to an unchunked file, so that a killed process loses none. A
file that is finished, by a split or at the end, is completed, then rewritten beside in compressed and indexed chunks
and exchanged at once: whenever the process ends, a readable recording lies there, and the next one continues it.
Reading goes straight through the records and needs no index, so that an intact and a cut file are read alike, the cut
one up to the cut.
"""

from weld_force_ros.recording.contract_messages import ContractMessage, OutcomeCounts, contract_messages, count_outcomes
from weld_force_ros.recording.json_export import ExportReport, export_json
from weld_force_ros.recording.reader import (
    Bag,
    FileSummary,
    Summary,
    TopicSummary,
    is_recording_file,
    open_bag,
    stored,
    summary,
)
from weld_force_ros.recording.recorded import Recorded
from weld_force_ros.recording.recorder import Recorder
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.recovery import RecoveryReport, recover
from weld_force_ros.recording.rosbag2_format import STRING, MessageDefinition, offered_qos, string_cdr
from weld_force_ros.recording.table_export import FORMATS, export_tables
from weld_force_ros.recording.timeline import GAP_NS, Gap, Timeline, gap_in_words, local_time

__all__ = [
    "FORMATS",
    "GAP_NS",
    "STRING",
    "Bag",
    "ContractMessage",
    "ExportReport",
    "FileSummary",
    "Gap",
    "MessageDefinition",
    "OutcomeCounts",
    "Recorded",
    "Recorder",
    "Recording",
    "RecoveryReport",
    "Summary",
    "Timeline",
    "TopicSummary",
    "contract_messages",
    "count_outcomes",
    "export_json",
    "export_tables",
    "gap_in_words",
    "is_recording_file",
    "local_time",
    "offered_qos",
    "open_bag",
    "open_recording",
    "recover",
    "stored",
    "string_cdr",
    "summary",
]
