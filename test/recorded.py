# SPDX-License-Identifier: Apache-2.0
"""Data that others recorded and published, which lies beside the repository."""

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get('KALMAN_ROS_DATA', Path(__file__).parents[2] / 'shared' / 'data'))


def data(name):
    """Return the path of a file; the test is skipped where it is not."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f'{path.name} is not in {DATA}; set KALMAN_ROS_DATA')
    return path
