# SPDX-License-Identifier: Apache-2.0
"""The faults whose responses are computed, as columns: of readings, inputs, parameters, start."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Dynamics, options_of
from kalman_ros.scenario.declarations import model_of
from kalman_ros.scenario.parameter_files import section
from kalman_ros.scenario.wiring import system

from .evidence import Evidence
from .passage import Passage
from .responses import Columns

#: An offset that changes is followed in pieces: at most N, and none shorter than (s).
PIECES, _SHORTEST = 30, 1.0
#: How late inputs may act, in samples of the loop.
LAGS = (1, 2, 3, 5, 8, 12, 20, 30)
#: Dead zones that are tried, as quantiles of the size of the input.
DEAD = (0.2, 0.35, 0.5, 0.65, 0.8)
#: Of numerical derivatives, relative.
_STEP = 1e-4


def edges(found: Passage) -> Array:
    """Return the edges (B + 1,) of the pieces of a recording, in seconds."""
    first, last = found.events[0].time, found.events[-1].time
    count = int(np.clip((last - first) / _SHORTEST, 1, PIECES))
    return np.linspace(first, last + 1e-6, count + 1)


def columns(evidence: Evidence, found: Passage, tones: Array | None = None) -> Columns:
    """Return the columns of every fault of a recording that acts additively.

    ``tones`` are the frequencies (Hz) of sines, one an input, that may add to the input.
    """
    labels: list[tuple[str, ...]] = []
    readings = {}
    for name in dict.fromkeys(event.sensor for event in found.events):
        block, own = _of_sensor(evidence, found, name)
        readings[name] = (len(labels), block)
        labels += own
    parts = [part for part in _of_state(evidence, found, tones) if part[1].shape[2]]
    state = np.concatenate([block for _, block in parts], axis=2)
    return Columns([*labels, *(label for own, _ in parts for label in own)], readings, state)


def _of_sensor(
    evidence: Evidence, found: Passage, name: str
) -> tuple[Array, list[tuple[str, ...]]]:
    """Return mixes of coordinates, offsets in pieces, and stamps that are early."""
    model = evidence.scenario.model
    events = [found.events[i] for i in found.of(name)]
    read = evidence.sensors[name].value[[event.index for event in events]]
    # as predicted, for the noise of a reading is correlated with its innovation
    values = evidence.scenario.sensors[name].sensor.measure(np.array([e.x for e in events]))
    N, k = values.shape
    pieces = np.searchsorted(edges(found), [event.time for event in events], 'right') - 1
    B = len(edges(found)) - 1
    block = np.zeros((N, k, 2 * k * k + k * B + 1))
    labels: list[tuple[str, ...]] = []
    for kind, mixed in (('mix', values), ('read', read)):
        for i in range(k):
            for j in range(k):
                block[:, i, len(labels)] = mixed[:, j]
                labels.append((kind, name, str(i), str(j)))
    for i in range(k):
        block[np.arange(N), i, len(labels) + pieces] = 1.0
        labels += [('offset', name, str(i), str(b)) for b in range(B)]
    X, U = np.array([event.x for event in events]), np.array([event.u for event in events])
    H = np.array([event.H for event in events])
    block[:, :, -1] = np.einsum('eij,ej->ei', H, model.time_derivative(X, U))
    return block, [*labels, ('stamp', name)]


def _of_state(
    evidence: Evidence, found: Passage, tones: Array | None
) -> Iterator[tuple[list[tuple[str, ...]], Array]]:
    """Yield the first belief, the inputs and the parameters, each with its labels."""
    model, n, E = evidence.scenario.model, evidence.scenario.model.state.size, len(found.events)
    first = np.zeros((E, n, n))
    first[0] = np.diag(evidence.scenario.initial_belief.std)
    yield [('first', name) for name in model.state.names], first
    X, U = (np.array([getattr(e, name) for e in found.events]) for name in ('x', 'u'))
    dt = np.array([event.dt for event in found.events])
    for index, name in enumerate(model.input.names):
        labels, pushes = _pushes(evidence, found, index, tones)
        moved = effect(model, X, U, index) * dt[:, None]
        yield [(kind, name, *rest) for kind, *rest in labels], moved[:, :, None] * pushes[:, None]
    names: list[tuple[str, ...]] = []
    blocks: list[Array] = []
    for name, other, size in varied(evidence):
        change = (other.time_derivative(X, U) - model.time_derivative(X, U)) / size
        names.append(('parameter', name))
        blocks.append(change * dt[:, None])
    yield names, np.stack(blocks, axis=2) if blocks else np.zeros((E, n, 0))


def effect(model: Dynamics, X: Array, U: Array, index: int) -> Array:
    """Return d rate / d u_index (E, n) at states (E, n) and inputs (E, m)."""
    step = np.zeros(U.shape[1])
    step[index] = _STEP * max(1.0, float(np.abs(U[:, index]).max(initial=0.0)))
    return np.asarray(
        (model.time_derivative(X, U + step) - model.time_derivative(X, U)) / step[index]
    )


def _pushes(
    evidence: Evidence, found: Passage, index: int, tones: Array | None
) -> tuple[list[tuple[str, ...]], Array]:
    """Return what may add to an input (E, p): its own multiple, pieces, delays, dead zones."""
    times = np.array([event.time for event in found.events])
    u = np.array([event.u[index] for event in found.events])
    labels: list[tuple[str, ...]] = [('gain',)]
    pushes: list[Array] = [u]
    where = np.searchsorted(edges(found), times, 'right') - 1
    for b in range(len(edges(found)) - 1):
        labels.append(('push', str(b)))
        pushes.append((where == b).astype(float))
    stamps, values = evidence.inputs.stamp, evidence.inputs.value[:, index]
    for lag in LAGS:
        labels.append(('lag', str(lag)))
        seconds = lag / evidence.scenario.rate
        pushes.append(held(stamps, values, times - seconds) - u)
    for size in np.quantile(np.abs(values), DEAD) if len(values) else ():
        labels.append(('dead', repr(float(size))))
        pushes.append(-np.clip(u, -size, size))
    if tones is not None:
        for wave in (np.sin, np.cos):
            labels.append(('tone', repr(float(tones[index])), wave.__name__))
            pushes.append(wave(2.0 * np.pi * tones[index] * times))
    return labels, np.stack(pushes, axis=1)


def held(stamps: Array, values: Array, times: Array) -> Array:
    """Return the input that was in effect just before each of ``times``; the first before all."""
    if not len(stamps):
        return np.zeros(len(times))
    at = np.searchsorted(stamps, times - 1e-6, 'right') - 1
    return np.asarray(values[np.maximum(at, 0)])


def value_of(evidence: Evidence, name: str) -> float:
    """Return the value of a parameter of the model, its default if the file has none."""
    given = evidence.parameters.get(f'model_parameters.{name}')
    if given is not None:
        return float(given)
    options = options_of(system(str(evidence.parameters.get('model', ''))).build)
    return float(next(option.default for option in options if option.name == name))  # type: ignore[arg-type]


def varied(evidence: Evidence) -> Iterator[tuple[str, Dynamics, float]]:
    """Yield each parameter of the model that is a number, the model with another, by how much."""
    values = section(evidence.parameters, 'model_parameters')
    used = system(str(evidence.parameters.get('model', '')))
    for option in options_of(used.build):
        value = values.get(option.name, option.default)
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            continue
        size = _STEP * (abs(float(value)) or 1.0)
        try:
            yield option.name, model_of(used, {**values, option.name: float(value) + size}), size
        except ValueError:
            continue
