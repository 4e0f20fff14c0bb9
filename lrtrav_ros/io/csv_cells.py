"""Text of others, such as file names and what errors say of them, in the cells of tables."""

from __future__ import annotations

from collections.abc import Mapping

_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")


def cell_text(text: str) -> str:
    """Return a cell that no spreadsheet takes for a formula, and that UTF-8 can hold.

    A text that begins with ``=``, ``+``, ``-``, ``@``, a tab or a carriage return gets an apostrophe before it, unless
    it is a number; so does one that begins with an apostrophe: no two texts that UTF-8 can hold give one cell. Bytes of
    a file name that are not UTF-8 become ``\\udcXX``.

    Parameters
    ----------
    text : str
        The text.
    """
    text = printable(text)
    is_guarded = text.startswith("'") or (text.startswith(_FORMULA_STARTS) and not _is_number(text))
    return f"'{text}" if is_guarded else text


def cells(row: Mapping[str, str]) -> dict[str, str]:
    """Return a row of a table with all its cells as `cell_text` has them."""
    return {column: cell_text(text) for column, text in row.items()}


def printable(text: str) -> str:
    """Return a text that UTF-8 can hold: bytes of file names that are not UTF-8 become ``\\udcXX``."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
