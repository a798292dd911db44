"""Draw line figures as SVG: whole numbers, relative steps and style sheet classes, some kilobytes each.

Every text that is drawn is escaped here. What a pointer reads off a line stands in its attributes: its name, its unit,
and the values at the ends of its axes.
"""

import base64
import struct
import zlib
from dataclasses import dataclass, field
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

WIDTH, SCALE = 400, 10  # of a figure; so many units are a pixel
_VIRIDIS = (
    (68, 1, 84), (72, 40, 120), (62, 74, 137), (49, 104, 142), (38, 130, 142), (31, 158, 137), (53, 183, 121),
    (109, 205, 89), (180, 222, 44), (253, 231, 37),
)  # fmt: skip
_SHADES = 32
_UNSEEN = 2  # units: a fifth of a pixel


@dataclass(frozen=True)
class Axis:
    """Values from `low` to `high` between two places in pixels."""

    low: float
    high: float
    start: float
    end: float

    def at(self, values: ArrayLike) -> NDArray[np.int64]:
        """Return where values lie, in the figure's units."""
        share = (np.asarray(values, dtype=np.float64) - self.low) / (self.high - self.low)
        return np.round(SCALE * (self.start + share * (self.end - self.start))).astype(np.int64)

    def ticks(self, at_most: int) -> list[float]:
        """Return round values along the axis."""
        raw = (self.high - self.low) / at_most
        power = 10.0 ** np.floor(np.log10(raw))
        step = next(power * nice for nice in (1.0, 2.0, 5.0, 10.0) if power * nice >= raw * (1 - 1e-9))
        count = np.arange(np.ceil(self.low / step - 1e-9), np.floor(self.high / step + 1e-9) + 1)
        ticks: list[float] = (count * step + 0.0).tolist()
        return ticks


def axis_of(values: ArrayLike, start: float, end: float, *, least: float = 0.0, from_zero: bool = False) -> Axis:
    """Return an axis that all values lie on with some room; at least `least` long, and from 0 on if asked for."""
    finite = np.asarray(values, dtype=np.float64)
    low, high = float(finite.min()), float(finite.max())
    room = max(0.06 * (high - low), (least - (high - low)) / 2, 1e-12)
    return Axis(0.0 if from_zero else low - room, high + room, start, end)


