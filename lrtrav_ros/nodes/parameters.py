"""The parameters of a node, from `lrtrav_ros.config`, as one immutable configuration that can change at run time."""

from __future__ import annotations

import sys
from collections.abc import Collection
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from lrtrav_ros.config import NODE_DEFAULTS, PRESETS, Config, Parameter, Value, foreign_names, parameters

_INT64_MAX = 2**63 - 1


class Settings:
    """Declares parameters on a node and keeps `config` up to date.

    Defaults are those of the preset, but for `config.NODE_DEFAULTS`. A change is checked as a whole and then takes
    effect at once: whoever reads `config` sees all of a batch or none. Values for parameters of other packages' nodes,
    which sections for all nodes contain, are ignored with a warning.

    Parameters
    ----------
    node : rclpy.node.Node
        Where the parameters are declared.
    stages : collection of str
        Which of them: `config.SHORT_RANGE_STAGES` or `config.LONG_RANGE_STAGES`.

    Attributes
    ----------
    config : Config
        The configuration; a new one after each change.

    Raises
    ------
    ValueError
        If a value that the node was started with does not fit, or is for a misspelt parameter.
    """

    def __init__(self, node: Node, stages: Collection[str]) -> None:
        self._node = node
        self._warn_of_foreign_names()
        self.config = Config.preset(self._declared_preset()).updated(NODE_DEFAULTS)
        defaults = self.config.values()
        own = {
            parameter.name: self._declare(parameter.name, defaults[parameter.name], _descriptor(parameter))
            for parameter in parameters()
            if parameter.stage in stages
        }
        self._own_names = set(own)
        self.config = self.config.updated(own)  # all together: one may only fit with another that comes later
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    @property
    def stamp_tolerance_ns(self) -> int:
        """``source.max_stamp_difference_s`` in nanoseconds."""
        return round(self.config.source.max_stamp_difference_s * 1e9)

    def _warn_of_foreign_names(self) -> None:
        """Warn of values given at the start for nodes of others; raises ValueError where a name is misspelt."""
        foreign = foreign_names(getattr(self._node, "_parameter_overrides", {}))
        if foreign:
            self._node.get_logger().warning(f"ignored, this package has no such parameters: {', '.join(foreign)}")

    def _declared_preset(self) -> str:
        """Declare the parameter ``preset`` and return its value."""
        text = f"the defaults of all other parameters: {' or '.join(PRESETS)}"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        return str(self._declare("preset", PRESETS[0], descriptor))

    def _declare(self, name: str, default: Value, descriptor: ParameterDescriptor) -> Any:
        """Declare a parameter and return its value; raises ValueError where the value given at the start is refused."""
        try:
            return self._node.declare_parameter(name, default, descriptor).value
        except ParameterException as err:
            raise ValueError(str(err)) from err

    def _with_changes(self, changes: list[RosParameter]) -> Config:
        """Return the configuration with the changes of parameters; raises ValueError where one does not fit."""
        return self.config.updated({item.name: item.value for item in changes if item.name in self._own_names})

    def _validate(self, changes: list[RosParameter]) -> SetParametersResult:
        """Accept or refuse changes, all together."""
        try:
            self._with_changes(changes)
        except ValueError as err:
            return SetParametersResult(successful=False, reason=str(err))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[RosParameter]) -> None:
        """Take over changes that `_validate` accepted."""
        self.config = self._with_changes(changes)


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    """Return what ROS tools show of a parameter and hold it to."""
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    descriptor = ParameterDescriptor(
        description=f"{parameter.description}{unit}",
        additional_constraints=f"one of {', '.join(parameter.choices)}" if parameter.choices else "",
        read_only=parameter.read_only,
        # `15` in a YAML file or on a command line is an integer, and is as good for a float as `15.0`.
        dynamic_typing=parameter.type is float,
    )
    low, high = parameter.minimum, parameter.maximum
    if parameter.type is int:
        bounds = (-_INT64_MAX if low is None else int(low), _INT64_MAX if high is None else int(high))
        descriptor.integer_range = [IntegerRange(from_value=bounds[0], to_value=bounds[1])]
    elif parameter.type is float:
        least, most = (-sys.float_info.max if low is None else low), (sys.float_info.max if high is None else high)
        descriptor.floating_point_range = [FloatingPointRange(from_value=float(least), to_value=float(most))]
    return descriptor
