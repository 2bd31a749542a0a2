# SPDX-License-Identifier: Apache-2.0
"""Sensors that follow what they measure with a lag, as behind a filter or in a housing."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Curve, Figure, Finding
from .lagging import behind, continuous
from .passage import Passage

#: The size of the effect, 1 for a lag of just this time, is between these.
_LEAST, _MOST = 0.4, 2.5
#: The number of fitted numbers: the time, and the size, which makes up for its grid.
_NUMBERS = 2.0


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors that lag behind, each with its likeliest time."""
    for name in case.judged:
        fits = [(case.responses.alone(k), k) for k in case.responses.columns('lag of', name)]
        fits = [(fit, k) for fit, k in fits if _LEAST < float(fit.size[0]) < _MOST]
        if not fits:
            continue
        fit, column = max(fits, key=lambda pair: pair[0].gain)
        if fit.gain > CHANCE:
            lag = float(case.responses.labels[column][2])
            yield _finding(case, name, lag, float(fit.size[0]), fit.gain)


def _finding(case: Examination, name: str, lag: float, size: float, gain: float) -> Finding:
    evidence, space = case.evidence, case.evidence.scenario.sensors[name].sensor.output
    times, effect = _effect(case.passage, evidence, name, lag)
    curves = tuple(
        Curve(space.label(each), times - times[0], size * effect[:, i])
        for i, each in enumerate(space.names)
    )
    about = lag * size

    def again(after: Examination) -> Finding | None:
        """Return the lag with the size that predictions of the corrected pass give it."""
        more = [
            after.responses.alone(k)
            for k in after.responses.columns('lag of', name)
            if float(after.responses.labels[k][2]) == lag
        ]
        nearer = size + float(more[0].size[0]) if more else 0.0
        if not _LEAST < nearer < _MOST:
            return None
        moved = Examination(evidence, known=after.passage)
        return _finding(moved, name, lag, nearer, gain)

    return Finding(
        'lag', name,
        f'readings of {name} follow what they measure with a lag of some {about:.2g} s, as behind '
        'a filter or in a housing: the faster it changes, the less they show. Take the filter '
        f'out, or make it a state of the model. If it is a delay, {name}.stamp_offset mends it.',
        gain**0.5, gain=gain, parameters=_NUMBERS,
        figure=Figure(f'{name}: its lag', 'time [s]', 'reading - measured', curves),
        mended=partial(_without, evidence, name, times, size * effect), again=again,
    )  # fmt: skip


def _effect(passage: Passage, evidence: Evidence, name: str, lag: float) -> tuple[Array, Array]:
    """Return the times (N,) of the readings of a pass, and the effect of a lag on them (N, k)."""
    events = [passage.events[i] for i in passage.of(name)]
    sensor = evidence.scenario.sensors[name].sensor
    times = np.array([event.time for event in events])
    values = sensor.measure(np.array([event.x for event in events]))
    return times, behind(times, continuous(values, sensor.output), lag)


def _without(evidence: Evidence, name: str, times: Array, effect: Array) -> Evidence:
    """Return the evidence without an effect (N, k) on the readings of a sensor."""
    record = evidence.sensors[name]
    added = [np.interp(record.stamp, times, column) for column in effect.T]
    return evidence.with_values(name, record.value - np.stack(added, axis=1))
