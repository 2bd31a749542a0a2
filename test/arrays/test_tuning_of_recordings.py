# SPDX-License-Identifier: Apache-2.0
"""`kr.tune` on recordings of others: the delay of a receiver, the bias and the noise of ranges."""

import numpy as np
import pytest
from recorded import data

import kalman_ros as kr
from kalman_ros.core import from_coordinates

pytestmark = pytest.mark.slow


def local(ecef, origin):
    """Return east and north (N, 2) of ECEF positions (N, 3) about one of them."""
    x, y, z = origin
    longitude, latitude = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    sin, cos = np.sin([longitude, latitude]), np.cos([longitude, latitude])
    east = np.array([-sin[0], cos[0], 0.0])
    north = np.array([-sin[1] * cos[0], -sin[1] * sin[0], cos[1]])
    return (ecef - origin) @ np.stack((east, north)).T


def ecef(degrees, height):
    """Return ECEF positions (N, 3) of latitudes and longitudes (N, 2) on WGS 84."""
    a, e2 = 6378137.0, 6.69437999014e-3
    latitude, longitude = np.radians(degrees).T
    N = a / np.sqrt(1.0 - e2 * np.sin(latitude) ** 2)
    flat = (N + height) * np.cos(latitude)
    up = (N * (1.0 - e2) + height) * np.sin(latitude)
    return np.stack((flat * np.cos(longitude), flat * np.sin(longitude), up), axis=1)


def best_delay(time, poses, at, fixes, *, biased):
    """Return by how much fixes lag behind poses, by least squares on a grid."""

    def misfit(delay):
        there = np.column_stack([np.interp(at - delay, time, column) for column in poses.T])
        error = fixes - there
        return np.square(error - biased * error.mean(axis=0)).sum()

    grid = np.arange(-0.1, 0.3, 0.002)
    return grid[np.argmin([misfit(delay) for delay in grid])]


@pytest.mark.thorough
@pytest.mark.parametrize('biases', [[], ['gnss']], ids=['unbiased', 'biased'])
def test_the_delay_of_a_car_s_receiver_is_found(biases):
    """Without a bias it is the .1 s of the published note; a bias takes half of it over."""
    folder = data('car_60s')
    load = {name: np.load(folder / f'{name}.npy') for name in (
        'frame_times', 'frame_positions', 'live_gnss_ublox_t', 'live_gnss_ublox_value'
    )}  # fmt: skip
    poses, fixes = load['frame_positions'], load['live_gnss_ublox_value']
    origin, begin = poses[0], load['frame_times'][0]
    times = {'poses': load['frame_times'] - begin, 'gnss': load['live_gnss_ublox_t'] - begin}
    values = {
        'poses': local(poses, origin),
        'gnss': local(ecef(fixes[:, :2], fixes[:, 4]), origin),
    }
    use = {name: (t >= 0.5) & (t < 30.0) for name, t in times.items()}
    times = {name: times[name][use[name]] for name in times}
    values = {name: values[name][use[name]] for name in values}

    def car(jerk=1.0, spread=1.0):
        zero, one = np.zeros((2, 2)), np.eye(2)
        A = np.block([[zero, one], [zero, zero]])
        W = np.block([[zero, zero], [zero, jerk * one]])
        H = np.eye(2, 4)
        return kr.continuous_model(A, W=W), {
            'poses': (H, 0.05**2 * one), 'gnss': (H, spread**2 * one)
        }  # fmt: skip

    initial = [0.0] * 4, np.diag([100.0, 100.0, 400.0, 400.0])
    found = kr.tune(car, times, values, initial=initial, delays=['gnss'], biases=biases)
    delay = found.parameters['gnss.delay']
    inside = (times['gnss'] > 0.8) & (times['gnss'] < 29.8)
    best = best_delay(
        times['poses'], values['poses'], times['gnss'][inside], values['gnss'][inside],
        biased=bool(biases),
    )  # fmt: skip
    assert delay.value == pytest.approx(best, abs=0.01)
    assert delay.high - delay.low < 0.02
    if not biases:
        assert delay.value == pytest.approx(0.1, abs=0.02)


class Wheels(kr.Model):
    """A robot in the plane, driven by its speed and its yaw rate."""

    state = kr.Space('x y psi', angles=('psi',))
    input = kr.Space('v omega')

    def __init__(self, turning, slip):
        self._noise = np.diag([slip, slip, turning])

    def derivative(self, x, u):
        psi = x[..., 2]
        return from_coordinates(
            u[..., 0] * np.cos(psi), u[..., 0] * np.sin(psi), u[..., 1] + 0.0 * psi
        )

    def noise_density(self, x):
        return self._noise


ANCHORS = {
    '105': (-0.02, -0.01), '107': (-0.02, 2.365), '109': (2.385, -0.005), '108': (2.385, 2.36)
}  # fmt: skip
WHEELS = 0.0785


@pytest.mark.thorough
def test_the_bias_and_the_noise_of_uwb_ranges_are_found():
    lines = [line.split() for line in (data('uwb_robot') / 'Indoor_UWB_Input.txt').open()]
    ranges = [line for line in lines if line[0] == 'range2']
    drives = np.array([line[1:4] for line in lines if line[0] == 'odom2diff'], dtype=float)
    first = next(line for line in (data('uwb_robot') / 'Indoor_UWB_GT.txt').open()).split()
    times = {a: [float(line[1]) for line in ranges if line[6] == a] for a in ANCHORS}
    values = {a: [float(line[2]) for line in ranges if line[6] == a] for a in ANCHORS}
    right, left = drives[:, 1], drives[:, 2]
    inputs = np.stack(((right + left) / 2.0, (right - left) / WHEELS), axis=1)

    def robot(offset=0.0, noise=0.3, turning=0.1, slip=1e-3):
        def to(anchor):
            return lambda x: np.hypot(
                x[..., :1] - anchor[0], x[..., 1:2] - anchor[1]
            ) + offset  # fmt: skip

        sensors = {a: kr.sensor(to(at), [[noise**2]], a) for a, at in ANCHORS.items()}
        belief = [float(first[2]), float(first[3]), 0.0], np.diag([0.01, 0.01, 10.0])
        return Wheels(turning, slip), sensors, belief

    found = kr.tune(robot, times, values, inputs, input_times=drives[:, 0])
    # against the truth, the ranges have a bias of .118 m and a deviation of .107 m
    assert found.values['offset'] == pytest.approx(0.118, abs=0.03)
    assert found.values['noise'] == pytest.approx(0.107, rel=0.25)
    assert found.parameters['offset'].low > 0.0
