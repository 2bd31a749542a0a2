# SPDX-License-Identifier: Apache-2.0
"""Units that show without a filter: vectors whose size is the same in every attitude.

The field of the Earth and gravity have a known size, which readings have, too, however the
instrument is turned.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from math import inf, log

import numpy as np

from kalman_ros.core import Array, Space, rotations

from . import input_axes
from .examination import Examination
from .finding import Curve, Figure, Finding
from .hypotheses import alike
from .units import conversions, label_of, mixed, mixing, scaling

#: Number of attitudes that are tried, share by which the size may change among them, and by which
#: an axis has to.
_ATTITUDES, _SAME, _DIFFERENT = 20, 0.01, 0.2
#: A unit has to be nearer than this factor; none is as near to 1.
_NEAR = 1.3
_ACCELERATION = 'm/s^2'


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors and inputs of which vectors have the size of another unit."""
    for name in case.evidence.scenario.enabled:
        record = case.evidence.sensors.get(name)
        if record is not None and len(record):
            yield from _of_sensor(case, name, record.value)
    yield from _of_input(case)


def _of_sensor(case: Examination, name: str, read: Array) -> Iterator[Finding]:
    evidence, source = case.evidence, case.evidence.scenario.sensors[name]
    space = source.sensor.output
    groups = [group for group in alike(space) if len(group) == 3]
    attitudes = _attitudes(case) if groups and source.judged else None
    if attitudes is None:
        return
    predicted = source.sensor.measure(attitudes)
    for group in groups:
        expected = _size(predicted[:, group])
        factor = _factor(space, group, expected, read[:, group])
        if factor is None:
            continue
        M, label = scaling(case, name, group, factor), label_of(case, name, group)
        norms = np.linalg.norm(read[:, group], axis=1)
        time = evidence.sensors[name].stamp - evidence.start
        yield Finding(
            'unit', label,
            f'readings of {label} have the size {np.nanmedian(norms):.3g}, and {expected:.3g} '
            f'{space.units[group[0]]} is that of every attitude: multiplied by {factor:.4g} they '
            f'fit. They are in {conversions(space, group)[factor]}.',
            inf, mixing(evidence, name, M), plain=True,
            figure=Figure(f'{label}: size', 'time [s]', space.units[group[0]],
                          (Curve('as read', time, norms, 'dots'),
                           Curve('expected', time[[0, -1]], np.full(2, expected), 'bound'))),
            mended=partial(mixed, evidence, name, M),
        )  # fmt: skip


def _of_input(case: Examination) -> Iterator[Finding]:
    """Yield the accelerometer behind the input that is in another unit."""
    model, values = case.evidence.scenario.model, case.evidence.inputs.value
    rest = model.equilibrium.input
    for group in alike(model.input) if len(values) else ():
        size = float(np.linalg.norm(rest[list(group)]))
        if len(group) != 3 or model.input.units[group[0]] != _ACCELERATION or not size:
            continue
        factor = _factor(model.input, group, size, values[:, group])
        if factor is not None:
            finding = input_axes.multiplied(case, group, factor)
            yield replace(finding, z=inf, gain=0.0, plain=True)


def _attitudes(case: Examination) -> Array | None:
    """Return states at rest in different attitudes (A, n); None if none has an attitude."""
    model = case.evidence.scenario.model
    if not model.state.rotations:
        return None
    rng = np.random.default_rng(0)
    states = np.tile(model.equilibrium.state, (_ATTITUDES, 1))
    for names in model.state.rotations:
        turns = rotations.exp(3.0 * rng.standard_normal((_ATTITUDES, 3)))
        states[:, model.state.rotation(names)] = rotations.log(turns)
    return states


def _size(vectors: Array) -> float:
    """Return the size of vectors (A, 3) that is the same for all; 0 if there is none."""
    norms = np.linalg.norm(vectors, axis=1)
    mean = float(norms.mean())
    same = np.ptp(norms) <= _SAME * mean
    return mean if same and np.ptp(vectors, axis=0).min() > _DIFFERENT * mean else 0.0


def _factor(space: Space, group: Sequence[int], expected: float, read: Array) -> float | None:
    """Return the factor of a unit by which vectors (N, 3) have the expected size."""
    sizes = np.linalg.norm(read, axis=1)
    sizes = sizes[np.isfinite(sizes)]
    size = float(np.median(sizes)) if len(sizes) else 0.0
    if not expected or not size:
        return None
    ratio = log(expected / size)
    near = min(conversions(space, tuple(group)), key=lambda factor: abs(log(factor) - ratio))
    return near if abs(log(near) - ratio) < log(_NEAR) else None
