# SPDX-License-Identifier: Apache-2.0
"""The profiles of Fast DDS 2 and 3 differ by one name; and each process names one."""

from pathlib import Path

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.middleware.transport import LOOPBACK, PROFILES, PROMPT, profiles


@pytest.mark.parametrize('path', [LOOPBACK, PROMPT], ids=lambda path: path.stem)
def test_both_versions_say_the_same(path):
    newer = path.with_stem(f'{path.stem}_3').read_text()
    assert newer.replace('heartbeat_period', 'heartbeatPeriod').replace(
        '<!-- Fast DDS 3', '<!-- Fast DDS'
    ) == (path.read_text())


def test_one_variable_names_a_file_that_exists():
    [(name, file)] = profiles(PROMPT).items()
    assert name in PROFILES and Path(file).exists()
