"""Rows of the pages of an SQLite file, where the tree that leads to them is damaged or cut off.

The layout of a page, a cell and a record is that of https://www.sqlite.org/fileformat2.html (sections 1.6 and 2.1).
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, NamedTuple

from lrtrav_ros.io.bag_records import file_size

_LEAF_OF_TABLE = 0x0D
_HEADER_BYTES = 100
_INTEGER_BYTES = {1: 1, 2: 2, 3: 3, 4: 4, 5: 6, 6: 8}
_FIRST_BLOB = 12


class MessageRow(NamedTuple):
    """A row of the table of messages."""

    number: int
    topic: int
    time_ns: int
    data: bytes


def message_rows(path: Path) -> Iterator[MessageRow]:
    """Yield the rows that look like messages, in the order of their pages: two integers and a blob after the id."""
    with path.open("rb") as file:
        header = file.read(_HEADER_BYTES)
        if len(header) < _HEADER_BYTES:
            return
        (page_size,) = struct.unpack_from(">H", header, 16)
        pages = _Pages(file, 1 << 16 if page_size == 1 else page_size, n_reserved=header[20])
        if page_size != 1 and page_size < 512:
            return
        for number in range(1, pages.n + 1):
            yield from pages.rows(number)


class _Pages:
    """The pages of a file, by their number from 1."""

    def __init__(self, file: BinaryIO, page_size: int, *, n_reserved: int) -> None:
        self._file = file
        self._page_size = page_size
        self._usable = page_size - n_reserved
        self._room = file_size(file)  # every byte of it is one row's, whatever damaged sizes and links say
        self.n = self._room // page_size if page_size else 0

    def rows(self, number: int) -> Iterator[MessageRow]:
        """Yield the rows of a page, but for those that are damaged."""
        page = self._page(number)
        start = _HEADER_BYTES if number == 1 else 0
        if page[start] != _LEAF_OF_TABLE:
            return
        (n_cells,) = struct.unpack_from(">H", page, start + 3)
        for i in range(min(n_cells, (len(page) - start - 8) // 2)):
            (at,) = struct.unpack_from(">H", page, start + 8 + 2 * i)
            try:
                size, at = _varint(page, at)
                row, at = _varint(page, at)
                if size <= self._room:
                    self._room -= size
                    yield _message(row, self._payload(page, at, size))
            except (IndexError, ValueError, struct.error):
                continue

    def _page(self, number: int) -> bytes:
        if not 1 <= number <= self.n:
            raise IndexError(f"there is no page {number}")
        self._file.seek((number - 1) * self._page_size)
        return self._file.read(self._page_size)

    def _payload(self, page: bytes, at: int, size: int) -> bytes:
        """Return what a cell holds, on its page and those that it is continued on."""
        usable = self._usable
        n_here = size
        if size > usable - 35:
            least = (usable - 12) * 32 // 255 - 23
            n_here = least + (size - least) % (usable - 4)
            n_here = n_here if n_here <= usable - 35 else least
        parts, left = [page[at : at + n_here]], size - n_here
        following = page[at + n_here :]
        while left > 0:
            page = self._page(struct.unpack_from(">I", following)[0])
            parts.append(page[4 : min(usable, 4 + left)])
            left -= len(parts[-1])
            following = page
        return b"".join(parts)


def _message(number: int, payload: bytes) -> MessageRow:
    """Return the row of a record; raises ValueError where it is none of a message."""
    header_size, at = _varint(payload, 0)
    kinds = []
    while at < header_size:
        kind, at = _varint(payload, at)
        kinds.append(kind)
    if len(kinds) != 4 or kinds[0] != 0 or kinds[3] < _FIRST_BLOB or kinds[3] % 2:
        raise ValueError("it is no message")
    topic, at = _integer(payload, at, kinds[1])
    time_ns, at = _integer(payload, at, kinds[2])
    data = payload[at:]
    if len(data) != (kinds[3] - _FIRST_BLOB) // 2:
        raise ValueError("it is not whole")
    return MessageRow(number, topic, time_ns, data)


def _integer(data: bytes, at: int, kind: int) -> tuple[int, int]:
    """Return an integer, and where the next value begins."""
    if kind in (8, 9):
        return kind - 8, at
    if kind not in _INTEGER_BYTES:
        raise ValueError("it is no integer")
    end = at + _INTEGER_BYTES[kind]
    return int.from_bytes(data[at:end], "big", signed=True), end


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """Return an integer of 1 to 9 bytes, and where the next one begins."""
    value = 0
    for i in range(8):
        value = value << 7 | data[at + i] & 0x7F
        if data[at + i] < 0x80:
            return value, at + i + 1
    return value << 8 | data[at + 8], at + 9
