"""Draw a campaign: how peak forces are distributed, and a strip along the chainage of each line."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

import numpy as np

from weld_force_ros._words import Words
from weld_force_ros.report.quantities import kilonewtons
from weld_force_ros.report.svg_figure import SCALE, WIDTH, Axis, Panel, figure, shades_of
from weld_force_ros.report.templates import SIGNS

STRIP_HEIGHT, DECISIONS_HEIGHT = 100, 30
"""Of a strip's own units; in the upper part stand the shares of decisions."""
_UPWARDS = [name for name in reversed(SIGNS) if name != "unusable"]


def histogram(forces: Sequence[Mapping[str, Any]], bin_n: float, words: Words) -> str:
    """Draw welds by peak force, stacked by decision.

    Args:
        forces: rows of `from_n`, `decision` and `n`.
        bin_n: breadth of a bar.
        words: of the page.
    """
    starts = sorted({row["from_n"] for row in forces})
    counts = {(row["from_n"], row["decision"]): row["n"] for row in forces}
    most = max(sum(counts.get((start, one), 0) for one in _UPWARDS) for start in starts)
    x = Axis(starts[0] / 1e3, (starts[-1] + bin_n) / 1e3, 52.0, WIDTH - 10.0)
    panel = Panel(x, Axis(0.0, 1.05 * most, 190.0, 20.0))
    panel.frame(words("summary.peak_kn"), words("summary.welds"))
    for start in starts:
        below = 0
        for decision in _UPWARDS:
            count = counts.get((start, decision), 0)
            if count:
                panel.parts.append(_bar(panel, start / 1e3, (start + bin_n) / 1e3, below, below + count, decision))
            below += count
    return figure(224, words("summary.histogram_label", most=kilonewtons(starts[-1] + bin_n)), [panel])


def _bar(panel: Panel, left: float, right: float, low: float, high: float, css: str) -> str:
    (x0, x1), (y0, y1) = panel.x.at([left, right]), panel.y.at([low, high])
    return f'<rect class="{css}" x="{x0 + 6}" y="{y1}" width="{max(6, x1 - x0 - 12)}" height="{max(8, y0 - y1)}"/>'


def strip(line: Mapping[str, Any], words: Words) -> str:
    """Draw a line along its chainage: shares of decisions in each stretch, and below them forces by speed.

    Each stretch is a link to its row in the table of stretches.

    Args:
        line: of `summary`: its `number`, `stretches` and `peaks_kn` (n_speed, n_stretch), None where no weld is.
        words: of the page.
    """
    peaks = np.array([[np.nan if cell is None else cell for cell in row] for row in line["peaks_kn"]], dtype=np.float64)
    count = peaks.shape[1]
    low, high = float(np.nanmin(peaks)), float(np.nanmax(peaks))
    forces = Panel(
        Axis(0.0, count, 0.0, count / SCALE),
        Axis(0.0, 1.0, STRIP_HEIGHT / SCALE, (DECISIONS_HEIGHT + 2) / SCALE),
    )
    forces.image(shades_of(np.nan_to_num(peaks, nan=low), low, high), words("figure.map_title"))
    parts = list(forces.parts)
    for at, stretch in enumerate(line["stretches"]):
        if stretch is None:
            parts.append(f'<rect class="empty" x="{at}" y="0" width="1" height="{STRIP_HEIGHT}"/>')
            continue
        top = 0.0
        shares = []
        for decision in _UPWARDS:
            height = DECISIONS_HEIGHT * stretch["decisions"].get(decision, 0) / stretch["n"]
            if height:
                shares.append(f'<rect class="{decision}" x="{at}" y="{top:.4g}" width="1" height="{height:.4g}"/>')
            top += height
        shares.append(f'<rect class="target" x="{at}" y="0" width="1" height="{STRIP_HEIGHT}"/>')
        name = escape(stretch["label"])
        parts.append(f'<a href="#{stretch["id"]}" aria-label="{name}"><title>{name}</title>{"".join(shares)}</a>')
    return (
        f'<svg class="strip" viewBox="0 0 {count} {STRIP_HEIGHT}" preserveAspectRatio="none" role="group" '
        f'aria-label="{escape(words("summary.strip_label", line=line["name"]))}">{"".join(parts)}</svg>'
    )


def share_bar(decisions: Mapping[str, int], total: int, label: str) -> str:
    """Draw the shares of decisions as one bar."""
    parts, left = [], 0.0
    for decision in _UPWARDS:
        width = 100 * decisions.get(decision, 0) / total
        if width:
            parts.append(f'<rect class="{decision}" x="{left:.4g}" width="{width:.4g}" height="10"/>')
        left += width
    return (
        f'<svg class="share" viewBox="0 0 100 10" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(label)}"><title>{escape(label)}</title>{"".join(parts)}</svg>'
    )
