# SPDX-License-Identifier: Apache-2.0
"""The gradient of the likelihood along the delay of a sensor."""

from dataclasses import replace

import numpy as np
import pytest
from tuned_cases import COVERED, Case, likelihood, recorded

from kalman_ros.analysis.tuning.earlier import noisier
from kalman_ros.analysis.tuning.fit import fit
from kalman_ros.analysis.tuning.free_parameter import FreeParameter
from kalman_ros.analysis.tuning.named_parameters import NamedParameters
from kalman_ros.analysis.tuning.scan import scanned
from kalman_ros.core import Gaussian
from kalman_ros.estimators import build_filter
from kalman_ros.scenario import build

ROBOT = replace(COVERED[2], seconds=8.0, starts={})


@pytest.mark.slow
@pytest.mark.parametrize(
    ('delay', 'true', 'at'),
    [
        # a speed that changes by noise alone: all that it shows of the delay is in covariances
        ('odometry.delay', 0.03, 0.011),
        ('imu.delay', 0.03, 0.052),
        # later than the recording begins, and earlier: the first reading is from before it then
        ('position.delay', 0.06, 0.048),
        ('position.delay', 0.06, 0.072),
    ],
)
def test_the_gradient_is_that_of_the_likelihood(delay, true, at):
    case = replace(ROBOT, fitted=[delay], errors={delay: true})
    found = likelihood(case, recorded(case, 5))
    z = np.array([found.parameters[0].scaled(at)])
    h = 1e-3
    above, below = (found.values([z + s * h])[0] for s in (1.0, -1.0))
    top = found.expand(z)
    deviation = top.information[0, 0] ** -0.5
    assert abs(top.gradient[0]) * deviation > 0.1
    assert top.gradient[0] == pytest.approx((above - below) / (2.0 * h), abs=0.03 / deviation)


@pytest.mark.thorough
@pytest.mark.slow
def test_the_delay_of_a_speed_is_found():
    case = replace(ROBOT, fitted=['odometry.delay'], errors={'odometry.delay': 0.03}, seconds=30.0)
    (found,) = fit(likelihood(case, recorded(case, 5))).parameters
    assert found.determined
    assert found.high - found.low < 0.02
    assert found.low < 0.03 < found.high


@pytest.mark.slow
@pytest.mark.parametrize('delay', [-0.7, 0.4])
def test_a_delay_beyond_other_maxima_of_the_likelihood_is_reached(delay):
    """An ascent from zero ends at -0.0055 +- 0.0015 for the first, 3,000 nats below."""
    name = 'odometry.delay'
    case = replace(ROBOT, fitted=[name], errors={name: delay}, seconds=30.0)
    (found,) = fit(likelihood(case, recorded(case, 5))).parameters
    assert found.low < delay < found.high
    assert found.high - found.low < 0.02


def _turning(time):
    """Return rates about two axes, and the force of gravity on a body that is level."""
    return np.array([0.2 * np.sin(time), 0.0, 0.6, 0.0, 0.0, 9.80665])


@pytest.mark.slow
def test_an_orientation_is_turned_back_by_its_delay():
    """Near half a turn about the vertical, where numbers of an orientation jump."""
    begin = [0.0] * 5 + [3.0] + [0.0] * 9
    values = {
        'model': 'inertial', 'filter': 'ekf', 'rate': 50.0, 'sensors': ['attitude'],
        'attitude.kind': 'states', 'attitude.measures': ['rx', 'ry', 'rz'],
        'attitude.noise': [0.01] * 3, 'attitude.type': 'geometry_msgs/PoseStamped',
        'attitude.fields': [f'pose.orientation.r{axis}' for axis in 'xyz'], 'attitude.rate': 10.0,
        'initial_estimate': begin, 'initial_std': [0.05] * 15,
    }  # fmt: skip
    name = 'attitude.delay'
    case = Case('body', values, {}, [name], 5.0, _turning, {name: 0.1})
    found = likelihood(case, recorded(case, 3))
    assert found.expand(np.zeros(1)).value == pytest.approx(found.values([np.zeros(1)])[0])
    (fitted,) = fit(found).parameters
    assert fitted.low < 0.1 < fitted.high
    assert fitted.high - fitted.low < 0.08


