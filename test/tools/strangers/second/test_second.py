# SPDX-License-Identifier: Apache-2.0
"""The recordings of the second set are deterministic and finite, and the package reads them."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from .. import recordings as first
from ..matching import is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..simulation import Readings
from .messages import ALL_FORMS
from .recordings import RECORDINGS, TABLE, write
from .systems import SYSTEMS

#: Recordings of the tests that decide: one of each system.
ALWAYS = (
    'ferry_compass_crane', 'crawler_tracks_correlated', 'train_gnss_rounded', 'blimp_fix_swapped',
    'taxi_gyro_tilted', 'copter_all_noise_double', 'diver_pressure_waves', 'crane_swing_dead_zone',
    'hoist_drum_batched', 'chamber_weak_cooling', 'chain_middle_clogged', 'rod_gyro_saturated',
    'satellite_wheel_reversed', 'arm_gyro_lag',
)  # fmt: skip
#: All names; those that are not in ALWAYS run only with ``--all`` or where the test is named.
MOSTLY_THOROUGH = [
    pytest.param(name, marks=[pytest.mark.thorough] if name not in ALWAYS else [])
    for name in RECORDINGS
]
#: Length of the recordings of the quick tests, as a share of that of the system.
SHORT = 0.04


def shortened(recording: Recording) -> Recording:
    """Return a recording of the first seconds, without a fault of its messages."""
    seconds = {'seconds': SHORT * SYSTEMS[recording.system].physics['seconds']}
    return replace(recording, fault=Recording.fault, physics={**recording.physics, **seconds})


def simulated(name: str) -> Readings:
    """Return the readings of a recording with its fault, in full length."""
    recording = RECORDINGS[name]
    system = SYSTEMS[recording.system]
    rng = np.random.default_rng(recording.seed)
    readings = system.simulate(rng, {**system.physics, **recording.physics})
    recording.fault(readings, rng)
    return readings


def test_the_set_is_large_and_its_names_and_seeds_are_unique() -> None:
    clean = sum(recording.kind == 'clean' for recording in TABLE)
    assert clean >= 12
    assert len(RECORDINGS) - clean >= 38
    everything = [*first.TABLE, *TABLE]
    assert len({recording.name for recording in everything}) == len(everything)
    assert len({recording.seed for recording in everything}) == len(everything)
    assert {recording.system for recording in TABLE} == {*SYSTEMS}


def test_only_clean_recordings_are_without_a_fault() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.slow
@pytest.mark.parametrize('system', SYSTEMS)
def test_a_short_recording_is_the_same_again_and_is_read(system: str, tmp_path: Path) -> None:
    recording = shortened(RECORDINGS[f'{system}_clean'])
    for folder in 'ab':
        write_files(recording, SYSTEMS[system], tmp_path / folder, ALL_FORMS)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    run = kr.replay(tmp_path / 'a' / 'recording.mcap', tmp_path / 'a' / 'robot.yaml')
    for name, sensor in run.sensors.items():
        assert len(sensor.nis) > 0, name
        assert np.isfinite(sensor.nis).all(), name


@pytest.mark.parametrize('name', RECORDINGS)
def test_the_parameter_file_of_the_second_set_is_accepted(name: str, tmp_path: Path) -> None:
    file = tmp_path / 'robot.yaml'
    file.write_text(edited(RECORDINGS[name], SYSTEMS[RECORDINGS[name].system]))
    assert len(kr.load(file).sensors) > 1


@pytest.mark.slow
@pytest.mark.parametrize('name', MOSTLY_THOROUGH)
@pytest.mark.thorough
def test_readings_are_finite_the_same_again_and_all_in_the_recording(
    name: str, tmp_path: Path
) -> None:
    readings, again = simulated(name), simulated(name)
    assert [*readings] == [*again]
    for sensor, channel in readings.items():
        assert len(channel.time) > 50, sensor
        for part in ('time', 'value', 'noise', 'stamp', 'received'):
            numbers = getattr(channel, part)
            assert len(numbers) == len(channel.time)
            assert np.isfinite(numbers).all(), f'{sensor} {part}'
            assert (numbers == getattr(again[sensor], part)).all(), f'{sensor} {part}'
    write(name, tmp_path)
    bag = Bag(tmp_path / 'recording.mcap')
    assert not bag.damage
    count = Counter(message.topic for message in bag.messages(bag.topics))
    assert count == {f'/{channel.topic}': len(channel.time) for channel in readings.values()}


@pytest.mark.thorough
@pytest.mark.slow
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_fault_changes_the_readings_or_the_file(name: str) -> None:
    recording = RECORDINGS[name]
    system = SYSTEMS[recording.system]
    faulty = simulated(name)
    good = system.simulate(np.random.default_rng(recording.seed), system.physics)

    def differs(sensor: str) -> bool:
        one, other = faulty[sensor], good[sensor]
        return len(one.time) != len(other.time) or any(
            not np.array_equal(getattr(one, part), getattr(other, part))
            for part in ('value', 'noise', 'stamp')
        )

    faults = recording.kind != 'clean' and not recording.edits
    assert not faults or any(differs(sensor) for sensor in good)


@pytest.mark.slow
def test_clean_recordings_are_consistent_and_a_fault_is_not(tmp_path: Path) -> None:
    ratio = {}
    for name in ('diver_clean', 'diver_fresh_water'):
        write(name, tmp_path / name)
        run = kr.replay(tmp_path / name / 'recording.mcap', tmp_path / name / 'robot.yaml')
        ratio[name] = run.sensors['sounder'].nis.mean()
    assert abs(ratio['diver_clean'] - 1.0) < 0.25
    assert ratio['diver_fresh_water'] > 5.0


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('blimp_radar_turned', 'rotated', 'radar', True),
        ('blimp_radar_turned', 'rotated', 'fix', True),
        ('blimp_radar_turned', 'bias', 'radar.bearing', True),
        ('blimp_radar_turned', 'bias', 'fix.x', False),
        ('crane_command_delay', 'input delay', 'speed', True),
        ('crane_command_delay', 'parameter', 'lag', True),
        ('crane_command_delay', 'stamps late', 'trolley', False),
        ('train_gnss_clock', 'stamps early', 'gnss', True),
        ('copter_barometer_walk', 'random walk', 'barometer', True),
    ],
)
def test_findings_match_what_is_alike_and_the_kinds_of_this_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


@pytest.mark.slow
def test_the_program_lists_and_writes_this_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'second', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'second', '--out', str(tmp_path), 'blimp_clean'])
    assert {path.name for path in (tmp_path / 'blimp_clean').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip
