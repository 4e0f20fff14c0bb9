"""The report of an evaluation: one HTML file that holds all it shows, for any browser, without a network."""

from __future__ import annotations

import base64
import dataclasses
import hashlib
import statistics
from collections.abc import Iterable, Iterator, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path

from lrtrav_ros.detector import StageTimes
from lrtrav_ros.evaluation.report.charts import Bar, Series, line_chart, stacked_bars
from lrtrav_ros.evaluation.report.gallery import CALLED_FREE, Exhibit, Picture
from lrtrav_ros.evaluation.report.tables import (
    BAND_NAMES,
    HEIGHT_NAMES,
    PAPER_SCORES,
    SCORE_TITLES,
    missed_of,
    obstacle_bands,
)
from lrtrav_ros.evaluation.scoring.reliability import CONFIDENCE_BINS
from lrtrav_ros.evaluation.scoring.score_records import FrameRecord, FrameTimes, MethodRecord, Summary, TableRow
from lrtrav_ros.evaluation.scoring.scores import Scores
from lrtrav_ros.io.atomic_files import write_bytes
from lrtrav_ros.io.csv_cells import printable
from lrtrav_ros.method.ground import NO_GROUND

_STAGES = {field.name: field.name.removesuffix("_ms") for field in dataclasses.fields(StageTimes)}
_N_COLOURS = 8
_NONE = "\N{EN DASH}"
_TOPS = {"precision": 1.0, "recall": 1.0}  # of the axes; those of errors end where the values do
_SECTIONS = (
    ("scores", "Scores"),
    ("obstacles", "Obstacles"),
    ("distance", "By distance"),
    ("frames", "Frame by frame"),
    ("confidence", "Confidence"),
    ("time", "Time"),
    ("gallery", "Gallery"),
    ("called-free", "Obstacles called free"),
    ("configuration", "Configuration"),
)


def write_report(
    path: Path,
    summary: Summary,
    records: Sequence[FrameRecord],
    times: Sequence[FrameTimes],
    exhibits: Sequence[Exhibit] = (),
) -> None:
    """Write the report of an evaluation to `path`; see `report_html`."""
    write_bytes(path, printable(report_html(summary, records, times, exhibits)).encode())


def report_html(
    summary: Summary, records: Sequence[FrameRecord], times: Sequence[FrameTimes], exhibits: Sequence[Exhibit] = ()
) -> str:
    """Return the report: tables, curves per frame, time per stage, pictures and the effective configuration.

    Parameters
    ----------
    summary : Summary
        The table.
    records, times : sequence of FrameRecord, sequence of FrameTimes
        Scores and times of each frame, in the order in which frames are to be shown.
    exhibits : sequence of Exhibit
        The frames of which there are pictures; see `gallery.make_gallery`.
    """
    body = [
        _header(summary),
        _scores(summary),
        _obstacles(summary),
        _bands(summary),
        _frames(summary, records),
        _confidence(summary),
        _times(summary, times),
        _gallery(summary, exhibits),
        _called_free(summary, exhibits),
        _configuration(summary),
    ]
    return _document("Evaluation of traversable regions", "\n".join(body), n_series=len(summary.methods))


def _document(title: str, body: str, *, n_series: int) -> str:
    """Return a page that loads nothing from elsewhere."""
    resources = files("lrtrav_ros.evaluation.report")
    style = f"\n{resources.joinpath('report.css').read_text(encoding='utf-8')}{_series_style(n_series)}"
    script = f"\n{resources.joinpath('report.js').read_text(encoding='utf-8')}"
    # Attributes place what charts show, so they may have styles; so may elements in browsers without style-src-elem.
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
    policy += f"style-src-elem {_digest(style)}; script-src {_digest(script)}"
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<title>{escape(title)}</title>
<style>{style}</style>
</head>
<body>
{body}
<dialog><img alt=""><p></p></dialog>
<script>{script}</script>
</body>
</html>
"""


def _digest(text: str) -> str:
    """Return the content of an element as a policy names it."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode('ascii')}'"


