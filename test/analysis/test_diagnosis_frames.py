# SPDX-License-Identifier: Apache-2.0
"""Angles from north, and parts of a sensor that are exchanged, of a filter that is lost."""

from types import SimpleNamespace

import numpy as np
import pytest
from tools.strangers.injected.recordings import recorded

from kalman_ros.analysis.diagnosis import gross, mounting
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.core import Space


@pytest.fixture(scope='module')
def target():
    return recorded('turn_rate', None, 20.0, 3)


@pytest.mark.slow
def test_a_bearing_from_north_is_put_right(target):
    space, record = target.scenario.sensors['radar'].sensor.output, target.sensors['radar']
    value = record.value.copy()
    bearing = space.names.index('bearing')
    value[:, bearing] = 0.5 * np.pi - value[:, bearing]
    case = Examination(target.with_values('radar', space.wrap(value)))
    assert gross.lost(case)
    first = gross.find(case)[0]
    assert (first.kind, first.subject) == ('swapped', 'radar.bearing')
    assert 'clockwise from north' in first.sentence and first.change == {}
    np.testing.assert_allclose(first.mended().sensors['radar'].value, record.value, atol=1e-9)


@pytest.mark.parametrize(
    ('units', 'orders'),
    [
        (('rad', 'rad', 'rad'), {(1, 0, 2), (2, 1, 0), (0, 2, 1)}),
        (('m', 'rad', 'm', 'rad'), {(2, 3, 0, 1)}),
        (('m', 'm', 'm', 'm'), {(1, 0, 2, 3), (2, 1, 0, 3), (3, 1, 2, 0), (0, 2, 1, 3),
                                (0, 3, 2, 1), (0, 1, 3, 2)}),
        (('m', 'm', 'rad'), set()),
        (('m',), set()),
    ],
)  # fmt: skip
def test_parts_that_read_the_same_are_exchanged(monkeypatch, units, orders):
    monkeypatch.setattr(mounting, 'axes_exchanged', lambda case, name, order, gain: order)
    output = Space(tuple(f'y{index}' for index in range(len(units))), units)
    sensors = {'beacons': SimpleNamespace(sensor=SimpleNamespace(output=output))}
    case = SimpleNamespace(evidence=SimpleNamespace(scenario=SimpleNamespace(sensors=sensors)))
    found = [*mounting.blocks_exchanged(case, 'beacons')]
    assert set(found) == orders and len(found) == len(orders)
