"""The files that a finished run ends with, made from its records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lrtrav_ros.evaluation.report.gallery import make_gallery
from lrtrav_ros.evaluation.report.html_report import write_report
from lrtrav_ros.evaluation.report.tables import scores_csv, times_csv
from lrtrav_ros.evaluation.scoring.evaluation_folder import EvaluationFolder
from lrtrav_ros.evaluation.scoring.frame_evaluation import Setup
from lrtrav_ros.evaluation.scoring.methods import Method
from lrtrav_ros.evaluation.scoring.score_records import Summary, to_json
from lrtrav_ros.evaluation.scoring.summary import summarise
from lrtrav_ros.evaluation.truth.opening import NamedSet
from lrtrav_ros.io.atomic_files import write_bytes
from lrtrav_ros.io.parameter_file import dump_parameters


def write_configs(methods: Sequence[Method], values: Mapping[str, object], folder: EvaluationFolder) -> None:
    """Write the effective configuration of each method, ``configs/METHOD.yaml``, which ``lrtrav detect`` reads.

    Parameters
    ----------
    methods : sequence of Method
        The methods.
    values : mapping of str to value
        Parameters that are changed in all of them.
    folder : EvaluationFolder
        Where the files go.
    """
    for method in methods:
        text = dump_parameters(method.configuration(values))
        write_bytes(folder.path / "configs" / f"{method.name}.yaml", text.encode())


def write_results(
    sets: Sequence[NamedSet],
    setup: Setup,
    folder: EvaluationFolder,
    *,
    unknown: str = "",
    jobs: int = 1,
    cluster: str | None = None,
) -> Summary:
    """Write ``scores.csv``, ``times.csv``, ``summary.json`` and ``report.html``; return the summary.

    Parameters
    ----------
    sets : sequence of NamedSet
        The frames, all of which have been evaluated.
    setup : Setup
        The methods.
    folder : EvaluationFolder
        Where their records are, and the files go.
    unknown : str
        The rule for unknown pixels; empty for that of each set.
    jobs : int
        Number of processes that make the report's pictures; see `parallel.run_tasks`.
    cluster : str, optional
        Address of a Dask scheduler to use in their place.

    Raises
    ------
    OSError, ValueError, RuntimeError
        If a frame has no record, a file cannot be written, or the tasks not be run.
    """
    records, times = [], []
    for item in sets:
        for name in item.frames.names:
            record, frame_times = folder.record(item.name, name), folder.times(item.name, name)
            if record is None or frame_times is None:
                raise ValueError(f"{folder.path}: the record of {item.name}/{name} is gone; run the evaluation again")
            records.append(record)
            times.append(frame_times)
    summary = summarise(sets, records, setup, unknown, folder.mask)
    methods = [method.name for method in summary.methods]
    write_bytes(folder.path / "scores.csv", scores_csv(records, methods).encode())
    write_bytes(folder.path / "times.csv", times_csv(times).encode())
    write_bytes(folder.path / "summary.json", to_json(summary).encode())
    exhibits = make_gallery(sets, setup, records, unknown=unknown, jobs=jobs, cluster=cluster)
    write_report(folder.path / "report.html", summary, records, times, exhibits)
    return summary
