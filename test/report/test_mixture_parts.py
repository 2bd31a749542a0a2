# SPDX-License-Identifier: Apache-2.0
"""The parts of sums of Gaussians in pictures: places, weights, and single beliefs without any."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.core import Gaussian, Space
from kalman_ros.estimators.mixture import Mixture
from kalman_ros.report.mixture_parts import draw_part_ellipses, parts_of

TIMES = np.arange(0.0, 60.0, 10.0)


@pytest.fixture(scope='module')
def estimates():
    bearings = 1.4 + 1e-3 * np.arange(len(TIMES))
    scenario = kr.load(
        {'model': 'bearing_tracker', 'rate': 0.1, 'sensors': ['bearing'],
         'bearing.kind': 'bearing', 'bearing.position': [0.0, 0.0],
         'bearing.noise': [0.026], 'bearing.rate': 0.1,
         'initial_std': [2000.0, 2000.0, 2.0, 2.0], 'filter': 'gaussian_sum'}
    )  # fmt: skip
    return kr.filter(scenario, times=TIMES, readings=bearings)


def polygons(axis):
    (found,) = (each for each in axis.collections if each.get_label() == 'its parts')
    corners = np.array([path.vertices[:4] for path in found.get_paths()])
    return corners, found.get_facecolor()[:, 3]


def test_each_part_has_a_band_as_dark_as_its_weight(estimates):
    parts = parts_of(estimates)
    for k in range(len(TIMES)):
        here = parts.step == k
        assert parts.weight[here].sum() == pytest.approx(1.0)
        mean = parts.weight[here] @ parts.mean[here]
        np.testing.assert_allclose(mean, estimates.mean[k], rtol=1e-9, atol=1e-9)
    assert (parts.step == 0).sum() > 2
    axes = estimates.plot()
    corners, opacity = polygons(axes[1, 0])
    order = np.argsort(-parts.weight)
    band = 3.0 * parts.std[order, 1]
    np.testing.assert_allclose(corners[:, 0, 0], TIMES[parts.step[order]])
    np.testing.assert_allclose(corners[:, 1, 0], TIMES[parts.step[order]] + 10.0)
    np.testing.assert_allclose(corners[:, 0, 1], parts.mean[order, 1] - band)
    np.testing.assert_allclose(corners[:, 2, 1], parts.mean[order, 1] + band)
    assert (np.diff(opacity) <= 0.0).all()
    assert opacity[0] == pytest.approx(0.6 * parts.weight.max())
    assert 'its parts' in axes[1, 0].get_legend_handles_labels()[1]
    plt.close('all')


def test_single_gaussians_have_no_parts():
    model = kr.continuous_model([[0.0, 1.0], [0.0, 0.0]], W=[0.0, 0.1])
    found = kr.filter(model, ([1, 0], 0.01), [0, 1], [0, 1], initial=([0, 1], 1.0))
    assert parts_of(found) is None
    axes = found.plot()
    assert not any('its parts' in axis[0].get_legend_handles_labels()[1] for axis in axes)
    plt.close('all')


def test_ellipses_are_about_the_parts():
    space = Space(('x', 'y'))
    parts = [
        Gaussian(np.array(m), s * np.eye(2)) for m, s in (([0.0, 0.0], 1.0), ([9.0, 0.0], 4.0))
    ]
    _, axis = plt.subplots()
    whole = Mixture(np.array([0.25, 0.75]), parts, space)
    draw_part_ellipses(axis, whole, 10.0, np.array([1.0, 2.0]))
    (found,) = axis.collections
    near, far = (path.vertices for path in found.get_paths())
    # the heavier one comes first
    np.testing.assert_allclose(near[:-1].mean(axis=0), [1.0, 0.2], atol=0.02)
    assert np.ptp(near[:, 0]) == pytest.approx(2 * 3 * 2 / 10, rel=1e-3)
    assert np.ptp(far[:, 0]) == pytest.approx(2 * 3 * 1 / 10, rel=1e-3)
    draw_part_ellipses(axis, parts[0], 1.0, np.zeros(2))  # a single Gaussian
    assert len(axis.collections) == 1
    plt.close('all')
