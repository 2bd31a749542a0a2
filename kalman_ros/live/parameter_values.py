# SPDX-License-Identifier: Apache-2.0
"""Conversion of the values of a viewer to the declared parameters of a node."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterType
from rclpy.parameter import Parameter

from kalman_ros.pipeline.settings import OF_RCLPY


def _read_number(value: Any) -> Any:
    """Return a floating-point number for an integer, or for the text of an infinite number."""
    if type(value) is int:
        return float(value)
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value


def _read_unchanged(value: Any) -> Any:
    return value


#: Description, class and conversion of a single value, by type of parameter.
_SINGLE: dict[int, tuple[str, type, Callable[[Any], Any]]] = {
    ParameterType.PARAMETER_BOOL: ('true or false', bool, _read_unchanged),
    ParameterType.PARAMETER_INTEGER: ('a whole number', int, _read_unchanged),
    ParameterType.PARAMETER_DOUBLE: ('a number', float, _read_number),
    ParameterType.PARAMETER_STRING: ('a text', str, _read_unchanged),
}
#: Type of a single value of each type of list.
_LISTS: dict[int, int] = {
    ParameterType.PARAMETER_BOOL_ARRAY: ParameterType.PARAMETER_BOOL,
    ParameterType.PARAMETER_INTEGER_ARRAY: ParameterType.PARAMETER_INTEGER,
    ParameterType.PARAMETER_DOUBLE_ARRAY: ParameterType.PARAMETER_DOUBLE,
    ParameterType.PARAMETER_STRING_ARRAY: ParameterType.PARAMETER_STRING,
}
#: Limit of the integers in a message.
_WHOLE = 2**63


def of_viewer(name: str, value: Any, known: ParameterDescriptor) -> Parameter:
    """Return a parameter with the value of a viewer; a value for a list of one is accepted.

    Raises
    ------
    ValueError
        If the parameter cannot be changed, or if the value has another type or is out of range.
    """
    if name.startswith(OF_RCLPY) or known.read_only:
        raise ValueError(f'{name}: it can only be set at the start of the node')
    item_type = _LISTS.get(known.type, known.type)
    if item_type not in _SINGLE or known.dynamic_typing:
        raise ValueError(f'{name}: a viewer cannot change parameters of its type')
    expected, kind, read = _SINGLE[item_type]
    values = [read(item) for item in (value if isinstance(value, list) else [value])]
    is_list = known.type in _LISTS
    if (not is_list and isinstance(value, list)) or any(type(item) is not kind for item in values):
        description = f'a list, each {expected}' if is_list else expected
        raise ValueError(f'{name}: expected {description}, got {value!r:.60}')
    for item in values:
        _check_range(name, item, known)
    return Parameter(name, Parameter.Type(known.type), values if is_list else values[0])


def _check_range(name: str, value: Any, known: ParameterDescriptor) -> None:
    ranges = [*known.floating_point_range, *known.integer_range]
    if type(value) is int and not -_WHOLE <= value < _WHOLE:
        raise ValueError(f'{name}: expected 64 bits, got {value!r:.60}')
    # NaN passes: the node refuses it with a better message
    if ranges and (value < ranges[0].from_value or value > ranges[0].to_value):
        low, high = ranges[0].from_value, ranges[0].to_value
        raise ValueError(f'{name}: expected {low:g} to {high:g}, got {value:g}')
