# SPDX-License-Identifier: Apache-2.0
"""Runs one filter through the fault matrix, on the nodes in lockstep."""

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
from kalman_ros.nodes.plant.options import PlantOptions
from kalman_ros.pipeline.estimator_options import EstimatorOptions
from kalman_ros.simulation.faults import options_of_sensors
from kalman_ros.simulation.trajectory import Trajectory

from .cases import Case, Schedule
from .fault_settings import SETTINGS, Setting
from .findings import Counts, Finding, finding

_NODES = ('estimator', 'controller', 'plant')
_VARIANCE = 1e-6  # of a reset pose
_FATES = ('fused', 'rejected', 'dropped')


@dataclass(frozen=True)
class _Account:
    """The numbers of messages on each topic so far, and the counts of plant and estimator."""

    messages: dict[str, int]
    published: int
    counted: Counter[str]


class FaultMatrix:
    """The loop with one filter, which runs one case after another.

    Each starts at the initial state with the same noise, so only the fault differs.

    Parameters
    ----------
    filter
        Its name.
    schedule
        Of every case.
    seed
        Of all noise.
    setting
        The scenario.
    """

    def __init__(
        self, filter: str, schedule: Schedule, seed: int, setting: Setting = SETTINGS[0]
    ) -> None:
        self.filter, self.schedule, self.setting = filter, schedule, setting
        driven = bool(scenario.build({'model': setting.scenario}).input.fields)
        nodes = _NODES if driven else tuple(node for node in _NODES if node != 'controller')
        self._run = Run(setting.scenario, {'filter': filter}, seed=seed, nodes=nodes)
        sensors = self._run.scenario.sensors
        self._decoded: dict[str, Any] = {}
        # parameters changed so far, by node, with their defaults
        self._restored: dict[str, dict[str, Value]] = {'plant': {}, 'estimator': {}}
        self._topics = {name: source.signal.topic for name, source in sensors.items()}
        known = [
            *scenario.options({'model': setting.scenario}).values(),
            *options_of(PlantOptions),
        ]
        known += options_of_sensors(sensors)
        self._usual = {o.name: o.default for o in (*known, *options_of(EstimatorOptions))}

    def findings(self, cases: Sequence[Case], done: Callable[[], None]) -> list[Finding]:
        """Return the finding of each case; ``done`` is called after each."""
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
            whole, space = run.trajectory(), run.scenario.model.state
        return [
            finding(
                case,
                self.setting,
                self.filter,
                self.schedule,
                space,
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
        """Replace the faults of the last case by those of a case, and run it."""
        run = self._run
        plant = {**case.plant, **case.windows(self.schedule, self._topics)}
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
        """Reset the estimator to a wrong position with a small covariance."""
        pose = PoseWithCovarianceStamped()
        pose.pose.pose.position.x, pose.pose.pose.position.y = x, y
        pose.pose.covariance[0] = pose.pose.covariance[7] = _VARIANCE
        run = self._run

        def resets() -> int:
            return int(run.reported('estimator', 'resets'))

        run.refresh('estimator')
        before = resets()
        run.wait(self._pose.get_subscription_count, 10.0, lambda: 'initialpose has no subscribers')
        self._pose.publish(pose)
        run.wait(lambda: resets() > before, 10.0, lambda: 'initialpose was not taken')

    def _account(self) -> _Account:
        """Count messages, after all published ones are recorded."""
        run = self._run
        run.refresh('plant', 'estimator')
        sent = self._reported('plant')
        run.wait(lambda: self._recorded(sent['readings']), 20.0, lambda: 'messages are missing')
        messages = {topic: len(raw) for topic, raw in run.recorder.raw.items()}
        return _Account(messages, sent['readings'], self._reported('estimator'))

    def _reported(self, node: str) -> Counter[str]:
        """Return a node's counts of the readings of all sensors."""
        found: Counter[str] = Counter()
        for value in self._run.diagnostics[node].values:
            sensor, _, what = value.key.partition(': ')
            if sensor in self._topics and what.startswith(('readings', *_FATES)):
                found[what.partition(':')[0]] += int(value.value)
        return found

    def _recorded(self, readings: int) -> bool:
        """Return whether ``readings`` readings, and the answers to every step, are received."""
        raw, scenario = self._run.recorder.raw, self._run.scenario
        state = scenario.state.topic
        answers = [state, f'{state}/covariance']
        if scenario.input.fields:
            answers.append(scenario.input.topic)
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
        """Return whether all values from estimator, controller and ground truth are finite."""
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
