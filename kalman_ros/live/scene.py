# SPDX-License-Identifier: Apache-2.0
"""Constant data of a live page while the nodes run: names, units, and drawing."""

from __future__ import annotations

from importlib import import_module
from inspect import getdoc
from itertools import zip_longest
from typing import Any

import numpy as np

from kalman_ros import models
from kalman_ros.control.laws import LAWS
from kalman_ros.core import DesignError, Sensor, Space
from kalman_ros.estimators import FILTERS
from kalman_ros.scenario import Scenario
from kalman_ros.scenario.drawing import drawing
from kalman_ros.scenario.regulator import feedback

from .adjustments import Adjustments
from .controls import Control
from .drawn_path import described
from .limits import limits


def chosen(adjustments: Adjustments) -> dict[str, Any]:
    """Return the filter and the law, if there is one, that are in use."""
    law = {'law': adjustments.value('controller', 'law')} if adjustments.driven else {}
    return {'filter': adjustments.value('estimator', 'filter'), **law}


def placed(adjustments: Adjustments) -> dict[str, list[tuple[float, float]]]:
    """Return the poles that are placed, of the ``regulator`` and the ``estimator``."""
    now = chosen(adjustments)
    poles = {}
    if now.get('law') == 'placement':
        poles['regulator'] = _poles(adjustments, 'controller', 'regulator')
    if now['filter'] == 'luenberger':
        poles['estimator'] = _poles(adjustments, 'estimator', 'observer')
    return poles


def places(adjustments: Adjustments) -> dict[str, list[float]]:
    """Return the places in the plant of the sensors that are at rest and measure a bearing."""
    if adjustments.value('plant', 'model') == 'bearing_tracker':
        return {}
    published = [n for n in adjustments.sensors if adjustments.value('plant', f'{n}.enabled')]
    positions = {name: _sensor_position(adjustments, name) for name in published}
    return {name: position['place'] for name, position in positions.items() if position}


def _poles(adjustments: Adjustments, node: str, prefix: str) -> list[tuple[float, float]]:
    real, imaginary = (
        adjustments.value(node, f'{prefix}_{part}') for part in ('poles', 'frequencies')
    )
    return [(float(re), float(im)) for re, im in zip_longest(real, imaginary, fillvalue=0.0)]


def scene(adjustments: Adjustments, controls: dict[str, Control]) -> dict[str, Any]:
    """Return the scene of a scenario for JSON."""
    plant = adjustments.scenario('plant')
    state, input = plant.model.state, plant.model.input
    return {
        'name': adjustments.file.stem,
        'model': adjustments.value('plant', 'model'),
        'about': _about(str(adjustments.value('plant', 'model'))),
        'rate': plant.rate,
        'time': adjustments.time_unit,
        'state': _space(state),
        'input': _space(input),
        'sensors': {
            name: {
                **_space(source.sensor.output),
                'sees': _most_seen(plant, source.sensor),
                **_sensor_position(adjustments, name),
            }
            for name, source in plant.sensors.items()
        },
        'drawing': drawing(str(adjustments.value('plant', 'model')), state)._asdict(),
        'relative': adjustments.value('plant', 'model') == 'bearing_tracker',
        'length': _length(adjustments),
        'equilibrium': plant.model.equilibrium.state.tolist(),
        'force': force_scale(adjustments),
        'path': described(adjustments),
        'controls': [control.described() for control in controls.values()],
        'choices': {
            'filter': list(FILTERS),
            **({'law': list(LAWS)} if adjustments.driven else {}),
        },
        'linear': plant.plan.linear,
    }


def _about(model: str) -> str:
    """Return what the module of a model says in its first line."""
    module, colon, _ = model.partition(':')
    text = getdoc(import_module(module if colon else f'{models.__name__}.{module}'))
    return (text or '').partition('\n')[0]


def force_scale(adjustments: Adjustments) -> float:
    """Return the magnitude of an input that moves the system visibly, within its limit."""
    if not adjustments.driven:
        return 1.0
    scenario = adjustments.scenario('controller')
    model, start = scenario.model, adjustments.scenario('plant').initial_state
    try:
        K = feedback(scenario).gain
    except DesignError:
        return 1.0
    scale = abs(K @ model.state.subtract(start, model.equilibrium.state)).max()
    pairs = limits(adjustments)['input'].values()
    largest = [max(abs(side or 0.0) for side in pair) for pair in pairs if None not in pair]
    return float(f'{min(scale, *filter(None, largest), scale):.2g}') if scale > 0.0 else 1.0


def _space(space: Space) -> dict[str, Any]:
    return {'names': space.names, 'units': space.units, 'angles': space.angles}


def _most_seen(scenario: Scenario, sensor: Sensor) -> str:
    """Return the state that matters most to a reading, at the start, by its uncertainty."""
    std = np.sqrt(scenario.initial_belief.covariance.diagonal())
    size = abs(sensor.jacobian(scenario.initial_state)).max(axis=0) * std
    return scenario.model.state.names[int(size.argmax())]


def _sensor_position(adjustments: Adjustments, sensor: str) -> dict[str, Any]:
    """Return the position of a sensor that measures a bearing; empty for any other sensor."""
    if 'bearing' not in adjustments.scenario('plant').sensors[sensor].sensor.output.names:
        return {}
    try:
        return {'place': adjustments.value('plant', f'{sensor}.position')}
    except KeyError:
        return {'place': [0.0, 0.0]}


def _length(adjustments: Adjustments) -> float:
    """Return the length in metres of the part that is drawn."""
    try:
        return float(adjustments.value('plant', 'model_parameters.length'))
    except KeyError:
        return 1.0
