# SPDX-License-Identifier: Apache-2.0
"""Options as ROS parameters: declared with description and range, changed as a whole or not."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping, Sequence
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

from kalman_ros.core import Option, Value, refuse_unknown
from kalman_ros.core.registry import names_code

from .managed import reason

#: Parameters that rclpy itself reads from the same files.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
_LIMIT = 1e300


def given(node: Node) -> dict[str, Value]:
    """Return the values of the parameters that there are, but for those of rclpy."""
    return {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not name.startswith(_OF_RCLPY)
    }


def as_declared(node: Node, parameter: Parameter) -> Parameter:
    """Return a parameter with its value in the type that it has been declared with, if it fits.

    ``ros2 param load`` sends numbers such as 1e-05 and inf, and lists with one in them, as words,
    and an empty list as one of no type.
    """
    name, value = parameter.name, parameter.value
    if not node.has_parameter(name) or node.describe_parameter(name).dynamic_typing:
        return parameter
    current = node.get_parameter(name).value
    if _is_list(current):
        if isinstance(value, str) and value.startswith('[') and value.endswith(']'):
            value = [item.strip() for item in value[1:-1].split(',')]
        if all(isinstance(item, float) for item in current) and _is_list(value):
            value = [_number(item) for item in value]
        elif not value and all(isinstance(item, str) for item in current):
            value = ['']
    elif isinstance(current, float):
        value = _number(value)
    try:
        return Parameter(name, value=value)
    except TypeError:  # a mixture, which no parameter can be
        return parameter


def is_kept(node: Node, parameter: Parameter) -> bool:
    """Return whether a parameter has the value already."""
    name = parameter.name
    if not node.has_parameter(name):
        return False
    current, value = node.get_parameter(name).value, parameter.value
    if _is_list(current) and _is_list(value):
        return [*current] == [*value]
    return type(current) is type(value) and bool(current == value)


def _is_list(value: Any) -> bool:
    return isinstance(value, (Sequence, array)) and not isinstance(value, (str, bytes))


def _number(value: Any) -> Any:
    """Return a word as the number that it is, a whole number as one with a fraction."""
    if not isinstance(value, (str, int)) or isinstance(value, bool):
        return value
    try:
        return float(value)
    except (ValueError, OverflowError):
        return value


def free(node: Node, values: Mapping[str, Value]) -> None:
    """Declare these values instead of all that there are, free to become anything else."""
    free = {name: ParameterDescriptor(dynamic_typing=True) for name in values}
    _replace(node, {name: (value, free[name]) for name, value in values.items()})


def _replace(node: Node, declared: Mapping[str, tuple[Value, ParameterDescriptor]]) -> None:
    """Declare values with their descriptors instead of all that there are."""
    for name in given(node):
        node.describe_parameter(name).read_only = False  # else it could not be taken back
        node.undeclare_parameter(name)
    triples = [(name, value, descriptor) for name, (value, descriptor) in declared.items()]
    node.declare_parameters('', triples, ignore_override=True)


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


class CodeNames:
    """Refuses parameters that name code unless they are as they were at the start of the node.

    To import a module is to run it, and anybody in the ROS domain may call a node's services. So
    what is imported, and which file is opened, is for the start-up parameters alone to say.
    """

    def __init__(self, node: Node) -> None:
        self._trusted = given(node)
        node.add_on_set_parameters_callback(self._check)

    def trust(self, values: Mapping[str, Value]) -> None:
        """Accept these values too: what the start-up parameters amount to, with defaults."""
        self._trusted.update(values)

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for name, value in ((found.name, found.value) for found in parameters):
            if names_code(name) and value != self._trusted.get(name):
                why = 'names code, which counts only from the start-up parameters'
                return SetParametersResult(successful=False, reason=f'{name}: it {why}')
        return SetParametersResult(successful=True)


class LiveParameters:
    """Declares parameters and lets them change: all that are set together, or none.

    Parameters
    ----------
    node
        The node. What it was given before comes back at the end.
    options
        What each parameter means, by name.
    values
        The value of each.
    prepare
        Builds everything from a full set of values and returns a function that puts it in
        place. Raising ValueError refuses the change with that reason.
    """

    def __init__(
        self,
        node: Node,
        options: Mapping[str, Option],
        values: Mapping[str, Value],
        prepare: Callable[[dict[str, Value]], Callable[[], None]],
    ) -> None:
        self._node = node
        self._given = given(node)
        self._options = options
        self._values = dict(values)
        self._changes: dict[str, Value] = {}
        self._prepare = prepare
        self._ready: Callable[[], None] = lambda: None
        known = options.values()
        _replace(node, {o.name: (values[o.name], _descriptor(o)) for o in known})
        node.add_pre_set_parameters_callback(self._typed)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def close(self) -> None:
        """Leave only what was given, with what has changed since, free to become anything."""
        node = self._node
        node.remove_pre_set_parameters_callback(self._typed)
        node.remove_on_set_parameters_callback(self._check)
        node.remove_post_set_parameters_callback(self._apply)
        free(node, self._given)

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
            if not parameter.name.startswith(_OF_RCLPY)
        }
        try:
            refuse_unknown(changes, self._options, 'parameter')
            for name, value in changes.items():
                self._options[name].check(value)
            if changes:
                self._ready = self._prepare({**self._values, **changes})
        except Exception as error:  # a model of a user's own may raise anything
            why = reason(error) or f'{type(error).__name__}: {error}'
            return SetParametersResult(successful=False, reason=why)
        self._changes = changes
        return SetParametersResult(successful=True)

    def _apply(self, _: list[Parameter]) -> None:
        if self._changes:
            self._ready()
            self._values.update(self._changes)
            self._given.update(self._changes)
            self._changes = {}
