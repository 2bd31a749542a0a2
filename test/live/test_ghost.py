# SPDX-License-Identifier: Apache-2.0
"""The ghost of a live page beside the estimator of the package, on the same samples."""

from dataclasses import replace

import numpy as np
import pytest

from kalman_ros.codecs.layout import Sample
from kalman_ros.core import Gaussian
from kalman_ros.live.adjustments import Adjustments
from kalman_ros.live.ghost import Ghost
from kalman_ros.scenario import shipped

STEP = 10_000_000  # ns


def adjustments(name='cart_pole'):
    return Adjustments(shipped.file(name), {})


def frames(count=10, steps=5):
    """Yield the samples of each frame: readings, and inputs that answer them."""
    random = np.random.default_rng(0)
    for frame in range(count):
        times = [STEP * (frame * steps + k) for k in range(steps)]
        yield {
            'joint_states': [Sample(t, 0.01 * random.standard_normal(2), None) for t in times],
            'force': [Sample(t, random.standard_normal(1), None) for t in times],
        }


def test_the_ghost_is_the_estimator_of_the_package():
    settings = adjustments().estimator_settings()
    ghost, estimator = Ghost(settings), settings.estimator()
    for samples in frames():
        beliefs = ghost.fuse(samples)
        for reading, force in zip(samples['joint_states'], samples['force']):
            estimator.add_reading('joint_states', reading.time, reading.values)
            estimator.add_input(force.time, force.values)
        assert [time for time, _ in beliefs] == [s.time for s in samples['joint_states']]
        assert beliefs[-1][1].mean.tobytes() == estimator.belief.mean.tobytes()
        assert beliefs[-1][1].covariance.tobytes() == estimator.belief.covariance.tobytes()


def test_a_ghost_that_starts_later_goes_on_exactly_from_the_belief():
    settings = adjustments().estimator_settings()
    ghost, estimator = None, Ghost(settings)
    for k, samples in enumerate(frames()):
        beliefs = estimator.fuse(samples)
        if ghost is not None:
            assert ghost.fuse(samples)[-1][1].mean.tolist() == beliefs[-1][1].mean.tolist()
        if k == 4:
            ghost = Ghost(settings)
            time, belief = beliefs[-1]
            ghost.start(time, Gaussian(*belief), samples['force'][-1].values)


def test_a_reading_from_before_the_start_is_not_fused_twice():
    settings = adjustments().estimator_settings()
    ghost, samples = Ghost(settings), next(frames())
    time = samples['joint_states'][-1].time
    ghost.start(time, Gaussian(np.zeros(4), 1e-4 * np.eye(4)), np.zeros(1))
    assert ghost.fuse({'joint_states': samples['joint_states']}) == []


def test_an_input_from_before_the_start_does_not_move_the_start():
    settings = adjustments().estimator_settings()
    ghost, other = Ghost(settings), Ghost(settings)
    first, second = list(frames(2))
    time, belief = first['force'][-1].time, Gaussian(np.ones(4), 1e-4 * np.eye(4))
    for each in (ghost, other):
        each.start(time, belief, first['force'][-1].values)
    ghost.fuse(first)
    assert ghost.fuse(second)[-1][1].mean.tolist() == other.fuse(second)[-1][1].mean.tolist()


def test_the_ghost_keeps_the_values_from_before_a_change():
    changed = adjustments()
    ghost = Ghost(changed.estimator_settings())
    changed.change('estimator', {'joint_states.noise': [1.0, 1.0]}, tried=True)
    after = Ghost(changed.estimator_settings())
    samples = next(frames())
    before, later = (each.fuse(samples)[-1][1].covariance.trace() for each in (ghost, after))
    assert before < 0.1 * later


def test_another_filter_takes_the_same_values():
    changed = adjustments()
    changed.change('estimator', {'joint_states.noise': [0.02, 0.03]}, tried=True)
    settings = changed.estimator_settings('ukf')
    assert settings.scenario.filter == Ghost(settings).filter == 'ukf'
    noise = settings.scenario.sensors['joint_states'].sensor.covariance
    assert noise.diagonal() == pytest.approx([4e-4, 9e-4])
    assert settings.scenario.sensors['joint_states'].covariance_from == 'configuration'
    with pytest.raises(ValueError, match='unknown filter'):
        changed.estimator_settings('ukff')


def test_after_a_reset_the_ghost_starts_from_the_initial_belief():
    settings = adjustments().estimator_settings()
    ghost, other = Ghost(settings), Ghost(settings)
    first, second = list(frames(2))
    ghost.fuse(first)
    ghost.reset()
    assert ghost.fuse(second)[-1][1].mean.tolist() == other.fuse(second)[-1][1].mean.tolist()


def test_readings_that_only_the_node_can_read_are_refused():
    settings = adjustments().estimator_settings()
    source = settings.scenario.sensors['joint_states']
    late = replace(source, signal=replace(source.signal, stamp_offset=1_000_000))
    scenario = replace(settings.scenario, sensors={'joint_states': late})
    with pytest.raises(ValueError, match='only the node of the estimator reads joint_states'):
        Ghost(replace(settings, scenario=scenario))
