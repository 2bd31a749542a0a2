# SPDX-License-Identifier: Apache-2.0
"""Readings that are the input, moved from their place to the centre of the body."""

from itertools import pairwise

import numpy as np
import pytest
from thorough import thorough

import kalman_ros as kr
from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Signal
from kalman_ros.core import rotations as so3
from kalman_ros.core.mount import mounting
from kalman_ros.models.inertial import Inertial
from kalman_ros.pipeline.reading_reader import InputReader
from kalman_ros.scenario.input_place import InputPlace, at_centre

PLACE, ORIGIN = (0.4, -0.3, 0.2), (0.0, 0.0, 0.0)
IMU = tuple(
    f'{name}.{axis}' for name in ('angular_velocity', 'linear_acceleration') for axis in 'xyz'
)
SECOND, MILLISECOND = 1_000_000_000, 1_000_000


def signal(fields=IMU, place=PLACE):
    mount = mounting((0.0, 0.0, 0.0), 'enu', '', place).at(place)
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
        values = moved(SECOND + k * 5 * MILLISECOND, np.concatenate((w, at_place(w, turning))))
        np.testing.assert_array_equal(values[:3], w)
        errors.append(values[3:])
    # what is left is half a step of the angular jerk
    assert np.abs(errors[9:]).max() < 0.5 * 0.005 * 0.6 * 9.0
    assert np.abs([at_place(*wobble(k * 0.005)) for k in range(400)]).max() > 0.6


def scaled(gyro, accelerometer, place=PLACE):
    """Return the signal of the input of an inertial scenario with scales and a place."""
    parameters = {
        'model_parameters.gyro_scale': gyro,
        'model_parameters.accelerometer_scale': accelerometer,
        'input.mount.translation': list(place),
    }
    return kr.load('inertial', parameters).input


@pytest.mark.parametrize(('gyro', 'accelerometer'), [(1.1, 1.0), (1.0, 0.95), (0.7, 1.3)])
def test_readings_with_a_scale_move_as_what_they_stand_for(gyro, accelerometer):
    true, read = InputPlace(signal()), at_centre(scaled(gyro, accelerometer))
    away = at_centre(scaled(gyro, accelerometer))
    scale = np.repeat((gyro, accelerometer), 3)
    for k in range(40):
        w, turning = wobble(k * 0.005)
        u, time = np.concatenate((w, at_place(w, turning))), SECOND + k * 5 * MILLISECOND
        found = read(time, u / scale)
        np.testing.assert_allclose(scale * found, true(time, u), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(away.away(time, found), u / scale, rtol=1e-12, atol=1e-12)


def test_a_scale_that_is_changed_live_counts_at_once():
    reader = InputReader(scaled(1.0, 1.0))
    for gyro in (1.0, 1.2):
        reader.configure(scaled(gyro, 1.0))
        sample = Sample(0, np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0]), None)
        w = 0.5 * gyro
        expected = -w * w * np.array([-PLACE[0], -PLACE[1], 0.0])
        np.testing.assert_allclose(reader._read.moved(sample).values[3:], expected, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('place', 'least', 'most'), [(PLACE, 0.0, 0.1), thorough(ORIGIN, 10.0, 30.0)]
)
def test_dead_reckoning_stays_where_the_centre_is(place, least, most):
    """Half a minute of rocking in place, with the attitude that the same rates give."""
    model, dt = Inertial(), 0.005
    moved = at_centre(signal(place=place)) or (lambda time, values: values)
    x = model.equilibrium.state.copy()
    up = np.array([0.0, 0.0, 9.80665])
    for k in range(6000):
        w, turning = wobble((k + 0.5) * dt)
        force = at_place(w, turning) + so3.rotate_back(x[3:6], up)
        u = moved(SECOND + k * 5 * MILLISECOND, np.concatenate((w, force)))
        x = model.state.add(x, dt * model.derivative(x, u))
    assert least <= np.linalg.norm(x[:3]) <= most


def test_a_velocity_is_that_of_the_centre():
    fields = ('twist.linear.x', 'twist.linear.y', 'twist.angular.z')
    moved = InputPlace(signal(fields))
    found = moved(0, np.array([1.0, 0.0, 0.5]))
    np.testing.assert_allclose(found, [1.0 + 0.5 * -0.3, -0.5 * 0.4, 0.5])


