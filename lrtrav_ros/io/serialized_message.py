"""Messages as they come over the wire (CDR): the stamp is read at once, the rest when the message's turn comes."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import cache
from typing import Any

from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

_KIND_BYTES = 4  # which encoding the rest has; its second byte is odd where numbers are little-endian
_STAMP_END = _KIND_BYTES + 8


@dataclass(frozen=True, slots=True, eq=False)
class SerializedMessage:
    """A message that begins with a header, as bytes.

    Parameters
    ----------
    data : bytes
        The message in CDR, as ROS 2 sends and records it.
    type_name : str
        Its type, such as ``sensor_msgs/msg/Image``.

    Raises
    ------
    ValueError
        If `data` ends before the stamp.
    """

    data: bytes
    type_name: str

    def __post_init__(self) -> None:
        if len(self.data) < _STAMP_END:
            raise ValueError(f"damaged message: {len(self.data)} bytes are no {self.type_name}")

    @property
    def stamp_ns(self) -> int:
        """The header's stamp in nanoseconds."""
        order = "<" if self.data[1] & 1 else ">"
        seconds, nanoseconds = struct.unpack_from(f"{order}iI", self.data, _KIND_BYTES)
        return int(seconds) * 10**9 + int(nanoseconds)

    @property
    def without_stamp(self) -> bytes:
        """All but the header's stamp: the same in messages that say the same."""
        return self.data[:_KIND_BYTES] + self.data[_STAMP_END:]

    def decode(self) -> Any:
        """Return the message; its arrays are read-only views of `data`.

        Raises
        ------
        ValueError
            If `data` is no whole message of this type.
        """
        try:
            return _types().deserialize_cdr(memoryview(self.data), self.type_name)
        except Exception as err:  # rosbags raises anything from AssertionError to struct.error on damaged data
            raise ValueError(f"damaged message: {len(self.data)} bytes are no {self.type_name} ({err})") from err


@cache
def _types() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)
