# SPDX-License-Identifier: Apache-2.0
"""A replay does what the estimator does with the same messages, however they arrived."""

import hashlib
import json
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from static_frames import message as transforms

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.serialization import serialize_message
from tools.bench.linear import parameters
from tools.bench.replays import record

import kalman_ros as kr
from kalman_ros.bags import columns
from kalman_ros.bags.columns import Rows
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.recording_writer import RecordingWriter
from kalman_ros.bags.replay import _out_of_step, estimator_settings, replay, replay_bag
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.codecs.tick import write_tick
from kalman_ros.programs.replay import pictures, program, statistics, tables

GYRO = ['angular_velocity.x', 'angular_velocity.y']
START = 1_700_000_000_000_000_000
VALUES = {**parameters(4, 2, 'kf', 100.0), 'input.topic': 'input'}


def wire(signal, time, *values):
    return bytes(serialize_message(SignalCodec(signal).encode(time, *values)))


def recorded(folder, arrivals, values=VALUES, extra=(), namespace=''):
    """Write readings and inputs, each (received, stamp, source, values), and return the folder."""
    scenario = estimator_settings(values).scenario
    with RecordingWriter(folder) as writer:
        writer.add(f'{namespace}/y', 'sensor_msgs/msg/JointState')
        writer.add(f'{namespace}/input', 'std_msgs/msg/Float64MultiArray')
        for received, stamp, source, numbers in arrivals:
            signal = scenario.input if source is None else scenario.sensors[source].signal
            topic = f'{namespace}/{signal.topic}'
            writer.write(topic, START + received, wire(signal, START + stamp, np.array(numbers)))
        for topic, received, data in extra:
            writer.write(topic, START + received, data)
    return folder


#: As they are received: late, doubled, from the future, not finite, older than the window.
ARRIVALS = [
    (10**7, 10**7, 'y', [0.1, 0.2]),
    (2 * 10**7, 2 * 10**7, None, [0.5]),
    (4 * 10**7, 4 * 10**7, 'y', [0.2, 0.3]),
    (5 * 10**7, 3 * 10**7, 'y', [0.3, 0.1]),
    (5 * 10**7 + 1, 3 * 10**7, 'y', [0.3, 0.1]),
    (6 * 10**7, 9 * 10**9, 'y', [0.0, 0.0]),
    (7 * 10**7, 7 * 10**7, 'y', [np.nan, 0.0]),
    (2 * 10**9, 2 * 10**9, 'y', [0.1, 0.1]),
    (2 * 10**9 + 10**7, 10**7, 'y', [0.0, 0.0]),
]


def test_it_is_the_online_estimator_fed_in_the_order_of_reception(tmp_path):
    found = replay(recorded(tmp_path / 'a', ARRIVALS), VALUES)
    online = estimator_settings(VALUES).estimator()
    outcomes, means = [], []
    for received, stamp, source, numbers in ARRIVALS:
        now, time = START + received, START + stamp
        if source is None:
            online.add_input(now, np.array(numbers), now)  # the message has no stamp
            continue
        outcome, correction = online.add_reading(source, time, np.array(numbers), None, now)
        outcomes.append(outcome.name)
        if correction is not None:
            means.append(online.belief.mean)
    y = found.sensors['y']
    assert list(y.outcome) == outcomes
    assert {'FUSED', 'DUPLICATE', 'FUTURE', 'NOT_FINITE', 'TOO_OLD'} == set(outcomes)
    assert dict(y.counts) == dict(online.counts['y'])
    np.testing.assert_array_equal(found.beliefs.mean, means)
    np.testing.assert_array_equal(found.beliefs.covariance[-1], online.belief.covariance)
    readings = [each for each in ARRIVALS if each[2]]
    offset = 1e-9 * (START - found.start)
    np.testing.assert_allclose(y.received, [r * 1e-9 + offset for r, *_ in readings], atol=1e-6)
    np.testing.assert_allclose(y.stamp, [s * 1e-9 + offset for _, s, *_ in readings], atol=1e-6)
    np.testing.assert_array_equal(found.inputs.value, [[0.5]])
    assert np.isnan(y.innovation[y.outcome == 'FUTURE']).all()
    assert np.isfinite(y.innovation[y.outcome == 'FUSED']).all()