def turned(moved, time, rate):
    """Return the acceleration of the centre, for a body that turns about z, and its place."""
    values = np.zeros(6)
    values[2] = rate
    return moved(time, values)[3:]


#: Of an angular acceleration of 1 about z, and of a rate of 1.
SWUNG, DRAWN = np.array([0.3, 0.4, 0.0]), np.array([-0.4, 0.3, 0.0])


def test_the_angular_acceleration_is_of_readings_in_order():
    moved, half = InputPlace(signal()), 500 * MILLISECOND
    # how long a reading is held is known after eight intervals
    for k in range(9):
        np.testing.assert_allclose(turned(moved, SECOND + k * half, 0.0), 0.0)
    rest = SECOND + 8 * half
    found = turned(moved, rest + half, 1.0)  # the longest time that counts
    np.testing.assert_allclose(found, -2.0 * SWUNG - DRAWN)
    # what is late, or comes twice, or has no stamp, has the acceleration that is known
    for time in (rest + half, rest + half - 1, rest + 1, 0, None):
        np.testing.assert_allclose(turned(moved, time, 1.0), found)
    assert np.isnan(turned(moved, rest + 2 * half, np.nan)).any()
    # it has been accounted for by the time of the next reading
    np.testing.assert_allclose(turned(moved, rest + 2 * half, 1.0), -DRAWN)
    # longer apart it is unknown, and so it is when a clock went back
    np.testing.assert_allclose(turned(moved, rest + 3 * half + 1, 2.0), -4.0 * DRAWN)
    np.testing.assert_allclose(turned(moved, rest, 1.0), -DRAWN)
    for k in range(1, 8):
        np.testing.assert_allclose(turned(moved, rest + k * half, 1.5), -2.25 * DRAWN)
    # what has changed meanwhile is made up for
    np.testing.assert_allclose(turned(moved, rest + 8 * half, 1.5), -1.0 * SWUNG - 2.25 * DRAWN)


def test_without_stamps_there_is_no_angular_acceleration():
    moved = InputPlace(signal())
    for time, rate in ((0, 0.1), (0, 0.2), (None, 0.5)):
        np.testing.assert_allclose(turned(moved, time, rate), -(rate**2) * DRAWN)


@pytest.mark.parametrize('kind', ['even', 'jitter', 'pairs', 'bursts', 'drops'])
def test_the_velocity_of_the_centre_has_the_noise_of_one_rate(kind):
    """Whatever the stamps: readings held from one to the next add up to the change of the rate."""
    rng = np.random.default_rng(4)
    count, sigma = 3000, 0.005
    steps = {
        'even': np.full(count, 10.0),
        'jitter': 10.0 + np.diff(rng.uniform(-4.0, 4.0, count + 1)),
        'pairs': np.tile([0.1, 19.9], count // 2),
        'bursts': np.tile([0.001, 0.001, 0.001, 39.997], count // 4),
        'drops': 10.0 * rng.geometric(0.7, count),
    }[kind]
    times = 10**9 + np.cumsum(np.round(steps * MILLISECOND)).astype(np.int64)
    moved, velocity, largest = InputPlace(signal((*IMU[:3], *IMU[3:]))), np.zeros(3), 0.0
    for time, until in pairwise(times):
        rate = sigma * rng.normal()
        velocity += (turned(moved, int(time), rate) + rate**2 * DRAWN) * (until - time) * 1e-9
        largest = max(largest, float(np.linalg.norm(velocity)))
    assert largest < 8.0 * sigma * np.linalg.norm(SWUNG)


def test_what_is_written_at_the_place_is_read_at_the_centre():
    rng = np.random.default_rng(5)
    away, back = InputPlace(signal()), InputPlace(signal())
    for k in range(50):
        u, time = rng.normal(size=6), 10**9 + k * k * MILLISECOND
        written = away.away(time, u)
        assert np.abs(written[3:] - u[3:]).max() > 1e-3
        np.testing.assert_allclose(back(time, written), u, rtol=0.0, atol=1e-9)


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
