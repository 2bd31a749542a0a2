# SPDX-License-Identifier: Apache-2.0
"""The recordings of the seventh set are the same again, obey their models and show faults."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr

from ..matching import is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..sets import RECORDINGS as EVERYTHING
from ..sets import SETS
from ..simulation import Channel
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, jittery, write
from .systems import SYSTEMS


def surprise(recording: Recording, folder: Path) -> dict[str, tuple[float, int]]:
    """Return the sum of the NIS of each sensor, and the number of its readings."""
    write_files(recording, SYSTEMS[recording.system], folder, FORMS)
    run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml')
    return {
        name: (float(np.nansum(sensor.nis)), int(np.isfinite(sensor.nis).sum()))
        for name, sensor in run.sensors.items()
    }


def sizes(system: str) -> dict[str, int]:
    """Return how many coordinates each sensor of a system has."""
    plan = kr.load(SYSTEMS[system].robots / f'{system}.yaml')
    return {name: timed.sensor.output.size for name, timed in plan.sensors.items()}


def test_the_seventh_set_is_large_and_its_names_and_seeds_are_unique() -> None:
    clean = sum(recording.kind == 'clean' for recording in TABLE)
    assert clean >= 12
    assert 58 <= len(TABLE) - clean <= 90
    assert {recording.system for recording in TABLE} == {*SYSTEMS}
    assert len(EVERYTHING) == sum(len(table) for table in SETS.values())
    assert len({recording.seed for recording in TABLE}) == len(TABLE)


def test_recordings_of_the_seventh_set_with_a_fault_say_what_it_concerns() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.parametrize('system', SYSTEMS)
def test_the_same_seed_gives_the_same_bytes_in_the_seventh_set(
    system: str, tmp_path: Path
) -> None:
    recording = Recording(system, 'short', 1, physics={'seconds': 6.0})
    for folder in 'ab':
        write_files(recording, SYSTEMS[system], tmp_path / folder, FORMS)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    other = replace(recording, seed=2)
    write_files(other, SYSTEMS[system], tmp_path / 'c', FORMS)
    assert (tmp_path / 'c' / 'recording.mcap').read_bytes() != (
        tmp_path / 'a' / 'recording.mcap'
    ).read_bytes()


@pytest.mark.parametrize('system', SYSTEMS)
def test_the_parameter_files_of_the_seventh_set_are_accepted(system: str, tmp_path: Path) -> None:
    texts = {
        edited(recording, SYSTEMS[system]) for recording in TABLE if recording.system == system
    }
    for text in texts:
        (tmp_path / 'robot.yaml').write_text(text)
        assert kr.load(tmp_path / 'robot.yaml').sensors


def test_jittery_messages_come_later_and_in_their_order() -> None:
    time = np.arange(50.0) / 10.0
    ones = np.ones((50, 1))
    channel = Channel('a', 'range', time, ones, ones.copy(), time.copy(), time + 0.001)
    jittery(channel, np.random.default_rng(0), 0.3)
    assert (np.diff(channel.received) >= 0.0).all()
    assert (channel.received > time).all()
    assert (channel.received < time + 0.302).all()
    assert (channel.stamp == time).all()


def test_a_clean_recording_of_the_seventh_set_is_consistent_and_a_fault_is_not(
    tmp_path: Path,
) -> None:
    good = surprise(RECORDINGS['trolley_clean_blocks'], tmp_path / 'a')
    for name, (total, count) in good.items():
        assert abs(total / count - 1.0) < 5.0 * np.sqrt(2.0 / count), name
    faulty = surprise(RECORDINGS['trolley_odometer_worn'], tmp_path / 'b')
    assert faulty['odometer'][0] > 2.0 * good['odometer'][0]


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('system', SYSTEMS)
def test_systems_of_the_seventh_set_obey_their_models_over_seeds(
    system: str, tmp_path: Path
) -> None:
    runs = [
        surprise(Recording(system, 'clean', 9000 + seed), tmp_path / str(seed))
        for seed in range(8)
    ]
    for name, size in sizes(system).items():
        total, count = (sum(run[name][k] for run in runs) for k in (0, 1))
        assert abs(total / count / size - 1.0) < max(0.05, 4.0 * np.sqrt(2.0 / count / size)), name


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize(
    'name',
    [name for name, one in RECORDINGS.items() if one.kind not in ('clean', 'correlated noise')],
)
def test_a_fault_of_the_seventh_set_is_visible(name: str, tmp_path: Path) -> None:
    recording = RECORDINGS[name]
    faulty = surprise(recording, tmp_path / 'faulty')
    plain = replace(recording, kind='clean', fault=Recording.fault, physics={}, edits={})
    good = surprise(plain, tmp_path / 'good')
    if recording.kind == 'losses':
        assert faulty[recording.subject][1] < good[recording.subject][1]
    else:
        change = sum(faulty[sensor][0] - good[sensor][0] for sensor in good)
        missing = sum(good[sensor][1] - faulty[sensor][1] for sensor in good)
        assert abs(change) > 150.0 or missing > 100


def test_hum_correlates_the_innovations_of_two_sensors_of_a_ram(tmp_path: Path) -> None:
    write('ram_hum', tmp_path)
    run = kr.replay(tmp_path / 'recording.mcap', tmp_path / 'robot.yaml')
    one, other = run.sensors['pressure'], run.sensors['rod']
    near = np.abs(other.stamp[:, np.newaxis] - one.stamp).argmin(axis=1)
    assert np.corrcoef(one.innovation[near, 0], other.innovation[:, 0])[0, 1] > 0.4


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('weeder_right_wheel', 'scale', 'wheels.right', True),
        ('weeder_right_wheel', 'scale', 'wheels.left', False),
        ('weeder_commands_late', 'parameter', 'command_time', True),
        ('trolley_loaded', 'parameter', 'B[1]', True),
        ('yacht_declination', 'rotated', 'gnss', True),
        ('yacht_keel_up', 'input gain', 'aside', True),
        ('horse_radio_delay', 'parameter', 'masts.range_offset', True),
        ('horse_barn', 'outliers', 'masts.range_1', False),
        ('elbow_play', 'backlash', 'joint', True),
        ('ram_one_side', 'asymmetric gain', 'valve', True),
        ('orangery_soil_drifts', 'drift', 'probes.air', False),
        ('telescope_stars_swapped', 'swapped', 'stars', True),
        ('mixer_weak_brine', 'scale', 'probe', True),
        ('ram_hum', 'correlated noise', 'rod', True),
    ],
)
def test_findings_match_the_kinds_of_the_seventh_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_the_seventh_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'seventh', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'seventh', '--out', str(tmp_path), 'orangery_clean'])
    assert {path.name for path in (tmp_path / 'orangery_clean').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip
    write('orangery_clean', tmp_path / 'again')
    once, again = ((tmp_path / at / 'recording.mcap').read_bytes()
                   for at in ('orangery_clean', 'again'))  # fmt: skip
    assert once == again
