# SPDX-License-Identifier: Apache-2.0
"""A long run of the loop in real time, with faults, observed each second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from kalman_ros.codecs.messages import leading_stamp, message_type
from kalman_ros.core import Array
from kalman_ros.harness import Run
from kalman_ros.nodes.middleware.diagnostics import NUMBER, PUBLISHERS
from kalman_ros.nodes.middleware.topics import HISTORY

from .findings import Delivery, Soak
from .machine import Withheld, usage

SCENARIO = 'mass_spring_damper_2d'
RATE = 200.0
#: A little of everything, all the time.
FAULTS = {
    'dropout': 0.05,
    'burst_loss': 0.005,
    'jitter': 0.01,
    'reordering': 0.02,
    'duplication': 0.02,
    'outliers': 0.01,
    'nan': 0.01,
    'gate': 0.999,
}
_FATES = ('fused', 'rejected', 'dropped')
#: Without a change for this many seconds no message is in transit.
_PAUSE = 1.5


class Endurance:
    """The four nodes in real time, and their statistics.

    Parameters
    ----------
    seed
        Of all noise.
    """

    def __init__(self, seed: int) -> None:
        overrides = {
            'rate': RATE,
            'velocity.rate': RATE,
            'actuator_loss': 0.02,
            'disturbance_noise': [0.01],
            **{
                f'{name}.{key}': v
                for name in ('position', 'velocity')
                for key, v in FAULTS.items()
            },
            **{f'{name}.reliable': True for name in ('position', 'velocity')},
        }
        self._run = Run(SCENARIO, overrides, seed=seed, lockstep=False)
        sensors = self._run.scenario.sensors
        self._sensors = {name: source.signal.topic for name, source in sensors.items()}
        self._ages: list[float] = []
        self._all_ages: list[Array] = []
        self._looks: list[tuple[float, ...]] = []
        self._not_finite: set[str] = set()

    def soak(self, seconds: float, progress: Callable[[float], None]) -> Soak:
        """Run for ``seconds``; ``progress`` is called each second with the elapsed ones."""
        with self._run as run:
            scenario = run.scenario
            kind = message_type(scenario.input.type)
            run.node.create_subscription(
                kind, scenario.input.topic, self._on_force, HISTORY, raw=True
            )
            # before the first step: steps missed from then on must have a reason
            self._withheld = Withheld([run.processes['plant'].pid])
            run.set_parameter('run_until', 1e9)
            start = self._clock()
            while self._clock() - start < seconds:
                run.spin(1.0)
                self._look(self._clock() - start)
                progress(self._clock() - start)
            self._end()
            return self._findings()

    def _clock(self) -> float:
        return float(self._run.node.get_clock().now().nanoseconds) * 1e-9

    def _on_force(self, data: bytes) -> None:
        self._ages.append(self._clock() - leading_stamp(data) * 1e-9)

    def _look(self, time: float) -> None:
        """Record all counts, and drop the messages."""
        run = self._run
        ages = np.array(self._ages or [np.nan])
        missed = int(run.reported('plant', 'missed steps') or 0)
        resident = [usage(process.pid).resident for process in run.processes.values()]
        middle, tail = np.percentile(ages, (50, 99))
        self._looks.append((time, missed, self._withheld(), float(middle), float(tail), *resident))
        self._all_ages.append(ages)
        self._ages.clear()
        for topic in run.recorder.raw:
            if topic in self._sensors.values():
                continue
            if not np.isfinite(run.recorder[topic].values).all():
                self._not_finite.add(topic)
        run.recorder.forget()

    def _end(self) -> None:
        """Wait for messages in transit: no node publishes any more, the controller included."""
        run = self._run
        run.set_parameter('estimate_timeout', 0.0, 'controller')
        run.set_parameter('run_until', 0.0)
        before: Any = None
        while before != (now := self._counts()):
            before = now
            run.spin(_PAUSE)

    def _counts(self) -> dict[tuple[str, str], int]:
        """Return all whole numbers in the diagnostics of the nodes, by node and name.

        The number of reports is left out: it never stands still.
        """
        return {
            (node, value.key): int(value.value)
            for node in self._run.processes
            for value in self._status(node).values
            if value.value.isdigit() and value.key != NUMBER
        }

    def _status(self, node: str) -> DiagnosticStatus:
        return self._run.diagnostics[node]

    def _findings(self) -> Soak:
        run, counts = self._run, self._counts()
        time, missed, withheld, middle, tail, *resident = np.array(self._looks).T
        ages = np.concatenate(self._all_ages)
        low, high, most = np.nanpercentile(ages, (50, 90, 99))
        return Soak(
            rate=run.scenario.rate,
            time=time,
            resident=dict(zip(run.processes, resident)),
            missed=missed,
            withheld=withheld,
            median=middle,
            tail=tail,
            latency=(float(low), float(high), float(most)),
            deliveries=tuple(self._deliveries(counts)),
            not_finite=tuple(sorted(self._not_finite)),
            readings=self._readings(counts),
        )

    def _deliveries(self, counts: dict[tuple[str, str], int]) -> list[Delivery]:
        estimate, force = self._run.scenario.state.topic, self._run.scenario.input.topic
        published = counts['controller', 'forces published']
        taken = ('estimates answered', 'estimates skipped for newer ones')
        found = [
            self._delivery(topic, 'estimator', counts['plant', key], counts['estimator', key])
            for name, topic in self._sensors.items()
            for key in (f'{name}: readings',)
        ]
        return [
            *found,
            self._delivery(
                estimate,
                'controller',
                counts['estimator', 'estimates published'],
                sum(counts['controller', key] for key in taken),
            ),
            self._delivery(force, 'plant', published, counts['plant', 'forces received']),
            self._delivery(
                force, 'estimator', published, counts['estimator', f'{force}: received']
            ),
        ]

    def _delivery(self, topic: str, receiver: str, published: int, received: int) -> Delivery:
        key = f'{PUBLISHERS}{self._run.node.resolve_topic_name(topic)}'
        publishers = int(self._run.reported(receiver, key) or 1)
        return Delivery(topic, receiver, published, received, publishers)

    def _readings(self, counts: dict[tuple[str, str], int]) -> tuple[int, int, int, int]:
        """Return the number of readings, and of each outcome."""

        def total(what: str) -> int:
            starts = tuple(f'{name}: {what}' for name in self._sensors)
            return sum(
                count
                for (node, key), count in counts.items()
                if node == 'estimator' and key.startswith(starts)
            )

        fused, rejected, dropped = (total(fate) for fate in _FATES)
        return total('readings'), fused, rejected, dropped