def in_lockstep(path):
    """Write a recording in lockstep, and return where it is."""
    scenario = estimator_settings(VALUES).scenario
    with RecordingWriter(path) as writer:
        writer.add('/y', 'sensor_msgs/msg/JointState')
        writer.add('/input', 'std_msgs/msg/Float64MultiArray')
        writer.add('/tick', 'sensor_msgs/msg/TimeReference')
        for step in range(5):
            received, time = START + 10**6 * step, step * 10**7
            y = wire(scenario.sensors['y'].signal, time, np.array([0.1 * step, 0.0]))
            writer.write('/y', received, y)
            writer.write('/tick', received + 1, write_tick(time, ('y',)))
            writer.write(
                '/input', received + 2, wire(scenario.input, time, np.array([2.0 * step]))
            )
    return path


def test_inputs_in_lockstep_act_from_the_time_of_the_step_that_they_answer(tmp_path):
    """The time of simulation, and not that of reception, is that of an input without a stamp."""
    found = replay(in_lockstep(tmp_path / 'a'), VALUES)
    assert found.lockstep
    # the last one answers a step without a successor
    np.testing.assert_allclose(found.inputs.stamp, [0.0, 0.01, 0.02, 0.03], atol=1e-12)
    np.testing.assert_allclose(found.inputs.value[:, 0], [0.0, 2.0, 4.0, 6.0])


@pytest.mark.parametrize(
    ('lockstep', 'offset', 'named'),
    [(True, 0.013, True), (True, 0.0, False), (False, 0.013, False)],
)
def test_offsets_that_leave_the_steps_of_lockstep_are_named(lockstep, offset, named):
    found = estimator_settings({**VALUES, 'y.stamp_offset': offset})
    said = _out_of_step(SimpleNamespace(lockstep=lockstep, settings=found))
    assert ('where y.stamp_offset can only be whole periods' in said) is named
    assert bool(said) is named


def test_a_topic_of_ticks_without_a_tick_is_not_lockstep(tmp_path):
    """A plant may offer the topic and run in real time."""
    bag = recorded(tmp_path / 'bag', ARRIVALS)
    with RecordingWriter(tmp_path / 'offered') as writer:
        writer.add('/tick', 'sensor_msgs/msg/TimeReference')
        for topic, (kind,) in Bag(bag).topics.items():
            writer.add(topic, kind)
        for message in Bag(bag).messages(['/y', '/input']):
            writer.write(message.topic, message.time, message.data)
    run, expected = replay(tmp_path / 'offered', VALUES), replay(bag, VALUES)
    assert not run.lockstep
    np.testing.assert_array_equal(run.beliefs.mean, expected.beliefs.mean)


def test_messages_that_are_none_are_counted(tmp_path):
    broken = [('/y', 3 * 10**7, b'\0\1\0\0xx'), ('/y', 4 * 10**7, bytes(2_000_000))]
    found = replay(recorded(tmp_path / 'a', ARRIVALS[:1], extra=broken), VALUES)
    assert found.sensors['y'].undecodable == 2
    assert found.sensors['y'].fused == 1


def test_inputs_that_never_acted_are_counted_and_not_listed(tmp_path):
    lost = [(3 * 10**7, 3 * 10**7, None, [np.nan]), (4 * 10**7, 4 * 10**7, None, [np.inf])]
    broken = [('/input', 5 * 10**7, b'\0\1\0\0xx')]
    found = replay(recorded(tmp_path / 'a', [*ARRIVALS[:2], *lost], extra=broken), VALUES)
    assert found.inputs.value.tolist() == [[0.5]]
    assert found.notes == (
        '/input: 2 dropped: not finite', '/input: 1 dropped: not decodable, or too long'
    )  # fmt: skip


def test_inputs_of_another_size_are_counted(tmp_path):
    found = replay(recorded(tmp_path / 'a', ARRIVALS[:2]), {**VALUES, 'input.fields': ['data[3]']})
    assert len(found.inputs.value) == 0
    assert found.notes == ('/input: 1 dropped: wrong size',)


@pytest.mark.parametrize(
    ('changes', 'drawn'), [({}, True), ({'y.enabled': False, 'sensors': ['y']}, False)]
)
@pytest.mark.slow
def test_what_no_picture_can_show_is_left_out(changes, drawn, tmp_path):
    arrivals = [(k * 10**7, k * 10**7, 'y', [0.1, 1e308 if k == 5 else 0.2]) for k in range(30)]
    acting = [(10**7, 10**7, None, [0.5])]
    bag = recorded(tmp_path / 'a', sorted([*arrivals, *acting], key=lambda row: row[0]))
    found = replay(bag, {**VALUES, **changes})
    paths = pictures.draw_all(found, tmp_path)
    assert all(path.stat().st_size > 1000 for path in paths)
    assert ('delays.png' in [path.name for path in paths]) == drawn