def _series_style(n_series: int) -> str:
    """Return the colours of the methods, and the rules by which check boxes hide their lines and keys light them up."""
    rules = []
    for i in range(n_series):
        dashes = " stroke-dasharray: 5 3;" if i >= _N_COLOURS else ""
        rules += [
            f".s{i} {{ --c: var(--c{i % _N_COLOURS});{dashes} }}",
            f"body:has(#m{i}:not(:checked)) .line.s{i} {{ display: none; }}",
            f"body:has(#m{i}:not(:checked)) .keys .s{i} {{ opacity: 0.4; }}",
            f"body:has(.keys .s{i}:hover) .line:not(.s{i}) {{ opacity: 0.15; }}",
        ]
    return "\n".join([*rules, ""])


def _section(name: str, content: str) -> str:
    return f'<section><h2 id="{name}">{dict(_SECTIONS)[name]}</h2>\n{content}</section>'


def _header(summary: Summary) -> str:
    n_frames = sum(item.n_frames for item in summary.sets)
    names = ", ".join(escape(item.name) for item in summary.sets)
    links = "".join(f'<a href="#{name}">{title}</a>' for name, title in _SECTIONS)
    return (
        "<header><h1>Evaluation of traversable regions</h1>"
        f'<p class="soft">{_number_of(len(summary.methods), "method")} on {_number_of(n_frames, "frame")} of {names}. '
        f"{_unknown_rule(summary)}</p><nav>{links}</nav>{_tiles(summary)}</header>"
    )


def _number_of(n: int, noun: str) -> str:
    return f"{n} {noun}" if n == 1 else f"{n} {noun}s"


def _unknown_rule(summary: Summary) -> str:
    """Say what unknown pixels of the truth count as."""
    texts = {"ignore": "are ignored", "not-traversable": "count as not traversable"}
    rules = {item.unknown for item in summary.sets}
    if len(rules) == 1:
        return f"Pixels of unknown truth {texts.get(rules.pop(), 'are ignored')}."
    each = "; ".join(f"{item.name}: {texts.get(item.unknown, item.unknown)}" for item in summary.sets)
    return f"Pixels of unknown truth: {escape(each)}."


def _tiles(summary: Summary) -> str:
    """Return the best value of each score, and by which method."""
    if not summary.means:
        return ""
    missed = min(summary.means, key=lambda row: row.obstacles.total.n_missed)
    rmse = min(summary.means, key=lambda row: row.scores.rmse)
    precision = max(summary.means, key=lambda row: row.scores.precision)
    recall = max(summary.means, key=lambda row: row.scores.recall)
    reach = max(summary.means, key=lambda row: row.reach_m or 0.0)
    tiles = "".join(
        f'<div><dt>{title}</dt><dd class="value">{value}</dd><dd>{escape(row.method)}</dd></div>'
        for title, row, value in (
            ("Lowest RMSE", rmse, f"{rmse.scores.rmse:.3f}"),
            ("Highest precision", precision, f"{precision.scores.precision:.3f}"),
            ("Highest recall", recall, f"{recall.scores.recall:.3f}"),
            ("Fewest obstacles missed", missed, missed_of(missed.obstacles.total) or _NONE),
            ("Farthest reach", reach, _NONE if reach.reach_m is None else f"{reach.reach_m:.0f} m"),
        )
    )
    return f'<dl class="tiles">{tiles}</dl>'


def _scores(summary: Summary) -> str:
    """Return the table of methods and sets, and what could not be scored."""
    rows = [*summary.results, *summary.means]
    with_paper, with_spread = any(row.paper for row in rows), any(row.spread for row in rows)
    with_flicker = any(row.flicker is not None for row in rows)
    head = ["method", *SCORE_TITLES.values(), *["± RMSE"] * with_spread, "missed obstacles", "reach m", "gained m"]
    head += ["flicker"] * with_flicker + ["paper: precision", "recall", "RMSE"] * with_paper + ["frames"]
    groups = [(item.name, [row for row in summary.results if row.set == item.name]) for item in summary.sets]
    if len(summary.sets) > 1:
        groups.append(("mean of the sets", list(summary.means)))
    worst = max((row.scores.rmse for row in rows), default=0.0) or 1.0
    body = "".join(
        f'<tbody><tr><th colspan="{len(head)}" scope="rowgroup">{escape(name)}</th></tr>'
        + "".join(
            _score_row(row, of_set, worst, with_paper=with_paper, with_spread=with_spread, with_flicker=with_flicker)
            for row in of_set
        )
        + "</tbody>"
        for name, of_set in groups
    )
    text = (
        "<p>Precision: how much of what was found is traversable. Recall: how much of what is traversable was found. "
        "RMSE: root of the share of pixels that are wrong. False positives: how much of what is not traversable is "
        "called free. Reach: how far ahead the mask finds the ground without interruption; gained: how much farther "
        "than short range alone.</p>"
    )
    if with_flicker:
        text += (
            "<p>Flicker: share of the pixels whose label changes from a frame to the next; it tells something where "
            "frames are consecutive.</p>"
        )
    return _section("scores", f"{text}{_table(head, body)}{_seeds(summary)}{_problems(summary)}")


