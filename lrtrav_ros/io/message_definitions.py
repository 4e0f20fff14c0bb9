"""The texts of message types, which a bag carries so that programs without them can read it."""

from __future__ import annotations

from dataclasses import dataclass

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from lrtrav_ros.io.bag_messages import ROS2
from lrtrav_ros.io.bag_reader import MAX_DEFINITION_CHARACTERS, BagReader


@dataclass(frozen=True, slots=True)
class MessageDefinition:
    """The text of a type, and its hash (RIHS01)."""

    text: str
    digest: str


def own_definition(kind: str) -> MessageDefinition:
    """Return the definition of a type of ROS 2 that this package writes, such as ``sensor_msgs/msg/Image``."""
    return _definition(ROS2, kind)


def recorded_definition(reader: BagReader, kind: str) -> MessageDefinition:
    """Return the definition of a type of the messages that a reader yields.

    Raises
    ------
    ValueError
        If the recording does not say what the type is, and it is none of ROS 2's own.
    """
    try:
        if reader.typestore is not None:
            return _definition(ROS2 if _is_alike(kind, reader.typestore) else reader.typestore, kind)
        text = reader.definitions.get(kind)
        if text is None:
            return _definition(ROS2, kind)
        if len(text) > MAX_DEFINITION_CHARACTERS:
            raise ValueError(f"its definition takes more than {MAX_DEFINITION_CHARACTERS} characters")
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_idl(text) if text.startswith("=") else get_types_from_msg(text, kind))
        return MessageDefinition(text, store.hash_rihs01(kind))
    except Exception as err:  # rosbags raises anything from KeyError to its own errors
        raise ValueError(f"type {kind} is not known ({type(err).__name__}: {err})") from err


def _definition(store: Typestore, kind: str) -> MessageDefinition:
    return MessageDefinition(store.generate_msgdef(kind, ros_version=2)[0], store.hash_rihs01(kind))


def _is_alike(kind: str, store: Typestore) -> bool:
    """Return whether a type has the same layout in ROS 2, whatever its fields are called."""
    return kind in ROS2.fielddefs and _layout(kind, store) == _layout(kind, ROS2)


def _layout(kind: str, store: Typestore) -> object:
    """Return the kinds of a type's fields, those of its parts in their place."""

    def resolved(value: object) -> object:
        if isinstance(value, tuple):
            return tuple(resolved(part) for part in value)
        return _layout(value, store) if isinstance(value, str) and value in store.fielddefs else value

    return [resolved(description) for _, description in store.fielddefs[kind][1]]
