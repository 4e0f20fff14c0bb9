"""What could not be read or used, told once for each kind."""

from __future__ import annotations

from collections.abc import Hashable


class Problems:
    """Collects problems: of those that are alike the first one, and how many there are.

    The same recording may be gone through several times, so that a case that is known is not counted again.
    """

    def __init__(self) -> None:
        self._firsts: dict[str, str] = {}
        self._cases: dict[str, set[Hashable]] = {}

    def __bool__(self) -> bool:
        """Return whether there are any."""
        return bool(self._firsts)

    def add(self, text: str, *, kind: str | None = None, case: Hashable = None) -> None:
        """Add a problem of a kind, by default that of its text; `case` is what tells two of a kind apart."""
        kind = text if kind is None else kind
        self._firsts.setdefault(kind, text)
        self._cases.setdefault(kind, set()).add(case)

    def lines(self) -> list[str]:
        """Return one line for each kind, in the order in which they were first met."""
        more = {kind: len(cases) - 1 for kind, cases in self._cases.items()}
        return [
            f"{text} (and {more[kind]} more like it)" if more[kind] else text for kind, text in self._firsts.items()
        ]
