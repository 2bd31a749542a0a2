# SPDX-License-Identifier: Apache-2.0
"""The recordings are those of the table, the same each time, and their files are accepted."""

from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr

from .recordings import RECORDINGS, TABLE, write
from .systems import SYSTEMS

pytestmark = pytest.mark.slow


def test_every_name_is_unique() -> None:
    assert len(RECORDINGS) == len(TABLE) >= 40


def test_seeds_differ() -> None:
    assert len({recording.seed for recording in TABLE}) == len(TABLE)


@pytest.mark.parametrize('name', ['tank_clean', 'oven_core_late'])
def test_a_recording_has_the_same_bytes_again(name: str, tmp_path: Path) -> None:
    for folder in 'ab':
        write(name, tmp_path / folder)
    for file in ('recording.mcap', 'robot.yaml'):
        first, second = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert len(first) > 100
        assert first == second


@pytest.mark.parametrize('name', mostly_thorough(SYSTEMS, 'rover', 'quadrotor'))
def test_the_parameter_file_is_accepted(name: str, tmp_path: Path) -> None:
    file = tmp_path / 'robot.yaml'
    file.write_text(SYSTEMS[name].parameters)
    assert {*kr.load(file).sensors} <= {*SYSTEMS[name].simulate(*_still(name))}


def test_a_clean_recording_is_consistent_and_a_fault_is_not(tmp_path: Path) -> None:
    ratio = {}
    for name in ('tank_clean', 'tank_valve'):
        write(name, tmp_path / name)
        folder = tmp_path / name
        run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml')
        ratio[name] = run.sensors['lower'].nis.mean()
    assert abs(ratio['tank_clean'] - 1.0) < 0.15
    assert ratio['tank_valve'] > 1.5


def _still(name: str) -> tuple[np.random.Generator, dict[str, float]]:
    return np.random.default_rng(1), SYSTEMS[name].physics