def _table(head: Sequence[str], body: str) -> str:
    titles = "".join(f'<th scope="col">{escape(title)}</th>' for title in head)
    return f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>{body}</table></div>'


def _score_row(
    row: TableRow,
    of_set: Sequence[TableRow],
    worst: float,
    *,
    with_paper: bool,
    with_spread: bool,
    with_flicker: bool,
) -> str:
    cells = [f'<th scope="row">{escape(row.method)}</th>']
    for name in SCORE_TITLES:
        value = getattr(row.scores, name)
        best = (max if name in _TOPS else min)(getattr(item.scores, name) for item in of_set)
        kind = " best" * (value == best and len(of_set) > 1)
        share = f' style="--share:{value / worst * 100:.3g}%"' if name == "rmse" else ""
        cells.append(f'<td class="{name}{kind}"{share}>{value:.4f}</td>')
    spread = row.spread.rmse if row.spread else None
    cells += [_cell(spread, 4)] * with_spread + [f"<td>{missed_of(row.obstacles.total) or _NONE}</td>"]
    cells += [_cell(row.reach_m, 1), _cell(row.gain_m, 1)] + [_cell(row.flicker, 4)] * with_flicker
    if with_paper:
        cells += [_cell(getattr(row.paper, name) if row.paper else None, 4) for name in PAPER_SCORES]
    return f"<tr>{''.join(cells)}<td>{row.n_frames}</td></tr>"


def _cell(value: float | None, digits: int) -> str:
    return f"<td>{_NONE if value is None else f'{value:.{digits}f}'}</td>"


def _seeds(summary: Summary) -> str:
    if not any(row.spread for row in summary.results):
        return ""
    return f'<p class="soft">± is the standard deviation over {len(summary.seeds)} seeds.</p>'


def _problems(summary: Summary) -> str:
    """Name the frames that could not be used, those without truth, and those where a stage gave up."""
    items = []
    for item in summary.sets:
        items += [f"{item.name}/{failed.frame} could not be used: {failed.error}" for failed in item.errors]
        if item.n_without_truth:
            items.append(f"{item.name}: {_number_of(item.n_without_truth, 'frame')} without ground truth")
    for row in summary.results:
        if row.gave_up:
            items.append(f"{row.set}, {row.method}: {NO_GROUND} in {', '.join(row.gave_up)}; scored as found")
    if not items:
        return '<p class="soft">All frames could be used, and no stage gave up.</p>'
    listed = "".join(f"<li>{escape(item)}</li>" for item in items)
    return f"<details open><summary>{_number_of(len(items), 'note')} on frames</summary><ul>{listed}</ul></details>"


def _obstacles(summary: Summary) -> str:
    """Return a table of the obstacles that each method misses, by distance and height."""
    with_height = any(row.obstacles.by_height for row in summary.means)
    head = ["method", "all", *(f"{band} m" for band in BAND_NAMES)]
    head += [f"{band} m high" for band in HEIGHT_NAMES] * with_height
    body = "".join(
        f'<tr><th scope="row">{escape(row.method)}</th>'
        + "".join(f"<td>{missed_of(counts) or _NONE}</td>" for counts in obstacle_bands(row.obstacles)[: len(head) - 1])
        + "</tr>"
        for row in summary.means
    )
    text = (
        "<p>Standing obstacles that are missed: connected regions that are not traversable, of at least 0.1 % of the "
        "image and below its top row, of which more than half is called free. By the distance of their feet"
        + (" and by their height" if with_height else "")
        + "; those of all frames taken together.</p>"
    )
    return _section("obstacles", f"{text}{_table(head, f'<tbody>{body}</tbody>')}")


