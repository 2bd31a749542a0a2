# SPDX-License-Identifier: Apache-2.0
"""A bearing does not depend on the unit of length, nor does where a belief is divided."""

import numpy as np
import pytest

from kalman_ros.core import Gaussian, Space
from kalman_ros.sensors.bearing import Bearing

PLANE = Space(('x', 'y'), ('m', 'm'))


def prior(unit, P=((0.5, 0.1), (0.1, 0.3))):
    return Gaussian(unit * np.array([1.0, 0.5]), unit**2 * np.array(P))


@pytest.mark.parametrize('unit', [1e-3, 1e3])
def test_hypotheses_are_the_same_in_another_unit_of_length(unit):
    sensor, y = Bearing(PLANE, [0.01]), np.array([0.4])
    expected = sensor.hypotheses(prior(1.0), y, 6)
    found = sensor.hypotheses(prior(unit), y, 6)
    np.testing.assert_allclose(found.log_weights, expected.log_weights, rtol=1e-6)
    for part, reference in zip(found.parts, expected.parts):
        np.testing.assert_allclose(part.mean, unit * reference.mean, rtol=1e-6)
        np.testing.assert_allclose(
            part.covariance, unit**2 * reference.covariance, rtol=1e-6, atol=1e-9 * unit**2
        )


@pytest.mark.parametrize('P', [((0.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 9.0))])
def test_a_place_that_is_known_or_on_a_line_is_not_divided(P):
    assert Bearing(PLANE, [0.01]).hypotheses(prior(1.0, P), np.zeros(1), 6) is None


def posterior(z, P, y, std):
    """Return the evidence of a bearing, and mean and covariance of a place N(z, P) given it.

    By the midpoint rule in polar coordinates about the sensor.
    """
    theta = y + std * np.linspace(-6.0, 6.0, 121)[:, None]
    farthest = np.hypot(*z) + 6.0 * np.sqrt(np.linalg.eigvalsh(P)[1])
    r = (np.arange(800) + 0.5) * farthest / 800
    places = r[:, None] * np.stack((np.cos(theta), np.sin(theta)), axis=-1)
    off = places - z
    exponent = np.einsum('...i,ij,...j->...', off, np.linalg.inv(P), off)
    exponent += ((theta - y) / std) ** 2
    scale = (2.0 * np.pi) ** 1.5 * np.sqrt(np.linalg.det(P)) * std
    w = r * np.exp(-0.5 * exponent) / scale * (farthest / 800) * (0.1 * std)
    evidence, w = w.sum(), w / w.sum()
    mean = np.einsum('ij,ijk->k', w, places)
    off = places - mean
    return evidence, mean, np.einsum('ij,ijk,ijl->kl', w, off, off)


@pytest.mark.parametrize(
    ('y', 'P'), [(0.4, ((0.5, 0.1), (0.1, 0.3))), (-0.8, ((0.2, 0.05), (0.05, 0.15)))]
)
def test_hypotheses_together_are_the_posterior_by_integration(y, P):
    """To first order in the noise, along the line of sight and far from it."""
    given = prior(1.0, P)
    found = Bearing(PLANE, [0.05]).hypotheses(given, np.array([y]), 6)
    evidence, mean, covariance = posterior(*given[:2], y, 0.05)
    w = np.exp(found.log_weights)
    assert w.sum() == pytest.approx(evidence, rel=0.01)
    w /= w.sum()
    total = w @ [part.mean for part in found.parts]
    np.testing.assert_allclose(total, mean, rtol=5e-3)
    spread = [
        part.covariance + np.outer(part.mean - total, part.mean - total) for part in found.parts
    ]
    np.testing.assert_allclose(np.tensordot(w, spread, 1), covariance, rtol=0.01)


@pytest.mark.parametrize('mean', [(1.0, 0.5), (3.0, -1.0), (-0.3, 0.2), (0.0, 4.5)])
def test_directions_of_a_place_have_the_moments_of_its_density(mean):
    """The trigonometric moments of the direction of N(z, P), by quadrature over the plane."""
    z, P = np.array(mean), np.array(((0.5, 0.2), (0.2, 0.4)))
    found = Bearing(PLANE, [0.05]).hypotheses(Gaussian(z, P), np.array([0.1]), 6)
    theta = (np.arange(720)[:, None] + 0.5) / 720 * 2.0 * np.pi
    r = (np.arange(800) + 0.5) / 800 * (np.hypot(*z) + 6.0)
    off = r[:, None] * np.stack((np.cos(theta), np.sin(theta)), axis=-1) - z
    exponent = np.einsum('...i,ij,...j->...', off, np.linalg.inv(P), off)
    density = (r * np.exp(-0.5 * exponent)).sum(axis=1)
    for order in (1, 2, 3):
        moment = found.shares @ np.exp(1j * order * found.forecast[:, 0])
        expected = density @ np.exp(1j * order * theta[:, 0]) / density.sum()
        assert moment == pytest.approx(expected, abs=1e-4)