@dataclass
class Panel:
    """A field between two axes; what is drawn first lies below.

    Args:
        x: along the figure.
        y: upwards.
    """

    x: Axis
    y: Axis
    parts: list[str] = field(default_factory=list)

    def frame(self, x_title: str, y_title: str, *, x_ticks: int = 7, y_ticks: int = 4) -> None:
        """Draw grid lines with their values and the axes' titles."""
        x0, x1, y0, y1 = (SCALE * v for v in (self.x.start, self.x.end, self.y.start, self.y.end))
        lines, texts = [], []
        for value in self.y.ticks(y_ticks):
            at = int(self.y.at(value))
            lines.append(f"M{x0:.0f} {at}H{x1:.0f}")
            texts.append(_text(x0 - 50, at + 40, f"{value:.6g}".replace("-", "−"), "e"))
        if x_title:
            for value in self.x.ticks(x_ticks):
                at = int(self.x.at(value))
                lines.append(f"M{at} {y0:.0f}v40")
                texts.append(_text(at, y0 + 150, f"{value:.6g}".replace("-", "−"), "m"))
            texts.append(_text((x0 + x1) / 2, y0 + 290, x_title, "m"))
        texts.append(_text(0, y1 - 60, y_title, "t"))
        self.parts.append(f'<path class="grid" d="{"".join(lines)}"/>')
        self.parts.append(f'<path class="box" d="M{x0:.0f} {y1:.0f}V{y0:.0f}H{x1:.0f}"/>')
        self.parts.extend(texts)

    def line(self, x: ArrayLike, y: ArrayLike, css: str, name: str = "", unit: str = "") -> None:
        """Draw a line; one with a name can be read off."""
        read = f' data-name="{escape(name)}" data-unit="{escape(unit)}" data-y="{_axis(self.y)}"' if name else ""
        self.parts.append(f'<path class="{css}" d="{_steps(*_needed(self.x.at(x), self.y.at(y)))}"{read}/>')

    def band(self, x: ArrayLike, low: ArrayLike, high: ArrayLike, css: str) -> None:
        """Fill what lies between two lines."""
        along = self.x.at(x)
        (x_low, y_low), (x_high, y_high) = (_needed(along, self.y.at(side)) for side in (low, high))
        outline = _steps(np.concatenate([x_low, x_high[::-1]]), np.concatenate([y_low, y_high[::-1]]))
        self.parts.append(f'<path class="{css}" d="{outline}z"/>')

    def dots(self, x: ArrayLike, y: ArrayLike, css: str) -> None:
        """Draw a dot at each point."""
        along, up = self.x.at(x), self.y.at(y)
        steps = zip(np.diff(along, prepend=0) - 1, np.diff(up, prepend=0), strict=True)
        marks = "".join(f"m{a}{'' if b < 0 else ' '}{b}h1" for a, b in steps)
        self.parts.append(f'<path class="{css}" d="m1 0{marks}"/>')

    def span(self, low: float, high: float, css: str) -> None:
        """Shade the field from one value of x to another."""
        left, right = sorted(int(v) for v in self.x.at([low, high]))
        top, bottom = SCALE * self.y.end, SCALE * self.y.start
        self.parts.append(
            f'<rect class="{css}" x="{left}" y="{top:.0f}" width="{max(10, right - left)}" '
            f'height="{bottom - top:.0f}"/>'
        )

    def vertical(self, x: float, css: str, text: str = "", row: int = 0) -> None:
        """Draw a line across the field with a text beside it, on one of several rows from the top."""
        at, top, bottom = int(self.x.at(x)), SCALE * self.y.end, SCALE * self.y.start
        self.parts.append(f'<path class="{css}" d="M{at} {top:.0f}V{bottom:.0f}"/>')
        if text:
            is_right = at > SCALE * (self.x.start + self.x.end) / 2
            aside, anchor = (-40, "e") if is_right else (40, "t")
            self.parts.append(_text(at + aside, top + 110 + 130 * row, text, f"{anchor} {css}"))

    def horizontal(
        self, y: float, css: str, text: str = "", *, first: float | None = None, last: float | None = None
    ) -> None:
        """Draw a line along the field, or along a part of it, with a text above its end."""
        left = int(self.x.at(self.x.low if first is None else first))
        right = int(self.x.at(self.x.high if last is None else last))
        at = int(self.y.at(y))
        self.parts.append(f'<path class="{css}" d="M{left} {at}H{right}"/>')
        if text:
            self.parts.append(_text(right - 30, at - 35, text, f"e {css}"))

    def text(self, x: float, y: float, text: str, css: str) -> None:
        """Write at a point of the field; classes m and e centre and right-align."""
        self.parts.append(_text(int(self.x.at(x)), int(self.y.at(y)), text, css))

    def ends(self, left: str, right: str) -> None:
        """Name what lies beyond both ends, below the title of the axis."""
        below = SCALE * self.y.start + 410
        self.parts.append(_text(0, below, f"← {left}", "t end"))
        self.parts.append(_text(SCALE * self.x.end, below, f"{right} →", "e end"))

    def cross(self, x: float, y: float, css: str) -> None:
        """Mark a point."""
        a, b = int(self.x.at(x)), int(self.y.at(y))
        self.parts.append(f'<path class="{css}" d="M{a - 50} {b - 50}l100 100m0-100l-100 100"/>')

    def image(self, shades: NDArray[np.uint8], name: str) -> None:
        """Fill the field with cells of 0 to 255, (n_y, n_x), the first row at the bottom."""
        x0, x1, y0, y1 = (SCALE * v for v in (self.x.start, self.x.end, self.y.start, self.y.end))
        self.parts.append(
            f'<image class="cells" x="{x0:.0f}" y="{y1:.0f}" width="{x1 - x0:.0f}" height="{y0 - y1:.0f}" '
            f'preserveAspectRatio="none" href="{_png(shades[::-1])}"><title>{escape(name)}</title></image>'
        )


def arrow(running: str, text: str, y_px: float = 9) -> str:
    """Return an arrow of the running direction with its words, in a figure's upper right corner.

    Args:
        running: with: to the right, in which x rises; against: to the left; both.
        text: to the left of it.
        y_px: of its middle.
    """
    right, y = SCALE * (WIDTH - 4), SCALE * y_px
    left = right - 340
    heads = ""
    if running != "against":
        heads += f"M{right - 90} {y - 45:.0f}l90 45l-90 45"
    if running != "with":
        heads += f"M{left + 90} {y - 45:.0f}l-90 45l90 45"
    return f'<path class="arrow" d="M{left} {y:.0f}H{right}{heads}"/>' + _text(left - 40, y + 40, text, "e arrow-text")