def test_a_part_of_the_recording(tmp_path):
    record(tmp_path / 'a', VALUES, 2.0)
    found = replay(tmp_path / 'a', VALUES, start=0.5, end=1.0)
    assert len(found.sensors['y'].stamp) == 51
    assert found.sensors['y'].received[0] == pytest.approx(0.5)
    assert len(replay(tmp_path / 'a', VALUES, end=1e300).sensors['y'].stamp) == 200
    with pytest.raises(ValueError, match='nothing could be replayed'):
        replay(tmp_path / 'a', VALUES, start=1e300)
    for wrong in ((1.0, 1.0), (-1.0, 2.0)):
        with pytest.raises(ValueError, match='part: expected 0 <= start < end'):
            replay(tmp_path / 'a', VALUES, start=wrong[0], end=wrong[1])


@pytest.mark.slow
def test_the_command_takes_a_part_and_a_namespace(tmp_path, capsys):
    """Of 100 readings 10 ms apart in /robot, those from .2 to .4 s; in / there are none."""
    every = [(k * 10**7, k * 10**7, 'y', [0.1, 0.2]) for k in range(100)]
    file = tmp_path / 'robot.yaml'
    file.write_text(json.dumps({'/**': {'ros__parameters': VALUES}}))
    typed = [str(recorded(tmp_path / 'a', every, namespace='/robot')), '--params-file', str(file)]
    typed += ['--out', str(tmp_path / 'out'), '--from', '0.2', '--to', '0.4']
    with pytest.raises(SystemExit) as ended:
        program.main([*typed, '--namespace', '/robot'])
    assert ended.value.code in (0, 1), capsys.readouterr().err
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert sum(summary['sensors']['y']['outcomes'].values()) == 21
    with pytest.raises(SystemExit) as ended:
        program.main(typed)
    assert ended.value.code == 2
    assert 'no topic /y; recorded are /robot/input, /robot/y' in capsys.readouterr().err


def test_estimates_at_a_rate_are_predictions(tmp_path):
    found = replay(recorded(tmp_path / 'a', ARRIVALS[:3]), {**VALUES, 'publish_rate': 1000.0})
    time = found.beliefs.time
    assert len(time) == 21
    np.testing.assert_allclose(np.diff(time), 1e-3, atol=1e-6)


def test_smoothing_uses_later_readings_and_says_where_it_matters(tmp_path):
    record(tmp_path / 'a', VALUES, 4.0)
    found = replay(tmp_path / 'a', VALUES, smooth=True)
    smoothed, beliefs = found.smoothed, found.beliefs
    np.testing.assert_allclose(smoothed.time, beliefs.time, atol=1e-9)
    # the last knows of no later one; all others are no less certain
    np.testing.assert_array_equal(smoothed.mean[-1], beliefs.mean[-1])
    assert (smoothed.std <= beliefs.std + 1e-12).all()
    assert smoothed.std[200, 0] < 0.9 * beliefs.std[200, 0]
    label, time, size, sigmas = statistics.largest_change(found)
    row = np.argmin(np.abs(smoothed.time - time))
    change = (smoothed.mean - beliefs.mean)[row]
    assert size in change
    assert sigmas == pytest.approx(np.max(np.abs(smoothed.mean - beliefs.mean) / beliefs.std))
    assert label in [found.scenario.model.state.label(name) for name in ('x0', 'x1', 'x2', 'x3')]


def test_smoothing_by_way_of_the_disk_gives_the_same_bytes(tmp_path, monkeypatch):
    record(tmp_path / 'a', VALUES, 2.0)
    whole = replay(tmp_path / 'a', VALUES, smooth=True).smoothed
    monkeypatch.setattr(columns, '_MOST', 5000)
    parts = replay(tmp_path / 'a', VALUES, smooth=True).smoothed
    assert isinstance(parts.mean, np.memmap)
    for name in ('time', 'mean', 'covariance'):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_filter_that_has_no_smoother_says_so(tmp_path, monkeypatch):
    record(tmp_path / 'a', VALUES, 1.0)
    monkeypatch.setattr(Bag, 'messages', None)  # refused before the first one is read
    with pytest.raises(ValueError, match='filter: expected one of'):
        replay(tmp_path / 'a', {**VALUES, 'filter': 'steady_state'}, smooth=True)


