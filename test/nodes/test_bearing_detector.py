# SPDX-License-Identifier: Apache-2.0
"""Bearings from frames of sound: where the source is, or none where it is not sure."""

from dataclasses import replace
from math import atan2

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.nodes.microphone_array.bearing_detector import BearingDetector
from kalman_ros.nodes.microphone_array.options import MicrophoneArrayOptions
from kalman_ros.scenario import build, shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation.sound import SimulatedSound, Sound

OPTIONS = MicrophoneArrayOptions()
RATE = OPTIONS.sample_rate
ARRAY = MicrophoneArray([*OPTIONS.microphones])
PLACE = np.array([3.0, 4.0])


def signal():
    built = build(from_file(shipped.file('sound_tracker'), 'estimator'))
    return built.sensors[OPTIONS.bearing_sensor].signal


def heard(options, level=1.0, noise=OPTIONS.microphone_noise, seed=0):
    """Return the detector, its message about a frame, and its report."""
    detector = BearingDetector(signal(), ARRAY, RATE, options)
    low, high = options.band
    sound = SimulatedSound(ARRAY, RATE, detector.samples, Sound(level, (low, high), noise), seed)
    message = detector(10**9, sound(PLACE), options)
    return detector, message, detector.report()[2]


def test_a_frame_has_its_duration():
    assert heard(OPTIONS)[0].samples == 1600
    assert heard(replace(OPTIONS, frame_duration=0.02))[0].samples == 320


def test_a_longer_frame_is_surer_of_the_bearing():
    stds = []
    for duration in (0.02, 0.5):
        options = replace(OPTIONS, frame_duration=duration)
        _, message, values = heard(options, noise=0.05)
        assert message is not None and values['bearings'] == 1
        stds.append(values['standard deviation of the last [rad]'])
    assert stds[1] < 0.5 * stds[0] < 0.1


def test_the_bearing_is_that_of_the_source():
    _, message, values = heard(OPTIONS)
    assert message.header.stamp.sec == 1 and message.header.frame_id == 'map'
    turn, std = message.pose.pose.orientation, values['standard deviation of the last [rad]']
    assert abs(2.0 * atan2(turn.z, turn.w) - atan2(4.0, 3.0)) < 4.0 * std < 0.05
    assert message.pose.covariance[-1] == pytest.approx(std**2)


@pytest.mark.parametrize('seed', range(5))
def test_noise_alone_has_no_bearing(seed):
    _, message, values = heard(OPTIONS, level=0.0, seed=seed)
    assert message is None and values['frames without a source'] == 1


def test_odds_decide_whether_there_is_a_source():
    """A source of .05 Pa at 1 m, 5 m away, is exp(25.1) = 8e10 times as likely as noise alone."""
    found = [
        heard(replace(OPTIONS, least_odds=odds), level=0.05, noise=0.05)[2]
        for odds in (1e10, 1e12)
    ]
    assert [values['bearings'] for values in found] == [1, 0]
    assert found[1]['frames without a source'] == 1


def test_an_uncertain_bearing_is_not_published():
    _, message, values = heard(replace(OPTIONS, largest_std=1e-6))
    assert message is None and values['frames without a direction'] == 1
