# SPDX-License-Identifier: Apache-2.0
"""Sound in, track out: the real nodes, with microphones in place of the plant's own bearings."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from scipy.io import wavfile

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.harness import NodeError, Run
from kalman_ros.nodes.microphone_array.options import MicrophoneArrayOptions
from kalman_ros.simulation.sound import SimulatedSound, Sound

NAME = 'sound_tracker'
NIS = 'estimate/innovation/bearing'


def tracker(**options):
    """Return a run, in which the plant's ticks go through the microphones if in lockstep."""
    return Run(NAME, **options)


@pytest.mark.thorough
def test_a_sound_is_tracked_and_found():
    with tracker(seed=1) as run:
        run.advance(36.0)
        loop, heard = run.trajectory(), run.recorder['bearing']
        nis = run.recorder[NIS].values[:, -1]
        run.wait(lambda: run.reported('microphone_array', 'bearings') == '181', 60.0, lambda: '')
        assert run.diagnostics['microphone_array'].message == 'source detected'
    assert len(loop.time) == 36 * 20 + 1
    # a bearing every 200 ms, each with its variance, smaller as the robot comes near
    assert len(heard.stamp) == len(nis) == 36 * 5 + 1
    sigma = np.sqrt(heard.covariance[:, 0, 0])
    assert sigma[:20].mean() > 0.01 > 0.006 > sigma[-20:].mean()
    truth = loop.truth[::4]
    error = heard.values[:, 0] - np.arctan2(truth[:, 1], truth[:, 0])
    for statistic in (error**2 / sigma**2, nis):
        low, high = chi_square_bounds(1.0, 2.0 / len(statistic), 1e-4)
        assert low < statistic.mean() < high
    off = np.hypot(*(loop.truth - loop.estimate)[:, :2].T)
    std = np.sqrt(np.trace(loop.covariance[:, :2, :2], axis1=1, axis2=2))
    assert off[0] > 10.0
    assert off[-1] < 4.0
    assert std[-1] < 4.0
    assert np.mean(off < 3.0 * std) > 0.97
    # by then it is nearly there
    assert np.hypot(*loop.truth[-1, :2]) < 8.0 < 25.0 < np.hypot(*loop.truth[0, :2])


@pytest.mark.thorough
def test_the_same_seed_sounds_the_same():
    def estimates(seed):
        with tracker(seed=seed) as run:
            run.advance(2.0)
            return b''.join(run.recorder.raw['estimate']), b''.join(run.recorder.raw['bearing'])

    first = estimates(3)
    assert len(first[1]) > 0
    assert first == estimates(3)
    assert first[1] != estimates(4)[1]


@pytest.mark.thorough
def test_where_nothing_sounds_nothing_is_published_and_the_loop_goes_on():
    with tracker(only={'microphone_array': {'sound_level': 0.0}}) as run:
        run.advance(2.0)
        silent = 'frames without a source'
        said = lambda: run.reported('microphone_array', silent)  # noqa: E731
        run.wait(lambda: said() == '11', 60.0, said)
        assert 'nothing to publish' in run.diagnostics['microphone_array'].message
        assert len(run.recorder['bearing'].stamp) == 0
        assert len(run.recorder['estimate'].stamp) == 41


@pytest.mark.thorough
def test_what_a_bearing_must_be_like_changes_live():
    with tracker() as run:
        run.advance(1.0)
        before = len(run.recorder['bearing'].stamp)
        run.set_parameter('largest_std', 1e-6, 'microphone_array')
        run.advance(1.0)
        assert before == len(run.recorder['bearing'].stamp) == 6
        unclear = 'frames without a direction'
        said = lambda: run.reported('microphone_array', unclear)  # noqa: E731
        run.wait(lambda: said() == '5', 60.0, said)


@pytest.mark.thorough
def test_asked_again_it_says_the_same():
    """Without answers the plant repeats its tick, and the bearing is repeated."""
    with tracker(overrides={'lockstep_timeout': 0.4}) as run:
        run.advance(1.15)  # the next step has a bearing
        run.kill('estimator')
        with pytest.raises(NodeError, match='the estimator did not answer'):
            run.advance(1.0)
        run.start('estimator')
        run.set_parameter('run_until', 2.0)
        last = lambda: run.recorder['bearing'].stamp.max() * 1e-9  # noqa: E731
        run.wait(lambda: last() > 2.99, 30.0, lambda: f'the last bearing is of {last()} s')
        raw, stamps = run.recorder.raw['bearing'], run.recorder['bearing'].stamp
    by_stamp = {}
    for stamp, message in zip(stamps.tolist(), raw):
        by_stamp.setdefault(stamp, set()).add(message)
    assert len(by_stamp) == 11
    assert len(raw) > 11
    assert all(len(messages) == 1 for messages in by_stamp.values())


@pytest.mark.thorough
def test_in_real_time():
    with tracker(lockstep=False) as run:
        run.advance(3.0)
        heard, believed = run.recorder['bearing'], run.recorder['estimate']
    assert 10 <= len(heard.stamp) <= 17
    assert len(believed.stamp) >= 0.8 * len(heard.stamp)
    assert np.all(np.abs(heard.values[:, 0] - np.arctan2(25.0, 5.0)) < 0.2)


@pytest.mark.thorough
def test_a_recording_is_heard(tmp_path):
    options = MicrophoneArrayOptions()
    array = MicrophoneArray(np.array(options.microphones))
    hear = SimulatedSound(array, 16000.0, 16000, Sound(1.0, (200.0, 3000.0), 0.02), 0)
    seconds = [hear(20.0 * np.array([np.cos(b), np.sin(b)])) for b in (2.0, -1.0)]
    sound = np.concatenate(seconds, axis=1).T
    path = tmp_path / 'two_places.wav'
    wavfile.write(path, 16000, np.round(sound / np.abs(sound).max() * 32767).astype(np.int16))
    only = {'microphone_array': {'recording': str(path)}}
    with tracker(lockstep=False, nodes=('microphone_array',), only=only) as run:
        log = run.processes['microphone_array'].output
        run.wait(lambda: 'is over after 2 s' in log(), 60.0, lambda: 'the recording goes on')
        run.spin(0.2)
        heard = run.recorder['bearing']
    assert len(heard.stamp) == 10
    np.testing.assert_allclose(np.diff(heard.stamp), 200_000_000)
    expected = np.repeat([2.0, -1.0], 5)
    std = np.sqrt(heard.covariance[:, 0, 0])
    assert np.all(np.abs(heard.values[:, 0] - expected) < 4.0 * std)
    assert np.all(std < 0.01)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ('parameters', 'says'),
    [
        (
            {'bearing_sensor': 'bearin'},
            r"bearing_sensor: expected a sensor among \(bearing\), got 'bearin'",
        ),
        ({'recording': '/nowhere.wav'}, "recording: cannot read '/nowhere.wav'"),
        ({'microphones': [0.0, 0.0, 1.0, 0.0]}, 'microphones: expected x and y of three or more'),
        ({'band': [200.0]}, 'band: expected 2 numbers, got 1'),
        ({'band': [200.0, 300.0]}, 'band: expected 32 frequencies of a frame or more, got 11'),
    ],
)
def test_a_mistake_is_one_line(parameters, says):
    only = {'microphone_array': parameters}
    died = f'microphone_array died: microphone_array: {says}'
    run = tracker(lockstep=False, nodes=('microphone_array',), only=only)
    with pytest.raises(NodeError, match=died), run:
        pass
