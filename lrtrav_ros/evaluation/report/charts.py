"""Charts as HTML: lines and stacked bars that keep their letters' size on every width of screen, without scripts.

The lines stand in an SVG that is stretched to the room there is; all text around it is HTML. Series are told by the
classes ``s0``, ``s1`` … of the style sheet, and the parts of bars by ``p0``, ``p1`` …
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

_HEIGHT = 100.0
_N_LABELS = 6


@dataclass(frozen=True, slots=True)
class Series:
    """A line: its name, the number of its colour, and a value for each point, None where there is none."""

    name: str
    colour: int
    values: tuple[float | None, ...]


def line_chart(
    title: str,
    series: Sequence[Series],
    labels: Sequence[str],
    *,
    top: float | None = None,
    every_label: bool = False,
    reference: Sequence[float] = (),
) -> str:
    """Return a chart with a line for each series.

    Parameters
    ----------
    title : str
        Stands above it.
    series : sequence of Series
        The lines, with a value for each point.
    labels : sequence of str
        Names of the points; shown with all values where the pointer rests on them.
    top : float, optional
        The largest value that there can be, at which the axis ends, such as 1 for a share; without it the axis
        begins at 0 and ends where the values do.
    every_label : bool
        Write all the labels below the axis; else the numbers of some points, from 1 on.
    reference : sequence of float
        What the values should be, as a dashed line; none by default.
    """
    values = [value for item in series for value in item.values if value is not None]
    low, high = _limits([*values, *reference], top)
    lines = _reference(reference, low, high) + "".join(_line(item, low, high) for item in series)
    ticks = _ticks(low, high)
    grid = "".join(f'<path class="grid" d="M0 {_y(tick, low, high)}H{len(labels)}"/>' for tick in ticks)
    hits = "".join(_hit(i, label, series) for i, label in enumerate(labels))
    scale = "".join(f'<span style="top:{_y(tick, low, high)}%">{tick:g}</span>' for tick in ticks)
    return (
        f'<figure class="chart"><figcaption>{escape(title)}</figcaption><div class="plot"><div class="y">{scale}</div>'
        f'<svg viewBox="0 0 {max(len(labels), 1)} {_HEIGHT:g}" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(title)}">{grid}{lines}{hits}</svg>'
        f'<div class="x">{_x_labels(labels, every_label=every_label)}</div></div></figure>'
    )


def _limits(values: Sequence[float], top: float | None) -> tuple[float, float]:
    """Return the ends of the axis: all values are between them."""
    if top is None:
        greatest = max(values, default=0.0)
        parts = 10 if greatest > 0.1 else 100
        return 0.0, max(math.ceil(round(greatest * parts, 6)), 1) / parts
    return min(math.floor(min(values, default=0.0) * 10) / 10, top - 0.1), top


def _ticks(low: float, high: float) -> list[float]:
    """Return about four round values from one end to the other."""
    step = next(
        (step for step in (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.25, 0.5, 1.0) if (high - low) / step < 5.5),
        high - low,
    )
    return [round(high - i * step, 6) for i in range(int((high - low) / step + 1e-6) + 1)]


def _y(value: float, low: float, high: float) -> str:
    return f"{(high - value) / (high - low) * _HEIGHT:.4g}"


def _line(series: Series, low: float, high: float) -> str:
    """Return the lines through the values, parted where some are missing, and dots for those without neighbours."""
    line, dots = [], []
    values = (None, *series.values, None)
    for i, (before, value, after) in enumerate(zip(values, values[1:], values[2:], strict=False)):
        if value is not None:
            place = f"{i + 0.5:g} {_y(value, low, high)}"
            if before is None and after is None:
                dots.append(f"M{place}h0")
            else:
                line.append(f"{'M' if before is None else 'L'}{place}")
    paths = {f"line s{series.colour}": line, f"line dot s{series.colour}": dots}
    return "".join(f'<path class="{name}" d="{"".join(parts)}"/>' for name, parts in paths.items() if parts)


def _reference(values: Sequence[float], low: float, high: float) -> str:
    points = "L".join(f"{i + 0.5:g} {_y(value, low, high)}" for i, value in enumerate(values))
    return f'<path class="reference" d="M{points}"/>' if points else ""


def _hit(index: int, label: str, series: Sequence[Series]) -> str:
    """Return the strip over a point that says its values."""
    values = [(item.name, item.values[index]) for item in series]
    lines = [label, *(f"{name}: {value:.4f}" for name, value in values if value is not None)]
    text = escape("\n".join(lines))
    return f'<rect class="hit" x="{index}" width="1" height="{_HEIGHT:g}"><title>{text}</title></rect>'


def _x_labels(labels: Sequence[str], *, every_label: bool) -> str:
    n = len(labels)
    if every_label:
        chosen = list(enumerate(labels))
    else:
        step = max(math.ceil(n / _N_LABELS / 5) * 5, 1) if n > _N_LABELS else 1
        chosen = [(i, str(i + 1)) for i in range(n) if i == 0 or (i + 1) % step == 0]
    return "".join(f'<span style="left:{(i + 0.5) / n * 100:.4g}%">{escape(label)}</span>' for i, label in chosen)


@dataclass(frozen=True, slots=True)
class Bar:
    """A bar of parts, one after the other; `colour` is the number of its name's, parts have those of their place."""

    name: str
    colour: int
    parts: tuple[float, ...]


def stacked_bars(bars: Sequence[Bar], parts: Sequence[str], *, unit: str) -> str:
    """Return horizontal bars, one below the other, with the sum of each and a legend of the parts.

    Parameters
    ----------
    bars : sequence of Bar
        The bars, with a value for each part.
    parts : sequence of str
        Names of the parts.
    unit : str
        Unit of the values.
    """
    longest = max((sum(bar.parts) for bar in bars), default=0.0) or 1.0
    rows = "".join(_bar(bar, parts, longest, unit) for bar in bars)
    legend = "".join(f'<li><i class="p{i}"></i>{escape(name)}</li>' for i, name in enumerate(parts))
    return f'<ul class="legend">{legend}</ul><div class="bars">{rows}</div>'


def _bar(bar: Bar, parts: Sequence[str], longest: float, unit: str) -> str:
    segments = "".join(
        f'<i class="p{i}" style="width:{value / longest * 100:.4g}%" '
        f'title="{escape(f"{name}: {value:.1f} {unit}")}"></i>'
        for i, (name, value) in enumerate(zip(parts, bar.parts, strict=True))
        if value > 0
    )
    name = f'<span class="name s{bar.colour}">{escape(bar.name)}</span>'
    return f'{name}<span class="bar">{segments}<b>{sum(bar.parts):.0f} {escape(unit)}</b></span>'
