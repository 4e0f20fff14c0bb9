"""The parameters of a node, from `lrtrav_ros.config`, as one immutable configuration that can change at run time."""

from __future__ import annotations

import sys
from collections.abc import Collection
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from lrtrav_ros import config

_INT64_MAX = 2**63 - 1
_NOT_OURS = ("qos_overrides.", "use_sim_time", "start_type_description_service", "preset")


class Settings:
    """Declares parameters on a node and keeps `config` up to date.

    A change is checked as a whole and then takes effect at once: who reads `config` sees all of a batch or nothing.

    Parameters
    ----------
    node
        Where the parameters are declared.
    stages
        Which of them: the first part of their names, such as ``stereo``.

    Raises
    ------
    ValueError
        If a value that the node was started with does not fit.
    """

    def __init__(self, node: Node, stages: Collection[str]) -> None:
        self._node = node
        self._refusal = ""
        self.config = config.Config.preset(self._declared_preset())
        self._names = {known.name for known in config.parameters() if known.name.partition(".")[0] in stages}
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)
        defaults = self.config.values()
        for known in config.parameters():
            if known.name in self._names:
                self._declare(known.name, defaults[known.name], _descriptor(known))
        self._warn_of_unknown()

    @property
    def stamp_tolerance_ns(self) -> int:
        """``source.max_stamp_difference_s`` in nanoseconds."""
        return round(self.config.source.max_stamp_difference_s * 1e9)

    def _declared_preset(self) -> str:
        text = f"the defaults of all other parameters: {' or '.join(config.PRESETS)}"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        return str(self._declare("preset", config.PRESETS[0], descriptor))

    def _declare(self, name: str, default: config.Value, descriptor: ParameterDescriptor) -> Any:
        try:
            return self._node.declare_parameter(name, default, descriptor).value
        except ParameterException as err:
            raise ValueError(self._refusal or str(err)) from err

    def _changed(self, parameters: list[RosParameter]) -> config.Config:
        """Return the configuration with the changes of `parameters`; raises ValueError where one does not fit."""
        return self.config.updated({item.name: item.value for item in parameters if item.name in self._names})

    def _validate(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            self._changed(parameters)
        except ValueError as err:
            self._refusal = str(err)
            return SetParametersResult(successful=False, reason=self._refusal)
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[RosParameter]) -> None:
        self.config = self._changed(parameters)

    def _warn_of_unknown(self) -> None:
        """Warn of values given at the start that no parameter takes: most likely a name is misspelt."""
        for name in getattr(self._node, "_parameter_overrides", {}):
            if name.startswith(_NOT_OURS):
                continue
            try:
                config.find_parameter(name)
            except ValueError as err:
                self._node.get_logger().warning(f"a value is given for an unknown parameter: {err}")


def _descriptor(parameter: config.Parameter) -> ParameterDescriptor:
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
