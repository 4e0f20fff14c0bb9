"""Stages of one frame, run once for all the methods that share them."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, ParamSpec, TypeVar

import numpy as np

from lrtrav_ros.detector import Stage, StageRunner

_P = ParamSpec("_P")
_R = TypeVar("_R")


class SharedStages:
    """Remembers what the stages gave on one frame, and how long they took.

    Arguments are compared by value, arrays too; so nothing that a stage takes or returns may be changed afterwards.
    """

    def __init__(self) -> None:
        self._calls: dict[tuple[Stage, Callable[..., Any]], list[_Call]] = {}

    def runner(self) -> StageRunner:
        """Return a runner for one method; a stage that already ran for another counts with the time it took then."""
        return _SharingRunner(self)

    def call(self, stage: Stage, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> tuple[_R, float]:
        """Return what `function` returns, and the milliseconds that it took when it was called."""
        calls = self._calls.setdefault((stage, function), [])
        arguments = [*args, *chain.from_iterable(sorted(kwargs.items()))]
        for call in calls:
            if call.has(arguments):
                return call.result, call.time_ms
        start = time.perf_counter()
        result = function(*args, **kwargs)
        time_ms = (time.perf_counter() - start) * 1e3
        calls.append(_Call(arguments, result, time_ms))
        return result, time_ms


class _SharingRunner(StageRunner):
    """Runs the stages for one method."""

    def __init__(self, stages: SharedStages) -> None:
        super().__init__()
        self._stages = stages

    def __call__(self, stage: Stage, function: Callable[_P, _R], *args: _P.args, **kwargs: _P.kwargs) -> _R:
        result, time_ms = self._stages.call(stage, function, *args, **kwargs)
        self._times_ms[stage] += time_ms
        return result


@dataclass(frozen=True, slots=True, eq=False)
class _Call:
    """A call that was made; keywords are among its arguments."""

    arguments: Sequence[Any]
    result: Any
    time_ms: float

    def has(self, arguments: Sequence[Any]) -> bool:
        """Return whether the arguments are the same; settings, which come last, are compared before images."""
        return len(arguments) == len(self.arguments) and all(map(_same, reversed(arguments), reversed(self.arguments)))


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        return one is other or (one.dtype == other.dtype and np.array_equal(one, other))
    return bool(type(one) is type(other) and one == other)
