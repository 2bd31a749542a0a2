# SPDX-License-Identifier: Apache-2.0
"""Fault hypotheses as columns of a regression: readings, inputs, parameters, initial belief."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from kalman_ros.core import Array, Dynamics, Space
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.body_roles import body_of
from kalman_ros.scenario.lever_arm import LeverArm

from .alignment import is_alignable, tilted
from .evidence import Evidence
from .parameters import STEP, Varied, varied
from .passage import Passage
from .responses import Columns, Pushes, Responses, responses

#: Readings over which movements are compared, and the share that rates of the model leave of them
#: where they tell nothing.
_SPAN, _UNEXPLAINED = 10, 0.9
#: A changing offset is constant in each piece: largest number of pieces, and shortest piece (s).
PIECES, _SHORTEST = 30, 1.0
#: Number of trial delays of inputs, from one sample of the loop on, and the longest (s), also as a
#: share of the recording.
_LAGS, _LONGEST, _LONGEST_SHARE = 12, 10.0, 0.1
#: A rate below this share of its root mean square has no direction.
_MOVING = 0.1
#: Trial dead zones: quantiles of the magnitude of the input where it is not zero, and shares of
#: the first one, for an input that is seldom small.
_DEAD, _SMALLER = (0.2, 0.35, 0.5, 0.65, 0.8), (0.15, 0.4)


def edges(passage: Passage) -> Array:
    """Return the edges (B + 1,) of the pieces of a recording, in seconds."""
    first, last = passage.series('time')[[0, -1]].tolist()
    count = int(np.clip((last - first) / _SHORTEST, 1, PIECES))
    return np.linspace(first, last + 1e-6, count + 1)


def columns(
    evidence: Evidence,
    passage: Passage,
    tones: Array | None = None,
    subjects: Collection[str] = (),
) -> Columns:
    """Return the columns of every additive fault of a recording.

    Parameters
    ----------
    evidence, passage
        Recording, and a pass over it.
    tones
        One frequency (Hz) for each input, of a sine that may be added to the input.
    subjects
        Sensors, to which the columns are limited, without offsets; or what is no sensor, for the
        columns of inputs, of the first belief and of parameters.
    """
    labels: list[tuple[str, ...]] = []
    readings: dict[str, list[tuple[int, Array]]] = {}
    for name in passage.names:
        readings[name] = []
        if subjects and name not in subjects:
            continue
        block, sensor_labels = _sensor_columns(evidence, passage, name)
        readings[name].append((len(labels), block))
        labels += sensor_labels
    if labels and subjects:
        return Columns(labels, readings)
    numbers = [*varied(evidence)]
    pushed, pushes = _pushes(evidence, passage, tones)
    changed, state = _state_columns(evidence, passage, numbers)
    labels += [*pushed, *changed]
    for name, blocks in readings.items():
        if any(name in number.sensors for number in numbers):
            added = _read_parameters(evidence, passage, name, numbers)
            blocks.append((len(labels) - len(numbers), added))
    offset, offsets = ([], {}) if subjects else _offsets(passage, passage.names, edges(passage))
    labels += offset
    return Columns(labels, readings, offsets, pushes, state)


def _offsets(
    passage: Passage, names: Sequence[str], limits: Array
) -> tuple[list[tuple[str, ...]], dict[str, Any]]:
    """Return the labels of offsets of sensors, and that of each coordinate of each reading (E, k).

    There is one for each piece between the ``limits`` (B + 1,) and each coordinate of all sensors:
    all those of a piece, then those of the next one.
    """
    sizes = {name: passage.series('innovation', name).shape[1] for name in names}
    coordinates = [(name, str(i)) for name, k in sizes.items() for i in range(k)]
    labels: list[tuple[str, ...]] = [
        ('offset', *of, str(b)) for b in range(len(limits) - 1) for of in coordinates
    ]
    offsets, first = {}, 0
    for name, k in sizes.items():
        piece = np.searchsorted(limits, passage.series('time', name), 'right') - 1
        start = len(coordinates) * np.clip(piece, 0, len(limits) - 2)
        offsets[name] = start[:, None] + first + np.arange(k)
        first += k
    return labels, offsets


def offset_responses(passage: Passage, name: str, limits: Array) -> Responses:
    """Return the regression on the offsets of a sensor alone, in pieces of any length."""
    labels, offsets = _offsets(passage, [name], limits)
    return responses(passage, Columns(labels, {}, offsets))


def _sensor_columns(
    evidence: Evidence, passage: Passage, name: str
) -> tuple[Array, list[tuple[str, ...]]]:
    """Return the columns of a sensor: mixed coordinates, early stamps, lever arm, mounting."""
    source = evidence.scenario.sensors[name]
    recorded = evidence.sensors[name].value[passage.series('index', name)]
    # predictions, since the noise of a reading is correlated with its innovation
    X = passage.series('x', name)
    values = source.sensor.measure(X)
    N, k = values.shape
    block = np.zeros((N, k, 2 * k * k + k + 1))
    labels: list[tuple[str, ...]] = []
    for kind, mixed in (('mix', values), ('read', recorded)):
        for i in range(k):
            for j in range(k):
                block[:, i, len(labels)] = mixed[:, j]
                labels.append((kind, name, str(i), str(j)))
    for i in range(k):
        block[:, i, len(labels)] = np.maximum(values[:, i], 0.0)
        labels.append(('upper', name, str(i)))
    block[:, :, -1] = reading_rates(evidence, passage, name)
    labels.append(('stamp', name))
    ways = _directions(block[:, :, -1])
    for i in np.flatnonzero(np.ptp(ways, axis=0) == 2.0).tolist():
        block = np.concatenate((block, np.zeros((N, k, 1))), axis=2)
        block[:, i, -1] = ways[:, i]
        labels.append(('play', name, str(i)))
    arms = displaced(evidence.scenario, name, X)
    if arms is not None:
        block = np.concatenate((block, arms), axis=2)
        labels += [('arm', name, axis) for axis in 'xyz']
    if is_alignable(source.signal.fields):
        block = np.concatenate((block, tilted(source, values)), axis=2)
        labels += [('turn', name, axis) for axis in 'xyz']
    return block, labels


def directions(evidence: Evidence, passage: Passage, name: str) -> Array:
    """Return the direction, -1 or 1, in which each coordinate of a sensor moves (N, k)."""
    return _directions(reading_rates(evidence, passage, name))


def walks(evidence: Evidence, passage: Passage, name: str) -> bool:
    """Return whether what a sensor reads moves otherwise than by the rates of the model.

    Some states walk at random, and then the filter moves by its corrections.
    """
    times, index, nu = (passage.series(field, name) for field in ('time', 'index', 'innovation'))
    predicted = evidence.sensors[name].value[index] - nu
    rates = reading_rates(evidence, passage, name)
    by_rates = np.cumsum(rates * np.diff(times, prepend=times[:1])[:, None], axis=0)
    moved, expected = (np.diff(values[::_SPAN], axis=0) for values in (predicted, by_rates))
    if not len(moved):
        return False
    size = np.median(moved**2, axis=0)
    left = np.median((moved - expected) ** 2, axis=0)
    return bool(np.any(left > _UNEXPLAINED * size))


def reading_rates(evidence: Evidence, passage: Passage, name: str) -> Array:
    """Return the rate of each coordinate of a sensor's readings (N, k)."""
    H, X, U = (passage.series(field, name) for field in 'Hxu')
    return np.asarray(np.einsum('eij,ej->ei', H, evidence.scenario.model.time_derivative(X, U)))


