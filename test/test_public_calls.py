"""Every public function and class that takes arrays, with arguments that it cannot have.

A kernel does not look where it reads and writes: what is refused here would otherwise end the process. That the layout
of good arguments does not matter to the method is tested in `method/test_arguments.py`.
"""

from __future__ import annotations

import dataclasses
import functools
import inspect
import random
from typing import Any

import numpy as np
import pytest
from hostile_arguments import KINDS_OF_NUMBERS, NEVER_ARRAYS, in_place_of, read_only
from public_calls import ELSEWHERE, PublicCall, names_that_take_arrays, public_calls

CALLS = public_calls()
NOT_COMPARED = {"times", "find_clusters", "comparison"}
MOST_RECORDS = 40  # of the records that differ in one field, in place of each argument that is one


def test_the_table_is_complete() -> None:
    checks = {name for name in names_that_take_arrays() if name.startswith("numerics.checks.")}
    assert names_that_take_arrays() - checks - ELSEWHERE <= {f"{call.module}.{call.name}" for call in CALLS}
    assert names_that_take_arrays() >= ELSEWHERE


@pytest.mark.parametrize("call", CALLS, ids=str)
def test_good_arguments_are_taken(call: PublicCall) -> None:
    for height, width in ((12, 20), (1, 1), (1, 9), (9, 1)):
        call.function(**call.make(height, width))


@pytest.mark.parametrize("call", CALLS, ids=str)
def test_arrays_that_cannot_be_written_to_are_taken(call: PublicCall) -> None:
    arguments = call.make(12, 20)
    arrays = {name: read_only(value) for name, value in arguments.items() if isinstance(value, np.ndarray)}
    assert call.answer({**arguments, **arrays}) is None


@pytest.mark.parametrize("call", CALLS, ids=str)
def test_what_does_not_fit_is_refused_with_value_and_remedy(call: PublicCall) -> None:
    arguments = call.make(12, 20)
    for name, good in arguments.items():
        values = list(in_place_of(good))
        if not isinstance(good, np.ndarray):
            values = random.Random(0).sample(values, min(MOST_RECORDS, len(values)))
        for value in values:
            call.answer({**arguments, name: value})
    for name, expected in call.make(12, 20).items():
        if isinstance(expected, np.ndarray):
            np.testing.assert_array_equal(arguments[name], expected)  # no argument was written to


@pytest.mark.parametrize("call", CALLS, ids=str)
def test_what_is_never_an_array_of_numbers_is_refused(call: PublicCall) -> None:
    arguments = call.make(12, 20)
    for name, good in arguments.items():
        if isinstance(good, np.ndarray):
            for value in NEVER_ARRAYS:
                value = np.zeros(good.shape, value) if isinstance(value, np.dtype) else value
                if not (value is None and name in may_be_none(call)):
                    assert call.answer({**arguments, name: value}) is not None, (name, value)


@pytest.mark.parametrize("call", CALLS, ids=str)
def test_numbers_of_numpy_are_as_good_as_those_of_python(call: PublicCall) -> None:
    expected: Any = None
    for name, number in call.make(12, 20).items():
        if type(number) not in (int, float):
            continue
        expected = plain(call.function(**call.make(12, 20))) if expected is None else expected
        for kind in KINDS_OF_NUMBERS:
            same = kind(number) if isinstance(number, int) or issubclass(kind, np.floating) else kind()
            if float(same) == number and call.answer({**call.make(12, 20), name: same}) is None:
                assert plain(call.function(**{**call.make(12, 20), name: same})) == expected, (name, same)


def plain(result: Any) -> Any:
    """Return what can be compared with ``==``: the numbers in arrays and records, without the time that took."""
    if isinstance(result, np.ndarray):
        return result.dtype.str, result.shape, result.tobytes()
    if isinstance(result, (tuple, list)):
        return [plain(item) for item in result]
    if dataclasses.is_dataclass(result):
        return [
            plain(getattr(result, item.name)) for item in dataclasses.fields(result) if item.name not in NOT_COMPARED
        ]
    return repr(result)


@functools.cache
def may_be_none(call: PublicCall) -> set[str]:
    """Return the arguments that may be left out."""
    parameters: Any = inspect.signature(call.function).parameters
    return {name for name, parameter in parameters.items() if parameter.default is None}
