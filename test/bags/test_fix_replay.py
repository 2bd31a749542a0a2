# SPDX-License-Identifier: Apache-2.0
"""A recording of satellite fixes through the replay: the datum, and fixes that are none."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from rclpy.serialization import serialize_message
from sensor_msgs.msg import NavSatFix

from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import estimator_settings, replay
from kalman_ros.codecs.fixes import place_of
from kalman_ros.codecs.messages import decode, write_stamp
from kalman_ros.core.geodesy import Place, TangentPlane
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.pipeline.global_topics import GlobalTopics
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

DATUM = Place(49.8728, 8.6512, 144.0)
START = 1_700_000_000_000_000_000
STEP = 200_000_000
ALONE = {
    name: value
    for name, value in from_file(shipped.file('navsat'), 'estimator').items()
    if not name.startswith(('imu.', 'gnss.mount'))
}
ALONE['sensors'] = ['gnss']
FIRST = {'datum': [float('inf')]}


def recorded(folder, fixes):
    """Write fixes, each metres of the datum and a status, five a second."""
    plane = TangentPlane(DATUM)
    with RecordingWriter(folder) as writer:
        writer.add('/fix', 'sensor_msgs/msg/NavSatFix')
        for k, (local, status) in enumerate(fixes):
            message = NavSatFix()
            message.latitude, message.longitude, message.altitude = plane.place(np.array(local))
            message.status.status = status
            write_stamp(message.header.stamp, START + k * STEP)
            writer.write('/fix', START + k * STEP, bytes(serialize_message(message)))
    return folder


def path(first):
    """Return a straight path, east at 10 m/s, after a message without a fix."""
    moves = [((first + 2.0 * k, 5.0, 0.0), 0) for k in range(50)]
    return [((7000.0, 0.0, 0.0), -1), *moves]


def test_the_first_good_fix_is_the_origin_and_others_are_counted(tmp_path):
    found = replay(recorded(tmp_path / 'a', path(300.0)), ALONE, FIRST)
    gnss = found.sensors['gnss']
    assert dict(gnss.counts) == {Outcome.NO_FIX: 1, Outcome.FUSED: 50}
    assert gnss.outcome[0] == 'NO_FIX'
    assert np.isnan(gnss.value[0]).all()
    np.testing.assert_allclose(gnss.stamp, 0.2 * np.arange(51), atol=1e-6)
    # north is another direction there: by 300 m of longitude
    first, last = (TangentPlane(DATUM).place(np.array((x, 5.0, 0.0))) for x in (300.0, 398.0))
    there = TangentPlane(first).local(last)
    assert there[1] == pytest.approx(-0.0055, abs=1e-4)
    np.testing.assert_allclose(gnss.value[[1, -1]], [[0.0, 0.0], there[:2]], atol=1e-6)


def test_the_datum_of_the_parameters_or_of_a_file_is_the_origin(tmp_path):
    bag, file = recorded(tmp_path / 'a', path(300.0)), tmp_path / 'datum.yaml'
    file.write_text(f'/**: {{ros__parameters: {{datum: {list(DATUM)}}}}}\n')
    for changes in ({}, {**FIRST, 'datum_file': str(file)}):
        found = replay(bag, ALONE, changes)
        np.testing.assert_allclose(found.sensors['gnss'].value[-1], [398.0, 5.0], atol=1e-6)


def test_a_replay_writes_no_datum_file(tmp_path):
    file = tmp_path / 'datum.yaml'
    replay(recorded(tmp_path / 'a', path(0.0)), ALONE, {**FIRST, 'datum_file': str(file)})
    assert not file.exists()


def test_what_it_records_has_the_datum_once_and_the_estimate_as_fixes(tmp_path):
    bag = recorded(tmp_path / 'a', path(300.0))
    found = replay(bag, ALONE, {'publish_fix': True}, out=tmp_path / 'out')
    written = {'/estimate/datum': [], '/estimate/fix': []}
    for message in Bag(tmp_path / 'out').messages(list(written)):
        written[message.topic].append(place_of(decode(message.data, NavSatFix)))
    assert written['/estimate/datum'] == [pytest.approx(DATUM)]
    assert len(written['/estimate/fix']) == len(found.beliefs.time)
    local = TangentPlane(DATUM).local(written['/estimate/fix'][-1])
    np.testing.assert_allclose(local[:2], found.beliefs.mean[-1, :2], atol=1e-6)


@pytest.mark.parametrize(
    ('values', 'why'),
    [
        ({'publish_fix': True, 'model': 'cart_pole'}, 'publish_fix: expected states x and y'),
        ({'publish_fix': True, 'model': 'turn_rate'}, 'publish_fix: expected a datum, or a'),
    ],
)
def test_an_estimate_that_is_no_place_is_refused(tmp_path, values, why):

    known = estimator_settings(values)
    with pytest.raises(ValueError, match=why):
        GlobalTopics(known.scenario, known.options, known.origin())
