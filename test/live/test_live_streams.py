# SPDX-License-Identifier: Apache-2.0
"""Frames of a live page: how many rows they keep, and predictions over several steps."""

from collections import defaultdict

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.layout import Sample
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.streams import Streams
from kalman_ros.scenario import shipped


def truths(count):
    samples = defaultdict(list)
    samples['ground_truth'] = [
        Sample(10_000_000 * k, np.full(2, float(k)), None) for k in range(count)
    ]
    return samples


@pytest.mark.parametrize(('periods', 'rows'), [(1, 10), (4, 40), (100, 200)])
def test_a_late_frame_keeps_as_many_rows_a_second(periods, rows):
    scenario = Adjustments(shipped.file('mass_spring_damper'), {}).scenario('plant')
    frame = Streams(scenario).frame(truths(200), scenario, None, {}, periods=periods)
    assert len(frame['truth']) == pytest.approx(rows, abs=rows // 4)
    assert frame['truth'][-1][0] == 1.99


def test_a_prediction_over_several_steps_is_that_of_each_step():
    scenario = Adjustments(shipped.file('mass_spring_damper'), {}).scenario('plant')
    streams = Streams(scenario)
    streams.estimate = np.array([0.3, -0.1]), np.diag([0.01, 0.04])
    step = scenario.model.linearized_step(*scenario.model.equilibrium, 1.0 / scenario.rate)
    x, P = streams.estimate
    for _ in range(5):
        x, P = step.F @ x, step.F @ P @ step.F.T + step.Q
    found = streams.prior(scenario, 5)
    np.testing.assert_allclose(found['x'], x, rtol=1e-4)
    np.testing.assert_allclose(found['P'], P.ravel(), rtol=1e-4)


def test_what_is_from_before_a_reset_is_in_no_frame():
    scenario = Adjustments(shipped.file('mass_spring_damper'), {}).scenario('plant')
    streams, samples = Streams(scenario), truths(100)
    streams.frame(samples, scenario, None, {})
    streams.restart(truths(120))

    def late(first, count):
        found = truths(count)
        found['ground_truth'] = found['ground_truth'][first:]
        times = [sample.time for sample in found['ground_truth']]
        found['estimate'] = [Sample(time, np.ones(2), None) for time in times]
        found['estimate/covariance'] = [Sample(None, np.eye(2).ravel(), None) for _ in times]
        found['position'] = [Sample(time, np.ones(1), None) for time in times]
        innovations = (f'estimate/innovation/{name}' for name in scenario.sensors)
        topics = 'force', *scenario.sensors, *innovations
        return {**dict.fromkeys(topics, ()), **found}

    frame = streams.frame(late(110, 125), scenario, None, {}, periods=9)
    for rows in (frame['truth'], frame['estimate'], frame['readings']['position']):
        assert [row[0] for row in rows] == [1.2, 1.21, 1.22, 1.23, 1.24]
    assert streams.frame(late(100, 119), scenario, None, {}) is None