def test_readings_from_before_the_first_belief_leave_it_positive():
    """A speed that is read better than it is predicted: its variance became negative."""
    exact = {'model_parameters.acceleration_noise': 1.0, 'odometry.noise': [0.02, 0.1]}
    name, values = 'odometry.delay', {**ROBOT.values, **exact}
    case = replace(ROBOT, values=values, fitted=[name], errors={name: 0.5}, seconds=4.0)
    found = likelihood(case, recorded(case, 5))
    (free,) = found.parameters
    logs = [found.values([np.array([free.scaled(delay)])])[0] for delay in (0.0, 0.3, 0.5, 0.7)]
    assert np.isfinite(logs).all()
    assert logs[0] < logs[1] < logs[2] - 100.0 and logs[3] < logs[2] - 100.0


def test_what_is_read_before_a_belief_is_uncertain_by_the_noise_since():
    """P + W is the covariance of the state that is read, of which the belief keeps P."""
    built = build({'model': 'level', 'reading.noise': [0.5]}, with_law=False)
    sensor, W = built.sensors['reading'].sensor, np.array([[[3.0]]])
    prior = Gaussian(np.zeros((1, 1)), np.full((1, 1, 1), 2.0))
    filter = build_filter('kf', built.believed_plan)
    correction = filter.correct(prior, np.array([1.0]), noisier(sensor, prior.mean, W))
    S = 2.0 + 3.0 + 0.25
    assert correction.innovation_covariance.item() == pytest.approx(S)
    assert correction.posterior.mean.item() == pytest.approx(2.0 / S)
    assert correction.posterior.covariance.item() == pytest.approx(2.0 - 4.0 / S)


class Waves:
    """Readings alike for all values until the 9,000th, and a likelihood with many maxima."""

    def __init__(self, free, until=None, start=0.0):
        self.parameters, self.until, self.start = free, until, np.array([start])
        self.asked = []

    def values(self, points):
        self.asked += [float(z[0]) for z in points]
        if self.until is not None:
            return np.zeros(len(points))
        return np.array([20.0 * np.cos(20.0 * z[0]) - 9.0 * (z[0] - 6.2) ** 2 for z in points])


@pytest.mark.parametrize('scale', [0.1, 1.0])
def test_a_scan_takes_more_readings_until_values_differ(scale):
    limits = -10.0 * scale, 10.0 * scale
    free = FreeParameter('s.delay', 0.0, *limits, scale=scale, scan=0.1 * scale)
    whole, counts = Waves([free]), []

    def first(count):
        counts.append(count)
        return whole if count > 9000 else Waves([free], until=count)

    whole.first = first
    z = scanned(whole, 2000, lambda text, share: None)
    assert counts == [2000, 4000, 8000, 16000]
    assert z[0] == pytest.approx(20.0 * 2.0 * np.pi / 20.0, abs=0.03)
    assert len(whole.asked) == len({*np.round(whole.asked[:-6], 9)}) + 6
    assert min(whole.asked) > -10.0 and max(whole.asked) < 10.0


def test_a_parameter_with_one_maximum_is_not_scanned():
    z = scanned(Waves([FreeParameter('s.noise', 0.5)], start=0.5), 2000, None)
    assert z.tolist() == [0.5]


def test_bounds_of_a_delay_may_be_wider_than_those_that_are_scanned():
    def chosen(*bounds):
        named = NamedParameters({})
        (free,) = named.choose(['position.delay'], {'position.delay': bounds} if bounds else None)
        return free.low, free.high

    assert chosen() == (-1.0, 1.0)
    assert chosen(0.0, 8.0) == (0.0, 8.0)
    assert chosen(-0.3, 0.2) == (-0.3, 0.2)
    with pytest.raises(ValueError, match='position.delay: expected bounds within -10 and 10 s'):
        chosen(0.0, 11.0)
