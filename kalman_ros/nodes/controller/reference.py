# SPDX-License-Identifier: Apache-2.0
"""The set point: a state on ``reference``, or a pose on ``goal``, as RViz publishes it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.core import Array, Signal, is_finite
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import QUEUE, on_topic
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.regulator import tracking

_POSE = 'pose.pose.'


class ReferenceReader:
    """Computes the equilibrium of each received reference.

    For a pose the velocities are zero, and other states are at the model's
    equilibrium. One in another frame than the estimate's is refused; no frame means the same one.

    Parameters
    ----------
    node
        The node, for its subscriptions.
    scenario
        The system.
    take
        Called with the state (n,) and the input (m,) that holds it.
    frame
        Returns the frame of the estimate, '' if unknown.
    """

    def __init__(
        self,
        node: Host,
        scenario: Scenario,
        take: Callable[[Array, Array], None],
        frame: Callable[[], str],
    ) -> None:
        self._frame = frame
        self._warn = Throttle(node.get_logger().warning)
        self._node, self._scenario, self._take = node, scenario, take
        self._rest = scenario.model.equilibrium
        #: Of references, linearised about the equilibrium of the model.
        self.equilibria = tracking(scenario)
        self._space = scenario.model.state

    def listen(self) -> None:
        """Subscribe."""
        state = self._scenario.state
        self._subscribe(on_topic(state, 'reference'), list(range(self._space.size)))
        fields = state.fields
        given = [index for index, field in enumerate(fields) if field.startswith(_POSE)]
        if given:
            own = tuple(f'pose.{fields[index][len(_POSE) :]}' for index in given)
            self._subscribe(Signal('goal', 'geometry_msgs/PoseStamped', own), given)

    def _subscribe(self, signal: Signal, given: list[int]) -> None:
        read = WireReader(SignalCodec(signal))

        def on_message(data: bytes) -> None:
            try:
                values = read(data).values
                self._check_frame(leading_frame(data))
                self._on_values(values, given)
            except (LookupError, ValueError) as error:
                self._warn(f'{signal.topic}: {error}; the old one stays')

        self._node.create_subscription(
            read.message_type, signal.topic, on_message, QUEUE, raw=True
        )

    def _check_frame(self, given: str) -> None:
        expected = self._frame()
        if given and expected and given != expected:
            raise ValueError(f"expected the frame '{expected}' of the estimate, got '{given}'")

    def _on_values(self, values: Array, given: list[int]) -> None:
        state = self._rest.state.copy()
        state[given] = values
        difference = self._space.subtract(state, self._rest.state)
        if not np.isfinite(difference).all():
            raise ValueError('expected finite numbers')
        found = self.equilibria.equilibrium(difference)
        target = self._rest.state + found.state, self._rest.input + found.input
        if not all(map(is_finite, target)):
            raise ValueError('expected finite numbers')
        self._take(*target)