def test_a_truth_gives_errors(tmp_path):
    scenario = estimator_settings(VALUES).scenario
    extra = [
        ('/truth', stamp, wire(scenario.state, START + stamp, np.full(4, stamp * 1e-7)))
        for stamp in (0, 10**8)
    ]
    with pytest.raises(ValueError, match=r'truth: the recording has no topic /truth'):
        replay(recorded(tmp_path / 'a', ARRIVALS[:4]), VALUES, truth='truth')
    with RecordingWriter(tmp_path / 'b') as writer:
        writer.add('/truth', 'sensor_msgs/msg/JointState')
        writer.add('/y', 'sensor_msgs/msg/JointState')
        for topic, received, data in extra:
            writer.write(topic, START + received, data)
        for message in Bag(tmp_path / 'a').messages(['/y']):
            writer.write(*(message.topic, message.time, message.data))
    found = replay(tmp_path / 'b', VALUES, truth='truth')
    truth = found.truth.at(found.scenario, found.beliefs.time)
    offset = 1e-9 * (found.start - START)
    expected = np.tile(((found.beliefs.time + offset) * 100.0)[:, np.newaxis], 4)
    np.testing.assert_allclose(truth, expected, rtol=1e-6)
    errors = statistics.errors(found)
    wanted = np.sqrt(np.mean((truth - found.beliefs.mean) ** 2, axis=0))
    np.testing.assert_allclose(errors.rms, wanted)
    assert errors.nees > 10.0  # it is wrong, and sure of it


def test_a_sensor_with_too_few_innovations_is_not_called_consistent(tmp_path, monkeypatch):
    few = replay(recorded(tmp_path / 'a', ARRIVALS), VALUES)
    count = statistics.statistics(few.sensors['y']).count
    assert (
        tables.claim(few)
        == f'what could be judged is consistent; too few innovations of y ({count})'
    )
    monkeypatch.setattr(statistics, '_LEAST', count + 1)
    assert 'too few innovations of y' in tables.claim(few)
    monkeypatch.setattr(statistics, '_LEAST', count)
    assert tables.claim(few) == 'The filter is consistent.'


@pytest.mark.parametrize(('lost', 'fails'), [(20, False), (21, True)])
def test_a_sensor_that_is_mostly_dropped_fails_however_good_the_rest_is(tmp_path, lost, fails):
    later = [10**7 * (k + 1) for k in range(40)]
    arrivals = [(t, t if k >= lost else later[39], 'y', [0.0, 0.0]) for k, t in enumerate(later)]
    found = replay(recorded(tmp_path / 'a', arrivals), {**VALUES, 'future_tolerance': 0.001})
    assert statistics.statistics(found.sensors['y']).dropped == lost
    dropped = [c for c in statistics.checks(found, None) if c.name == 'dropped of y']
    assert [c.passed for c in dropped] == ([False] if fails else [])


def test_a_missing_input_is_named_with_the_nearest_topic_and_none_without_an_input(tmp_path):
    recorded(tmp_path / 'a', ARRIVALS)
    found = replay(tmp_path / 'a', {**VALUES, 'input.topic': 'inputs'})
    assert "no input /inputs (did you mean '/input'?)" in ' '.join(found.notes)
    still = {
        'model': 'linear', 'model_parameters.states': ['a', 'b'], 'model_parameters.inputs': [],
        'model_parameters.A': [0.0] * 4, 'model_parameters.B': [],
        'model_parameters.noise_density': [1.0, 1.0], 'sensors': ['y'],
        **{name: value for name, value in VALUES.items() if name.startswith('y.')},
        'y.measures': ['a', 'b'], 'initial_state': [0.0, 0.0], 'initial_estimate': [0.0, 0.0],
        'initial_std': [1.0, 1.0], 'state.type': 'sensor_msgs/JointState',
        'state.fields': ['position[a]', 'position[b]'],
    }  # fmt: skip
    assert not any('input' in note for note in replay(tmp_path / 'a', still).notes)


