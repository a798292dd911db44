"""Write the summary page of a campaign: how forces and decisions are distributed, and the worst welds.

The page does not grow with the campaign.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import duckdb

from weld_force_ros._files import write_whole
from weld_force_ros._words import Words, english
from weld_force_ros.campaign import plan as plans
from weld_force_ros.campaign import query, summary_figures
from weld_force_ros.campaign.plan import Plan
from weld_force_ros.errors import InputError, os_errors_as
from weld_force_ros.report import weld_words
from weld_force_ros.report.html_page import self_contained
from weld_force_ros.report.numbers import decimals
from weld_force_ros.report.page_header import header
from weld_force_ros.report.quantities import kilometres, kilonewtons, kmh, percent
from weld_force_ros.report.templates import SIGNS

FILE = "summary.html"
WORST = 50
SCRIPTS = ("dom.js", "campaign.js")
_BIN_N = 10e3
_STRETCHES = 120
_WELDS_A_STRETCH = 8  # at least, so that no stretch is empty for want of welds
_LINES = 12  # whose chainage is drawn
_WORST_OF_STRETCH = 3
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
    SELECT weld_id, line, section, vehicle, rail, chainage_m, decision, geometry_answer, force_answer, peak_force_n,
        worst_speed_kmh, worst_criterion, worst_ratio, permitted_speed_kmh, judged_speed_kmh
    FROM verdicts ORDER BY worst_ratio DESC, peak_force_n DESC, weld_number LIMIT $worst
"""

_CHAINAGES = """
    SELECT line, min(chainage_m) AS first_m, max(chainage_m) AS last_m, count(*) AS n FROM verdicts
    WHERE chainage_m IS NOT NULL GROUP BY line ORDER BY n DESC, line LIMIT $lines
"""

_STRETCH = "least(floor(({of}.chainage_m - $first_m) / $stretch_m), $last)::INT"

_ALONG = f"""
    SELECT {_STRETCH.format(of="v")} AS stretch, s.speed_kmh, max(s.peak_force_n) AS peak_n
    FROM verdicts v JOIN speeds s USING (weld_number)
    WHERE v.line = $line AND v.chainage_m IS NOT NULL GROUP BY ALL
"""  # noqa: S608

_STRETCHES_OF = f"""
    SELECT {_STRETCH.format(of="v")} AS stretch, count(*) AS n, histogram(decision) AS decisions,
        max(peak_force_n) AS peak_n,
        (list({{'weld': weld_id, 'decision': decision, 'chainage_m': chainage_m, 'ratio': worst_ratio}}
            ORDER BY worst_ratio DESC, weld_number))[1:$worst] AS worst
    FROM verdicts v WHERE v.line = $line AND v.chainage_m IS NOT NULL GROUP BY stretch ORDER BY stretch
"""  # noqa: S608

_REJECTIONS = """
    SELECT reason, count(*) AS n, min(source) AS example FROM rejections
    GROUP BY reason ORDER BY n DESC, reason LIMIT 20
"""


def write(out: Path) -> Path:
    """Write the summary of a campaign's results beside them.

    Raises:
        InputError: there are none, jinja2 is not installed, or the page cannot be written.
    """
    page = out / FILE
    with os_errors_as(InputError, page, "name a file in a writable folder"):
        write_whole(page, html(out).encode())
    return page


def html(out: Path) -> str:
    """Return the page; the same for the same results."""
    plan, words = plans.results(out), english()
    connection = query.connect(out)
    try:
        content = _content(plan, connection, words)
    finally:
        connection.close()
    vehicles = sorted({name for section in plan.sections for name in section.vehicles})
    return self_contained(
        "campaign.html",
        SCRIPTS,
        words,
        title=plan.name,
        about=words("summary.about", welds=f"{plan.welds:,}", sections=len(plan.sections),
                    vehicles=", ".join(vehicles), software=plan.software),
        facts={"live": False, "newest": None, "title": plan.name, "signs": SIGNS,
               "words": {"script": words.section("script")}},
        styles=("campaign.css",),
        **content,
    )  # fmt: skip


def _content(plan: Plan, connection: duckdb.DuckDBPyConnection, words: Words) -> dict[str, Any]:
    decisions = {row["decision"]: row["n"] for row in _records(connection, _DECISIONS)}
    forces = _records(connection, _FORCES)
    rejected = connection.execute("SELECT count(*) FROM rejections").fetchall()[0][0]
    judged = sum(decisions.values())
    chips = [(name, f"{decisions[name]:,}", percent(decisions[name] / judged)) for name in SIGNS if name in decisions]
    if rejected:
        chips.append(("unusable", f"{rejected:,}", words("summary.no_verdict")))
    lines = _records(connection, _CHAINAGES, lines=_LINES)
    return {
        "header": header([], [plan.limits], words),
        "chips": chips,
        "histogram": summary_figures.histogram(forces, _BIN_N, words) if forces else "",
        "strips": [_along(connection, number, line, words) for number, line in enumerate(lines)],
        "worst": [_worst(row, words) for row in _records(connection, _WORST, worst=WORST)],
        "groups": [_group(connection, by, words) for by in _GROUPS_BY],
        "rejections": _records(connection, _REJECTIONS),
        "decisions": [name for name in SIGNS if name != "unusable"],
    }


