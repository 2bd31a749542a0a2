# SPDX-License-Identifier: Apache-2.0
"""The parameters of all nodes in a ROS graph, by names such as ``/estimator.position.noise``."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from threading import Lock
from time import monotonic
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, ParameterEvent, ParameterType
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    ListParameters,
    SetParametersAtomically,
)
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.task import Future

from kalman_ros.harness.graph_topics import GraphTopics
from kalman_ros.pipeline.settings import OF_RCLPY

from .parameter_values import of_viewer

#: Seconds in which all nodes must answer, and between two looks whether they have.
_PATIENCE, _LOOK = 3.0, 0.05
#: The service by which a node is found, and what separates its name from a parameter's.
_SERVICE, _BETWEEN = '/set_parameters_atomically', '.'


class GraphParameters:
    """Reads and changes the parameters of nodes through their services; any thread may call.

    Parameters
    ----------
    graph
        In which the nodes are.
    """

    def __init__(self, graph: GraphTopics) -> None:
        self._node = Node(
            'viewer_parameters', context=graph.context, start_parameter_services=False,
            enable_rosout=False,
        )  # fmt: skip
        self._executor = SingleThreadedExecutor(context=graph.context)
        self._executor.add_node(self._node)
        self._clients: dict[str, Any] = {}
        self._lock = Lock()

    def close(self) -> None:
        """Leave the graph."""
        with self._lock:
            self._executor.shutdown()
            self._node.destroy_node()

    def read(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the values of parameters that exist, of all of them for no names.

        Nodes that do not answer are left out.
        """
        with self._lock:
            asked = self._split(names) if names else self._listed()
            return {
                f'{node}{_BETWEEN}{name}': parameter_value_to_python(value)
                for node, values in self._values(asked).items()
                for name, value in values.items()
                if value.type != ParameterType.PARAMETER_NOT_SET and not name.startswith(OF_RCLPY)
            }

    def change(self, values: Mapping[str, Any]) -> str:
        """Change parameters, of each node all or none; return why some are refused, or ''.

        A whole number is accepted where a decimal one is expected, and a value for a list of one.
        """
        with self._lock:
            strange = [name for name in values if not name.partition(_BETWEEN)[2]]
            if strange:
                return f'expected /NODE{_BETWEEN}PARAMETER, got {strange[0]:.60}'
            asked = self._split(values)
            described = self._described(asked)
            refusals, requests = [], {}
            for node, names in asked.items():
                try:
                    wanted = [
                        of_viewer(name, values[f'{node}{_BETWEEN}{name}'], known)
                        for name, known in _existing(names, described.get(node)).items()
                    ]
                except ValueError as error:
                    refusals.append(f'{node}: {error}')
                else:
                    requests[node] = SetParametersAtomically.Request(
                        parameters=[each.to_parameter_msg() for each in wanted]
                    )
            answers = self._ask(SetParametersAtomically, _SERVICE, requests)
            for node in requests:
                if node not in answers:
                    refusals.append(f'{node}: it does not answer')
                elif not answers[node].result.successful:
                    refusals.append(f'{node}: {_plain(answers[node].result.reason)}')
            return '; '.join(refusals)

    def _nodes(self) -> list[str]:
        """Return the full names of the nodes with parameters."""
        services = self._node.get_service_names_and_types()
        return sorted(name[: -len(_SERVICE)] for name, _ in services if name.endswith(_SERVICE))

    def _split(self, names: Sequence[str] | Mapping[str, Any]) -> dict[str, list[str]]:
        """Return the names of parameters by node; ones of unknown nodes are left to the caller."""
        found: dict[str, list[str]] = defaultdict(list)
        for full in names:
            node, _, name = full.partition(_BETWEEN)
            found[node].append(name)
        return dict(found)

    def _listed(self) -> dict[str, list[str]]:
        """Return the names of all parameters by node."""
        requests = {node: ListParameters.Request() for node in self._nodes()}
        answers = self._ask(ListParameters, '/list_parameters', requests)
        return {
            node: sorted(name for name in answer.result.names if not name.startswith(OF_RCLPY))
            for node, answer in answers.items()
        }

    def _values(self, names: Mapping[str, list[str]]) -> dict[str, dict[str, Any]]:
        """Return the values of parameters, as messages, by node and name."""
        answers = self._ask_known(GetParameters, '/get_parameters', names)
        return {
            node: dict(zip(names[node], answer.values))
            for node, answer in answers.items()
            if len(answer.values) == len(names[node])  # else one of them does not exist
        }

    def _described(
        self, names: Mapping[str, list[str]]
    ) -> dict[str, dict[str, ParameterDescriptor]]:
        """Return the descriptions of parameters by node and name, of nodes that answer."""
        answers = self._ask_known(DescribeParameters, '/describe_parameters', names)
        return {node: {d.name: d for d in answer.descriptors} for node, answer in answers.items()}

    def _ask_known(
        self, kind: Any, service: str, names: Mapping[str, list[str]]
    ) -> dict[str, Any]:
        """Ask the nodes that exist for parameters by name; return the answers."""
        known = {*self._nodes()}
        requests = {n: kind.Request(names=each) for n, each in names.items() if n in known}
        return self._ask(kind, service, requests)

    def _ask(self, kind: Any, service: str, requests: Mapping[str, Any]) -> dict[str, Any]:
        """Call a service of several nodes at once; return the answers received in time."""
        end = monotonic() + _PATIENCE
        clients = {node: self._client(kind, f'{node}{service}') for node in requests}
        waiting: dict[str, Future] = {}
        while monotonic() < end:
            for node, client in clients.items():
                if node not in waiting and client.service_is_ready():
                    waiting[node] = client.call_async(requests[node])
            if len(waiting) == len(clients) and all(each.done() for each in waiting.values()):
                break
            self._executor.spin_once(timeout_sec=_LOOK)
        return {node: each.result() for node, each in waiting.items() if each.done()}

    def _client(self, kind: Any, service: str) -> Any:
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        return self._clients[service]


def _plain(reason: str) -> str:
    """Return the reason of a node; rclpy takes an empty list for one of another type."""
    return 'it accepts no empty list' if reason.startswith('Wrong parameter type') else reason


def _existing(
    names: Sequence[str], described: Mapping[str, ParameterDescriptor] | None
) -> dict[str, ParameterDescriptor]:
    """Return the descriptions of parameters; ValueError if they do not exist."""
    if described is None:
        raise ValueError('there is no such node, or it does not answer')
    found = {name: described[name] for name in names if name in described}
    missing = [name for name in names if name not in found]
    if missing:
        # a node may describe none of them if one does not exist
        what = 'does not have all of' if len(missing) > 1 else 'has no parameter'
        raise ValueError(f'it {what} {", ".join(missing)}')
    return found


def changed(event: ParameterEvent) -> Iterator[tuple[str, Any]]:
    """Yield the parameters that have changed by an event, with their values."""
    for each in (*event.new_parameters, *event.changed_parameters):
        if not each.name.startswith(OF_RCLPY):
            yield f'{event.node}{_BETWEEN}{each.name}', parameter_value_to_python(each.value)
