"""Query a campaign's results in SQL, by DuckDB over their Parquet parts.

In a notebook, `connect(Path("results"))` gives a DuckDB connection with views `verdicts`, `vehicles`, `speeds` and
`rejections`, whose `sql(...).df()` is a pandas and `.pl()` a Polars table. Columns are those of `tables`, and
`section`; `vehicles` are the verdicts of all vehicles over a weld. Questions answer with the vehicle that they concern
most: a row a weld.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb
import pyarrow as pa  # type: ignore[import-untyped]

from weld_force_ros.campaign import plan, tables
from weld_force_ros.errors import InputError

_TABLES = {
    "verdicts": tables.VERDICTS,
    "other_vehicles": tables.VERDICTS,
    "speeds": tables.SPEEDS,
    "rejections": tables.REJECTIONS,
}

_WELD = "v.weld_id, v.line, v.section, s.vehicle, v.rail, v.chainage_m"

# The computed speed that is nearest to a given one and not above it.
_AT = """
    SELECT weld_number, vehicle, max_by(speeds, speed_kmh) AS at FROM speeds
    WHERE speed_kmh <= {speed} * (1 + 1e-9) GROUP BY ALL
"""

_OVER = f"""
    SELECT {_WELD}, v.decision, s.at.speed_kmh AS speed_kmh, s.at.peak_force_n AS peak_force_n,
        s.at.p2_force_n AS p2_force_n, s.at.force_20hz_n AS force_20hz_n, s.at.contact_loss_s AS contact_loss_s
    FROM ({_AT.format(speed="$at_kmh")}) s JOIN verdicts v USING (weld_number)
    WHERE CASE WHEN $peak_n IS NULL THEN NOT s.at.within_limits ELSE s.at.peak_force_n > $peak_n END
    QUALIFY row_number() OVER (PARTITION BY v.weld_number ORDER BY s.at.peak_force_n DESC, s.vehicle) = 1
    ORDER BY peak_force_n DESC, v.weld_number
"""  # noqa: S608

_WORSE = f"""
    SELECT {_WELD}, v.decision, v.judged_speed_kmh AS from_kmh, s.at.speed_kmh AS to_kmh,
        now.peak_force_n AS peak_now_n, s.at.peak_force_n AS peak_restricted_n,
        s.at.peak_force_n / now.peak_force_n - 1 AS change
    FROM verdicts v
    JOIN ({_AT.format(speed="$to_kmh")}) s ON s.weld_number = v.weld_number
    JOIN speeds now ON now.weld_number = v.weld_number AND now.vehicle = s.vehicle
        AND now.speed_kmh = v.judged_speed_kmh
    WHERE s.at.speed_kmh < v.judged_speed_kmh AND change > $by
    QUALIFY row_number() OVER (PARTITION BY v.weld_number ORDER BY change DESC, s.vehicle) = 1
    ORDER BY change DESC, v.weld_number
"""  # noqa: S608

# A weld is the same if line, rail and name are; of one that was measured twice, the last counts.
_LAST = """
    SELECT * FROM {prefix}verdicts
    QUALIFY row_number() OVER (PARTITION BY line, rail, weld_id ORDER BY weld_number DESC) = 1
"""
# Forces are compared under one vehicle, the one that decides now.
_CHANGED = f"""
    SELECT coalesce(a.weld_id, b.weld_id) AS weld_id, coalesce(a.line, b.line) AS line,
        coalesce(a.rail, b.rail) AS rail, coalesce(b.chainage_m, a.chainage_m) AS chainage_m,
        a.decision AS decision_before, b.decision AS decision_after,
        a.vehicle AS vehicle_before, b.vehicle AS vehicle_after,
        p.peak_force_n AS peak_before_n, b.peak_force_n AS peak_after_n, b.peak_force_n / p.peak_force_n - 1 AS change
    FROM ({_LAST.format(prefix="before_")}) a
    FULL JOIN ({_LAST.format(prefix="")}) b
        ON a.weld_id = b.weld_id AND a.line = b.line AND a.rail IS NOT DISTINCT FROM b.rail
    LEFT JOIN before_vehicles p ON p.weld_number = a.weld_number AND p.vehicle = coalesce(b.vehicle, a.vehicle)
    WHERE a.decision IS DISTINCT FROM b.decision OR abs(change) > $by
    ORDER BY abs(change) DESC NULLS FIRST, weld_id