def _bands(summary: Summary) -> str:
    """Return charts and a table of the scores by distance."""
    rows = summary.means
    number = _numbers(summary)
    charts = "".join(
        line_chart(
            title,
            [Series(row.method, number[row.method], _values(row.bands, name)) for row in rows],
            [f"{band} m" for band in BAND_NAMES],
            top=_TOPS.get(name),
            every_label=True,
        )
        for name, title in SCORE_TITLES.items()
    )
    body = "".join(
        f'<tr><th scope="row">{escape(row.method)}</th><td class="text">{title}</td>'
        + "".join(_cell(value, 4) for value in _values(row.bands, name))
        + "</tr>"
        for row in rows
        for name, title in SCORE_TITLES.items()
    )
    table = _table(["method", "", *(f"{band} m" for band in BAND_NAMES)], f"<tbody>{body}</tbody>")
    text = "<p>Distance on the ground, by the geometry of the ground line; pixels of all frames taken together.</p>"
    return _section(
        "distance",
        f'{text}{_keys(summary, with_boxes=True)}<div class="charts">{charts}</div>'
        f"<details><summary>The numbers</summary>{table}</details>",
    )


def _values(scores: Iterable[Scores | None], name: str) -> tuple[float | None, ...]:
    return tuple(None if item is None else getattr(item, name) for item in scores)


def _numbers(summary: Summary) -> dict[str, int]:
    """Return the number of each method, by which it has its colour."""
    return {method.name: i for i, method in enumerate(summary.methods)}


def _keys(summary: Summary, *, with_boxes: bool) -> str:
    """Return a legend of the methods; boxes show and hide their lines in all charts, and a click on any name does."""
    keys = "".join(
        f'<li><label class="s{i}" for="m{i}">'
        + (f'<input type="checkbox" id="m{i}" checked>' if with_boxes else "")
        + f"{escape(method.name)}</label></li>"
        for i, method in enumerate(summary.methods)
    )
    return f'<ul class="legend keys">{keys}</ul>'


def _frames(summary: Summary, records: Sequence[FrameRecord]) -> str:
    """Return charts and a table for each set: a line for each method."""
    text = (
        "<p>A pointer that rests on a chart names frame and values; one that rests on a method shows it alone, and a "
        "click hides it.</p>"
    )
    charts = "".join(
        f"<h3>{escape(item.name)}</h3>{_set_charts(summary, [record for record in records if record.set == item.name])}"
        for item in summary.sets
    )
    return _section("frames", f"{text}{_keys(summary, with_boxes=False)}{charts}")


def _set_charts(summary: Summary, frames: Sequence[FrameRecord]) -> str:
    """Return the charts of one set, and the table of RMSE."""
    found = [{method.method: method for method in frame.methods} for frame in frames]
    numbers = _numbers(summary)
    charts = "".join(
        line_chart(
            title,
            [Series(method, i, _of_frames(found, method, name)) for method, i in numbers.items()],
            [frame.frame for frame in frames],
            top=_TOPS.get(name),
        )
        for name, title in SCORE_TITLES.items()
    )
    columns = [_of_frames(found, method, "rmse") for method in numbers]
    body = "".join(
        f'<tr><th scope="row">{escape(frame.frame)}</th>{"".join(_cell(column[i], 4) for column in columns)}</tr>'
        for i, frame in enumerate(frames)
    )
    table = _table(["RMSE", *numbers], f"<tbody>{body}</tbody>")
    return f'<div class="charts">{charts}</div><details><summary>The numbers</summary>{table}</details>'


def _of_frames(frames: Iterable[dict[str, MethodRecord]], method: str, name: str) -> tuple[float | None, ...]:
    return _values((frame[method].scores if method in frame else None for frame in frames), name)


