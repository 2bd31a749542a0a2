# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from kalman_ros.acoustics.array import MicrophoneArray
from kalman_ros.simulation.sound import SimulatedSound, Sound

ARRAY = MicrophoneArray([0.0, 0.0, 3.43, 0.0, 0.0, 1.0])
BAND = (100.0, 3000.0)


def heard(place, sound, samples=4000, seed=0, array=ARRAY):
    return SimulatedSound(array, 8000.0, samples, sound, seed)(np.array(place))


def test_sound_arrives_later_and_weaker_by_the_distance():
    near, far, _ = heard([-10.0, 0.0], Sound(2.0, BAND, 0.0))
    # 3.43 m behind is 10 ms later, which is 80 samples
    correlation = np.correlate(far, near, 'full')
    assert correlation.argmax() - (len(near) - 1) == 80
    np.testing.assert_allclose(near.std(), 2.0 / 10.0, rtol=0.05)
    np.testing.assert_allclose(far[80:] * 13.43, near[:-80] * 10.0, atol=1e-9)


def test_there_is_nothing_outside_the_band_but_noise():
    frame = heard([0.0, 50.0], Sound(1.0, (1000.0, 2000.0), 0.0), 8000)
    frequencies = np.fft.rfftfreq(8000, 1.0 / 8000.0)
    power = np.abs(np.fft.rfft(np.hanning(8000) * frame)) ** 2
    outside = (frequencies < 950.0) | (frequencies > 2050.0)
    assert power[:, outside].sum() < 1e-6 * power.sum()


def test_each_microphone_has_noise_of_its_own_and_the_seed_tells_all():
    quiet = Sound(0.0, BAND, 0.3)
    frame = heard([5.0, 5.0], quiet)
    np.testing.assert_allclose(frame.std(axis=1), 0.3, rtol=0.05)
    assert np.all(np.abs(np.corrcoef(frame) - np.eye(3)) < 0.05)
    np.testing.assert_array_equal(frame, heard([5.0, 5.0], quiet))
    assert np.abs(frame - heard([5.0, 5.0], quiet, seed=1)).max() > 0.1
    louder = heard([5.0, 5.0], quiet._replace(level=1.0))
    np.testing.assert_allclose(louder - frame, heard([5.0, 5.0], Sound(1.0, BAND, 0.0)), atol=1e-9)


def test_a_source_on_a_microphone_is_still_finite():
    assert np.isfinite(heard([0.0, 0.0], Sound(1.0, BAND, 0.0))).all()


def test_a_sound_without_frequencies_is_refused():
    with pytest.raises(ValueError, match='band: expected frequencies up to 4000 Hz'):
        heard(
            [1.0, 0.0],
            Sound(1.0, (5000.0, 6000.0), 0.0),
            array=MicrophoneArray([[0.1, 0.0], [-0.05, 0.0866], [-0.05, -0.0866]]),
        )


def test_sound_grows_with_the_inverse_of_the_distance_down_to_a_centimetre():
    one = MicrophoneArray([[0.0, 0.0], [0.0, 2.0], [2.0, 0.0]])
    for distance, counts in ((2.0, 2.0), (0.5, 0.5), (0.02, 0.02), (0.005, 0.01), (0.0, 0.01)):
        first, *_ = heard(one.positions[0] + [-distance, 0.0], Sound(1.0, BAND, 0.0), array=one)
        np.testing.assert_allclose(first.std(), 1.0 / counts, rtol=0.05)
