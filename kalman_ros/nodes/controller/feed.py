# SPDX-License-Identifier: Apache-2.0
"""The estimates for a controller: the newest of those that are waiting."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.nodes.middleware.host import Host
from kalman_ros.nodes.middleware.watcher import waiting
from kalman_ros.scenario import Scenario

from .guard import EstimateGuard

#: If more estimates are waiting, the older ones are not decoded.
_MOST = 50


class EstimateFeed:
    """Decodes estimates, and counts the skipped ones.

    Parameters
    ----------
    node
        The node, whose `intake` drops messages that cannot be decoded.
    scenario
        Names the topic and type of the estimate.
    guard
        Decides whether an estimate is older than the last.
    """

    def __init__(self, node: Host, scenario: Scenario, guard: EstimateGuard) -> None:
        self._node = node
        self._read = WireReader(SignalCodec(scenario.state))
        self._size = scenario.model.state.size
        self._guard = guard
        self.message_type = self._read.message_type
        #: While the node is active.
        self.subscription: Any = None
        #: Counts of estimates skipped for newer ones, and of those older than the last.
        self.passed = self.older = 0
        #: The last message that could be decoded.
        self._last = b''

    def newest(self, data: bytes, at: float | None) -> Sample | None:
        """Return the newest estimate that is not older than an earlier one.

        Parameters
        ----------
        data
            The message that woke the node; more may be waiting.
        at
            When it was received, on a steady clock; None if time may go back.
        """
        messages = waiting(self.subscription, [data])
        topic = self.subscription.topic_name
        for passed, message in zip(range(len(messages) - 1, -1, -1), messages[: -_MOST - 1 : -1]):
            estimate: Sample | None = self._node.intake.read(topic, self._state_in, message)
            if estimate is None:
                continue
            self._last = message
            if self._guard.is_old(estimate.time, at):
                self.older += 1
                continue
            self.passed += passed
            return estimate
        return None

    def frame(self, configured: str) -> str:
        """Return the frame of the estimate, or the ``configured`` one before the first."""
        return leading_frame(self._last) if self._last else configured

    def _state_in(self, data: bytes) -> Sample:
        """Return the estimate in a message; its state is not finite if a field is missing."""
        try:
            return self._read(data)
        except (LookupError, ValueError):
            return Sample(None, np.full(self._size, np.nan), None)
