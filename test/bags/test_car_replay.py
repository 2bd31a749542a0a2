# SPDX-License-Identifier: Apache-2.0
"""A minute of a real car by a parameter file alone: fixes, an IMU and the speed of its wheels."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from recorded_bags import START, Car

from kalman_ros.bags.replay import replay

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
#: The receiver stamps its fixes 0.1 s late. Its errors are alike for seconds, and its speed is a
#: percent off that of the wheels: a noise of each reading that is larger than its scatter stands
#: for both. The IMU looks 3.8 degrees down and 0.8 degrees to the left of the way of the wheels,
#: which is their mounting.
CAR = """\
/**:
  ros__parameters:
    model: inertial
    model_parameters:
      gyro_noise: 1.0e-6
      accelerometer_noise: 1.0e-3
      gyro_bias_noise: 1.0e-10
      accelerometer_bias_noise: 1.0e-7
    datum: [DATUM]
    sensors: [gnss, wheels]
    gnss:
      measures: [x, 'y', z]
      topic: fix
      type: sensor_msgs/NavSatFix
      fields: [east, north, up]
      noise: [1.5, 1.5, 6.0]
      stamp_offset: -0.1
    wheels:
      kind: body_velocity
      axes: [x, 'y', z]
      topic: odom
      type: nav_msgs/Odometry
      fields: [twist.twist.linear.x, twist.twist.linear.y, twist.twist.linear.z]
      noise: [2.0, 1.0, 1.0]
      mount: {rotation: [0.0, 0.0657, -0.0143]}
    initial_estimate: [0.0, 0.0, 0.0, 0.0, 0.0, 1.534, 0.3, 7.9, 0.0,
                       0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    initial_std: [0.6, 0.6, 1.2, 0.05, 0.1, 0.05, 0.3, 0.5, 0.3,
                  0.003, 0.003, 0.003, 0.1, 0.1, 0.1]
"""
#: The first seconds are those of the first belief, and poses end.
BEGIN, END = 2.0, 59.8
OUTAGE = 30.0, 45.0


@pytest.fixture(scope='module')
def car():
    return Car()


@pytest.fixture(scope='module')
def errors(car, tmp_path_factory):
    """Return a function that returns times, horizontal errors (N, 2) and their covariances."""
    folder = tmp_path_factory.mktemp('car')
    file = folder / 'car.yaml'
    file.write_text(CAR.replace('DATUM', ', '.join(f'{number:.9f}' for number in car.datum)))

    def found(name, silent=(0.0, 0.0)):
        replayed = replay(car.bag(folder / name, silent), file)
        beliefs = replayed.beliefs
        # a recording begins with its first message
        time = beliefs.time + (replayed.start - START) * 1e-9
        use = (time > BEGIN) & (time < END)
        time = time[use]
        truth = [np.interp(time, car.times, car.truth[:, axis]) for axis in range(2)]
        error = beliefs.mean[use, :2] - np.transpose(truth)
        return time, error, beliefs.covariance[use, :2, :2]

    return found


def nees(error, P):
    """Return the normalised squared errors (N,) over their degrees of freedom."""
    return np.einsum('ni,nij,nj->n', error, np.linalg.inv(P), error) / 2.0


def rms(error):
    return np.sqrt(np.square(error).sum(axis=1).mean())


@pytest.mark.thorough
def test_the_place_of_the_car_is_nearer_than_that_of_its_receiver(car, errors):
    _, error, P = errors('whole')
    stamps, fixes = car.fixes()
    at = stamps - 0.1
    use = (at > BEGIN) & (at < END)
    truth = [np.interp(at[use], car.times, car.truth[:, axis]) for axis in range(2)]
    receiver = rms(fixes[use, :2] - np.transpose(truth))
    assert receiver == pytest.approx(0.55, abs=0.01)  # as the source has it, less the delay
    assert rms(error) < receiver
    # the errors of one minute are alike
    assert 0.5 < nees(error, P).mean() < 2.0


@pytest.mark.thorough
def test_without_fixes_for_15_s_the_band_covers_the_error(errors):
    time, error, P = errors('outage', OUTAGE)
    silent = (time > OUTAGE[0]) & (time < OUTAGE[1])
    assert nees(error, P)[silent].max() < 4.6  # 99 % of two coordinates, over two
    spread = np.sqrt(np.trace(P, axis1=1, axis2=2))
    assert spread[silent][-1] > 2.0 * spread[silent][0]
    assert rms(error[silent]) < 2.0
