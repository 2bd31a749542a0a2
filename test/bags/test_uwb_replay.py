# SPDX-License-Identifier: Apache-2.0
"""A real robot between four radio anchors, by a parameter file alone."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from recorded_bags import Uwb

from kalman_ros.bags.replay import replay

ANCHORS = {
    '105': (-0.02, -0.01), '107': (-0.02, 2.365), '109': (2.385, -0.005), '108': (2.385, 2.36)
}  # fmt: skip
#: The heading is that of the first two seconds of the way, which are not quite straight.
ROBOT = """\
/**:
  ros__parameters:
    model: diff_drive
    model_parameters: {acceleration_noise: 5.0, turn_noise: 20.0}   # it stops and turns at once
    odometry:
      covariance_from: configuration
      noise: [0.02, 0.2]
    initial_estimate: [1.652, 2.219, 0.0, -3.106, 0.0]
    initial_std: [0.02, 0.02, 0.1, 0.3, 0.5]
    sensors: [odometry%s]
"""
#: Ranges of radio are too long, since it takes detours: by an unknown amount for each anchor.
ANCHOR = """\
    anchor_%s:
      kind: landmarks
      measures: [x, 'y']
      reads: [range]
      positions: [%g, %g]
      noise: [0.11]
      bias_std: [0.15]
      topic: range_%s
      type: sensor_msgs/Range
      fields: [range]
"""


def parameters(file, anchors):
    """Write a parameter file with some of the anchors."""
    names = ''.join(f', anchor_{name}' for name in anchors)
    parts = [ANCHOR % (name, *ANCHORS[name], name) for name in anchors]
    file.write_text(ROBOT % names + ''.join(parts))
    return file


@pytest.fixture(scope='module')
def found(tmp_path_factory):
    """Return errors (N, 2), covariances and biases by the wheels alone, and with the ranges."""
    robot, folder = Uwb(), tmp_path_factory.mktemp('uwb')
    bag, results = robot.bag(folder / 'bag'), []
    for name, anchors in (('wheels', ()), ('all', ANCHORS)):
        replayed = replay(bag, parameters(folder / f'{name}.yaml', anchors))
        beliefs = replayed.beliefs
        # the recording begins with the first message
        time = beliefs.time + robot.times[0]
        truth = [np.interp(time, robot.times, robot.truth[:, axis]) for axis in range(2)]
        error = beliefs.mean[:, :2] - np.transpose(truth)
        results.append((error, beliefs.covariance[:, :2, :2], replayed.biases))
    return results


@pytest.mark.slow
def test_ranges_halve_the_error_of_the_wheels(found):
    (wheels, _, _), (both, _, _) = found
    alone, together = (np.linalg.norm(each[-1]) for each in (wheels, both))
    assert 0.3 < alone < 1.0
    assert together < 0.5 * alone


@pytest.mark.slow
def test_the_covariance_covers_the_error(found):
    _, (error, P, _) = found
    nees = np.einsum('ni,nij,nj->n', error, np.linalg.inv(P), error) / 2.0
    # one run of half a minute
    assert 0.3 < nees.mean() < 2.0
    assert (nees < 6.9).mean() > 0.99  # 99.9 % of two coordinates, over two


def test_the_biases_of_the_ranges_are_found(found):
    """The mean of all ranges less the true distances is 0.118 m."""
    (_, _, none), (_, _, biases) = found
    assert not none
    mean = np.mean([bias.mean[0] for bias in biases.values()])
    std = np.mean([bias.std[0] for bias in biases.values()])
    assert len(biases) == 4
    assert mean == pytest.approx(0.118, abs=2.0 * std)
    assert std < 0.05
