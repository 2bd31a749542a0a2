# SPDX-License-Identifier: Apache-2.0
"""Sensors whose readings follow the state behind a low-pass filter.

A reading y of the first order follows h(x) by tau y' = h(x) - y. Along the predictions of a pass,
the difference y - h(x) is what a lag adds to the readings; `responses` has its effect on the
innovations, of the size 1 that it has if tau is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .noise_levels import innovations
from .passage import Passage
from .responses import Columns, responses

#: Trial time constants, as multiples of the mean interval of the readings, and how many.
_SHORTEST, _COUNT = 0.1, 16
#: The longest one, as a share of the recording.
_LONGEST = 0.05
#: Factors by which a time constant is refined.
_FACTORS = np.geomspace(0.7, 1.0 / 0.7, 9)


def find(case: Examination) -> list[Finding]:
    """Return the sensors that fit the state behind a lag of some time constant."""
    findings = []
    for name in case.judged:
        interval = case.evidence.duration / max(len(case.passage.of(name)), 1)
        longest = _LONGEST * case.evidence.duration
        if len(case.passage.of(name)) < 20 or longest <= _SHORTEST * interval:
            continue
        constants = np.geomspace(_SHORTEST * interval, longest, _COUNT)
        gain, tau, std = _likeliest(case.passage, case.evidence, name, constants)
        if gain > CHANCE:
            finding = _finding(case, case.evidence, name, gain, tau, std)
            findings.append(replace(finding, exact=partial(_nearer, finding)))
    return findings


def _nearer(finding: Finding) -> Finding:
    """Return the finding about the pass that it corrects, since its predictions lag, too."""
    assert finding.mended is not None and finding.again is not None
    return finding.again(Examination(finding.mended())) or finding


def _likeliest(
    passage: Passage, evidence: Evidence, name: str, constants: Sequence[float] | Array,
    before: float = 0.0,
) -> tuple[float, float, float]:  # fmt: skip
    """Return the gain, the likeliest of the time constants, and its standard deviation.

    The readings are already without the effect of the lag ``before``.
    """
    added = behind(passage, evidence, name, [before, *constants])
    block = added[:, :, 1:] - added[:, :, :1]
    labels = [(str(index),) for index in range(block.shape[2])]
    regression = responses(passage, Columns(labels, {name: [(0, block)]}))
    gains = 2.0 * regression.gradient - regression.information.diagonal()
    best = int(np.argmax(gains))
    other = best - 1 if best else best + 1
    M = regression.information
    apart = M[best, best] + M[other, other] - 2.0 * M[best, other]
    std = abs(constants[best] - constants[other]) / max(float(apart), 1e-300) ** 0.5
    return float(gains[best]), float(constants[best]), float(std)


def behind(
    passage: Passage, evidence: Evidence, name: str, constants: Sequence[float] | Array
) -> Array:
    """Return what lags of T time constants add to the predicted readings of a sensor (N, k, T).

    The predictions of all events are joined by lines, which a lag follows exactly.
    """
    sensor = evidence.scenario.sensors[name].sensor
    values = sensor.measure(passage.series('x'))
    dt = np.diff(passage.series('time'))[:, None]
    tau = np.maximum(np.asarray(constants, dtype=float), 1e-12)
    steps = sensor.output.subtract(values[1:], values[:-1])
    kept = np.exp(-dt / tau)
    entering = np.where(dt > 0.0, -np.expm1(-dt / tau) * tau / np.maximum(dt, 1e-12), 1.0)
    added = np.zeros((*values.shape, len(tau)))
    entered = entering[:, None, :] * steps[:, :, None]
    for index, (a, entry) in enumerate(zip(kept, entered)):
        added[index + 1] = a * added[index] - entry
    return np.asarray(added[passage.of(name)])


def _finding(
    case: Examination, evidence: Evidence, name: str, gain: float, tau: float, std: float
) -> Finding:
    """Return the finding of a lag; ``evidence`` has the readings as they are."""
    record = evidence.sensors[name]
    value = record.value.copy()
    rows = case.passage.series('index', name)
    value[rows] -= behind(case.passage, evidence, name, [tau])[:, :, 0]

    def again(after: Examination) -> Finding | None:
        more, nearer, about = _likeliest(after.passage, evidence, name, tau * _FACTORS, tau)
        return _finding(after, evidence, name, gain + more, nearer, about)

    return Finding(
        'lag', name,
        f'readings of {name} follow the state with a time constant of {tau:.3g} ± {std:.1g} s: a '
        'low-pass filter in the sensor or its driver, or a slow sensor. Take it out, or declare '
        'the lag as a state.',
        gain**0.5, gain=gain, figure=innovations(case, name, 0),
        mended=lambda: evidence.with_values(name, value), again=again,
    )  # fmt: skip
