# SPDX-License-Identifier: Apache-2.0
"""Every warning is logged, none of them all the time."""

from kalman_ros.pipeline.throttle import Throttle


def test_one_complaint_does_not_silence_another():
    said = []
    throttle = Throttle(said.append, seconds=60.0)
    for message in ('a', 'b', 'a', 'b', 'a'):
        throttle(message)
    assert said == ['a', 'b']


def test_it_is_said_again_after_the_time():
    said = []
    throttle = Throttle(said.append, seconds=0.0)
    throttle('a')
    throttle('a')
    assert said == ['a', 'a']


def test_a_flood_of_different_things_is_bounded():
    said = []
    throttle = Throttle(said.append, seconds=60.0)
    for index in range(1000):
        throttle(f'number {index}')
    assert len(said) == 20
