# SPDX-License-Identifier: Apache-2.0
"""What the picture of a study names."""

import pytest

pytest.importorskip('rclpy')

from kalman_ros.programs.study.study_run import Ran, described


@pytest.mark.parametrize(
    ('runs', 'text'),
    [
        ([], ''),
        ([Ran('linear', 'kf', 0, 8.0)], 'linear, filter kf, seed 0, 8 s'),
        ([Ran('linear', '', 1, 8.0)], 'linear, seed 1, 8 s'),
        (
            [Ran('linear', 'kf', 0, 2.0), Ran('linear', '', 0, 20.0), Ran('a', 'ekf', 2, 3.0)],
            'a, linear, filter ekf and kf, seed 0 and 2, 3 runs of 2 to 20 s',
        ),
        ([Ran('linear', 'kf', 0, 5.0)] * 4, 'linear, filter kf, seed 0, 4 runs of 5 s'),
    ],
)
def test_the_caption_of_a_study(runs, text):
    assert described(runs) == text