"""  # noqa: S608


@dataclass(frozen=True)
class Answer:
    """The result of a query: rows under the names of their columns."""

    columns: list[str]
    rows: list[tuple[Any, ...]]

    @property
    def records(self) -> list[dict[str, Any]]:
        """Rows as dictionaries by column name."""
        return [dict(zip(self.columns, row, strict=True)) for row in self.rows]

    def as_text(self, at_most: int) -> list[list[str]]:
        """Return the first rows as text."""
        return [[_text(cell) for cell in row] for row in self.rows[:at_most]]


def connect(out: Path) -> duckdb.DuckDBPyConnection:
    """Return a connection whose views are a campaign's results.

    Raises:
        InputError: there are none.
    """
    connection = duckdb.connect()
    _add_views(connection, out, prefix="")
    return connection


def _add_views(connection: duckdb.DuckDBPyConnection, out: Path, prefix: str) -> None:
    plan.results(out)
    for name, columns in _TABLES.items():
        # Only whole parts have this name: what is being written has another.
        parts = sorted(str(part) for part in (out / name).rglob("batch-*.parquet"))
        if parts:
            found = connection.read_parquet(parts, hive_partitioning=True)
            # Of results from before a column was added, it is not known.
            for column in (one for one in columns if one.name not in found.columns):
                found = found.project(f'*, CAST(NULL AS VARCHAR) AS "{column.name}"')
        else:
            found = connection.from_arrow(columns.append(pa.field("section", pa.string())).empty_table())
        found.create_view(prefix + name)
    both = f"FROM {prefix}verdicts UNION ALL BY NAME FROM {prefix}other_vehicles"
    connection.sql(both).create_view(f"{prefix}vehicles")


def ask(out: Path, sql: str, **values: Any) -> Answer:
    """Return the answer to SQL over the views of `connect`; `values` are those of its `$names`.

    Raises:
        InputError: no results are there, or DuckDB cannot answer.
    """
    return _answer(connect(out), sql, values)


def fetch(connection: duckdb.DuckDBPyConnection, sql: str, **values: Any) -> Answer:
    """Return the answer to SQL over the views of a connection; `values` are those of its `$names`."""
    found = connection.execute(sql, values or None)
    return Answer([column[0] for column in found.description or ()], found.fetchall())


def _answer(connection: duckdb.DuckDBPyConnection, sql: str, values: dict[str, Any]) -> Answer:
    try:
        return fetch(connection, sql, **values)
    except duckdb.Error as error:
        raise InputError(
            " ".join(str(error).split()), "ask over the views verdicts, vehicles, speeds and rejections"
        ) from None
    finally:
        connection.close()


def over(out: Path, at_kmh: float, peak_n: float | None = None) -> Answer:
    """Return the welds over a limit at a speed, the worst first.

    Args:
        out: the campaign's folder.
        at_kmh: the speed; of those computed, the nearest that is not above it counts.
        peak_n: limit of the peak force; if None, the campaign's limits for a line of that speed count.
    """
    return ask(out, _OVER, at_kmh=at_kmh, peak_n=peak_n)


def worse_if_restricted(out: Path, to_kmh: float, by: float = 0.0) -> Answer:
    """Return the welds whose peak force at the line's speed is less than after a restriction, the most harmed first.

    Args:
        out: the campaign's folder.
        to_kmh: the restriction; of the speeds computed, the nearest that is not above it counts.
        by: only those whose peak force rises by more than this share.
    """
    return ask(out, _WORSE, to_kmh=to_kmh, by=by)


def changed(before: Path, after: Path, by: float = float("inf")) -> Answer:
    """Return the welds of two campaigns that are decided otherwise, or are in one of them only.

    Args:
        before: the earlier campaign's folder.
        after: the later one's.
        by: also those whose peak force changed by more than this share.
    """
    connection = connect(after)
    _add_views(connection, before, prefix="before_")
    return _answer(connection, _CHANGED, {"by": by})


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)
