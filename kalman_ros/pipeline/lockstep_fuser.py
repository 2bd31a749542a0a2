# SPDX-License-Identifier: Apache-2.0
"""The estimator in lockstep: a step is fused once all of its messages are received."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from kalman_ros.codecs.tick import read_tick
from kalman_ros.core import Array, Gaussian

from .fuser import Fuser
from .reading import Reading
from .step_assembler import StepAssembler


class Output(Protocol):
    """Receiver of the results of an estimator: a node publishes them, a replay records them."""

    def publish(self, time: int, belief: Gaussian) -> None:
        """Take the belief at ``time``, in nanoseconds."""

    def publish_innovations(self, fused: Sequence[Reading]) -> None:
        """Take the readings of a step, with their corrections."""


class LockstepFuser:
    """Fusion, step by step, of the messages of the plant and the controller in any order.

    Parameters
    ----------
    fuser
        Fusion of the messages.
    output
        Receiver of the results.
    info
        Function that logs that time went back.
    resolve
        Function that returns the full name of a topic.
    """

    def __init__(
        self,
        fuser: Fuser,
        output: Output,
        info: Callable[[str], object],
        resolve: Callable[[str], str],
    ) -> None:
        self._fuser, self._output, self._info = fuser, output, info
        scenario = fuser.scenario
        topics = {source.signal.topic: name for name, source in scenario.sensors.items()}
        self._steps = StepAssembler(topics, answered=bool(scenario.input.fields), resolve=resolve)
        #: The input (m,) that led to the last step, and the time of the step before it.
        self.last_input: tuple[int, Array] | None = None

    def on_reading(self, name: str, data: bytes) -> None:
        """Take a message of the sensor ``name``; UndecodableError if it is not one.

        A step waits for all readings that its tick names, also for those that are not used.
        """
        source = self._fuser.scenario.sensors[name]
        reading = self._fuser.channels[name].read(data, source)
        self._steps.reading(name, reading.time, reading)
        self._fuse_steps()

    def on_input(self, data: bytes) -> None:
        """Take a message of the input."""
        input = self._fuser.read_input(data)
        if input is not None:
            self._steps.input(input.time, input.values)
            self._fuse_steps()

    def on_tick(self, data: bytes) -> None:
        """Take a tick."""
        time, topics = read_tick(data)
        asked_again = self._steps.waits_for(time)
        if self._steps.tick(time, topics):
            self._info('time went back: restarting')
            self._fuser.restart()
        self._fuse_steps()
        unanswered = self._steps.unanswered
        if asked_again and unanswered is not None:
            # the input that responds to it was lost: ask the controller again
            self._output.publish(unanswered, self._fuser.predicted(unanswered))

    def _fuse_steps(self) -> None:
        fuser = self._fuser
        for step in self._steps.complete():
            sensors = fuser.scenario.sensors
            received = [y for name, y in step.readings if sensors[name].timed.enabled]
            for reading in received:
                reading.time = reading.time or step.time
            if step.input is not None:
                received.append(Reading(None, *step.input))
            self.last_input = step.input
            fused = fuser.fuse(received)
            self._output.publish(step.time, fuser.predicted(step.time))
            self._output.publish_innovations(fused)