def _worst(row: Mapping[str, Any], words: Words) -> dict[str, Any]:
    """Return a weld as it is shown: one row, under the vehicle that decides."""
    chainage, ratio = row["chainage_m"], row["worst_ratio"]
    permitted = 0.0 if row["permitted_speed_kmh"] is None else row["permitted_speed_kmh"]
    place = (row["line"] and words("card.line", line=row["line"]), row["rail"], row["section"],
             None if chainage is None else kilometres(chainage))  # fmt: skip
    over = ratio is None or ratio == float("inf")
    return {
        "weld": row["weld_id"],
        "place": " · ".join(filter(None, place)),
        "decision": row["decision"],
        "geometry": row["geometry_answer"],
        "force": row["force_answer"],
        "vehicle": row["vehicle"],
        "criterion": weld_words.criterion_name(row["worst_criterion"], words),
        "times": words("phrase.limit_is_0") if over else words("phrase.times_limit", ratio=f"{ratio:.2f}"),
        "peak": words("summary.peak_at", peak=kilonewtons(row["peak_force_n"]), speed=kmh(row["worst_speed_kmh"])),
        "permitted": weld_words.highest_speed(permitted, row["judged_speed_kmh"], words),
    }


def _group(connection: duckdb.DuckDBPyConnection, by: str, words: Words) -> dict[str, Any]:
    view, name = _GROUPS_BY[by]
    rows = []
    for row in _records(connection, _GROUPED.format(view=view, group=name), groups=_GROUPS):
        shares = {one: row["decisions"].get(one, 0) for one in SIGNS}
        said = ", ".join(f"{words(f'decision.{one}')} {percent(n / row['n'])}" for one, n in shares.items() if n)
        rows.append({
            "name": row["name"],
            "n": f"{row['n']:,}",
            "bar": summary_figures.share_bar(row["decisions"], row["n"], f"{row['name']}: {said}"),
            "shares": {one: percent(n / row["n"]) if n else "–" for one, n in shares.items()},
            "forces": [kilonewtons(row[column]) for column in ("median_n", "high_n", "most_n")],
        })  # fmt: skip
    return {"by": by, "rows": rows}


def _along(connection: duckdb.DuckDBPyConnection, number: int, line: dict[str, Any], words: Words) -> dict[str, Any]:
    """Return a line's strip and its stretches."""
    count = max(1, min(_STRETCHES, line["n"] // _WELDS_A_STRETCH))
    stretch_m = max((line["last_m"] - line["first_m"]) / count, 1.0)
    where = {"line": line["line"], "first_m": line["first_m"], "stretch_m": stretch_m, "last": count - 1}
    cells = _records(connection, _ALONG, **where)
    speeds = sorted({cell["speed_kmh"] for cell in cells})
    stretches: list[dict[str, Any] | None] = [None] * (max(cell["stretch"] for cell in cells) + 1)
    peaks: list[list[float | None]] = [[None] * len(stretches) for _ in speeds]
    for cell in cells:
        peaks[speeds.index(cell["speed_kmh"])][cell["stretch"]] = round(cell["peak_n"] / 1e3, 1)
    for row in _records(connection, _STRETCHES_OF, worst=_WORST_OF_STRETCH, **where):
        first_m = line["first_m"] + row["stretch"] * stretch_m
        stretches[row["stretch"]] = _stretch(
            row, f"line-{number}-{row['stretch']}", first_m, first_m + stretch_m, words
        )
    name = line["line"] or words("summary.the_line")
    content = {"name": name, "peaks_kn": peaks, "stretches": stretches}
    flat = [cell for row in peaks for cell in row if cell is not None]
    return {
        **content,
        "svg": summary_figures.strip(content, words),
        "km": decimals([line["first_m"] / 1e3, (line["first_m"] + len(stretches) * stretch_m) / 1e3], 3),
        "speeds": words("summary.speeds", first=f"{speeds[0]:g}", last=kmh(speeds[-1])),
        "scale": f"{min(flat):.0f} – {max(flat):.0f} kN",
    }


def _stretch(row: Mapping[str, Any], name: str, first_m: float, last_m: float, words: Words) -> dict[str, Any]:
    counts = row["decisions"]
    shares = ", ".join(f"{words(f'decision.{one}')} {counts[one]}" for one in SIGNS if counts.get(one))
    peak = kilonewtons(row["peak_n"])
    place = words("summary.stretch", first=f"{first_m / 1e3:.3f}", last=f"{last_m / 1e3:.3f}")
    return {
        "id": name,
        "n": row["n"],
        "decisions": counts,
        "place": place,
        "shares": shares,
        "peak": peak,
        "label": words("summary.stretch_label", place=place, n=row["n"], shares=shares, peak=peak),
        "worst": [(one["weld"], one["decision"], kilometres(one["chainage_m"])) for one in row["worst"]],
    }  # fmt: skip


def _records(connection: duckdb.DuckDBPyConnection, sql: str, **values: Any) -> list[dict[str, Any]]:
    return query.fetch(connection, sql, **values).records
