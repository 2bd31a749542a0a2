# SPDX-License-Identifier: Apache-2.0
"""Parameters of all nodes in a ROS graph, by names such as ``/estimator.position.noise``."""

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

#: Time limit in seconds for the answers of all nodes, and interval between two checks for them.
_PATIENCE, _LOOK = 3.0, 0.05
#: Service by which nodes are discovered, and separator of node name and parameter name.
_SERVICE, _BETWEEN = '/set_parameters_atomically', '.'


class GraphParameters:
    """Access to the parameters of nodes through their services, from any thread.

    Parameters
    ----------
    graph
        Graph of the nodes.
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
        """Return the values of parameters that exist, or of all parameters for no names.

        Nodes that do not answer are omitted.
        """
        with self._lock:
            names_by_node = self._split(names) if names else self._list_all()
            return {
                f'{node}{_BETWEEN}{name}': parameter_value_to_python(value)
                for node, values in self._get_values(names_by_node).items()
                for name, value in values.items()
                if value.type != ParameterType.PARAMETER_NOT_SET and not name.startswith(OF_RCLPY)
            }

    def change(self, values: Mapping[str, Any]) -> str:
        """Change parameters, of each node all or none; return the reasons for refusals, or ''.

        An integer is accepted for a floating-point number, and a value for a list of one value.
        """
        with self._lock:
            malformed = [name for name in values if not name.partition(_BETWEEN)[2]]
            if malformed:
                return f'expected /NODE{_BETWEEN}PARAMETER, got {malformed[0]:.60}'
            names_by_node = self._split(values)
            described = self._describe(names_by_node)
            refusals, requests = [], {}
            for node, names in names_by_node.items():
                try:
                    parameters = [
                        of_viewer(name, values[f'{node}{_BETWEEN}{name}'], descriptor)
                        for name, descriptor in _existing(names, described.get(node)).items()
                    ]
                except ValueError as error:
                    refusals.append(f'{node}: {error}')
                else:
                    requests[node] = SetParametersAtomically.Request(
                        parameters=[parameter.to_parameter_msg() for parameter in parameters]
                    )
            answers = self._call_all(SetParametersAtomically, _SERVICE, requests)
            for node in requests:
                if node not in answers:
                    refusals.append(f'{node}: it does not answer')
                elif not answers[node].result.successful:
                    refusals.append(f'{node}: {_explain(answers[node].result.reason)}')
            return '; '.join(refusals)

    def _nodes(self) -> list[str]:
        """Return the full names of the nodes that have parameters."""
        services = self._node.get_service_names_and_types()
        return sorted(name[: -len(_SERVICE)] for name, _ in services if name.endswith(_SERVICE))

    def _split(self, names: Sequence[str] | Mapping[str, Any]) -> dict[str, list[str]]:
        """Return the names of parameters by node, whether or not the node exists."""
        by_node: dict[str, list[str]] = defaultdict(list)
        for full in names:
            node, _, name = full.partition(_BETWEEN)
            by_node[node].append(name)
        return dict(by_node)

    def _list_all(self) -> dict[str, list[str]]:
        """Return the names of all parameters by node."""
        requests = {node: ListParameters.Request() for node in self._nodes()}
        answers = self._call_all(ListParameters, '/list_parameters', requests)
        return {
            node: sorted(name for name in answer.result.names if not name.startswith(OF_RCLPY))
            for node, answer in answers.items()
        }

    def _get_values(self, names: Mapping[str, list[str]]) -> dict[str, dict[str, Any]]:
        """Return the values of parameters, as messages, by node and name."""
        answers = self._call_existing(GetParameters, '/get_parameters', names)
        return {
            node: dict(zip(names[node], answer.values))
            for node, answer in answers.items()
            if len(answer.values) == len(names[node])  # otherwise one of them does not exist
        }

    def _describe(
        self, names: Mapping[str, list[str]]
    ) -> dict[str, dict[str, ParameterDescriptor]]:
        """Return the descriptors of parameters by node and name, for nodes that answer."""
        answers = self._call_existing(DescribeParameters, '/describe_parameters', names)
        return {node: {d.name: d for d in answer.descriptors} for node, answer in answers.items()}

    def _call_existing(
        self, kind: Any, service: str, names: Mapping[str, list[str]]
    ) -> dict[str, Any]:
        """Call a service with names of parameters on the nodes that exist; return the answers."""
        known = {*self._nodes()}
        requests = {n: kind.Request(names=listed) for n, listed in names.items() if n in known}
        return self._call_all(kind, service, requests)

    def _call_all(self, kind: Any, service: str, requests: Mapping[str, Any]) -> dict[str, Any]:
        """Call a service of several nodes at once; return the answers within the time limit."""
        end = monotonic() + _PATIENCE
        clients = {node: self._client(kind, f'{node}{service}') for node in requests}
        waiting: dict[str, Future] = {}
        while monotonic() < end:
            for node, client in clients.items():
                if node not in waiting and client.service_is_ready():
                    waiting[node] = client.call_async(requests[node])
            if len(waiting) == len(clients) and all(future.done() for future in waiting.values()):
                break
            self._executor.spin_once(timeout_sec=_LOOK)
        return {node: future.result() for node, future in waiting.items() if future.done()}

    def _client(self, kind: Any, service: str) -> Any:
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, service)
        return self._clients[service]


def _explain(reason: str) -> str:
    """Return the reason of a refusal; rclpy reports an empty list as a wrong type."""
    return 'it accepts no empty list' if reason.startswith('Wrong parameter type') else reason


def _existing(
    names: Sequence[str], described: Mapping[str, ParameterDescriptor] | None
) -> dict[str, ParameterDescriptor]:
    """Return the descriptors of parameters; raise ValueError if one does not exist."""
    if described is None:
        raise ValueError('there is no such node, or it does not answer')
    existing = {name: described[name] for name in names if name in described}
    missing = [name for name in names if name not in existing]
    if missing:
        # if one parameter does not exist, a node may describe none of them
        problem = 'does not have all of' if len(missing) > 1 else 'has no parameter'
        raise ValueError(f'it {problem} {", ".join(missing)}')
    return existing


def changed(event: ParameterEvent) -> Iterator[tuple[str, Any]]:
    """Yield the parameters that an event reports as changed, with their values."""
    for parameter in (*event.new_parameters, *event.changed_parameters):
        if not parameter.name.startswith(OF_RCLPY):
            yield (
                f'{event.node}{_BETWEEN}{parameter.name}',
                parameter_value_to_python(parameter.value),
            )