def _directions(rates: Array) -> Array:
    """Return the directions of rates (N, k); one that is next to zero keeps the last direction."""
    fast = np.abs(rates) > _MOVING * np.sqrt(np.mean(rates**2, axis=0))
    last = np.maximum.accumulate(np.where(fast, np.arange(len(rates))[:, None], 0), axis=0)
    return np.asarray(np.sign(np.take_along_axis(rates, last, axis=0)))


def displaced(scenario: Scenario, name: str, X: Array) -> Array | None:
    """Return what an arm of 1 m along each axis adds to readings (N, k, 3) at states (N, n).

    An axis with a constant effect, which is that of a bias, is omitted: it has zeros.
    None if the state lacks the attitude or the rates that this takes.
    """
    source = scenario.sensors[name]
    try:
        body = body_of(scenario.model.state, scenario.state)
        at_centre, *displaced = (
            LeverArm(source.sensor, body, source.signal.fields, arm).measure(X)
            for arm in (np.zeros(3), *np.eye(3))
        )
    except ValueError:
        return None
    added = np.stack([(reading - at_centre) for reading in displaced], axis=-1)
    added[:, :, np.ptp(added, axis=0).max(axis=0) < 1e-6] = 0.0
    return added


def _along(passage: Passage) -> tuple[Array, Array, Array]:
    """Return the states (E, n), the inputs (E, m) and the durations of the steps (E, 1)."""
    return passage.series('x'), passage.series('u'), passage.series('dt')[:, None]


def _pushes(
    evidence: Evidence, passage: Passage, tones: Array | None
) -> tuple[list[tuple[str, ...]], Pushes | None]:
    """Return the columns of the inputs, with their labels; None without an input."""
    model, (X, U, dt) = evidence.scenario.model, _along(passage)
    labels: list[tuple[str, ...]] = []
    effects, amounts = [], []
    for index, name in enumerate(model.input.names):
        input_labels, pushes = _input_columns(evidence, passage, index, tones)
        labels += [(kind, name, *rest) for kind, *rest in input_labels]
        effects.append(effect(model, X, U, index) * dt)
        amounts.append(pushes)
    if not labels:
        return labels, None
    return labels, Pushes(effects, amounts)


