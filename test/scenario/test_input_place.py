# SPDX-License-Identifier: Apache-2.0
"""Readings that are the input, moved from their place to the centre of the body."""

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import Signal
from kalman_ros.core import rotations as so3
from kalman_ros.core.mount import mounting
from kalman_ros.models.inertial import Inertial
from kalman_ros.scenario.input_place import InputPlace, at_centre

PLACE, ORIGIN = (0.4, -0.3, 0.2), (0.0, 0.0, 0.0)
IMU = tuple(
    f'{name}.{axis}' for name in ('angular_velocity', 'linear_acceleration') for axis in 'xyz'
)
MILLISECOND = 1_000_000


def signal(fields=IMU, place=PLACE):
    mount = mounting((0.0, 0.0, 0.0), 'enu', '', place)
    return Signal('imu', 'sensor_msgs/Imu', fields, mounting=mount)


def wobble(t):
    """Return rates and angular accelerations (..., 3) of a body that rocks and turns."""
    t = np.asarray(t)[..., np.newaxis]
    amount, pace, start = np.array([0.6, 0.4, 1.2]), np.array([3.0, 2.0, 1.3]), np.arange(3.0)
    return amount * np.sin(pace * t + start), amount * pace * np.cos(pace * t + start)


def at_place(w, turning, place=PLACE):
    """Return the specific force (..., 3) at a place of a body whose centre does not move."""
    return np.cross(turning, place) + np.cross(w, np.cross(w, place))


def test_the_centre_of_a_body_that_rocks_does_not_accelerate():
    moved, errors = InputPlace(signal()), []
    for k in range(400):
        w, turning = wobble(k * 0.005)
        values = moved(k * 5 * MILLISECOND, np.concatenate((w, at_place(w, turning))))
        np.testing.assert_array_equal(values[:3], w)
        errors.append(values[3:])
    # what is left is half a step of the angular jerk
    assert np.abs(errors[1:]).max() < 0.5 * 0.005 * 0.6 * 9.0
    assert np.abs([at_place(*wobble(k * 0.005)) for k in range(400)]).max() > 0.6


@pytest.mark.slow
@pytest.mark.parametrize(('place', 'least', 'most'), [(PLACE, 0.0, 0.1), (ORIGIN, 10.0, 30.0)])
def test_dead_reckoning_stays_where_the_centre_is(place, least, most):
    """Half a minute of rocking in place, with the attitude that the same rates give."""
    model, dt = Inertial(), 0.005
    moved = at_centre(signal(place=place)) or (lambda time, values: values)
    x = model.equilibrium.state.copy()
    up = np.array([0.0, 0.0, 9.80665])
    for k in range(6000):
        w, turning = wobble((k + 0.5) * dt)
        force = at_place(w, turning) + so3.rotate_back(x[3:6], up)
        u = moved(k * 5 * MILLISECOND, np.concatenate((w, force)))
        x = model.state.add(x, dt * model.derivative(x, u))
    assert least <= np.linalg.norm(x[:3]) <= most


def test_a_velocity_is_that_of_the_centre():
    fields = ('twist.linear.x', 'twist.linear.y', 'twist.angular.z')
    moved = InputPlace(signal(fields))
    found = moved(0, np.array([1.0, 0.0, 0.5]))
    np.testing.assert_allclose(found, [1.0 + 0.5 * -0.3, -0.5 * 0.4, 0.5])


def test_the_angular_acceleration_is_of_two_readings_in_order():
    moved = InputPlace(signal())

    def force(time, rate):
        values = np.zeros(6)
        values[2] = rate
        return moved(time, values)[3:]

    drawn = -np.array([0.4, -0.3, 0.0])
    rest, half = 10**9, 500 * MILLISECOND
    np.testing.assert_allclose(force(rest, 0.0), 0.0)
    turned = force(rest + half, 1.0)  # the longest time that counts
    np.testing.assert_allclose(turned, 2.0 * -np.array([0.3, 0.4, 0.0]) - drawn)
    # what is late, or comes twice, has the acceleration that is known, and changes nothing
    for time in (rest + half, rest + half - 1, rest):
        np.testing.assert_allclose(force(time, 1.0), turned)
    np.testing.assert_allclose(force(None, 1.0), turned)
    assert np.isnan(force(rest + 2 * half, np.nan)).any()
    after = rest + 2 * half
    np.testing.assert_allclose(force(after, 1.0), -drawn)
    # longer apart it is unknown, and so it is when a clock went back
    np.testing.assert_allclose(force(after + half + 1, 2.0), -4.0 * drawn)
    np.testing.assert_allclose(force(after, 1.0), -drawn)


def test_only_what_depends_on_the_place_is_moved():
    assert at_centre(signal(place=ORIGIN)) is None
    assert at_centre(signal(IMU[:3])) is None
    assert at_centre(signal(IMU[3:])) is not None
    values = np.array([1.0, 2.0])
    planar = InputPlace(signal(('linear_acceleration.x', 'angular_velocity.z')))
    np.testing.assert_allclose(planar(0, values), [1.0 + 4.0 * 0.4, 2.0])


@pytest.mark.parametrize(
    ('given', 'why'),
    [
        ({'input.mount.translation': [0.1, 0.2]}, r'input\.mount\.translation: expected forward'),
        (
            {'input.mount.translation': [0.1, 0.0, 0.0], 'input.mount.tf': True},
            r'input\.mount\.tf: expected no mount\.translation and mount\.rotation beside it',
        ),
        (
            {'model': 'cart_pole', 'input.mount.translation': [0.1, 0.0, 0.0]},
            r'input\.mount\.translation: expected a velocity or an acceleration among the fields',
        ),
    ],
)
def test_wrong_places_are_refused(given, why):
    with pytest.raises(ValueError, match=why):
        kr.load(given.pop('model', 'inertial'), given)
