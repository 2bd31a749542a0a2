# SPDX-License-Identifier: Apache-2.0
"""The published fit of a pendulum by its own recipe, and what its recording determines."""

import numpy as np
import pytest
from recorded import data
from scipy.signal import butter, filtfilt

import kalman_ros as kr
from kalman_ros.core import from_coordinates

#: tau = J q'' + m c g sin q + Fv q' + Fc atan(100 q') + offset, by the recording's authors.
PUBLISHED = {'J': 0.06259, 'mc': 0.1022, 'Fv': 0.04707, 'Fc': 0.1839, 'offset': -0.07586}
G = 9.81


def recording():
    """Return time, angle, speed and torque (N,) at 300 Hz."""
    return np.loadtxt(data('pendulum') / 'data_measured.csv', delimiter=',', skiprows=1).T


def test_the_published_fit_is_reproduced_by_its_recipe():
    time, q, v, torque = recording()

    def smooth(x, cutoff):
        return filtfilt(*butter(3, cutoff), x)

    speed = np.gradient(q, time)
    acceleration = smooth(np.gradient(smooth(v, 0.2), time), 0.1)
    terms = acceleration, G * np.sin(q), speed, np.arctan(100.0 * speed), np.ones_like(q)
    found = np.linalg.lstsq(np.stack(terms, axis=1), smooth(torque, 0.1), rcond=None)[0]
    np.testing.assert_allclose(found, [*PUBLISHED.values()], rtol=5e-4)


class Pendulum(kr.Model):
    """The same pendulum, with a random torque."""

    state = kr.Space(('q', 'v'), ('rad', 'rad/s'))
    input = kr.Space(('torque',), ('N m',))
    max_step = 0.02

    def __init__(self, J, mc, Fv, Fc, offset, torque_noise):
        self._J, self._weight, self._friction = J, mc * G, (Fv, Fc, offset)
        self._noise = torque_noise

    def derivative(self, x, u):
        (q, v), (Fv, Fc, offset) = (x[..., 0], x[..., 1]), self._friction
        friction = Fv * v + Fc * np.arctan(100.0 * v) + offset
        return from_coordinates(v, (u[..., 0] - self._weight * np.sin(q) - friction) / self._J)

    def noise_density(self, x):
        W = np.zeros((*x.shape[:-1], 2, 2))
        W[..., 1, 1] = self._noise / self._J**2
        return W


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_rough_torque_does_not_determine_the_friction():
    def pendulum(J, mc, Fv, Fc, offset, torque_noise=0.01, noise=0.01):
        model = Pendulum(J, mc, Fv, Fc, offset, torque_noise)
        return model, {'position': ([[1.0, 0.0]], [[noise**2]])}

    blocks = [column[: len(column) // 6 * 6].reshape(-1, 6) for column in recording()]
    time, q, torque = blocks[0][:, 0], blocks[1][:, 0], blocks[3].mean(axis=1)
    found = kr.tune(
        pendulum, {'position': time}, {'position': q}, torque[:, np.newaxis],
        initial=([0.0, 0.0], 0.01 * np.eye(2)), input_times=time, linear=['offset', 'Fv'],
        fit={**PUBLISHED, 'torque_noise': 0.01, 'noise': 0.01},
    )  # fmt: skip
    # without it the readings are likelier than with the published one, by 7 in log-likelihood
    assert found.converged and 'too small for these data' in found.undetermined['Fc']
    assert found.values['Fc'] < 0.001 * PUBLISHED['Fc']
    for name in ('Fv', 'offset'):
        assert found.parameters[name].low < 0.0 < found.parameters[name].high
    assert found.parameters['mc'].high > 1.4 * found.parameters['mc'].low