def _confidence(summary: Summary) -> str:
    """Return reliability curves: how often the methods are right where they are so sure."""
    rows, numbers = [row for row in summary.means if row.reliability], _numbers(summary)
    if not rows:
        return _section("confidence", '<p class="soft">No method says how sure it is.</p>')
    labels = [f"{low:.0%}" for low, _ in CONFIDENCE_BINS]
    curves = [
        Series(row.method, numbers[row.method], tuple(item.share_right for item in row.reliability)) for row in rows
    ]
    shares = [Series(row.method, numbers[row.method], _shares(row)) for row in rows]
    middles = [(low + high) / 2 for low, high in CONFIDENCE_BINS]
    charts = line_chart(
        "share that is right, by confidence", curves, labels, top=1.0, every_label=True, reference=middles
    )
    charts += line_chart("share of the pixels, by confidence", shares, labels, every_label=True)
    text = (
        "<p>Of the pixels of which a method is 80 % sure, 80 % should be right: then its curve is on the dashed line. "
        "A bin begins at the confidence below it. Pixels of all frames taken together, without those of unknown truth "
        "and those where nothing tells. Calibration error: how far confidence is from the share that is right, a mean "
        "over the pixels.</p>"
    )
    return _section(
        "confidence",
        f'{text}{_keys(summary, with_boxes=False)}<div class="charts">{charts}</div>{_reliability_table(rows)}',
    )


def _shares(row: TableRow) -> tuple[float, ...]:
    """Return which share of the pixels is in each bin."""
    n_pixels = sum(item.n_pixels for item in row.reliability)
    return tuple(item.n_pixels / max(n_pixels, 1) for item in row.reliability)


def _reliability_table(rows: Sequence[TableRow]) -> str:
    """Return the calibration error of each method, and the numbers of its curve."""
    errors = "".join(
        f'<tr><th scope="row">{escape(row.method)}</th>{_cell(row.calibration_error, 4)}</tr>' for row in rows
    )
    body = "".join(
        f'<tr><th scope="row">{escape(row.method)}</th><td>{low:.0%} to {high:.0%}</td>'
        f"{_cell(item.confidence, 4)}{_cell(item.share_right, 4)}<td>{item.n_pixels}</td></tr>"
        for row in rows
        for (low, high), item in zip(CONFIDENCE_BINS, row.reliability, strict=True)
    )
    numbers = _table(["method", "bin", "mean confidence", "share right", "pixels"], f"<tbody>{body}</tbody>")
    return (
        f"{_table(['method', 'calibration error'], f'<tbody>{errors}</tbody>')}"
        f"<details><summary>The numbers</summary>{numbers}</details>"
    )


def _times(summary: Summary, times: Sequence[FrameTimes]) -> str:
    """Return the median time of each stage, as the paper's figure 6 shows it."""
    medians = _median_times(summary, times)
    bars = [Bar(name, number, medians[name]) for name, number in _numbers(summary).items() if name in medians]
    body = "".join(
        f'<tr><th scope="row">{escape(bar.name)}</th>'
        + "".join(_cell(value, 1) for value in (*bar.parts, sum(bar.parts)))
        + "</tr>"
        for bar in bars
    )
    table = _table(["method", *_STAGES.values(), "sum"], f"<tbody>{body}</tbody>")
    text = (
        "<p>Medians over the frames, in milliseconds, on one thread. Stages that methods share were run once and "
        "count for each of them. The paper reports 191 ms for its method at 640 x 480, 104 ms of it matching.</p>"
    )
    chart = stacked_bars(bars, tuple(_STAGES.values()), unit="ms")
    return _section("time", f"{text}{chart}<details><summary>The numbers</summary>{table}</details>")


def _median_times(summary: Summary, times: Sequence[FrameTimes]) -> dict[str, tuple[float, ...]]:
    """Return the median of each stage for each method that has times."""
    found: dict[str, list[StageTimes]] = {}
    for frame in times:
        for item in frame.methods:
            found.setdefault(item.method, []).append(item.stages)
    return {
        method.name: tuple(
            statistics.median(getattr(stages, stage) for stages in found[method.name]) for stage in _STAGES
        )
        for method in summary.methods
        if method.name in found
    }