@pytest.mark.slow
def test_a_consistent_filter_passes_and_one_that_is_sure_of_itself_fails(tmp_path):
    record(tmp_path / 'a', VALUES, 20.0)
    good = statistics.checks(replay(tmp_path / 'a', VALUES), None)
    assert [check.name for check in good] == ['NIS of y / 2', 'whiteness of y']
    assert all(check.passed for check in good)
    bad = replay(tmp_path / 'a', {**VALUES, 'y.noise': [0.25, 0.25]})
    assert not statistics.checks(bad, None)[0].passed
    stiff = {**VALUES, 'model_parameters.noise_density': [1e-6] * 4}
    slow = statistics.checks(replay(tmp_path / 'a', stiff), None)
    assert not slow[1].passed


@pytest.mark.slow
def test_innovations_of_placed_poles_are_not_expected_to_be_white(tmp_path):
    record(tmp_path / 'a', VALUES, 60.0)
    placed = {**VALUES, 'filter': 'luenberger', 'observer_poles': [-5.0, -6.0, -7.0, -8.0]}
    replayed = replay(tmp_path / 'a', placed)
    (nis,) = statistics.checks(replayed, None)
    assert (nis.name, nis.passed) == ('NIS of y / 2', True)
    shown = statistics.statistics(replayed.sensors['y']).whiteness
    assert abs(shown) > statistics.whiteness_bound(6000, 2, 1e-3)  # though the filter is right


def test_what_it_lacks_is_said_in_a_line_with_what_there_is(tmp_path):
    recorded(tmp_path / 'a', ARRIVALS)
    with pytest.raises(ValueError) as caught:
        replay(tmp_path / 'a', 'gnss_imu')
    assert str(caught.value).startswith('sensor gnss: the recording has no topic /')
    assert str(caught.value).endswith('; recorded are /input, /y')
    with pytest.raises(ValueError, match='sensor y: expected sensor_msgs/msg/Imu on /y, recorded'):
        replay(tmp_path / 'a', {**VALUES, 'y.type': 'sensor_msgs/Imu', 'y.fields': GYRO})
    with pytest.raises(ValueError, match='unknown parameter'):
        replay(tmp_path / 'a', {**VALUES, 'wheels': 4})
    with pytest.raises(ValueError, match="unknown scenario 'robot'"):
        replay(tmp_path / 'a', 'robot')


def test_a_topic_with_two_types_is_refused_and_one_of_no_use_is_not(tmp_path):
    with RecordingWriter(tmp_path / 'a') as writer:
        writer.add('/y', 'sensor_msgs/msg/JointState')
        writer.add('/strange', 'my_robot/msg/Gripper')
        writer.write('/strange', START, b'\0\1\0\0')
    with RecordingWriter(tmp_path / 'b') as writer:
        writer.add('/y', 'sensor_msgs/msg/Imu')
        writer.write('/y', START, b'\0\1\0\0')
    (tmp_path / 'both').mkdir()
    for file in tmp_path.glob('[ab]/*.mcap'):
        file.rename(tmp_path / 'both' / file.name)
    with pytest.raises(ValueError, match='recorded is sensor_msgs/msg/Imu and sensor_msgs/msg/J'):
        replay(tmp_path / 'both', VALUES)


def test_without_its_input_a_recording_is_replayed_and_a_note_says_so(tmp_path):
    record(tmp_path / 'a', VALUES, 1.0)
    found = replay(tmp_path / 'a', VALUES)
    assert found.notes == ('The recording has no input /input: it is taken to be idle.',)


def test_a_recording_without_a_clock_is_replayed_with_simulated_time(tmp_path):
    found = replay(recorded(tmp_path / 'a', ARRIVALS), {**VALUES, 'use_sim_time': True})
    assert found.notes == ('The recording has no /clock: messages come when recorded.',)
    plain = replay(tmp_path / 'a', VALUES)
    np.testing.assert_array_equal(found.beliefs.mean, plain.beliefs.mean)


def test_an_interrupted_replay_leaves_complete_files(tmp_path):
    record(tmp_path / 'a', VALUES, 20.0)

    def interrupt(done):
        if done > 5.0:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        replay(tmp_path / 'a', VALUES, out=tmp_path / 'out', progress=interrupt)
    bag = Bag(tmp_path / 'out')
    assert not bag.damage
    assert len(list(bag.messages(['/estimate']))) > 500
    assert bag.topics['/estimate/covariance'] == {'std_msgs/msg/Float64MultiArray'}