def figure(height: float, label: str, panels: list[Panel], extra: str = "", css: str = "", **data: str) -> str:
    """Return the SVG of panels; `data` become attributes that the page's script reads.

    Args:
        height: in pixels.
        label: what it shows, for whoever hears it.
        panels: of one axis along the figure.
        extra: further SVG on top.
        css: class of the figure.
        data: of the `data-` attributes.
    """
    attributes = "".join(f' data-{name}="{escape(value)}"' for name, value in data.items())
    body = "".join(part for panel in panels for part in panel.parts)
    return (
        f'<svg class="figure {css}" viewBox="0 0 {WIDTH * SCALE} {height * SCALE:.0f}" role="img" '
        f'aria-label="{escape(label)}" data-x="{_axis(panels[0].x)}"{attributes}>{body}{extra}</svg>'
    )


def shades_of(values: NDArray[np.float64], low: float, high: float) -> NDArray[np.uint8]:
    """Return values as shades from 0 to 255."""
    return np.round(255 * np.clip((values - low) / max(high - low, 1e-12), 0, 1)).astype(np.uint8)


def _colours(shares: NDArray[np.float64]) -> NDArray[np.float64]:
    anchors = np.array(_VIRIDIS, dtype=np.float64)
    at = shares * (len(anchors) - 1)
    return np.stack([np.interp(at, np.arange(len(anchors)), anchors[:, c]) for c in range(3)], axis=1)


def _png(shades: NDArray[np.uint8]) -> str:
    """Return an image with a palette as a data address."""
    palette = np.round(_colours(np.linspace(0, 1, _SHADES))).astype(np.uint8).tobytes()
    rows = b"".join(b"\0" + row.tobytes() for row in (shades // (256 // _SHADES)).astype(np.uint8))
    height, width = shades.shape
    header = struct.pack(">IIBBBBB", width, height, 8, 3, 0, 0, 0)
    chunks = ((b"IHDR", header), (b"PLTE", palette), (b"IDAT", zlib.compress(rows, 9)), (b"IEND", b""))
    packed = b"".join(struct.pack(">I", len(d)) + k + d + struct.pack(">I", zlib.crc32(k + d)) for k, d in chunks)
    return "data:image/png;base64," + base64.b64encode(b"\x89PNG\r\n\x1a\n" + packed).decode()


def _axis(axis: Axis) -> str:
    return f"{axis.low:.6g} {axis.high:.6g} {SCALE * axis.start:.0f} {SCALE * axis.end:.0f}"


def _steps(x: NDArray[np.int64], y: NDArray[np.int64]) -> str:
    """Return a path by relative steps: half the characters of one by places."""
    if len(x) == 1:
        return f"M{x[0]} {y[0]}h0"
    parts = [f"M{x[0]} {y[0]}l"]
    for dx, dy in zip(np.diff(x).tolist(), np.diff(y).tolist(), strict=True):
        parts.append(f"{dx}{'' if dy < 0 else ' '}{dy}")
    return parts[0] + " ".join(parts[1:]).replace(" -", "-")


def _needed(x: NDArray[np.int64], y: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the points of a line, x rising, without which it would pass another by more than `_UNSEEN` in height."""
    kept, first, low, high = [0], 0, -np.inf, np.inf
    for i in range(1, len(x)):
        run = x[i] - x[first]
        if not (run and low <= (y[i] - y[first]) / run <= high):
            first, low, high = i - 1, -np.inf, np.inf
            kept += [first] if kept[-1] < first else []
            run = x[i] - x[first]
        if run:
            low, high = max(low, (y[i] - _UNSEEN - y[first]) / run), min(high, (y[i] + _UNSEEN - y[first]) / run)
        else:  # straight up or down
            first, low, high = i, -np.inf, np.inf
            kept.append(i)
    kept += [len(x) - 1] if kept[-1] < len(x) - 1 else []
    return x[kept], y[kept]


def _text(x: float, y: float, text: str, css: str) -> str:
    return f'<text class="{css}" x="{x:.0f}" y="{y:.0f}">{escape(text)}</text>'
