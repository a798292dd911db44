"""Write the summary page of a campaign: how forces and decisions are distributed, and the worst welds.

The page does not grow with the campaign.
"""

from pathlib import Path
from typing import Any

import duckdb

from weld_force_ros._files import write_whole
from weld_force_ros.campaign import plan as plans
from weld_force_ros.campaign import query
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.report.html_page import self_contained
from weld_force_ros.report.numbers import short

FILE = "summary.html"
WORST = 50
_SCRIPTS = ("words.js", "source.js", "charts.js", "campaign.js")
_BIN_N = 10e3
_STRETCHES = 120
_WELDS_A_STRETCH = 8  # at least, so that no stretch is empty for want of welds
_LINES = 12  # whose chainage is drawn
_GROUPS = 40  # of one kind, the largest

_DECISIONS = "SELECT decision, count(*) AS n FROM verdicts GROUP BY decision ORDER BY n DESC"

_FORCES = f"""
    SELECT floor(peak_force_n / {_BIN_N}) * {_BIN_N} AS from_n, decision, count(*) AS n FROM verdicts
    GROUP BY ALL ORDER BY from_n
"""  # noqa: S608

_GROUPED = """
    WITH named AS (SELECT {group} AS name, decision, peak_force_n FROM {view}),
        largest AS (SELECT name FROM named GROUP BY name ORDER BY count(*) DESC, name LIMIT $groups)
    SELECT name, count(*) AS n, histogram(decision) AS decisions, median(peak_force_n) AS median_n,
        quantile_cont(peak_force_n, 0.95) AS high_n, max(peak_force_n) AS most_n
    FROM named WHERE name IN (FROM largest) GROUP BY name ORDER BY name
"""
_GROUPS_BY = {  # heading: view, and the name of the group in it
    "line": ("verdicts", "CASE line WHEN '' THEN 'unnamed line' ELSE line END"),
    "section and vehicle": ("vehicles", "section || ', ' || vehicle"),
    "vehicle that decides": ("verdicts", "vehicle"),
    "class": (
        "verdicts",
        "geometry_kind || ', ' || CASE curve_class WHEN 'hollow' THEN 'force falls with speed somewhere' "
        "ELSE 'force rises with speed' END",
    ),
    "line speed": (
        "verdicts",
        "CASE WHEN line_speed_kmh IS NULL THEN 'unknown' ELSE printf('%4d km/h', line_speed_kmh::INT) END",
    ),
    "worst position": ("verdicts", "printf('%3d cm after the sleeper', round(100 * worst_position_m)::INT)"),
}

_WORST = """
    SELECT weld_number, weld_id, line, section, vehicle, rail, chainage_m, decision, peak_force_n, worst_speed_kmh,
        worst_running, worst_criterion, worst_ratio, permitted_speed_kmh, judged_speed_kmh
    FROM verdicts ORDER BY worst_ratio DESC, peak_force_n DESC, weld_number LIMIT $worst
"""

_CHAINAGES = """
    SELECT line, min(chainage_m) AS first_m, max(chainage_m) AS last_m, count(*) AS n FROM verdicts
    WHERE chainage_m IS NOT NULL GROUP BY line ORDER BY n DESC, line LIMIT $lines
"""

_ALONG = """
    SELECT least(floor((v.chainage_m - $first_m) / $stretch_m), $last)::INT AS stretch, s.speed_kmh,
        max(s.peak_force_n) AS peak_n
    FROM verdicts v JOIN speeds s USING (weld_number)
    WHERE v.line = $line AND v.chainage_m IS NOT NULL GROUP BY ALL
"""

_REJECTIONS = """
    SELECT reason, count(*) AS n, min(source) AS example FROM rejections
    GROUP BY reason ORDER BY n DESC, reason LIMIT 20
"""


def write(out: Path) -> Path:
    """Write the summary of a campaign's results beside them.

    Raises:
        InputError: there are none, plotly or jinja2 is not installed, or the page cannot be written.
    """
    page = out / FILE
    with os_errors_as(InputError, page, "name a file in a writable folder"):
        write_whole(page, html(out).encode())
    return page


def html(out: Path) -> str:
    """Return the page; the same for the same results."""
    plan = plans.results(out)
    connection = query.connect(out)
    try:
        facts = _facts(plan, connection)
        worst = _records(connection, _WORST, worst=WORST)
    finally:
        connection.close()
    vehicles = sorted({name for section in plan.sections for name in section.vehicles})
    return self_contained(
        "campaign.html",
        _SCRIPTS,
        title=plan.name,
        about=f"{facts['welds']:,} welds, {len(plan.sections)} sections, {', '.join(vehicles)}; {plan.software}",
        facts=short(facts),
        rows=short([{name: cell for name, cell in row.items() if cell is not None} for row in worst]),
    )


def _facts(plan: Plan, connection: duckdb.DuckDBPyConnection) -> dict[str, Any]:
    return {
        "title": plan.name,
        "welds": plan.welds,
        "unverified": sum(not limit.verified for limit in plan.limits.limits),
        "limits": len(plan.limits.limits),
        "decisions": _records(connection, _DECISIONS),
        "bin_n": _BIN_N,
        "forces": _records(connection, _FORCES),
        "groups": [
            {"by": by, "rows": _records(connection, _GROUPED.format(view=view, group=group), groups=_GROUPS)}
            for by, (view, group) in _GROUPS_BY.items()
        ],
        "lines": [_along(connection, line) for line in _records(connection, _CHAINAGES, lines=_LINES)],
        "rejections": _records(connection, _REJECTIONS),
        "rejected": connection.execute("SELECT count(*) FROM rejections").fetchall()[0][0],
    }


def _along(connection: duckdb.DuckDBPyConnection, line: dict[str, Any]) -> dict[str, Any]:
    """Return the maximum force over chainage and speed of a line: (n_speed, n_stretch), None where no weld is."""
    stretches = max(1, min(_STRETCHES, line["n"] // _WELDS_A_STRETCH))
    stretch_m = max((line["last_m"] - line["first_m"]) / stretches, 1.0)
    cells = _records(
        connection, _ALONG, line=line["line"], first_m=line["first_m"], stretch_m=stretch_m, last=stretches - 1
    )
    speeds = sorted({cell["speed_kmh"] for cell in cells})
    count = max(cell["stretch"] for cell in cells) + 1
    peaks: list[list[float | None]] = [[None] * count for _ in speeds]
    for cell in cells:
        peaks[speeds.index(cell["speed_kmh"])][cell["stretch"]] = round(cell["peak_n"] / 1e3, 1)
    return {
        "line": line["line"], "first_m": line["first_m"], "stretch_m": stretch_m, "speeds_kmh": speeds,
        "peaks_kn": peaks,
    }  # fmt: skip


def _records(connection: duckdb.DuckDBPyConnection, sql: str, **values: Any) -> list[dict[str, Any]]:
    return query.fetch(connection, sql, **values).records
