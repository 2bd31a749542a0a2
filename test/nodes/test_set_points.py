# SPDX-License-Identifier: Apache-2.0
"""Set points of a body that hovers: what no input holds is refused, what moves on moves on."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip('rclpy')

import kalman_ros as kr
from kalman_ros.control.limiter import Limits, limits_of
from kalman_ros.core import Model, OperatingPoint, Space
from kalman_ros.nodes.controller.reference import ReferenceReader
from kalman_ros.scenario.regulator import tracking

GRAVITY, LAG = 9.81, 0.15


class Hovering(Model):
    """M v' = T - m g, LAG T' = u - T: thrust that lags."""

    state = Space(('z', 'v', 'T'), ('m', 'm/s', 'N'))
    input = Space(('thrust',), ('N',))

    def __init__(self, mass):
        self.mass = mass

    @property
    def equilibrium(self):
        hover = self.mass * GRAVITY
        return OperatingPoint(np.array([0.0, 0.0, hover]), np.array([hover]))

    def derivative(self, x, u):
        v, T = x[..., 1], x[..., 2]
        return np.stack((v, T / self.mass - GRAVITY, (u[..., 0] - T) / LAG), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.1, 0.1])


def scenario(mass):
    sensors = ([[1.0, 0.0, 0.0]], [[0.01]])
    return kr.make_scenario(Hovering(mass), sensors, rate=100.0, initial=(np.zeros(3), np.eye(3)))


@pytest.fixture
def reader():
    """Return a reader of set points of a body of 1 kg; it has what was held, and what moves."""
    node = SimpleNamespace(get_logger=lambda: SimpleNamespace(warning=lambda _: None))
    held, moved = [], []
    built = scenario(1.0)
    found = ReferenceReader(
        node, built, held.append, moved.append, lambda: '', 0.5, Limits.none(1)
    )
    found.held, found.moved = held, moved
    return found


def give(reader, *values, time=None):
    reader._on_values(time, np.array(values), [0, 1, 2])


def test_a_place_is_held_with_the_thrust_that_hovers(reader):
    give(reader, 2.0, 0.0, GRAVITY)
    ((state, input),) = reader.held
    np.testing.assert_allclose((*state, *input), [2.0, 0.0, GRAVITY, GRAVITY], atol=1e-9)


@pytest.mark.parametrize('again', [False, True])
def test_a_thrust_that_would_accelerate_is_no_set_point(reader, again):
    """Neither once nor repeated: a stream of it has no velocity."""
    for time in (10**9, 11 * 10**8)[: 1 + again]:
        with pytest.raises(
            ValueError, match=r'no input holds the system at T = 20 \(nearest 9\.81'
        ):
            give(reader, 2.0, 0.0, 20.0, time=time)
    assert not reader.held and not reader.moved


def test_a_velocity_moves_on(reader):
    give(reader, 2.0, 0.4, GRAVITY)
    (motion,) = reader.moved
    np.testing.assert_allclose(motion.states[-2][:2], [2.2, 0.4], atol=0.01)


def test_another_mass_hovers_with_another_thrust(reader):
    heavier = scenario(1.5)
    reader.adopt(heavier, tracking(heavier), Limits.none(1))
    give(reader, 2.0, 0.0, 1.5 * GRAVITY)
    ((_, input),) = reader.held
    assert input == pytest.approx([1.5 * GRAVITY])
    with pytest.raises(ValueError, match='no input holds'):
        give(reader, 2.0, 0.0, GRAVITY)


def test_a_set_point_that_takes_more_than_the_limits_is_refused(reader):
    spring = kr.load('mass_spring_damper')
    bounds = limits_of(1, {'input_limit': 2.0, 'input_lower_limit': -1.0})
    reader.adopt(spring, tracking(spring), bounds)
    stiffness = tracking(spring).equilibrium(np.array([1.0, 0.0]), np.zeros(2)).input[0]
    for x in (2.0 / stiffness, -1.0 / stiffness):
        reader._on_values(None, np.array([x, 0.0]), [0, 1])
        with pytest.raises(ValueError, match=r'it takes f of .* and the limits are -1 and 2'):
            reader._on_values(None, np.array([1.01 * x, 0.0]), [0, 1])
        with pytest.raises(ValueError, match=r'reference: it takes f of'):
            kr.simulate('mass_spring_damper', seconds=0.1, input_limit=2.0,
                        input_lower_limit=-1.0, reference={'x': 1.01 * x})  # fmt: skip
    assert len(reader.held) == 2


@pytest.mark.parametrize('limited', [kr.simulate, kr.monte_carlo])
def test_a_limit_below_the_thrust_that_hovers_is_refused(limited):
    given = {'seconds': 0.1, 'runs': 2} if limited is kr.monte_carlo else {'seconds': 0.1}
    message = r'input_limit: expected limits that contain the input at rest \[9\.81\], got'
    with pytest.raises(ValueError, match=message):
        limited(scenario(1.0), input_limit=9.8, **given)
    limited(scenario(1.0), input_limit=9.82, **given)
