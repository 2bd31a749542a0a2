# SPDX-License-Identifier: Apache-2.0
"""Puts one filter through the cases of the fault matrix, on the nodes in lockstep."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped

from kalman_ros import scenario
from kalman_ros.core import Value, options_of
from kalman_ros.harness import Run
from kalman_ros.nodes.options import EstimatorOptions
from kalman_ros.nodes.plant_options import PlantOptions
from kalman_ros.simulation.faults import options_of_sensors
from kalman_ros.simulation.trajectory import Trajectory

from . import cases as fault_cases
from .cases import Case, Schedule
from .findings import Counts, Finding, finding

_NODES = ('estimator', 'controller', 'plant')
_VARIANCE = 1e-6  # of a pose that it is sure of
_FATES = ('fused', 'rejected', 'dropped')


@dataclass(frozen=True)
class _Account:
    """How many messages came on each topic so far, and what plant and estimator counted."""

    messages: dict[str, int]
    published: int
    counted: Counter[str]


class FaultMatrix:
    """The loop with one filter, which is put through one case after another.

    Each begins at the initial state with the same noise, so what differs is the fault.

    Parameters
    ----------
    filter
        Its name.
    schedule
        Of every case.
    seed
        Of all noise.
    """

    def __init__(self, filter: str, schedule: Schedule, seed: int) -> None:
        self.filter, self.schedule = filter, schedule
        self._run = Run(fault_cases.SCENARIO, {'filter': filter}, seed=seed, nodes=_NODES)
        sensors = self._run.scenario.sensors
        self._decoded: dict[str, Any] = {}
        # what was set at some time, by node, with what it usually is
        self._restored: dict[str, dict[str, Value]] = {'plant': {}, 'estimator': {}}
        self._topics = {name: source.signal.topic for name, source in sensors.items()}
        known = [*scenario.options({}).values(), *options_of(PlantOptions)]
        known += options_of_sensors(sensors)
        self._usual = {o.name: o.default for o in (*known, *options_of(EstimatorOptions))}

    def findings(self, cases: Sequence[Case], done: Callable[[], None]) -> list[Finding]:
        """Return what each case does to the filter; ``done`` is called after each."""
        starts, warnings = [], []
        with self._run as run:
            self._pose = run.node.create_publisher(PoseWithCovarianceStamped, 'initialpose', 1)
            accounts = [self._account()]
            for case in cases:
                starts.append(run.elapsed + 1.0 / run.scenario.rate)
                self._go_through(case)
                accounts.append(self._account())
                warnings.append(run.diagnostics['estimator'].level != DiagnosticStatus.OK)
                done()
            whole = run.trajectory()
        return [
            finding(
                case,
                self.filter,
                self.schedule,
                _stretch(whole, start, self.schedule.stop),
                self._counts(before, after),
                warned=warned,
                finite=self._finite(before, after),
            )
            for case, start, warned, before, after in zip(
                cases, starts, warnings, accounts, accounts[1:]
            )
        ]

    def _go_through(self, case: Case) -> None:
        """Put the faults of a case in place of those of the last one, and run it."""
        run = self._run
        plant = {**case.plant, **case.windows(self.schedule)}
        for node, values in {'plant': plant, 'estimator': case.estimator}.items():
            change = {**self._restored[node], **values}
            if change:
                run.set_parameters(change, node)
            self._restored[node].update({name: self._usual[name] for name in values})
            run.trigger(f'{node}/reset')
        if case.pose is not None:
            self._start_from(*case.pose)
        run.advance(self.schedule.stop)

    def _start_from(self, x: float, y: float) -> None:
        """Have the estimator begin there, and sure of it."""
        pose = PoseWithCovarianceStamped()
        pose.pose.pose.position.x, pose.pose.pose.position.y = x, y
        pose.pose.covariance[0] = pose.pose.covariance[7] = _VARIANCE
        log = self._run.processes['estimator'].output
        said = log().count('initialpose')
        self._run.wait(
            self._pose.get_subscription_count, 10.0, lambda: 'initialpose has no subscribers'
        )
        self._pose.publish(pose)
        self._run.wait(
            lambda: log().count('initialpose') > said, 10.0, lambda: 'initialpose was not taken'
        )

    def _account(self) -> _Account:
        """Take stock, when all that was published has been recorded."""
        run = self._run
        run.refresh('plant', 'estimator')
        sent = self._said('plant')
        run.wait(lambda: self._recorded(sent['readings']), 20.0, lambda: 'messages are missing')
        messages = {topic: len(raw) for topic, raw in run.recorder.raw.items()}
        return _Account(messages, sent['readings'], self._said('estimator'))

    def _said(self, node: str) -> Counter[str]:
        """Return what a node has counted of the readings of all sensors."""
        found: Counter[str] = Counter()
        for value in self._run.diagnostics[node].values:
            sensor, _, what = value.key.partition(': ')
            if sensor in self._topics and what.startswith(('readings', *_FATES)):
                found[what.partition(':')[0]] += int(value.value)
        return found

    def _recorded(self, readings: int) -> bool:
        """Tell whether ``readings`` readings, and the answers to every step, are received."""
        raw, scenario = self._run.recorder.raw, self._run.scenario
        state = scenario.state.topic
        answers = (state, f'{state}/covariance', scenario.input.topic)
        steps = len(raw['ground_truth'])
        return sum(len(raw[topic]) for topic in self._topics.values()) >= readings and all(
            len(raw[topic]) >= steps for topic in answers
        )

    def _counts(self, before: _Account, after: _Account) -> Counts:
        since = {
            what: after.counted[what] - before.counted[what] for what in ('readings', *_FATES)
        }
        return Counts(after.published - before.published, since.pop('readings'), **since)

    def _finite(self, before: _Account, after: _Account) -> bool:
        """Tell whether all that estimator, controller and ground truth said is finite."""
        return all(
            np.isfinite(self._numbers(topic)[before.messages[topic] : after.messages[topic]]).all()
            for topic in after.messages
            if topic not in self._topics.values()
        )

    def _numbers(self, topic: str) -> Any:
        if topic not in self._decoded:
            self._decoded[topic] = self._run.recorder[topic].values
        return self._decoded[topic]


def _stretch(whole: Trajectory, start: float, seconds: float) -> Trajectory:
    """Return a part of a run, with its time counted from ``start``."""
    part = (whole.time >= start - 1e-6) & (whole.time < start + seconds - 1e-6)
    return replace(
        whole,
        time=whole.time[part] - start,
        truth=whole.truth[part],
        estimate=whole.estimate[part],
        covariance=whole.covariance[part],
        input=whole.input[part],
    )
