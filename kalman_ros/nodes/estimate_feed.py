# SPDX-License-Identifier: Apache-2.0
"""The estimates that a controller may answer: of all that have come, the newest."""

from __future__ import annotations

from typing import Any

import numpy as np

from kalman_ros.codecs.layout import Sample
from kalman_ros.codecs.messages import leading_frame
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.wire import WireReader
from kalman_ros.scenario import Scenario

from .estimate_guard import EstimateGuard
from .watcher import waiting

#: So many of those that wait are looked at, in a few milliseconds.
_MOST = 50


class EstimateFeed:
    """Reads estimates, and keeps account of those that nobody answers.

    Parameters
    ----------
    node
        The node, whose `intake` drops what cannot be read.
    scenario
        Where the estimate is found.
    trust
        What knows whether an estimate is older than the last.
    """

    def __init__(self, node: Any, scenario: Scenario, trust: EstimateGuard) -> None:
        self._node: Any = node
        self._read = WireReader(SignalCodec(scenario.state))
        self._size = scenario.model.state.size
        self._trust = trust
        self.message_type = self._read.message_type
        #: While the node is active.
        self.subscription: Any = None
        #: How many were passed over for newer ones, and how many were older than the last.
        self.passed = self.older = 0
        #: The last that could be read.
        self._last = b''

    def newest(self, data: bytes, at: float | None) -> Sample | None:
        """Return the estimate that came last, but for those that are older than one before.

        Parameters
        ----------
        data
            The message that woke the node; others may wait behind it.
        at
            When it came, on a clock that never rests; None if time may go back.
        """
        messages = [data, *waiting(self.subscription)]
        topic = self.subscription.topic_name
        for passed, message in zip(range(len(messages) - 1, -1, -1), messages[: -_MOST - 1 : -1]):
            estimate: Sample | None = self._node.intake(topic, self._state_in, message)
            if estimate is None:
                continue
            self._last = message
            if self._trust.is_old(estimate.time, at):
                self.older += 1
                continue
            self.passed += passed
            return estimate
        return None

    def frame(self, configured: str) -> str:
        """Return the frame of the estimate, or the ``configured`` one before the first."""
        return leading_frame(self._last) if self._last else configured

    def _state_in(self, data: bytes) -> Sample:
        """Return the estimate in a message, one of no finite state if it lacks a field."""
        try:
            return self._read(data)
        except (LookupError, ValueError):
            return Sample(None, np.full(self._size, np.nan), None)
