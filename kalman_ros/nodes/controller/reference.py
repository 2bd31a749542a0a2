# SPDX-License-Identifier: Apache-2.0
"""The set point: a state on ``reference``, or a pose on ``goal``, as RViz publishes it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.control.limiter import Limits
from kalman_ros.control.motion import Motion
from kalman_ros.control.tracking import FeedForward
from kalman_ros.core import Array, OperatingPoint, Signal
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.topics import QUEUE, on_topic
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.motions import moving_point
from kalman_ros.scenario.regulator import check_held, steered, target, tracking

_POSE = 'pose.pose.'


class ReferenceReader:
    """Computes the equilibrium of each received reference, or how it moves on.

    For a pose the velocities are zero, and other states are at the model's
    equilibrium. One in another frame than the estimate's is refused; no frame means the same one.
    A reference with a velocity moves on until the next one, with the input that this needs.

    Parameters
    ----------
    node
        The node, for its subscriptions.
    scenario
        The system.
    hold
        Called with the state (n,) to hold and the input (m,) that holds it.
    move
        Called with the motion of a reference that moves.
    frame
        Returns the frame of the estimate, '' if unknown.
    timeout
        Seconds for which a reference moves on.
    limits
        Limits of the input.
    """

    def __init__(
        self,
        node: Host,
        scenario: Scenario,
        hold: Callable[[OperatingPoint], None],
        move: Callable[[Motion], None],
        frame: Callable[[], str],
        timeout: float,
        limits: Limits,
    ) -> None:
        self._frame = frame
        self._warn = Throttle(node.get_logger().warning)
        self._node, self._hold, self._move = node, hold, move
        self._timeout = timeout
        self._last: tuple[int, Array] | None = None
        #: Number of references that were refused.
        self.refused = 0
        self.adopt(scenario, tracking(scenario), limits)
        self._space = scenario.model.state

    def adopt(self, scenario: Scenario, equilibria: FeedForward, limits: Limits) -> None:
        """Use the equilibria of another scenario, and other limits, from now on."""
        self._scenario, self.equilibria, self._limits = scenario, equilibria, limits
        self._steered = steered(scenario)

    def listen(self) -> None:
        """Subscribe."""
        self._last = None
        state = self._scenario.state
        self._subscribe(on_topic(state, 'reference'), list(range(self._space.size)))
        fields = state.fields
        given = [index for index, field in enumerate(fields) if field.startswith(_POSE)]
        if given:
            paths = tuple(f'pose.{fields[index][len(_POSE) :]}' for index in given)
            self._subscribe(Signal('goal', 'geometry_msgs/PoseStamped', paths), given)

    def rest_near(self, state: Array) -> OperatingPoint:
        """Return the state and the input of the equilibrium nearest to a state (n,)."""
        rest = self._scenario.model.equilibrium
        nearest = self.equilibria.nearest(self._space.subtract(state, rest.state))
        state = self._space.add(rest.state, nearest.state)
        return OperatingPoint(state, rest.input + nearest.input)

    def _subscribe(self, signal: Signal, given: list[int]) -> None:
        read = WireReader(SignalCodec(signal))

        def on_message(data: bytes) -> None:
            try:
                time, values, _ = read(data)
                self._check_frame(leading_frame(data))
                self._on_values(time, values, given)
            except (LookupError, ValueError) as error:
                self.refused += 1
                self._warn(f'{signal.topic}: {error}; the old one stays')

        self._node.create_subscription(
            read.message_type, signal.topic, on_message, QUEUE, raw=True
        )

    def _check_frame(self, given: str) -> None:
        expected = self._frame()
        if given and expected and given != expected:
            raise ValueError(f"expected the frame '{expected}' of the estimate, got '{given}'")

    def _on_values(self, time: int | None, values: Array, given: list[int]) -> None:
        if not np.isfinite(values).all():
            raise ValueError('expected finite numbers')
        state = self._scenario.model.equilibrium.state.copy()
        state[given] = values
        before, self._last = self._last, None if time is None else (time, state)
        try:
            held = target(self._scenario, self.equilibria, state)
        except ValueError as error:
            self._move(self._moving(before, state, error))
            return
        if self._steered:
            raise ValueError(
                'at rest no input moves all states of this model: publish a path, or a reference '
                'that moves'
            )
        check_held(self._scenario, held.input, self._limits)
        self._hold(held)

    def _moving(self, before: tuple[int, Array] | None, state: Array, error: ValueError) -> Motion:
        """Return how a state moves on, at the rate since the one before if that is known."""
        if not self._timeout or self._scenario.model.is_discrete:
            raise error
        rate, since = None, 0.0
        if before is not None and self._last is not None:
            since = (self._last[0] - before[0]) * 1e-9
            if 0.0 < since < self._timeout:
                change = self._space.subtract(state, before[1])
                rate = change / since if change.any() else None
        try:
            return moving_point(self._scenario, state, rate, self._timeout, since)
        except ValueError:
            raise error from None