def _state_columns(
    evidence: Evidence, passage: Passage, numbers: Sequence[Varied]
) -> tuple[list[tuple[str, ...]], Array]:
    """Return the columns of the initial belief and of the parameters, with their labels.

    The last ones are those of the ``numbers``, in their order.
    """
    model, (X, U, dt) = evidence.scenario.model, _along(passage)
    E, n = X.shape
    state = np.zeros((E, n, n + len(numbers)))
    state[0, :, :n] = np.diag(evidence.scenario.initial_belief.std)
    rates = model.time_derivative(X, U)
    for index, (_, size, changed, _) in enumerate(numbers):
        if changed is not model:
            state[:, :, n + index] = (changed.time_derivative(X, U) - rates) / size * dt
    firsts = [('first', name) for name in model.state.names]
    return [*firsts, *(('parameter', number.parameter.name) for number in numbers)], state


def _read_parameters(
    evidence: Evidence, passage: Passage, name: str, numbers: Sequence[Varied]
) -> Array:
    """Return what each parameter changes in the readings of a sensor (N, k, P)."""
    X = passage.series('x', name)
    sensor = evidence.scenario.sensors[name].sensor
    values, block = sensor.measure(X), np.zeros((len(X), sensor.output.size, len(numbers)))
    for index, (_, size, _, sensors) in enumerate(numbers):
        if name in sensors:
            changed = sensors[name].measure(X)
            block[:, :, index] = sensor.output.subtract(changed, values) / size
    return block


def effect(model: Dynamics, X: Array, U: Array, index: int) -> Array:
    """Return the derivative of the rate by an input (E, n), at states (E, n), inputs (E, m)."""
    step = np.zeros(U.shape[1])
    step[index] = STEP * max(1.0, float(np.abs(U[:, index]).max(initial=0.0)))
    return np.asarray(
        (model.time_derivative(X, U + step) - model.time_derivative(X, U)) / step[index]
    )


def _input_columns(
    evidence: Evidence, passage: Passage, index: int, tones: Array | None
) -> tuple[list[tuple[str, ...]], Array]:
    """Return the columns of an input (E, p): gain, exchange, pieces, delays, dead zones, tones."""
    times, U = passage.series('time'), passage.series('u')
    u = U[:, index]
    labels: list[tuple[str, ...]] = [('gain',), ('half',)]
    pushes: list[Array] = [u, np.maximum(u, 0.0)]
    space = evidence.scenario.model.input
    for other in (i for group in alike(space) if index in group for i in group if i != index):
        labels.append(('across', space.names[other]))
        pushes.append(U[:, other])
    pieces = np.searchsorted(edges(passage), times, 'right') - 1
    for b in range(len(edges(passage)) - 1):
        labels.append(('push', str(b)))
        pushes.append((pieces == b).astype(float))
    stamps, values = evidence.inputs.stamp, evidence.inputs.value[:, index]
    longest = evidence.scenario.rate * min(_LONGEST, _LONGEST_SHARE * evidence.duration)
    for lag in np.unique(np.geomspace(1.0, max(longest, 1.0), _LAGS).round().astype(int)):
        labels.append(('lag', str(lag)))
        seconds = lag / evidence.scenario.rate
        pushes.append(held(stamps, values, times - seconds) - u)
    for size in _dead_zones(values):
        labels.append(('dead', repr(float(size))))
        pushes.append(-np.clip(u, -size, size))
    if tones is not None:
        for wave in (np.sin, np.cos):
            labels.append(('tone', repr(float(tones[index])), wave.__name__))
            pushes.append(wave(2.0 * np.pi * tones[index] * times))
    return labels, np.stack(pushes, axis=1)


def _dead_zones(values: Array) -> list[float]:
    """Return the trial dead zones of an input with these values (N,)."""
    magnitudes = np.abs(values[values != 0.0])
    if not len(magnitudes):
        return []
    sizes: list[float] = np.quantile(magnitudes, _DEAD).tolist()
    return [*(share * sizes[0] for share in _SMALLER), *sizes]


def alike(space: Space) -> list[tuple[int, ...]]:
    """Return the groups of two or more coordinates that have the same unit."""
    by_unit: dict[str, list[int]] = {}
    for index, unit in enumerate(space.units):
        by_unit.setdefault(unit, []).append(index)
    return [tuple(group) for group in by_unit.values() if len(group) > 1]


def held(stamps: Array, values: Array, times: Array) -> Array:
    """Return the input that held just before each of ``times``, at first the first input."""
    if not len(stamps):
        return np.zeros(len(times))
    rows = np.searchsorted(stamps, times - 1e-6, 'right') - 1
    return np.asarray(values[np.maximum(rows, 0)])
