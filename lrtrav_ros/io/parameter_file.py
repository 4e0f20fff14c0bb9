"""ROS 2 parameter files, read as the nodes would read them, and written.

Sections are ``NAME: ros__parameters: …``. NAME is a node's, with or without the leading slash, its namespaces as maps
or joined by slashes; ``*`` stands for one part of it, ``**`` for any number. Of the sections that match a node, each
overrides those before it, as rcl and rclpy have it.
"""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeAlias

import yaml

from lrtrav_ros.config import (
    LONG_RANGE_STAGES,
    SHORT_RANGE_STAGES,
    Config,
    Value,
    find_parameter,
    foreign_names,
    is_general,
    parameters,
)
from lrtrav_ros.io.input_files import read_text

# The stages that a node decides offline: where both nodes have one, the short range does the work.
_STAGES = {
    "short_range": frozenset(SHORT_RANGE_STAGES),
    "long_range": frozenset(LONG_RANGE_STAGES) - frozenset(SHORT_RANGE_STAGES),
}
_PARAMETERS = "ros__parameters"
# A file with all parameters has 4 KB and is no deeper than 3.
_MAX_BYTES = 1 << 17
_MAX_BRACKETS = 32
_MAX_DIGITS = 64

_TOO_DEEP = "is nested too deeply for parameters"
_SECTION = r"/?(\w+|\*\*?)(/(\w+|\*\*?))*"

_Pairs: TypeAlias = tuple[tuple[Any, Any], ...]
"""A map of a YAML file."""

_Sections: TypeAlias = Mapping[str, Mapping[str, object]]
"""Parameters by the name of their section, a node's or a pattern, as it is spelt; in the file's order."""


@dataclass(frozen=True, slots=True)
class ParameterFile:
    """The parameters that a file has for the nodes of this package.

    Attributes
    ----------
    values : dict of str to object
        Those that it sets one by one, by full name.
    preset_values : dict of str to bool, int, float or str
        Those that its ``preset`` sets; empty where it names none.
    foreign : tuple of str
        Names in sections for several nodes that belong to nodes of other packages.
    """

    values: dict[str, object] = field(default_factory=dict)
    preset_values: dict[str, Value] = field(default_factory=dict)
    foreign: tuple[str, ...] = ()

    def config(self, preset: str = "") -> Config:
        """Return the configuration that the file gives.

        Parameters
        ----------
        preset : str, optional
            The preset to start from in place of the file's own.

        Raises
        ------
        ValueError
            If there is no such preset.
        """
        base = Config.preset(preset) if preset else Config().updated(self.preset_values)
        return base.updated(self.values)


def read_parameter_file(path: str | os.PathLike[str]) -> ParameterFile:
    """Read what a ROS parameter file has for ``short_range`` and ``long_range``, whatever their namespace.

    Each node's sections give the parameters of that node's stages; other nodes' sections are passed over.

    Parameters
    ----------
    path : path-like
        The YAML file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no ROS parameter file, a parameter is unknown or its value does not fit, or nodes of one name in
        several namespaces would get different parameters; the message names the file.
    """
    text = read_text(path, max_bytes=_MAX_BYTES)
    try:
        return _parameters_for_us(_sections(text))
    except yaml.YAMLError as err:
        raise ValueError(f"{path} is not YAML: {' '.join(str(err).split())}") from err
    except ValueError as err:
        raise ValueError(f"{path}: {err}") from err


def dump_parameters(config: Config) -> str:
    """Return `config` as the text of a ROS parameter file, which `read_parameter_file` and the nodes read."""
    return yaml.safe_dump({"/**": {_PARAMETERS: config.values()}}, sort_keys=False)


def _parameters_for_us(sections: _Sections) -> ParameterFile:
    """Return what the sections have for both nodes."""
    values: dict[str, object] = {}
    preset_values: dict[str, Value] = {}
    foreign: list[str] = []
    for node, stages in _STAGES.items():
        foreign += _foreign_names(sections, node)
        own = {parameter.name for parameter in parameters() if parameter.stage in stages}
        given = _given(sections, node, own | {"preset"})
        if "preset" in given:
            preset = Config.preset(str(given.pop("preset")))
            preset_values.update((name, value) for name, value in preset.values().items() if name in own)
        values.update(given)
    Config().updated(values)  # raises where one does not fit
    return ParameterFile(values, preset_values, tuple(dict.fromkeys(foreign)))


def _foreign_names(sections: _Sections, node: str) -> list[str]:
    """Return the names for nodes of others in the sections for `node`; a section for it alone must have none."""
    foreign: list[str] = []
    for section, values in sections.items():
        if _tokens(section)[-1] == node:
            for name in values:
                if not is_general(name):
                    find_parameter(name)
        elif _example(section, node):
            foreign += foreign_names(values)
    return foreign


