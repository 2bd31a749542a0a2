# SPDX-License-Identifier: Apache-2.0
"""What takes long in an estimator is done piece by piece behind its messages, not in one go."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.signal_codecs import codec_of
from kalman_ros.codecs.wire import WireWriter
from kalman_ros.nodes.estimator import intake as estimator_intake
from kalman_ros.nodes.estimator.node import EstimatorNode


@pytest.mark.slow
def test_diagnostics_do_not_follow_the_path_that_messages_have_paid_for(pair, monkeypatch):
    monkeypatch.setattr(estimator_intake, '_PAUSE', 0.0)
    found = pair(EstimatorNode, model='robot_3d', sensors="['odometry', 'imu']")
    node, scenario = found.node, found.node.scenario
    sensor, signal = scenario.sensors['imu'].sensor, scenario.sensors['imu'].signal
    write, imu = (
        WireWriter(codec_of(signal)),
        found.publisher(codec_of(signal).message_type, 'imu'),
    )
    reading, taken = sensor.measure(scenario.initial_state), node._online.counts['imu']
    steps, move = [], type(scenario.model).step
    monkeypatch.setattr(
        type(scenario.model), 'step', lambda *arguments: steps.append(1) or move(*arguments)
    )
    now = node.get_clock().now().nanoseconds
    for number in range(1, 101):
        imu.publish(write(now + number * 5_000_000, reading, sensor.covariance))
        found.until(lambda n=number: taken.total() >= n, 'a reading was not taken')
    del steps[:]
    _, _, values = node.report()
    assert 'latest readings alone, 1 sigma' in values
    assert not steps
