"""Turn messages into pandas DataFrames, with the columns of exported tables."""

from collections.abc import Iterable

import pandas as pd

from weld_force_ros.messages import Message
from weld_force_ros.recording.table_export import TABLES

_TABLES = {table.name: table for table in TABLES}


def of(name: str, messages: Iterable[Message]) -> pd.DataFrame:
    """Return messages as the table of a name, a row or several for each; what is not stated is missing."""
    table = _TABLES[name]
    return pd.DataFrame([row for message in messages for row in table.rows(message)], columns=list(table.columns))