def test_a_recording_is_not_replaced_by_its_replay(tmp_path):
    folder = tmp_path / 'a'
    record(folder, VALUES, 1.0)
    for source in (folder, next(folder.glob('*.mcap'))):
        with pytest.raises(ValueError, match='out: expected another folder'):
            replay(source, VALUES, out=folder)
    assert len(list(Bag(folder).messages(['/y']))) == 100


def test_initialpose_is_a_reset(tmp_path):
    message = PoseWithCovarianceStamped()
    message.pose.pose.position.x = 5.0
    message.pose.covariance[:] = (1e-6 * np.eye(6)).ravel()
    scenario = estimator_settings('mass_spring_damper_2d').scenario
    source = scenario.sensors['position']
    with RecordingWriter(tmp_path / 'a') as writer:
        for name, topic in (('position', '/position'), ('velocity', '/velocity')):
            kind = scenario.sensors[name].signal.type.replace('/', '/msg/')
            writer.add(topic, kind)
        writer.add('/initialpose', 'geometry_msgs/msg/PoseWithCovarianceStamped')
        y, R = np.array([1.0, 1.0]), 1e4 * np.eye(2)
        for k in (0, 2):
            time = START + k * 10**7
            writer.write('/position', time, wire(source.signal, time, y, R))
        writer.write('/initialpose', START + 10**7, bytes(serialize_message(message)))
    found = replay(tmp_path / 'a', 'mass_spring_damper_2d')
    x = found.scenario.model.state.names.index('x')
    assert abs(found.beliefs.mean[0, x]) < 0.5
    assert found.beliefs.mean[1, x] == pytest.approx(5.0, abs=1e-3)


def test_a_start_from_nothing_has_estimates_once_all_is_known(tmp_path):
    source = estimator_settings('mass_spring_damper_2d').scenario.sensors['position']
    rng = np.random.default_rng(4)
    with RecordingWriter(tmp_path / 'a') as writer:
        writer.add('/position', source.signal.type.replace('/', '/msg/'))
        for k in range(20):
            time = START + k * 10**7
            y = np.array([3.0, -2.0]) + 0.01 * rng.normal(size=2)
            writer.write('/position', time, wire(source.signal, time, y, 1e-4 * np.eye(2)))
    chosen = {'model': 'mass_spring_damper_2d', 'sensors': ['position']}
    exact, near = (
        replay(tmp_path / 'a', {**chosen, 'initial_std': [std] * 4}) for std in (np.inf, 1e4)
    )
    assert len(exact.beliefs.time) == len(near.beliefs.time) - 1 == 19
    np.testing.assert_allclose(exact.beliefs.mean, near.beliefs.mean[1:], rtol=1e-4, atol=1e-4)
    assert np.isfinite(exact.beliefs.covariance).all()
    smoothed = replay(
        tmp_path / 'a', {**chosen, 'initial_std': [np.inf] * 4}, smooth=True
    ).smoothed
    assert len(smoothed.time) == 19 and np.isfinite(smoothed.covariance).all()
    with pytest.raises(ValueError, match='^initial_std: a start from infinite variances takes'):
        replay(tmp_path / 'a', {**chosen, 'initial_std': [np.inf] * 4, 'filter': 'ukf'})


def test_nothing_is_smoothed_across_a_start_from_nothing(tmp_path):
    """After a gap the robot is elsewhere: what comes later says nothing of before."""
    source = estimator_settings('mass_spring_damper_2d').scenario.sensors['position']
    with RecordingWriter(tmp_path / 'a') as writer:
        writer.add('/position', source.signal.type.replace('/', '/msg/'))
        for k in [*range(20), *range(80, 100)]:
            time = START + k * 10**7
            y = np.array([3.0, -2.0]) if k < 20 else np.zeros(2)
            writer.write('/position', time, wire(source.signal, time, y, 1e-4 * np.eye(2)))
    chosen = {'model': 'mass_spring_damper_2d', 'sensors': ['position'], 'max_gap': 0.5}
    found = replay(tmp_path / 'a', {**chosen, 'initial_std': [np.inf] * 4}, smooth=True).smoothed
    x = found.mean[:, [0, 2]]
    assert len(x) == 38
    np.testing.assert_allclose(x[:19], np.tile([3.0, -2.0], (19, 1)), atol=0.1)
    np.testing.assert_allclose(x[19:], 0.0, atol=0.1)


