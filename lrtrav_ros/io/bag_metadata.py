"""What the ``metadata.yaml`` of a ROS 2 bag says."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePath
from typing import Any

import yaml

_MAX_DEPTH = 64
_MAX_DIGITS = 20  # of 64 bits; to read thousands takes minutes
_MAX_BYTES = 4 << 20  # a recording of a hundred topics in a thousand files takes a tenth of it


@dataclass(frozen=True, slots=True)
class BagMetadata:
    """The files of a recording, by their names, and how many messages there are on each topic."""

    names: tuple[str, ...] = ()
    counts: tuple[tuple[str, int], ...] = ()


class _Loader(yaml.SafeLoader):
    """Refuses merged mappings, of which a few lines can make endless ones, and endless numbers."""

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Leave ``<<`` a key, which then is none that can be read."""

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Return a whole number; raises ValueError."""
        if len(node.value) > _MAX_DIGITS:
            raise ValueError(f"it has a number of {len(node.value)} digits")
        return super().construct_yaml_int(node)


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)


def read_metadata(path: Path) -> BagMetadata:
    """Read the file.

    Raises
    ------
    ValueError
        If it is damaged; the message does not name it.
    OSError
        If it cannot be read.
    """
    if not path.is_file():
        raise ValueError("it is no regular file")
    if path.stat().st_size > _MAX_BYTES:
        raise ValueError(f"it is larger than {_MAX_BYTES} bytes")
    try:
        text = path.read_text(encoding="utf-8")
        check_depth(text)
        content: Any = yaml.load(text, _Loader)
        information = content["rosbag2_bagfile_information"]
        names = tuple(PurePath(name).name for name in information["relative_file_paths"])
        topics = information.get("topics_with_message_count", ())
        counts = tuple(_count(topic["topic_metadata"]["name"], topic["message_count"]) for topic in topics)
    except RecursionError as err:
        raise ValueError("it is nested too deeply") from err
    except KeyError as err:
        raise ValueError(f"it does not tell {err}") from err
    except (yaml.YAMLError, ValueError, TypeError, AttributeError, OverflowError) as err:
        raise ValueError(" ".join(str(err).split())[:200]) from err
    return BagMetadata(names, counts)


def _count(name: object, count: object) -> tuple[str, int]:
    """Return a topic's name and count; of lists that alias each other a text would take gigabytes."""
    if not isinstance(name, str) or not isinstance(count, int):
        raise ValueError("a topic's name is no text, or its count no whole number")
    return name, count


def check_depth(text: str) -> None:
    """Raise ValueError where brackets are nested so deeply that YAML's reader takes minutes."""
    depth = 0
    for bracket in re.findall(r"[][{}]", text):
        depth += 1 if bracket in "[{" else -1
        if depth > _MAX_DEPTH:
            raise ValueError("it is nested too deeply")
