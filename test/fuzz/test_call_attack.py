"""Every public function that takes arrays, with some of its arguments replaced by whatever there is.

Each call is taken, or refused with what is wrong and what to give; one that ends the process ends the test.
"""

from __future__ import annotations

from hostile_arguments import in_place_of
from hypothesis import given
from hypothesis import strategies as st
from public_calls import public_calls

CALLS = public_calls()
SIZES = ((12, 20), (1, 1), (1, 9), (9, 1), (40, 60), (7, 33))


@given(data=st.data())
def test_public_calls(data: st.DataObject) -> None:
    call = data.draw(st.sampled_from(CALLS))
    arguments = call.make(*data.draw(st.sampled_from(SIZES)))
    names = st.lists(st.sampled_from(list(arguments)), min_size=1, max_size=3, unique=True)
    for name in data.draw(names):
        values = list(in_place_of(arguments[name]))
        arguments[name] = values[data.draw(st.integers(0, len(values) - 1), label=name)]
    call.answer(arguments)
