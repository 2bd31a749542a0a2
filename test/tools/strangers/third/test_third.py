# SPDX-License-Identifier: Apache-2.0
"""The recordings of the third set are deterministic and finite, and the package reads them."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from .. import recordings as first
from ..matching import interval, is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..second import recordings as second
from ..simulation import Readings
from .bodies import AVAILABLE
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, write
from .systems import MUJOCO, SYSTEMS

#: Names of the systems that MuJoCo simulates.
BODIES = {system.name for system in MUJOCO}
#: Recordings of the tests that decide: one of each system.
ALWAYS = (
    'forklift_wheel_slip', 'hovercraft_locked_out', 'glider_pitot_iced', 'walker_vision_repeated',
    'rov_compass_iron', 'boom_valve_overlap', 'heater_plate_saturated', 'conveyor_correlated',
    'battery_shunt_saturated', 'gimbal_gyro_crossed', 'cartpole_gyro_quiet',
    'drone_imu_5_degrees',
)  # fmt: skip
#: All names; those that are not in ALWAYS run only with ``--all`` or where the test is named.
MOSTLY_THOROUGH = [
    pytest.param(name, marks=[pytest.mark.thorough] if name not in ALWAYS else [])
    for name in RECORDINGS
]


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
    assert clean >= 10
    assert len(TABLE) - clean >= 44
    everything = [*first.TABLE, *second.TABLE, *TABLE]
    assert len({recording.name for recording in everything}) == len(everything)
    assert len({recording.seed for recording in everything}) == len(everything)


def test_systems_of_mujoco_are_in_the_set_where_it_can_be_imported() -> None:
    assert {recording.system for recording in TABLE} == {*SYSTEMS} | BODIES
    assert BODIES & {*SYSTEMS} == (BODIES if AVAILABLE else set())
    assert {recording.system for recording in RECORDINGS.values()} == {*SYSTEMS}


def test_only_clean_recordings_are_without_a_fault() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.parametrize(
    'system',
    # the import of mujoco starts a process
    [pytest.param(n, marks=[pytest.mark.slow] if n in BODIES else []) for n in SYSTEMS],
)
def test_a_short_recording_is_the_same_again_and_is_read(system: str, tmp_path: Path) -> None:
    recording = Recording(system, 'short', 1, physics={'seconds': 3.0})
    for folder in 'ab':
        write_files(recording, SYSTEMS[system], tmp_path / folder, FORMS)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    run = kr.replay(tmp_path / 'a' / 'recording.mcap', tmp_path / 'a' / 'robot.yaml')
    for name, sensor in run.sensors.items():
        assert len(sensor.nis) > 0, name
        assert np.isfinite(sensor.nis).all(), name


@pytest.mark.parametrize('name', RECORDINGS)
def test_the_parameter_file_of_the_third_set_is_accepted(name: str, tmp_path: Path) -> None:
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
        assert len(channel.time) > 40, sensor
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


@pytest.mark.slow
@pytest.mark.parametrize('name', MOSTLY_THOROUGH)
@pytest.mark.thorough
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
    for name in ('heater_clean', 'heater_warm_room'):
        write(name, tmp_path / name)
        run = kr.replay(tmp_path / name / 'recording.mcap', tmp_path / name / 'robot.yaml')
        ratio[name] = run.sensors['air'].nis.mean()
    assert abs(ratio['heater_clean'] - 1.0) < 0.15
    assert ratio['heater_warm_room'] > 1.5


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('hovercraft_locked_out', 'gate', 'gnss', True),
        ('hovercraft_hard_iron', 'bias', 'magnetometer.forward', True),
        ('hovercraft_hard_iron', 'bias', 'magnetometer.left', False),
        ('battery_shunt_saturated', 'saturated', 'shunt', True),
        ('conveyor_correlated', 'correlated noise', 'laser.v', True),
        ('conveyor_correlated', 'correlated noise', 'marks.s', False),
        ('forklift_scanner_ahead', 'lever arm', 'scanner', True),
        ('rov_weak_astern', 'asymmetric gain', 'surge', True),
        ('drone_imu_5_degrees' if AVAILABLE else 'boom_imu_2_degrees', 'rotated', 'gnss', False),
    ],
)
def test_findings_match_the_kinds_of_this_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_this_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'third', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(RECORDINGS)
    main(['--set', 'third', '--out', str(tmp_path), 'heater_clean'])
    assert {path.name for path in (tmp_path / 'heater_clean').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip


def test_coordinates_without_a_bias_have_none() -> None:
    found = {'kind': 'bias', 'subject': 'magnetometer'}
    off = 'forward [T] by +3.03e-06 ± 4e-08, left [T] by {} ± 4e-08'
    for other, expected in (('-1.85e-08', 'in'), ('-3e-07', 'out')):
        finding = {**found, 'sentence': off.format(other)}
        assert interval(finding, RECORDINGS['hovercraft_hard_iron']) == expected