@pytest.mark.parametrize('placed', [True, False])
def test_initialpose_in_another_frame_takes_a_transform_of_the_recording(tmp_path, placed):
    message = PoseWithCovarianceStamped()
    message.header.frame_id = 'site'
    message.pose.pose.position.x = 5.0
    message.pose.covariance[:] = (1e-6 * np.eye(6)).ravel()
    sensors = estimator_settings('mass_spring_damper_2d').scenario.sensors
    source = sensors['position']
    with RecordingWriter(tmp_path / 'a') as writer:
        for name in ('position', 'velocity'):
            writer.add(f'/{name}', sensors[name].signal.type.replace('/', '/msg/'))
        writer.add('/initialpose', 'geometry_msgs/msg/PoseWithCovarianceStamped')
        writer.add('/tf', 'tf2_msgs/msg/TFMessage')
        y, R = np.array([1.0, 1.0]), 1e4 * np.eye(2)
        writer.write('/position', START, wire(source.signal, START, y, R))
        if placed:
            there = ('map', 'site', (10.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))
            writer.write('/tf', START + 10**6, transforms(there))
        writer.write('/initialpose', START + 10**7, bytes(serialize_message(message)))
        time = START + 2 * 10**7
        writer.write('/position', time, wire(source.signal, time, y, R))
    found = replay(tmp_path / 'a', 'mass_spring_damper_2d')
    x = found.scenario.model.state.names.index('x')
    assert found.beliefs.mean[1, x] == pytest.approx(15.0 if placed else 0.0, abs=0.5)
    assert any("expected frame 'map'" in note for note in found.notes) != placed


def test_the_name_at_the_front_door_is_the_same(tmp_path):
    assert kr.replay is replay


def test_rows_beyond_a_size_are_on_disk(monkeypatch):
    monkeypatch.setattr(columns, '_MOST', 1000)
    rows = Rows(a=(1,), b=(2, 2))
    for k in range(500):
        rows.append(np.array([float(k)]), None if k % 2 else np.full((2, 2), float(k)))
        assert len(rows._rows) <= 1000
    found = rows.columns()
    np.testing.assert_array_equal(found['a'][:, 0], np.arange(500.0))
    assert np.isnan(found['b'][1::2]).all()
    np.testing.assert_array_equal(found['b'][::2, 1, 0], np.arange(0.0, 500.0, 2.0))


def digest(found):
    whole = hashlib.sha256()
    for array in (found.beliefs.time, found.beliefs.mean, found.beliefs.covariance):
        whole.update(np.ascontiguousarray(array).tobytes())
    whole.update(np.ascontiguousarray(found.sensors['y'].innovation).tobytes())
    return whole.hexdigest()


@pytest.mark.thorough
@pytest.mark.slow
def test_a_hundred_replays_beside_busy_processes_have_one_hash(tmp_path):
    record(tmp_path / 'a', VALUES, 0.3)
    bag, settings = Bag(tmp_path / 'a'), estimator_settings(VALUES)
    busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(8)]
    try:
        found = {digest(replay_bag(bag, settings)) for _ in range(100)}
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert len(found) == 1


def test_the_nis_without_rejected_readings_is_told(tmp_path):
    """One outlier, which the gate rejects, is most of the mean."""
    arrivals = [(k * 10**7, k * 10**7, 'y', [0.0, 0.0]) for k in range(1, 30)]
    arrivals[20] = (*arrivals[20][:3], [1e3, 0.0])
    found = replay(recorded(tmp_path / 'a', arrivals), {**VALUES, 'y.gate': 0.999})
    numbers = statistics.statistics(found.sensors['y'])
    nis = found.sensors['y'].nis
    assert numbers.rejected == 1 and nis.argmax() == 20
    assert numbers.accepted_nis == pytest.approx(np.mean(np.delete(nis, 20)) / 2.0)
    assert numbers.nis == pytest.approx(np.mean(nis) / 2.0)
    assert numbers.nis > 100.0 * numbers.accepted_nis
    said = f'y: NIS {numbers.accepted_nis:.3g} without the rejected readings'
    assert said in list(tables.sentences(found, None))
    without = replay(recorded(tmp_path / 'b', ARRIVALS[:4]), VALUES)
    assert not any('NIS' in sentence for sentence in tables.sentences(without, None))