def _gallery(summary: Summary, exhibits: Sequence[Exhibit]) -> str:
    """Return pictures of the frames on which each method is best, in the middle and worst."""
    colours = (
        ("right", "found rightly"),
        ("wrong", "found wrongly"),
        ("missed", "missed"),
        ("ignored", "unknown, not counted"),
    )
    legend = "".join(f'<li><i class="{kind}"></i>{text}</li>' for kind, text in colours)
    parts = [
        "<p>For each method the frames with the lowest, the median and the highest RMSE. Short and long range: green "
        "is ground at short range, blue what was added to it, red an obstacle. Colours of the errors:</p>",
        f'<ul class="legend">{legend}</ul>',
    ]
    parts += _by_method(summary, [item for item in exhibits if item.rank != CALLED_FREE])
    return _section("gallery", "\n".join(parts))


def _called_free(summary: Summary, exhibits: Sequence[Exhibit]) -> str:
    """Return pictures of the frames on which each method calls most obstacle pixels free."""
    parts = [
        "<p>For each method the frames with the most pixels that are called free and are not traversable; those are "
        "vermilion. Standing obstacles are outlined: in yellow, and in vermilion where more than half is called "
        "free.</p>"
    ]
    parts += _by_method(summary, [item for item in exhibits if item.rank == CALLED_FREE])
    if len(parts) == 1:
        parts.append('<p class="soft">No method calls anything free that is not traversable.</p>')
    return _section("called-free", "\n".join(parts))


def _by_method(summary: Summary, exhibits: Sequence[Exhibit]) -> Iterator[str]:
    """Yield the exhibits of each method below its name."""
    for method in summary.methods:
        shown = [item for item in exhibits if item.record.method == method.name]
        if shown:
            yield f'<h3>{escape(method.name)} <small class="soft">{escape(method.description)}</small></h3>'
            yield from map(_exhibit, shown)


def _exhibit(item: Exhibit) -> str:
    scores, missed = item.record.scores, missed_of(item.record.obstacles.total)
    numbers = f"RMSE {scores.rmse:.4f}, precision {scores.precision:.4f}, recall {scores.recall:.4f}"
    numbers += f", false positives {scores.false_positive_rate:.4f}"
    numbers += f", missed {missed} obstacles" if missed else ""
    numbers += f", {item.record.problem}" if item.record.problem else ""
    place = f"{item.set}/{item.frame}"
    figures = "".join(_figure(picture, f"{item.record.method}, {place}: {picture.title}") for picture in item.pictures)
    content = f'<div class="pictures">{figures}</div>' if figures else '<p class="soft">No pictures of this frame.</p>'
    return (
        f'<h4><span class="rank">{escape(item.rank)}</span> {escape(place)} '
        f'<span class="numbers">{escape(numbers)}</span></h4>'
        f"{content}"
    )


def _figure(picture: Picture, text: str) -> str:
    data = base64.b64encode(picture.data).decode("ascii")
    return (
        f'<figure><img src="data:image/jpeg;base64,{data}" width="{picture.width}" height="{picture.height}" '
        f'alt="{escape(text)}" decoding="async"><figcaption>{escape(picture.title)}</figcaption></figure>'
    )


def _configuration(summary: Summary) -> str:
    """Return the settings in which methods differ, and those that they have in common."""
    methods = summary.methods
    names = list(dict.fromkeys(name for method in methods for name in method.configuration))
    different = [name for name in names if len({repr(method.configuration.get(name)) for method in methods}) > 1]
    text = "<p>The effective configuration of each method, by the names that <code>--set</code> takes.</p>"
    compared = _table(
        ["parameter", *(method.name for method in methods)],
        "".join(_setting(name, [method.configuration.get(name) for method in methods]) for name in different),
    )
    common = _table(
        ["parameter", "all methods"],
        "".join(_setting(name, [methods[0].configuration.get(name)]) for name in names if name not in different),
    )
    paths = "".join(f"<li>{escape(item.name)}: <code>{escape(item.path)}</code></li>" for item in summary.sets)
    return _section(
        "configuration",
        f"{text}<ul>{paths}</ul>{compared if different else ''}"
        f"<details><summary>What all methods have in common</summary>{common}</details>",
    )


def _setting(name: str, values: Sequence[object]) -> str:
    cells = "".join(f"<td><code>{escape(str(value))}</code></td>" for value in values)
    return f'<tr><th scope="row"><code>{escape(name)}</code></th>{cells}</tr>'
