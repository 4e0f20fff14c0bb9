"""The long run of these tests: with ``FUZZ_MINUTES`` each is repeated, with other examples, for its share of the time.

A table at the end says how many examples each test has seen.
"""

from __future__ import annotations

import functools
import itertools
import os
import time
from collections.abc import Generator
from typing import Any

import pytest

_MINUTES = float(os.environ.get("FUZZ_MINUTES", "0"))
_PROCESSES = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_SHARE_S = pytest.StashKey[float]()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give each of these tests its share of the minutes, which all processes have at the same time."""
    fuzzed = [item for item in items if hasattr(getattr(item, "obj", None), "hypothesis")]
    for item in fuzzed:
        item.stash[_SHARE_S] = _MINUTES * 60 * _PROCESSES / len(fuzzed)


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Generator[None, object, object]:
    """Run a test as pytest does, then again until its share of the time is over."""
    start, share_s = time.monotonic(), pyfuncitem.stash.get(_SHARE_S, 0.0)
    if not share_s:
        return (yield)
    test, number = pyfuncitem.obj, itertools.count()
    once = test.hypothesis.inner_test

    @functools.wraps(once)
    def counted(*args: Any, **kwargs: Any) -> object:
        next(number)
        return once(*args, **kwargs)

    test.hypothesis.inner_test = counted
    try:
        result = yield
        while time.monotonic() - start < share_s:
            test(**{name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames})
        return result
    finally:
        test.hypothesis.inner_test = once
        pyfuncitem.user_properties.append(("examples", next(number)))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Write how many examples each test has seen."""
    reports = [report for outcome in ("passed", "failed") for report in terminalreporter.getreports(outcome)]
    counts = {report.nodeid: dict(report.user_properties).get("examples") for report in reports}
    counts = {nodeid: count for nodeid, count in counts.items() if count is not None}
    if counts:
        terminalreporter.section("examples")
    for nodeid, count in counts.items():
        terminalreporter.line(f"{count:9,d}  {nodeid}")
