# SPDX-License-Identifier: Apache-2.0
"""The diagnostics of the controller: counts, gains, and why no input is computed."""

from __future__ import annotations

from collections.abc import Callable
from time import monotonic
from typing import Any

import numpy as np

from kalman_ros.control.feedback import Regulator
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.meters import Latency, Rate
from kalman_ros.pipeline.throttle import Throttle
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of

from .feed import EstimateFeed
from .motions import MotionReader
from .output import OutputStage
from .reference import ReferenceReader
from .stop import Stop

#: The warning while no plan is within the limits of the states.
_NO_PLAN = 'no plan keeps the limits of the states; they count with their price until one does'


class Health:
    """Counts and reports; of several problems, the one closest to the cause.

    Parameters
    ----------
    regulator, stop, feed, output, reference, motions
        The parts of a controller on which it reports.
    warn
        Logs that no plan is possible.

    Attributes
    ----------
    fault
        Why the last estimate had no answer; empty if it had one.
    answered, refused
        Numbers of estimates.
    came
        Time of the last estimate by the steady clock.
    """

    def __init__(
        self,
        regulator: Regulator,
        stop: Stop,
        feed: EstimateFeed,
        output: OutputStage,
        reference: ReferenceReader,
        motions: MotionReader,
        warn: Callable[[str], Any],
    ) -> None:
        self._regulator, self._stop, self._feed = regulator, stop, feed
        self._output, self._reference, self._motions = output, reference, motions
        self._warn = Throttle(warn)
        self._rate, self._latency, self.age = Rate(), Latency(), Latency()
        self.refused = 0
        #: Steps without a plan within the limits of the states, as last reported.
        self._impossible = 0
        self.begin()

    def begin(self) -> None:
        """Start: no estimate has been received yet."""
        self.fault, self.answered, self.came = '', 0, monotonic()

    def count(self, came: float) -> None:
        """Count an answered estimate, received at a time of the steady clock."""
        self.answered += 1
        self._latency.add(monotonic() - came)

    def receive(self) -> None:
        """Keep the time at which an estimate is received."""
        self.came = self._rate.count()

    def report(self, scenario: Scenario) -> Report:
        """Return counts and gains, or why no input is computed."""
        gains, target = self._regulator.feedback, self._regulator.target
        values = {
            'estimates answered': self.answered,
            'estimates refused': self.refused,
            'estimates skipped for newer ones': self._feed.passed,
            'estimates ignored: older than the last': self._feed.older,
            'forces published': self._output.count,
            'forces limited': self._output.limited,
            'rate [Hz]': self._rate.value,
            'from arrival to publication, 50 / 90 / 99 % [ms]': str(self._latency),
            'age of estimates, 50 / 90 / 99 % [ms]': str(self.age),
            'law': scenario.law,
            'set points refused': self._reference.refused,
            'motions planned': self._motions.planned,
            'motions refused': self._motions.refused,
            'reference': np.array2string(target[0], precision=4),
            'gain': np.array2string(gains.gain, precision=4),
            'poles': np.array2string(gains.poles, precision=4),
        }
        predictor = self._regulator.predictor
        if predictor is not None:
            values['inputs planned within limits'] = predictor.limited
            values['plans too late'] = predictor.late
            values['plans not possible'] = predictor.infeasible
        zero = f'the force {"is" if self._output.at_idle else "goes to"} {self._output.idle_name}'
        if self._stop.reason:
            return Level.ERROR, f'stopped ({self._stop.reason}): {zero}', values
        if self.fault:
            return Level.ERROR, f'{self.fault}: {zero}', values
        values.update(self._progress(scenario))
        if self._motions.refusal:
            values['reason of the last refusal'] = self._motions.refusal
        if not self._stop.may_act:
            return Level.WARN, f'disabled: {zero}', values
        if not self.answered:
            return Level.WARN, f'no {scenario.state.topic} received', values
        impossible = 0 if predictor is None else predictor.infeasible
        since, self._impossible = impossible - self._impossible, impossible
        if since > 0:
            self._warn(_NO_PLAN)
            return Level.WARN, _NO_PLAN, values
        return Level.OK, 'running', values

    def _progress(self, scenario: Scenario) -> dict[str, str]:
        """Return how far a motion has got; nothing where none is followed."""
        motion, elapsed = self._regulator.motion, self._regulator.elapsed
        if motion is None:
            return {}
        progress = {'motion': f'{elapsed:.2f} of {motion.duration:.2f} s'}
        body = body_of(scenario.model.state, scenario.state)
        places = [body.index[axis] for axis in body.position]
        if places:
            ahead = motion.states[min(int(elapsed / motion.dt), len(motion.states) - 1) :, places]
            length = float(np.linalg.norm(np.diff(ahead, axis=0), axis=1).sum())
            progress['remaining distance [m]'] = f'{length:.3f}'
        return progress
