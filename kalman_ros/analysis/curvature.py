# SPDX-License-Identifier: Apache-2.0
"""Readings that are far from linear within the first belief, for filters that linearise once."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array, Gaussian, Sensor, Space
from kalman_ros.estimators import filter_class
from kalman_ros.linear.batched import semidefinite_factor
from kalman_ros.scenario import Scenario


def curved(scenario: Scenario) -> Iterator[str]:
    """Yield a sentence for each sensor whose second-order term is as large as its noise."""
    if not filter_class(scenario.filter).linearises_once:
        return
    belief = scenario.initial_belief
    if not np.isfinite(belief.covariance).all():
        return
    for name, source in scenario.enabled.items():
        sensor = source.sensor
        noise = np.sqrt(sensor.covariance.diagonal())
        try:
            terms = second_order(sensor, scenario.model.state, belief)
        except Exception:  # a sensor of a user, at a state that it does not have
            continue
        terms = np.nan_to_num(terms, nan=0.0, posinf=0.0)
        worst = int(np.argmax(np.where(noise > 0.0, terms / np.maximum(noise, 1e-300), 0.0)))
        if terms[worst] > noise[worst] > 0.0:
            output = sensor.output
            unit = f' {output.units[worst]}'.rstrip()
            yield (
                f'Within the first belief {name} is not linear: its second-order term of '
                f'{output.names[worst]} is {terms[worst]:.2g}{unit}, and its noise '
                f'{noise[worst]:.2g}{unit}. The first readings make {scenario.filter} surer than '
                'it should be: iterated_ekf and ukf are not, or tell it more (initial_std).'
            )


def second_order(sensor: Sensor, state: Space, belief: Gaussian) -> Array:
    """Return the deviation of the second-order term of each number of a reading (k,).

    It is that of z'D z / 2 for standard normal z, D = L'H L with the second derivatives H of the
    number and P = L L': the root of tr(D D) / 2 (Y. Bar-Shalom, X. Li, T. Kirubarajan, Estimation
    with Applications to Tracking and Navigation, 2001, section 10.3.2). Differences are over
    deviations of the belief, as far as it reaches.
    """
    x, space = belief.mean, sensor.output
    directions = semidefinite_factor(belief.covariance).T
    directions = directions[np.abs(directions).max(axis=1, initial=0.0) > 0.0]
    middle = sensor.measure(x)

    def at(*moves: Array) -> Array:
        return space.subtract(sensor.measure(state.add(x, np.sum(moves, axis=0))), middle)

    squares = np.zeros(space.size)
    for i, one in enumerate(directions):
        squares += np.square(at(one) + at(-one))
        for other in directions[:i]:
            mixed = at(one, other) - at(one, -other) - at(-one, other) + at(-one, -other)
            squares += 2.0 * np.square(0.25 * mixed)
    return np.asarray(np.sqrt(0.5 * squares))
