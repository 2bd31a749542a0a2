# SPDX-License-Identifier: Apache-2.0
"""The diagnostics of the estimator: outcomes of the readings, and their consistency."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Set
from math import sqrt
from typing import Any

from kalman_ros.estimators.consistency import verdict
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.nodes.middleware.diagnostics import Level, Report
from kalman_ros.nodes.middleware.meters import Latency
from kalman_ros.pipeline.fuser import Fuser
from kalman_ros.scenario import Scenario, SensorSource


class Health:
    """Reports on a `Fuser`; of several problems, the one closest to the cause.

    Parameters
    ----------
    fuser
        Whose messages are reported on.
    latency
        From reception to publication.
    warn
        Logs that the clock of a sensor runs ahead, and that the estimator has restarted.
    """

    def __init__(self, fuser: Fuser, latency: Latency, warn: Callable[[str], Any]) -> None:
        self._fuser, self._latency, self._warn = fuser, latency, warn
        #: The sensors whose clocks were ahead at the last report.
        self._ahead: Set[str] = set()
        self._restarts = fuser.online.restarts

    def report(self, scenario: Scenario, published: int, *, lockstep: bool) -> Report:
        """Return the outcomes of the readings, and whether innovations scatter as expected."""
        fuser, online, channels = self._fuser, self._fuser.online, self._fuser.channels
        fuser.check_restarts()
        values: dict[str, Any] = {}
        for name, counts in online.counts.items():
            values.update(channels[name].report(counts))
        ahead = self._clocks_ahead()
        if str(self._latency):
            key = 'from arrival to publication, 50 / 90 / 99 % [ms]'
            values[key] = str(self._latency)
        topic = scenario.input.topic
        values[f'{topic}: used'] = fuser.inputs[Outcome.FUSED]
        values[f'{topic}: received'] = fuser.inputs.total()
        for outcome in (Outcome.OTHER_FRAME, Outcome.NO_TRANSFORM):
            if fuser.inputs[outcome]:
                values[f'{topic}: {outcome.value}'] = fuser.inputs[outcome]
        values['estimates published'] = published
        believed = scenario.believed
        values.update(fuser.observability.report(fuser.estimate()))
        for name, bias in believed.biases(online.belief).items():
            values[f'{name}: bias'] = ', '.join(
                f'{mean:.4g} ± {std:.2g}' for mean, std in zip(bias.mean, bias.std)
            )
        for name, factor in online.noise.items():
            values[f'{name}: noise'] = f'{sqrt(factor):.3g} times the declared'
        values['arithmetic'] = fuser.arithmetic
        values['resets'] = fuser.resets
        values['restarts'] = online.restarts
        if online.restarts > self._restarts:
            self._warn(f'restarted from the initial belief, {online.restarts} times so far')
        self._restarts = online.restarts
        values['repairs of the covariance'] = online.repairs
        sources = scenario.sensors
        silent = [name for name, channel in channels.items() if channel.silent(sources[name])]
        doubtful = [name for name, channel in channels.items() if not channel.nis.inside()]
        wrong = '' if fuser.fusing else 'fusion is switched off by ~/toggle'
        wrong = wrong or ahead
        if not wrong and online.time is None:
            wrong = self._unstarted()
        if not wrong and silent and not lockstep:
            wrong = f'no readings of {" and ".join(silent)} received'
        if not wrong and not lockstep:
            wrong = self._unused(sources)
        if not wrong and online.contradicting:
            wrong = f'{" and ".join(online.contradicting)} contradicts the sensors that agree'
        if not wrong and doubtful:
            wrong = f'innovations of {" and ".join(doubtful)} do not scatter as expected'
        judged = {
            f'NIS of {name}': channels[name].nis
            for name, source in scenario.enabled.items()
            if source.judged
        }
        return (Level.WARN, wrong, values) if wrong else (Level.OK, verdict(judged), values)

    def _clocks_ahead(self) -> str:
        """Return the sensors whose stamps are ahead of the clock, and warn of new ones."""
        ahead = {name: c.ahead for name, c in self._fuser.channels.items() if c.ahead}
        which = ' and '.join(f'{name} by {lead:.2g} s' for name, lead in ahead.items())
        words = f'stamps are ahead of the clock: {which}' if ahead else ''
        if ahead.keys() - self._ahead:
            self._warn(words)
        self._ahead = ahead.keys()
        return words

    def _unused(self, sources: Mapping[str, SensorSource]) -> str:
        """Return the sensors of which no reading is used, with the reason."""
        unused = {
            name: why
            for name, channel in self._fuser.channels.items()
            if (why := channel.use.problem(sources[name].timed.rate))
        }
        reasons = ', '.join(f'of {name} {why}' for name, why in unused.items())
        return f'no reading is used: {reasons}' if unused else ''

    def _unstarted(self) -> str:
        """Return why there is no estimate yet."""
        channels, counts = self._fuser.channels, self._fuser.online.counts
        outcomes = [
            f'{count} of {name} {outcome.value}'
            + (f' ({channels[name].trouble})' if outcome.explained else '')
            for name, outcome_counts in counts.items()
            for outcome, count in outcome_counts.items()
            if count
        ]
        if not outcomes:
            return 'no readings received'
        used = any(
            outcome.accepted for outcome_counts in counts.values() for outcome in +outcome_counts
        )
        since = ' since the last reset; in total' if used else ''
        return f'no reading could be used{since}: {", ".join(outcomes)}'
