"""A picture of how time grows with the images' size and the number of superpixels, as SVG that stands alone."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

from lrtrav_ros.benchmark.figures import TimeFigures, WorkloadFigures, numbers_of_threads
from lrtrav_ros.benchmark.workload import AFTER_MATCHING, WHOLE_FRAME

_WIDTH, _HEIGHT = 960, 420
_LEFT, _TOP, _PANEL_WIDTH, _PANEL_HEIGHT, _GAP = 50, 40, 290, 320, 60
_LEGEND = _LEFT + 2 * _PANEL_WIDTH + _GAP + 24
_LEAST_MS = 1e-3  # there is no place for 0


@dataclass(frozen=True, slots=True)
class _Style:
    """A line's colour, which tells the task, and its dashes, which others' programs have."""

    colour: str
    dashes: str = ""


_STYLES = {
    "matching": _Style("#0072b2"),
    "OpenCV StereoSGBM": _Style("#0072b2", "7 4"),
    "OpenCV StereoBM": _Style("#0072b2", "2 4"),
    "superpixels": _Style("#009e73"),
    "scikit-image SLIC": _Style("#009e73", "7 4"),
    "clustering": _Style("#cc79a7"),
    "scikit-learn SpectralClustering": _Style("#cc79a7", "7 4"),
}
_BY_THREADS = {
    WHOLE_FRAME: (_Style("#d55e00"), _Style("#e69f00")),
    AFTER_MATCHING: (_Style("#000000"), _Style("#888888")),
}


@dataclass(frozen=True, slots=True)
class _Axis:
    """A logarithmic axis: its ends, and where they are in the picture."""

    low: float
    high: float
    start: float
    end: float

    @classmethod
    def over(cls, values: Sequence[float], start: float, end: float) -> _Axis:
        """Return the axis that has room for values."""
        low, high = min(values), max(values)
        return cls(low / 1.15, high * 1.15, start, end)

    def place(self, value: float) -> float:
        """Return where a value is."""
        share = math.log(value / self.low) / math.log(self.high / self.low)
        return round(self.start + share * (self.end - self.start), 1)

    def ticks(self) -> list[float]:
        """Return the round numbers 1, 2, 5, 10, 20 ... on the axis."""
        powers = range(math.floor(math.log10(self.low)), math.ceil(math.log10(self.high)) + 1)
        return [
            digit * 10.0**power for power in powers for digit in (1, 2, 5) if self.low < digit * 10.0**power < self.high
        ]


@dataclass(frozen=True, slots=True)
class _Panel:
    """One of the two diagrams: what is on its axis to the right, how that is written, and where it stands."""

    title: str
    workloads: Sequence[WorkloadFigures]
    position: Callable[[WorkloadFigures], float]
    label: Callable[[WorkloadFigures], str]
    left: float


def growth_chart(workloads: Sequence[WorkloadFigures]) -> str:
    """Return the picture: both axes are logarithmic, so that time in proportion to the size is a diagonal.

    Parameters
    ----------
    workloads : sequence of WorkloadFigures
        The first has the number of superpixels with which sizes are drawn, and the size at which numbers of superpixels
        are; at least one other differs from it in one of the two.

    Returns
    -------
    str
        SVG.

    Raises
    ------
    ValueError
        If nothing grows.
    """
    if len(workloads) < 2:
        raise ValueError("there is one size and one number of superpixels; give more of either to draw a chart")
    first = workloads[0]
    styles = _styles(first)
    milliseconds = [max(times.wall_ms, _LEAST_MS) for item in workloads for times in _drawn(item)]
    scale = _Axis.over(milliseconds, _TOP + _PANEL_HEIGHT, _TOP)
    panels = (
        _Panel(
            f"size, {first.n_superpixels} superpixels",
            sorted((item for item in workloads if item.n_superpixels == first.n_superpixels), key=_pixels),
            _pixels,
            lambda item: f"{item.width}x{item.height}",
            _LEFT,
        ),
        _Panel(
            f"superpixels, {first.width} x {first.height}",
            sorted((item for item in workloads if _size(item) == _size(first)), key=_n_superpixels),
            _n_superpixels,
            lambda item: str(item.n_superpixels),
            _LEFT + _PANEL_WIDTH + _GAP,
        ),
    )
    drawn = [line for panel in panels if len(panel.workloads) > 1 for line in _draw(panel, styles, scale)]
    return "\n".join([_HEAD, *drawn, *_legend(styles), "</svg>", ""])


_HEAD = (
    f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
    'font-family="Helvetica, Arial, sans-serif" font-size="12">\n'
    "<title>Time of a frame by size and number of superpixels</title>\n"
    f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#ffffff"/>\n'
    f'<text x="{_LEFT - 8}" y="{_TOP - 8}" text-anchor="end">ms</text>'
)


def _pixels(workload: WorkloadFigures) -> float:
    return workload.width * workload.height


def _size(workload: WorkloadFigures) -> tuple[int, int]:
    return workload.width, workload.height


def _n_superpixels(workload: WorkloadFigures) -> float:
    return workload.n_superpixels


def _drawn(workload: WorkloadFigures) -> Iterator[TimeFigures]:
    """Yield what there are lines for: no stages of a whole frame, and half resolution only if it is set."""
    for times in workload.times:
        if not times.in_frame and (workload.half_resolution or not times.half_resolution):
            yield times


def _line_name(times: TimeFigures) -> str:
    return f"{times.name}, threads: {times.n_threads}" if times.name in _BY_THREADS else times.name


def _styles(workload: WorkloadFigures) -> dict[str, _Style]:
    """Return the style of each line by its name."""
    threads = numbers_of_threads(workload)
    styles = {}
    for times in _drawn(workload):
        if times.name in _BY_THREADS:
            choices = _BY_THREADS[times.name]
            styles[_line_name(times)] = choices[threads.index(times.n_threads) % len(choices)]
        else:
            styles[times.name] = _STYLES[times.name.partition(",")[0]]  # what is behind it names the matcher
    return styles


def _draw(panel: _Panel, styles: dict[str, _Style], scale: _Axis) -> Iterator[str]:
    """Yield the elements of a diagram."""
    positions = [panel.position(item) for item in panel.workloads]
    axis = _Axis.over(positions, panel.left, panel.left + _PANEL_WIDTH)
    bottom, right = _TOP + _PANEL_HEIGHT, panel.left + _PANEL_WIDTH
    for tick in scale.ticks():
        y = scale.place(tick)
        yield f'<path d="M{panel.left} {y}H{right}" stroke="#dddddd"/>'
        yield f'<text x="{panel.left - 6}" y="{y + 4:.1f}" text-anchor="end">{tick:g}</text>'
    for item, position in zip(panel.workloads, positions, strict=True):
        x = axis.place(position)
        yield f'<path d="M{x} {bottom}v5" stroke="#444444"/>'
        yield f'<text x="{x}" y="{bottom + 18}" text-anchor="middle">{escape(panel.label(item))}</text>'
    yield f'<path d="M{panel.left} {bottom}H{right}" stroke="#444444"/>'
    yield (
        f'<text x="{(panel.left + right) / 2:g}" y="{bottom + 40}" text-anchor="middle" font-weight="bold">'
        f"{escape(panel.title)}</text>"
    )
    for name, style in styles.items():
        yield from _line(panel, name, style, axis, scale)


def _line(panel: _Panel, name: str, style: _Style, axis: _Axis, scale: _Axis) -> Iterator[str]:
    """Yield the line of what has a name, with a dot at each value."""
    found = [
        (axis.place(panel.position(item)), scale.place(max(times.wall_ms, _LEAST_MS)))
        for item in panel.workloads
        for times in _drawn(item)
        if _line_name(times) == name
    ]
    points = " ".join(f"{x},{y}" for x, y in found)
    yield f'<polyline points="{points}" fill="none" {_stroke(style)}/>'
    yield from (f'<circle cx="{x}" cy="{y}" r="3" fill="{style.colour}"/>' for x, y in found)


def _legend(styles: dict[str, _Style]) -> Iterator[str]:
    for i, (name, style) in enumerate(styles.items()):
        y = _TOP + 12 + 20 * i
        yield f'<path d="M{_LEGEND} {y}h26" {_stroke(style)}/>'
        yield f'<text x="{_LEGEND + 32}" y="{y + 4}">{escape(name)}</text>'


def _stroke(style: _Style) -> str:
    dashes = f' stroke-dasharray="{style.dashes}"' if style.dashes else ""
    return f'stroke="{style.colour}" stroke-width="2"{dashes}'
