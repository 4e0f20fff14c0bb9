"""Everything besides the frames that results depend on, so that a change can be detected and named."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from lrtrav_ros.config import Value
from lrtrav_ros.evaluation.scoring.frame_evaluation import Setup
from lrtrav_ros.evaluation.truth.opening import NamedSet, ReaderOptions
from lrtrav_ros.offline.run_identity import LIBRARIES, PACKAGE, code_digest, library_versions

_DISTANCES = "the distances"  # their geometry is configured beside the methods, and the same for all
# The report is made anew in every run.
_WITHOUT_INFLUENCE = ("benchmark", "commands", "nodes", "offline", "report", "synthetic")


@dataclass(frozen=True, slots=True)
class EvaluationIdentity:
    """All that results depend on besides the frames: where two are equal, so are the results.

    Attributes
    ----------
    code : str
        A digest of the package's sources.
    libraries : dict of str to str
        Versions of the libraries that compute; a new one may round differently.
    options : dict of str to str
        Options of the command, by their names.
    settings : dict of str to dict
        The configuration of each method by full parameter names, and that by which distances are measured.
    """

    code: str
    libraries: dict[str, str]
    options: dict[str, str]
    settings: dict[str, dict[str, Value]]

    def changes_since(self, earlier: EvaluationIdentity) -> list[str]:
        """Return all that differs from an earlier one, such as ``clustering.k of robust: 10 -> 5``."""
        code = [] if self.code == earlier.code else ["the code of lrtrav_ros"]
        return [
            *code,
            *_changes(earlier.libraries, self.libraries),
            *_changes(earlier.options, self.options),
            *_setting_changes(earlier.settings, self.settings),
        ]


def evaluation_identity(
    setup: Setup, reading: ReaderOptions, *, sets: Sequence[NamedSet] = (), unknown: str
) -> EvaluationIdentity:
    """Return the identity of what a setup gives, computed by this code.

    Parameters
    ----------
    setup : Setup
        The methods.
    reading : ReaderOptions
        How the sets are read.
    sets : sequence of NamedSet
        The sets, each with its name: another set of that name is another one.
    unknown : str
        The rule for unknown pixels; empty for that of each set.
    """
    methods = [seeded.method for seeded in setup.methods]
    n_seeds = [len(seeded.configs) for seeded in setup.methods if seeded.method.is_random]
    fields = {f"--field {name}": str(value) for name, value in dataclasses.asdict(reading.fields).items()}
    libraries = [*LIBRARIES, *(["sklearn"] if any(method.needs_sklearn for method in methods) else [])]
    return EvaluationIdentity(
        code=code_digest(PACKAGE, without=_WITHOUT_INFLUENCE),
        libraries=library_versions(libraries),
        options={
            "--methods": ", ".join(method.name for method in methods),
            **({"--seeds": str(n_seeds[0])} if n_seeds else {}),
            "--save-masks": "yes" if setup.save_masks else "no",
            "--unknown": unknown or "default",
            "--labels": str(reading.labels or "default"),
            "--truth": "default" if reading.truth is None else str(reading.truth.absolute()),
            **fields,
            **{f"the place of {item.name}": str(item.frames.path.absolute()) for item in sets},
        },
        settings={
            **{seeded.method.name: seeded.configs[0].values() for seeded in setup.methods},
            _DISTANCES: setup.geometry.values(),
        },
    )


def _changes(earlier: Mapping[str, str], now: Mapping[str, str]) -> Iterator[str]:
    """Yield what changed of the names in both; those in one come and go with the methods."""
    for name, value in now.items():
        if name in earlier and earlier[name] != value:
            yield f"{name}: {earlier[name]} -> {value}"


def _setting_changes(
    earlier: Mapping[str, Mapping[str, Value]], now: Mapping[str, Mapping[str, Value]]
) -> Iterator[str]:
    """Yield what changed of the parameters of those in both: once for all that it changed alike in."""
    owners = [name for name in now if name in earlier]
    methods = [name for name in owners if name != _DISTANCES]
    for parameter in now[_DISTANCES]:
        changed: dict[tuple[Value | None, Value], list[str]] = {}
        for name in owners:
            before, after = earlier[name].get(parameter), now[name][parameter]
            if before != after:
                changed.setdefault((before, after), []).append(name)
        for (before, after), names in changed.items():
            of_methods = [name for name in names if name in methods]
            owner = "" if of_methods == methods else f" of {', '.join(of_methods or names)}"
            yield f"{parameter}{owner}: {before} -> {after}"
