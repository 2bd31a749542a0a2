# SPDX-License-Identifier: Apache-2.0
"""The estimate as a place on the Earth, and the datum of its local metres."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from kalman_ros.codecs.fixes import LOCAL, TYPE, FixCodec, is_local
from kalman_ros.core import Gaussian, Signal
from kalman_ros.core.geodesy import Origin
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

from .estimator_options import EstimatorOptions


def uses_fixes(scenario: Scenario) -> bool:
    """Return whether a sensor reads satellite fixes as metres."""
    return any(is_local(source.signal) for source in scenario.sensors.values())


class FixTopic:
    """The position of an estimate as ``sensor_msgs/NavSatFix`` on ``estimate/fix``.

    Parameters
    ----------
    scenario
        Scenario whose state has a position.
    frame
        Frame of the body.
    origin
        Datum of the local metres.

    Raises
    ------
    ValueError
        If the state has no position, or no datum will ever be known.
    """

    def __init__(self, scenario: Scenario, frame: str, origin: Origin) -> None:
        body = body_of(scenario.model.state, scenario.state)
        if not body.moves:
            names = ', '.join(scenario.model.state.names)
            raise ValueError(f'publish_fix: expected states x and y, got {names}')
        if origin.plane is None and not uses_fixes(scenario):
            raise ValueError(f'publish_fix: expected a datum, or a sensor that reads {TYPE}')
        self._index = np.array([body.index[axis] for axis in body.position])
        self._block = np.ix_(self._index, self._index)
        fields = tuple(field for axis, field in zip('xyz', LOCAL) if axis in body.position)
        self.signal = Signal(f'{scenario.state.topic}/fix', TYPE, fields)
        self._codec = FixCodec(self.signal, frame, origin)
        self.message_type = self._codec.message_type

    def __call__(self, time: int, belief: Gaussian) -> Any:
        """Return the message for a belief at ``time``, in nanoseconds, once the datum is known."""
        x, P = belief
        return self._codec.encode(time, x[self._index], P[self._block])


class DatumTopic:
    """The datum as ``sensor_msgs/NavSatFix`` on ``estimate/datum``, once it is known."""

    def __init__(self, scenario: Scenario, frame: str, origin: Origin) -> None:
        self.signal = Signal(f'{scenario.state.topic}/datum', TYPE, LOCAL)
        self._codec = FixCodec(self.signal, frame, origin)
        self.message_type = self._codec.message_type

    def __call__(self, time: int) -> Any:
        """Return the message, stamped ``time`` in nanoseconds."""
        return self._codec.encode(time, np.zeros(3))


class GlobalTopics:
    """The topic of the datum, published once, and that of the estimate as a fix if requested."""

    def __init__(self, scenario: Scenario, options: EstimatorOptions, origin: Origin) -> None:
        self._origin = origin
        self.fix = FixTopic(scenario, options.child_frame, origin) if options.publish_fix else None
        needed = self.fix is not None or uses_fixes(scenario)
        self.datum = DatumTopic(scenario, options.frame, origin) if needed else None
        #: Signals of the topics that are used.
        self.signals = [topic.signal for topic in (self.datum, self.fix) if topic is not None]
        self._known = False

    def __call__(self, time: int, belief: Gaussian) -> Iterator[tuple[Signal, Any]]:
        """Yield the signals, and the messages for a belief at ``time``, in nanoseconds."""
        if self._origin.plane is None:
            return
        if self.datum is not None and not self._known:
            yield self.datum.signal, self.datum(time)
        self._known = True
        if self.fix is not None:
            yield self.fix.signal, self.fix(time, belief)
