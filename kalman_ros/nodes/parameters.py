# SPDX-License-Identifier: Apache-2.0
"""Options as ROS parameters: declared with description and range, changed as a whole or not."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from math import isfinite
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from kalman_ros.core import Option, Value

#: Parameters that rclpy itself reads from the same files.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
_LIMIT = 1e300


def given(node: Node) -> dict[str, Value]:
    """Return what the user set for this node, and forget it: nothing is declared yet.

    The node must have been created with ``automatically_declare_parameters_from_overrides``.
    """
    found = {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not name.startswith(_OF_RCLPY)
    }
    for name in found:
        node.undeclare_parameter(name)
    return found


def declare(node: Node, options: Iterable[Option], values: Mapping[str, Value]) -> None:
    """Declare every option with its value, its meaning and its range."""
    node.declare_parameters(
        '',
        [(option.name, values[option.name], _descriptor(option)) for option in options],
        ignore_override=True,
    )


def _descriptor(option: Option) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=option.description, read_only=not option.about.live
    )
    low, high = option.about.minimum, option.about.maximum
    if isfinite(low) or isfinite(high):
        low, high = max(low, -_LIMIT), min(high, _LIMIT)
        if isinstance(option.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        elif type(option.default) is int:
            top = min(int(high), 2**63 - 1)
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=top)]
    return descriptor


class LiveParameters:
    """Lets parameters change while the node runs: all that are set together, or none.

    Parameters
    ----------
    node
        The node; its parameters are declared.
    options
        The same options, by name.
    prepare
        Builds everything from a full set of values and returns a function that puts it in
        place. Raising ValueError refuses the change with that reason.
    """

    def __init__(
        self,
        node: Node,
        options: Mapping[str, Option],
        prepare: Callable[[dict[str, Value]], Callable[[], None]],
    ) -> None:
        self._options = options
        self._prepare = prepare
        self._values = {name: node.get_parameter(name).value for name in options}
        self._ready: Callable[[], None] | None = None
        node.add_pre_set_parameters_callback(self._typed)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def _typed(self, parameters: list[Parameter]) -> list[Parameter]:
        """Turn whole numbers into numbers where those are wanted; leave what is wrong."""
        result = []
        for parameter in parameters:
            option = self._options.get(parameter.name)
            try:
                value = parameter.value if option is None else option.check(parameter.value)
                result.append(Parameter(parameter.name, value=value))
            except ValueError:
                result.append(parameter)
        return result

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        changes: dict[str, Any] = {
            parameter.name: parameter.value
            for parameter in parameters
            if parameter.name in self._options
        }
        try:
            for name, value in changes.items():
                self._options[name].check(value)
            candidate = {**self._values, **changes}
            self._ready = self._prepare(candidate) if changes else None
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._candidate = candidate
        return SetParametersResult(successful=True)

    def _apply(self, _: list[Parameter]) -> None:
        if self._ready is not None:
            self._ready()
            self._values, self._ready = self._candidate, None
