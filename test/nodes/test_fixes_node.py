# SPDX-License-Identifier: Apache-2.0
"""The estimator with a satellite receiver: datum, fixes out, and fixes that are none."""

from collections import Counter
from time import monotonic

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import NavSatFix

from kalman_ros.codecs.fixes import place_of
from kalman_ros.codecs.messages import decode, write_stamp
from kalman_ros.core.geodesy import Place, TangentPlane
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.nodes.estimator import channel
from kalman_ros.nodes.estimator.node import EstimatorNode
from kalman_ros.scenario import shipped

DATUM = Place(49.8728, 8.6512, 144.0)
KEPT = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FIRST_FIX = {'datum': '[.inf]', 'publish_fix': 'true'}


@pytest.fixture
def started(pair):
    """Return a function that starts the estimator of the scenario, with other parameters."""

    def start(**parameters):
        file = str(shipped.file('navsat'))
        return pair(EstimatorNode, file=file, **parameters)

    return start


def fix(found, local, status=0):
    """Return a fix at metres from the datum, stamped now."""
    message = NavSatFix()
    write_stamp(message.header.stamp, found.node.get_clock().now().nanoseconds)
    where = TangentPlane(DATUM).place(np.array(local))
    message.latitude, message.longitude, message.altitude = where
    message.status.status = status
    return message


def received(found, topic, queue=10):
    """Return a function that returns the fixes received by the peer."""
    subscription = found.peer.create_subscription(NavSatFix, topic, print, queue, raw=True)
    messages = []

    def take():
        while (taken := subscription.handle.take_message(NavSatFix, True)) is not None:
            messages.append(decode(taken[0], NavSatFix))
        return messages

    return take


def test_the_first_good_fix_is_the_datum_and_is_published_for_all_who_ask_later(started, tmp_path):
    file = tmp_path / 'datum.yaml'
    found = started(**FIRST_FIX, datum_file=str(file))
    send = found.publisher(NavSatFix, 'fix')
    counts = found.node._online.counts['gnss']
    send.publish(fix(found, (50.0, 0.0, 0.0), status=-1))
    found.until(lambda: counts[Outcome.NO_FIX] == 1, 'the fix without a status is not counted')
    assert not file.exists()
    send.publish(fix(found, (0.0, 0.0, 0.0)))
    found.until(lambda: counts[Outcome.FUSED] == 1, 'the fix is not fused')
    messages = received(found, 'estimate/datum', KEPT)
    found.until(messages, 'no datum')
    assert place_of(messages()[0]) == pytest.approx(DATUM)
    assert 'datum: [49.872800000, 8.651200000, 144.0000]' in file.read_text()


def test_a_receiver_that_has_lost_its_fix_is_a_problem(started, monkeypatch):
    found = started(**FIRST_FIX)
    send = found.publisher(NavSatFix, 'fix')
    counts, later = found.node._online.counts['gnss'], 0.0
    monkeypatch.setattr(channel, 'monotonic', lambda: monotonic() + later)
    send.publish(fix(found, (0.0, 0.0, 0.0)))
    found.until(lambda: counts[Outcome.FUSED] == 1, 'the fix is not fused')
    for number, problem in ((1, False), (2, True)):
        found.node.report()
        later += 2.0
        send.publish(fix(found, (0.0, 0.0, 0.0), status=-1))
        found.until(lambda n=number: counts[Outcome.NO_FIX] == n, 'it is not counted')
        found.node.report()
        why = found.node._health._unused(found.node.scenario.sensors)
        assert why == ('no reading is used: of gnss dropped: no position fix' if problem else '')
    send.publish(fix(found, (0.1, 0.0, 0.0)))
    found.until(lambda: counts[Outcome.FUSED] == 2, 'the second fix is not fused')
    found.node.report()
    assert found.node._health._unused(found.node.scenario.sensors) == ''


def test_readings_that_are_set_aside_as_intended_are_no_problem(monkeypatch):
    now = 0.0
    monkeypatch.setattr(channel, 'monotonic', lambda: now)
    for outcome, why in (
        (Outcome.MOVING, ''),
        (Outcome.REJECTED, 'rejected: outside the gate'),
        (Outcome.FUSED, ''),
    ):
        counts = Counter()
        use = channel.Use()
        for _ in range(20):
            now += 1.0
            counts[outcome] += 1
            use.count(counts)
        assert use.problem(1.0) == why
    assert use.problem(1e-3) == ''


def test_a_kept_datum_is_used_again(started, tmp_path):
    file = tmp_path / 'datum.yaml'
    file.write_text(f'/**: {{ros__parameters: {{datum: {list(DATUM)}}}}}\n')
    before = file.read_text()
    found = started(**FIRST_FIX, datum_file=str(file))
    estimates = received(found, 'estimate/fix')
    send = found.publisher(NavSatFix, 'fix')
    found.until(
        lambda: found.node._estimates._globe._fix_publisher.get_subscription_count(), 'unmatched'
    )
    send.publish(fix(found, (1.0, 2.0, 3.0)))
    found.until(estimates, 'no estimate as a fix')
    (message,) = estimates()
    local = TangentPlane(DATUM).local(place_of(message))
    np.testing.assert_allclose(local[:2], found.node._online.belief.mean[:2], atol=1e-6)
    P = np.array(message.position_covariance).reshape(3, 3)
    np.testing.assert_allclose(P[:2, :2], found.node._online.belief.covariance[:2, :2], atol=1e-6)
    assert file.read_text() == before


def test_a_datum_that_cannot_be_kept_is_a_warning(started, tmp_path, capfd):
    found = started(**FIRST_FIX, datum_file=str(tmp_path / 'no' / 'datum.yaml'))
    send = found.publisher(NavSatFix, 'fix')
    counts = found.node._online.counts['gnss']
    send.publish(fix(found, (0.0, 0.0, 0.0)))
    found.until(lambda: counts[Outcome.FUSED] == 1, 'the fix is not fused')
    assert 'datum_file' in capfd.readouterr().err


@pytest.mark.parametrize(
    ('changes', 'why'),
    [
        ({'datum': '[1.0, 2.0]'}, 'datum: expected latitude, longitude and altitude, got 2'),
        ({'datum_file': '/tmp/datum.yaml'}, 'datum_file: expected none beside a datum'),
        ({'gnss.fields': "['east', 'east']"}, 'expected east, north, up'),
        ({'gnss.mount.translation': '[1.0]'}, 'gnss.mount.translation: '),
    ],
)
def test_what_is_wrong_is_refused_at_the_start(started, changes, why):
    with pytest.raises(ValueError, match=why):
        started(**changes)
