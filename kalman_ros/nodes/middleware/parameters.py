# SPDX-License-Identifier: Apache-2.0
"""Options as ROS parameters: declared with description and range, changed all or none."""

from __future__ import annotations

from array import array
from collections import Counter
from collections.abc import Callable, Mapping, Sequence, Set
from functools import partial
from math import isfinite
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

from kalman_ros.core import Option, Value, refuse_unknown
from kalman_ros.core.registry import names_code
from kalman_ros.pipeline.settings import OF_RCLPY, Chosen

from .managed import reason

_LIMIT = 1e300
#: Parameters by whose value there are others.
SHAPING = ('law',)


def given(node: Node) -> dict[str, Value]:
    """Return the values of all parameters except rclpy's."""
    return {
        name: parameter.value
        for name, parameter in node.get_parameters_by_prefix('').items()
        if not name.startswith(OF_RCLPY)
    }


def as_declared(node: Node, parameter: Parameter) -> Parameter:
    """Return a parameter with its value in the declared type, if it can be converted.

    ``ros2 param load`` sends numbers such as 1e-05 and inf, and lists of them, as strings, and an
    empty list without a type.
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
    except TypeError:  # a mixed list, which is no valid parameter
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
    """Convert a string with a number, and a whole number, to float."""
    if not isinstance(value, (str, int)) or isinstance(value, bool):
        return value
    try:
        return float(value)
    except (ValueError, OverflowError):
        return value


def free(node: Node, values: Mapping[str, Value]) -> None:
    """Declare these values instead of all existing ones, with dynamic types."""
    free = {name: ParameterDescriptor(dynamic_typing=True) for name in values}
    _replace(node, {name: (value, free[name]) for name, value in values.items()})


def _replace(node: Node, declared: Mapping[str, tuple[Value, ParameterDescriptor]]) -> None:
    """Declare values with their descriptors instead of all existing ones."""
    for name in given(node):
        node.describe_parameter(name).read_only = False  # else it could not be undeclared
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
    """Refuses changes of parameters that name code after the start of the node.

    To import a module is to run it, and anybody in the ROS domain may call a node's services. So
    modules and files are set only by start-up parameters.
    """

    def __init__(self, node: Node) -> None:
        self._accepted = given(node)
        node.add_on_set_parameters_callback(self._check)

    def accept(self, values: Mapping[str, Value]) -> None:
        """Accept these values too: the start-up parameters with defaults."""
        self._accepted.update(values)

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for name, value in ((parameter.name, parameter.value) for parameter in parameters):
            if names_code(name) and value != self._accepted.get(name):
                why = 'names code, which counts only from the start-up parameters'
                return SetParametersResult(successful=False, reason=f'{name}: it {why}')
        return SetParametersResult(successful=True)


def harden(node: Node) -> None:
    """Let no request to the parameter services of rclpy end the node, or keep it from its work."""
    for service in node.services:
        kind = service.srv_name.rpartition('/')[2]
        if kind == 'set_parameters':
            service.callback = partial(_answer, partial(set_together, node))
        elif kind.endswith(('parameters', 'parameters_atomically', 'parameter_types')):
            service.callback = partial(_answer, service.callback)


def _answer(callback: Callable[[Any, Any], Any], request: Any, response: Any) -> Any:
    """Answer a request; one that rclpy cannot read, such as one of an unknown type, is refused."""
    try:
        return callback(request, response)
    except (TypeError, ValueError, ParameterException) as error:
        refused = SetParametersResult(successful=False, reason=str(error))
        if hasattr(response, 'result'):
            response.result = refused
        elif hasattr(response, 'results'):
            response.results = [refused] * len(request.parameters)
        return response


def set_together(node: Any, request: Any, response: Any) -> Any:
    """Answer the service ``set_parameters``: all that can be set become one change.

    rclpy sets one parameter after the other, each of which may design filter and gains again; a
    request with a thousand of them would keep the node from its work for seconds.
    """
    wanted = [Parameter.from_parameter_msg(message) for message in request.parameters]
    times = Counter(parameter.name for parameter in wanted)
    refusals = {
        parameter.name: f'{parameter.name}: expected once, got {times[parameter.name]} times'
        if times[parameter.name] > 1
        else node.parameter_error(as_declared(node, parameter))
        for parameter in wanted
    }
    result = node.set_parameters_atomically(
        [parameter for parameter in wanted if not refusals[parameter.name]]
    )
    for parameter in wanted:
        why = refusals[parameter.name]
        refused = SetParametersResult(successful=False, reason=why)
        response.results.append(refused if why else result)
    return response


class LiveParameters:
    """Declares parameters and applies changes: all of a set, or none.

    Parameters
    ----------
    node
        The node. Its earlier parameters are restored at the end.
    chosen
        The parameters with their values.
    prepare
        Builds what changes from the parameters after a change and the names of those that differ,
        and returns a function that puts it in place. Raising ValueError refuses the change with
        that reason.
    choose
        Returns the parameters after a change by which there are others: from those at the start,
        those that have been set since, and the change.
    """

    def __init__(
        self,
        node: Node,
        chosen: Chosen,
        prepare: Callable[[Chosen, Set[str]], Callable[[], None]],
        choose: Callable[[Mapping[str, Value], Mapping[str, Value], Mapping[str, Value]], Chosen],
    ) -> None:
        self._node = node
        #: The parameters at the start, and those that have been set since.
        self._given, self._later = given(node), dict[str, Value]()
        #: Values of parameters that the next change declares.
        self._following: dict[str, Value] = {}
        self._declaring = False
        self._chosen = self._next = chosen
        self._changes: dict[str, Value] = {}
        self._prepare, self._choose = prepare, choose
        self._ready: Callable[[], None] = lambda: None
        values, known = chosen.values, chosen.known.values()
        _replace(node, {o.name: (values[o.name], _descriptor(o)) for o in known})
        node.add_pre_set_parameters_callback(self._typed)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def close(self) -> None:
        """Restore the earlier parameters, with later changes and dynamic types."""
        node = self._node
        node.remove_pre_set_parameters_callback(self._typed)
        node.remove_on_set_parameters_callback(self._check)
        node.remove_post_set_parameters_callback(self._apply)
        known = self._chosen.known
        later = {name: value for name, value in self._later.items() if name in known}
        free(node, self._start(later))

    def _start(self, later: Mapping[str, Value]) -> dict[str, Value]:
        """Return the parameters for another start, after later changes."""
        start = {**self._given, **later}
        if later.keys().isdisjoint(SHAPING):
            return start
        from kalman_ros.scenario import law  # only a node with a law comes here, and has it

        return law.kept(start)

    def follow(self, values: Mapping[str, Value]) -> None:
        """Take these values of undeclared parameters as part of the next change."""
        self._following = dict(values)

    def parameter_error(self, parameter: Parameter) -> str:
        """Return why a parameter cannot be set, whatever the others are; '' if it can."""
        name, value = parameter.name, parameter.value
        if name.startswith(OF_RCLPY):
            return ''
        try:
            refuse_unknown([name], self._chosen.known, 'parameter')
            self._chosen.known[name].check(value)
        except ValueError as error:
            return reason(error)
        fixed = self._node.describe_parameter(name).read_only
        return f'{name}: it is read-only' if fixed and not is_kept(self._node, parameter) else ''

    def _typed(self, parameters: list[Parameter]) -> list[Parameter]:
        """Convert whole numbers to float where needed; keep invalid values."""
        if self._declaring:
            return parameters
        result = []
        for parameter in parameters:
            option = self._chosen.known.get(parameter.name)
            try:
                value = parameter.value if option is None else option.check(parameter.value)
                result.append(Parameter(parameter.name, value=value))
            except ValueError:
                result.append(parameter)
        return result

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        if self._declaring:
            return SetParametersResult(successful=True)
        changes: dict[str, Any] = {
            parameter.name: parameter.value
            for parameter in parameters
            if not parameter.name.startswith(OF_RCLPY)
        }
        changes.update(self._following)
        self._following = {}
        try:
            if changes:
                self._next = self._after(changes)
                before, values = self._chosen.values, self._next.values
                differing = {n for n, v in values.items() if n not in before or v != before[n]}
                self._ready = self._prepare(self._next, differing)
        except Exception as error:  # a model of a user's own may raise anything
            why = reason(error) or f'{type(error).__name__}: {error}'
            return SetParametersResult(successful=False, reason=why)
        self._changes = changes
        return SetParametersResult(successful=True)

    def _after(self, changes: Mapping[str, Any]) -> Chosen:
        """Return the parameters after a change; raise ValueError if it is wrong."""
        chosen = self._chosen
        if any(chosen.values[name] != changes[name] for name in SHAPING if name in changes):
            return self._choose(self._given, self._later, changes)
        refuse_unknown(changes, chosen.known, 'parameter')
        for name, value in changes.items():
            chosen.known[name].check(value)
        return chosen._replace(values={**chosen.values, **changes})

    def _apply(self, _: list[Parameter]) -> None:
        if self._declaring or not self._changes:
            return
        self._ready()
        self._later.update(self._changes)
        self._changes = {}
        before, self._chosen = self._chosen.known, self._next
        if self._chosen.known is not before:
            self._declare(before)

    def _declare(self, before: Mapping[str, Option]) -> None:
        """Declare the parameters that are new, and no longer those that do not exist now."""
        node, values, known = self._node, self._chosen.values, self._chosen.known
        self._declaring = True
        try:
            for name in before.keys() - known.keys():
                node.describe_parameter(name).read_only = False
                node.undeclare_parameter(name)
            new = [option for name, option in known.items() if name not in before]
            triples = [(o.name, values[o.name], _descriptor(o)) for o in new]
            node.declare_parameters('', triples, ignore_override=True)
        finally:
            self._declaring = False
