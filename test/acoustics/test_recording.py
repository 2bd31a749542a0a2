# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from scipy.io import wavfile

from kalman_ros.acoustics.recording import read


def test_frames_of_a_recording(tmp_path):
    sound = np.arange(60, dtype=np.int16).reshape(20, 3)
    wavfile.write(tmp_path / 'three.wav', 10, sound)
    recorded = read(tmp_path / 'three.wav', 3)
    assert recorded.sample_rate == 10.0
    np.testing.assert_array_equal(recorded.frame(0.5, 4), sound[5:9].T)
    np.testing.assert_array_equal(recorded.frame(1.6, 4), sound[16:].T)
    assert recorded.frame(1.7, 4) is None


@pytest.mark.parametrize('kind', [np.uint8, np.int16, np.int32, np.float32])
def test_the_unit_is_that_of_the_file(tmp_path, kind):
    wavfile.write(tmp_path / 'one.wav', 10, np.array([3, 4, 5], kind))
    np.testing.assert_array_equal(read(tmp_path / 'one.wav', 1).channels, [[3.0, 4.0, 5.0]])


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(ValueError, match="recording: cannot read '.*nowhere.wav'"):
        read(tmp_path / 'nowhere.wav', 3)
    (tmp_path / 'text.wav').write_text('no sound')
    with pytest.raises(ValueError, match="recording: cannot read '.*text.wav'"):
        read(tmp_path / 'text.wav', 3)
    wavfile.write(tmp_path / 'two.wav', 10, np.zeros((5, 2), np.int16))
    with pytest.raises(ValueError, match='recording: expected 3 channels, .* got 2'):
        read(tmp_path / 'two.wav', 3)
