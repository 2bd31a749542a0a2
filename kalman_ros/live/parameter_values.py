# SPDX-License-Identifier: Apache-2.0
"""What a viewer sends for a parameter, as the parameter that a node has declared."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.parameter import Parameter

from kalman_ros.pipeline.settings import OF_RCLPY


def _number(value: Any) -> Any:
    """Return what a viewer means by a number: also a whole one, or the text of an infinite one."""
    if type(value) is int:
        return float(value)
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _same(value: Any) -> Any:
    return value


#: By type: what one value of it is called, its class, and how a viewer's value is read.
_SINGLE: dict[int, tuple[str, type, Callable[[Any], Any]]] = {
    ParameterType.PARAMETER_BOOL: ('true or false', bool, _same),
    ParameterType.PARAMETER_INTEGER: ('a whole number', int, _same),
    ParameterType.PARAMETER_DOUBLE: ('a number', float, _number),
    ParameterType.PARAMETER_STRING: ('a text', str, _same),
}
#: The type of one value of a list.
_LISTS: dict[int, int] = {
    ParameterType.PARAMETER_BOOL_ARRAY: ParameterType.PARAMETER_BOOL,
    ParameterType.PARAMETER_INTEGER_ARRAY: ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_DOUBLE_ARRAY: ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_STRING_ARRAY: ParameterType.PARAMETER_STRING,
}
#: Whole numbers of a message are within these.
_WHOLE = 2**63


def of_viewer(name: str, value: Any, known: ParameterDescriptor) -> Parameter:
    """Return a parameter with a viewer's value; a value for a list of one is accepted.

    Raises
    ------
    ValueError
        If the parameter cannot be changed, or has another type or another range.
    """
    if name.startswith(OF_RCLPY) or known.read_only:
        raise ValueError(f'{name}: it can only be set at the start of the node')
    item = _LISTS.get(known.type, known.type)
    if item not in _SINGLE or known.dynamic_typing:
        raise ValueError(f'{name}: a viewer cannot change parameters of its type')
    expected, kind, read = _SINGLE[item]
    values = [read(each) for each in (value if isinstance(value, list) else [value])]
    listed = known.type in _LISTS
    if (not listed and isinstance(value, list)) or any(type(each) is not kind for each in values):
        what = f'a list, each {expected}' if listed else expected
        raise ValueError(f'{name}: expected {what}, got {value!r:.60}')
    for each in values:
        _check_range(name, each, known)
    return Parameter(name, Parameter.Type(known.type), values if listed else values[0])


def _check_range(name: str, value: Any, known: ParameterDescriptor) -> None:
    ranges = [*known.floating_point_range, *known.integer_range]
    if type(value) is int and not -_WHOLE <= value < _WHOLE:
        raise ValueError(f'{name}: expected 64 bits, got {value!r:.60}')
    # nodes judge what is no number, and say more about it
    if ranges and (value < ranges[0].from_value or value > ranges[0].to_value):
        low, high = ranges[0].from_value, ranges[0].to_value
        raise ValueError(f'{name}: expected {low:g} to {high:g}, got {value:g}')
