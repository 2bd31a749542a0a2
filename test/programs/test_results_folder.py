# SPDX-License-Identifier: Apache-2.0
"""The folder of the results of a program."""

from pathlib import Path

import pytest

from kalman_ros.programs.results import of_recording


@pytest.mark.parametrize(
    ('bag', 'name'),
    [
        ('monday', 'monday'),
        ('monday.mcap', 'monday'),
        ('out/linear/recording', 'linear'),
        ('out/cart_pole/recording', 'cart_pole'),
        ('out/cart_pole/recording/recording_0.mcap', 'cart_pole'),
        ('out/cart_pole/against/recording', 'cart_pole_against'),
        ('/recording', 'recording'),
    ],
)
def test_results_of_two_recordings_have_two_folders(bag, name):
    """`demo --record` names each of its recordings alike."""
    assert of_recording(Path(bag), 'doctor') == Path('out') / name / 'doctor'
