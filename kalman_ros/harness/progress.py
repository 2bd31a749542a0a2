# SPDX-License-Identifier: Apache-2.0
"""Progress of a run, from the stamps of its messages."""

from __future__ import annotations

from rclpy.task import Future

from kalman_ros.codecs.messages import leading_stamp, message_type
from kalman_ros.scenario import Scenario


class Progress:
    """A counter of the steps of the plant and of the answers to them."""

    def __init__(self, scenario: Scenario) -> None:
        self._rate = scenario.rate
        signal = scenario.input if scenario.input.fields else scenario.state
        self._answer = signal.topic
        self._answer_stamped = hasattr(message_type(signal.type), 'header')
        self._steps = 0
        self._goal = 0.0
        self._answered = -1
        self._answers = 0
        #: Stamps of the first and the last step; -1 before the first step.
        self.first = self.last = -1
        #: Future that is done when the goal is reached.
        self.reached = Future()

    @property
    def elapsed(self) -> float:
        """Simulated time in seconds since the first step, without pauses in real time."""
        return (self._steps - 1) / self._rate

    @property
    def answered(self) -> bool:
        """Whether the last step is answered; without stamps, whether the answers are as many."""
        if self._answer_stamped:
            return self._answered >= self.last
        return self._answers >= self._steps

    @property
    def arrived(self) -> bool:
        """Whether the goal is reached."""
        return self.elapsed >= self._goal

    def aim(self, seconds: float) -> None:
        """Set the goal: the step ``seconds`` after the start."""
        self._goal = seconds - 0.5 / self._rate
        self.reached = Future()

    def update(self, topic: str, data: bytes) -> None:
        """Process a message."""
        if topic == self._answer:
            self._answers += 1
            if self._answer_stamped:
                self._answered = leading_stamp(data)
        elif topic == 'ground_truth':
            stamp = leading_stamp(data)
            self._steps += stamp > self.last
            self.last = stamp
            if self.first < 0:
                self.first = stamp
            if self.arrived and not self.reached.done():
                self.reached.set_result(None)
