# SPDX-License-Identifier: Apache-2.0
"""The matrices of shipped linear models are those of their equations."""

import numpy as np
import pytest

from kalman_ros import scenario


def model(name, **parameters):
    given = {f'model_parameters.{key}': value for key, value in parameters.items()}
    return scenario.build({'model': name, **given}).model


def test_a_mass_in_a_plane_has_a_spring_and_a_damper_along_each_axis():
    """M x'' + c x' + k x = f, of energy m v^2 / 2 + k x^2 / 2, which the dampers take."""
    held = {'stiffness_x': 3.0, 'stiffness_y': 5.0, 'damping_x': 0.7, 'damping_y': 0.2}
    found = model('mass_spring_damper_2d', mass=2.0, force_noise=0.5, **held)
    x, u = np.array([0.3, -0.2, 0.4, 0.9]), np.array([1.5, -0.4])
    along_x = (1.5 - 0.7 * -0.2 - 3.0 * 0.3) / 2.0
    along_y = (-0.4 - 0.2 * 0.9 - 5.0 * 0.4) / 2.0
    np.testing.assert_allclose(found.derivative(x, u), [-0.2, along_x, 0.9, along_y])
    W = np.diag([0.0, 0.5 / 4.0, 0.0, 0.5 / 4.0])
    np.testing.assert_allclose(found.noise_density(x), W)


@pytest.mark.parametrize(
    ('own', 'index'),
    [({'main_resistance': 2.0, 'main_inductance': 0.5}, 0),
     ({'thruster_resistance': 2.0, 'thruster_inductance': 0.5}, 1)],
)  # fmt: skip
def test_a_current_follows_its_voltage_with_the_time_constant_of_its_circuit(own, index):
    """L di/dt + R i = u: after L / R at 1 V the current is (1 - 1/e) / R, and the other is 0."""
    volt = np.eye(2)[index]
    F, G, _ = model('current_sensors', **own).transition(np.zeros(2), volt, 0.25)
    np.testing.assert_allclose(G @ volt, volt * (1.0 - np.exp(-1.0)) / 2.0)
    assert F[index, index] == pytest.approx(np.exp(-1.0))
