# SPDX-License-Identifier: Apache-2.0
"""Nodes as processes in a private domain: start, stop, services, parameters, diagnostics."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.task import Future
from std_srvs.srv import Trigger

from kalman_ros.nodes.middleware.private_folder import PrivateFolder

from .interrupts import deferred
from .isolated_context import IsolatedContext
from .node_set import NodeSet
from .process import NodeProcess
from .readiness import missing

#: Time in seconds of a prompt answer, and number of rounds of twice that time in a call.
_PROMPT, _ROUNDS = 1.0, 15


class NodeError(RuntimeError):
    """A node died, did not start, or did not answer; the message has its name and the reason."""


class LaunchedNodes:
    """The processes of a `NodeSet`, which exist after `open`.

    Parameters
    ----------
    node_set
        Nodes and their parameters.
    """

    def __init__(self, node_set: NodeSet) -> None:
        self._node_set = node_set
        self.processes: dict[str, NodeProcess] = {}
        self.diagnostics: dict[str, DiagnosticStatus] = {}
        #: Whether a node was killed, so that its last messages are unknown.
        self._interrupted = False

    def open(self, *, sockets: bool) -> None:
        """Open a private domain with a node of this process; start no other node."""
        self._context = IsolatedContext('harness', sockets=sockets)
        self._folder = PrivateFolder()
        self._clients: dict[str, Any] = {}

    def __exit__(self, *_: object) -> None:
        self.close()

    @contextmanager
    def starting(self) -> Iterator[None]:
        """Stop all nodes if the code in this context fails."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def launch(self, topics: Sequence[str] = (), patience: float = 60.0) -> None:
        """Start all nodes, and wait until they and the subscribers of ``topics`` are connected.

        Earlier messages are lost. ``patience`` is a time limit in seconds.
        """
        self.listen()
        names = self._node_set.names
        for name in names:
            self.start(name)
        unready = partial(missing, names, self.diagnostics, topics)
        self.wait(lambda: not unready(), patience, lambda: f'not ready: {unready()}')

    def listen(self) -> None:
        """Subscribe to the diagnostics of the nodes."""
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._on_diagnostics, 50)

    @property
    def domain(self) -> int:
        """ROS domain of the nodes."""
        return self._context.domain

    @property
    def environment(self) -> Mapping[str, str]:
        """Environment of the nodes, for other programs in the run."""
        return self._context.environment

    @property
    def node(self) -> Any:
        """Node of this process in the domain of the run, to publish and subscribe."""
        return self._context.node

    def start(self, name: str) -> None:
        """Start a node; one that was killed may be started again."""
        log = self._folder.path / f'{name}.log'
        with deferred():
            self.processes[name] = NodeProcess(
                name, self._node_set.command(name), self._context.environment, log
            )

    def kill(self, name: str, number: int = 9) -> None:
        """Send a signal to a node, by default SIGKILL, and wait for its end."""
        process = self.processes[name]
        self._interrupted = True
        process.signal(number)
        if not process.wait(10.0):
            raise NodeError(f'the {name} did not end within 10 s of signal {number}')
        del self.processes[name]
        self.diagnostics.pop(name, None)

    def spin(self, seconds: float = 0.05, until: Future | None = None) -> None:
        """Process messages for ``seconds``, and check that every node is still running.

        The processing ends early if the future ``until`` is done.
        """
        self._context.spin(seconds, until)
        for name, process in self.processes.items():
            if process.exit_code is not None:
                raise NodeError(f'the {name} died: {process.last_words()}')

    def wait(
        self, condition: Callable[[], bool], seconds: float, trouble: Callable[[], str]
    ) -> None:
        """Process messages until ``condition`` holds; raise NodeError after ``seconds``."""
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                raise NodeError(f'{trouble()} within {seconds:g} s')
            self.spin(0.02)

    def set_parameter(self, name: str, value: Any, node: str = 'plant') -> None:
        """Change a parameter of a node; raise ValueError with the reason of a refusal."""
        self.set_parameters({name: value}, node)

    def set_parameters(self, values: Mapping[str, Any], node: str = 'plant') -> None:
        """Change parameters of a node, all or none; raise ValueError with a refusal's reason."""
        kind = SetParametersAtomically
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = kind.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        result = self.call(kind, f'{node}/set_parameters_atomically', request).result
        if not result.successful:
            raise ValueError(result.reason)

    def call(self, kind: Any, service: str, request: Any) -> Any:
        """Call a service of type ``kind`` and return the response; raise NodeError without one.

        A node that was killed and restarted may not be discovered yet, so that it misses a
        request. Then the request is repeated, but not for a slow node, which would process it
        twice.
        """
        client = self._client(kind, service)
        node = service.rpartition('/')[0]
        answer, lost = client.call_async(request), False
        for _ in range(_ROUNDS):
            self.spin(_PROMPT, until=answer)
            if answer.done():
                return answer.result()
            if lost:
                answer = client.call_async(request)
            # a node answers in order: if it answers a later request, it has not received this one
            lost = not lost and self._responds(node)
        raise NodeError(f'no answer from {service} within {2.0 * _ROUNDS * _PROMPT:g} s')

    def settle(self, node: str) -> None:
        """Return once a node has processed what it had received."""
        self.call(GetParameters, f'{node}/get_parameters', GetParameters.Request())

    def _responds(self, node: str) -> bool:
        """Return whether a node promptly answers a request without side effects."""
        client = self._client(GetParameters, f'{node}/get_parameters')
        answer = client.call_async(GetParameters.Request())
        self.spin(_PROMPT, until=answer)
        return bool(answer.done())

    def _client(self, kind: Any, service: str) -> Any:
        """Return the client of a service, after the service is discovered."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, service)
        client = self._clients[service]
        self.wait(client.service_is_ready, 20.0, lambda: f'there is no service {service}')
        return client

    def trigger(self, service: str) -> None:
        """Call a service without arguments, such as ``plant/reset``."""
        self.call(Trigger, service, Trigger.Request())

    def change_state(self, node: str, transition: str) -> bool:
        """Request a transition of a managed node, such as 'configure'; return its success."""
        request = ChangeState.Request(transition=Transition(label=transition))
        return bool(self.call(ChangeState, f'{node}/change_state', request).success)

    def state(self, node: str) -> str:
        """Return the state of a managed node."""
        answer = self.call(GetState, f'{node}/get_state', GetState.Request())
        return str(answer.current_state.label)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.diagnostics[status.name] = status

    def reported(self, node: str, key: str) -> str:
        """Return a value in the last ``/diagnostics`` of a node; '' if it is missing."""
        status = self.diagnostics.get(node)
        values = [] if status is None else status.values
        return next((str(value.value) for value in values if value.key == key), '')

    def close(self) -> None:
        """Stop every node and release all resources; signals are deferred until then."""
        with deferred():
            self._close()

    def _close(self) -> None:
        for process in self.processes.values():
            process.signal(2)
        for process in self.processes.values():
            process.wait(3.0)
            process.stop()
        self._context.close()
        self._folder.cleanup()
