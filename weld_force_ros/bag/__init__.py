"""Recordings: MCAP in the form that rosbag2 (Jazzy) gives it, written and read without ROS.

While a recording runs, each message is one whole write to an unchunked file, so that a killed process loses none. At
close the file is completed, then rewritten beside in compressed and indexed chunks and exchanged at once: whenever the
process ends, a readable recording lies there. Reading goes straight through the records and needs no index, so that
an intact and a cut file are read alike, the cut one up to the cut.
"""

from weld_force_ros.bag.form import STRING, MessageDefinition, offered_qos, string_cdr
from weld_force_ros.bag.reading import Bag, Recorded, Summary, TopicSummary, open_bag, summary
from weld_force_ros.bag.suite import ContractMessage, ExportReport, contract_messages, export_json
from weld_force_ros.bag.writing import Recorder, RecoveryReport, recover

__all__ = [
    "STRING",
    "Bag",
    "ContractMessage",
    "ExportReport",
    "MessageDefinition",
    "Recorded",
    "Recorder",
    "RecoveryReport",
    "Summary",
    "TopicSummary",
    "contract_messages",
    "export_json",
    "offered_qos",
    "open_bag",
    "recover",
    "string_cdr",
    "summary",
]