def _given(sections: _Sections, node: str, names: Collection[str]) -> dict[str, object]:
    """Return those of the parameters `names` that `node` is given; raises ValueError where namespaces disagree."""
    given = {
        full_name: {name: value for name, value in _overlaid(sections, full_name).items() if name in names}
        for full_name in _full_names(sections, node)
    }
    if not given:
        return {}
    (first, values), *others = given.items()
    for other, other_values in others:
        for name in [*values, *other_values]:
            if values.get(name) != other_values.get(name):
                here, there = (repr(own[name]) if name in own else "not set" for own in (values, other_values))
                raise ValueError(f"{name} is {here} for {first} and {there} for {other}; keep the sections of one")
    return values


def _full_names(sections: _Sections, node: str) -> list[str]:
    """Return the full names of the nodes called `node` that sections name; a pattern names one where no other fits."""
    examples = {section: example for section in sections if (example := _example(section, node))}
    return list(
        dict.fromkeys(
            example
            for section, example in examples.items()
            if not any(other != example and _matches(section, other) for other in examples.values())
        )
    )


def _example(section: str, node: str) -> str:
    """Return the shortest name of a node called `node` that a section is for, empty for none; ``*`` stays in it."""
    tokens = [token for token in _tokens(section) if token != "**"]
    if tokens and tokens[-1] in (node, "*"):
        tokens.pop()
    elif _tokens(section)[-1] != "**":
        return ""
    return "".join(f"/{token}" for token in (*tokens, node))


def _overlaid(sections: _Sections, full_name: str) -> dict[str, object]:
    """Return the parameters of a node: those of its sections, each overriding the ones before."""
    return {
        name: value
        for section, values in sections.items()
        if _matches(section, full_name)
        for name, value in values.items()
    }


def _matches(section: str, full_name: str) -> bool:
    """Return whether a section is for a node."""
    wildcards = {"*": "/[^/]+", "**": "(/[^/]+)*"}
    pattern = "".join(wildcards.get(token, f"/{token}") for token in _tokens(section))
    return re.fullmatch(pattern, full_name) is not None


def _tokens(section: str) -> list[str]:
    """Return the parts of a name; the leading slash can be left out."""
    return section.removeprefix("/").split("/")


class _Loader(yaml.SafeLoader):
    """Reads numbers such as 1e-3 as rcl does, and maps as pairs: a file may name a section more than once.

    As rcl does, it refuses aliases, of which some lines make gigabytes.
    """

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """Return the next node; raises ValueError."""
        if self.check_event(yaml.AliasEvent):
            raise ValueError("has an alias, such as *a, which ROS 2 does not read; write its value out")
        if self.flow_level > _MAX_BRACKETS:
            raise ValueError(_TOO_DEEP)
        return super().compose_node(parent, index)

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        """Return a whole number; raises ValueError."""
        if len(node.value) > _MAX_DIGITS:
            raise ValueError(f"has a number of {len(node.value)} digits")
        return super().construct_yaml_int(node)


_Loader.add_constructor("tag:yaml.org,2002:map", lambda loader, node: tuple(loader.construct_pairs(node, deep=True)))
_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)
_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$"), list("-+.0123456789")
)


def _sections(text: str) -> _Sections:
    """Return the sections of a file; a section that occurs again is merged into its first occurrence."""
    try:
        document = yaml.load(text, Loader=_Loader)
    except RecursionError as err:
        raise ValueError(_TOO_DEEP) from err
    except (LookupError, TypeError, AttributeError, OverflowError) as err:  # PyYAML, of tags that do not fit
        raise ValueError(f"has a tag that does not fit its value ({err!r})") from err
    sections: dict[str, dict[str, object]] = {}
    for section, parameters_of_it in _found_sections(document, "") if isinstance(document, tuple) else ():
        sections.setdefault(section, {}).update(_flattened(parameters_of_it, ""))
    if not sections:
        raise ValueError(f"has no parameters; write them under '/**:' and '{_PARAMETERS}:'")
    return sections


def _found_sections(pairs: _Pairs, name: str) -> Iterator[tuple[str, _Pairs]]:
    """Yield the name of each section under `name`, as it is spelt, and its parameters."""
    for key, value in pairs:
        below = f"{name}/{key}" if name and not name.endswith("/") else f"{name}{key}"
        if not isinstance(value, tuple):
            raise ValueError(f"has no '{_PARAMETERS}:' under {name or key!r}; write the parameters there")
        if key != _PARAMETERS:
            yield from _found_sections(value, below)
        elif re.fullmatch(_SECTION, name):
            yield name, value
        else:
            raise ValueError(f"{name!r} is no name of a node; write it as /NAMESPACE/NODE, with * or ** for a part")


def _flattened(pairs: _Pairs, prefix: str) -> Iterator[tuple[str, object]]:
    """Yield full names and values of nested parameters."""
    for key, value in pairs:
        if isinstance(value, tuple):
            yield from _flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
