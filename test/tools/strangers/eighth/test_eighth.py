# SPDX-License-Identifier: Apache-2.0
"""The recordings of the eighth set obey their files without a fault, and show it with one."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from ..matching import is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..sets import RECORDINGS as EVERYTHING
from ..sets import SETS, write
from ..simulation import Channel, Readings
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, north_first
from .systems import SYSTEMS
from .vehicles import air_pressure

#: What shows a fault if not the sum of the NIS by more than 150: stamps that repeat are refused.
_ELSEWHERE = {'kiwi_mocap_rounded'}


def replayed(recording: Recording, folder: Path) -> dict[str, np.ndarray]:
    """Return the NIS of each sensor of a recording."""
    write_files(recording, SYSTEMS[recording.system], folder, FORMS)
    run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml')
    return {name: sensor.nis for name, sensor in run.sensors.items()}


def dimensions(file: Path) -> dict[str, int]:
    """Return how many coordinates the readings of each sensor of a file have."""
    sensors = kr.load(file).sensors
    return {name: len(source.sensor.covariance) for name, source in sensors.items()}


def simulated(recording: Recording) -> Readings:
    """Return the readings of a recording."""
    system, rng = SYSTEMS[recording.system], np.random.default_rng(recording.seed)
    readings = system.simulate(rng, {**system.physics, **recording.physics})
    recording.fault(readings, rng)
    return readings


def innocent(recording: Recording) -> Recording:
    """Return the recording with the same seed and without its fault."""
    return replace(recording, fault=Recording.fault, physics={}, edits={})


def test_names_and_seeds_of_the_eighth_set_are_unique_and_twelve_are_clean() -> None:
    kinds = Counter(recording.kind for recording in TABLE)
    assert kinds['clean'] == 12
    assert 70 <= len(TABLE) <= 90
    assert {recording.system for recording in TABLE} == {*SYSTEMS}
    assert len(EVERYTHING) == sum(len(table) for table in SETS.values())
    assert len({recording.seed for recording in TABLE}) == len(TABLE)


def test_no_system_of_the_eighth_set_is_in_another_set() -> None:
    others = {each.system for name, table in SETS.items() if name != 'eighth'
              for each in table.values()}  # fmt: skip
    assert not others & {*SYSTEMS}


@pytest.mark.parametrize('recording', TABLE, ids=[recording.name for recording in TABLE])
def test_the_file_of_a_recording_of_the_eighth_set_is_edited_and_accepted(
    recording: Recording, tmp_path: Path
) -> None:
    system = SYSTEMS[recording.system]
    text = edited(recording, system)
    assert (text != system.parameters) is bool(recording.edits)
    assert {*recording.physics} <= {*system.physics}
    if recording.edits:
        (tmp_path / 'robot.yaml').write_text(text)
        assert kr.load(tmp_path / 'robot.yaml').sensors


@pytest.mark.parametrize('system', SYSTEMS)
def test_seconds_of_a_system_of_the_eighth_set_are_the_same_bytes_again(
    system: str, tmp_path: Path
) -> None:
    recording = Recording(system, 'short', 1, physics={'seconds': 5.0})
    for folder in 'ab':
        nis = replayed(recording, tmp_path / folder)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    for name, numbers in nis.items():
        assert len(numbers) > 0, name
        assert np.isfinite(numbers).all(), name


@pytest.mark.parametrize('system', ['cyclist', 'canal', 'hydrofoil'])
def test_a_system_of_the_eighth_set_obeys_its_file(system: str, tmp_path: Path) -> None:
    numbers: dict[str, list[float]] = {}
    for seed in range(3):
        for name, nis in replayed(Recording(system, 'x', seed), tmp_path / f'{seed}').items():
            numbers.setdefault(name, []).extend(nis)
    sizes = dimensions(tmp_path / '0' / 'robot.yaml')
    for name, every in numbers.items():
        expected = sizes[name]
        deviation = np.sqrt(2.0 / expected / len(every))
        assert abs(np.mean(every) / expected - 1.0) < 4.5 * deviation, name


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('system', SYSTEMS)
def test_a_system_of_the_eighth_set_obeys_its_file_over_twelve_seeds(
    system: str, tmp_path: Path
) -> None:
    numbers: dict[str, list[float]] = {}
    for seed in range(1, 13):
        for name, nis in replayed(Recording(system, 'x', seed), tmp_path / f'{seed}').items():
            numbers.setdefault(name, []).extend(nis)
    sizes = dimensions(tmp_path / '1' / 'robot.yaml')
    for name, every in numbers.items():
        assert 0.965 < np.mean(every) / sizes[name] < 1.035, name


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('name', [name for name, r in RECORDINGS.items() if r.kind != 'clean'])
def test_a_fault_of_the_eighth_set_is_visible(name: str, tmp_path: Path) -> None:
    faulty = replayed(RECORDINGS[name], tmp_path / 'faulty')
    good = replayed(innocent(RECORDINGS[name]), tmp_path / 'good')
    sums = [sum(nis.sum() for nis in each.values()) for each in (faulty, good)]
    if name in _ELSEWHERE:
        repeated = np.isnan(faulty[RECORDINGS[name].subject]).mean()
        assert repeated > 0.4
    else:
        assert abs(sums[0] - sums[1]) > 150.0


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_recording_of_the_eighth_set_is_finite_the_same_again_and_whole(
    name: str, tmp_path: Path
) -> None:
    readings, again = simulated(RECORDINGS[name]), simulated(RECORDINGS[name])
    for sensor, channel in readings.items():
        for part in ('time', 'value', 'noise', 'stamp', 'received'):
            numbers = getattr(channel, part)
            assert len(numbers) == len(channel.time) > 15
            assert np.isfinite(numbers).all(), f'{sensor} {part}'
            assert (numbers == getattr(again[sensor], part)).all(), f'{sensor} {part}'
    write(name, tmp_path)
    bag = Bag(tmp_path / 'recording.mcap')
    assert not bag.damage
    count = Counter(message.topic for message in bag.messages(bag.topics))
    assert count == {f'/{channel.topic}': len(channel.time) for channel in readings.values()}


def test_the_pressure_of_the_air_falls_with_the_height() -> None:
    # the standard atmosphere at 0, 1000 and 5000 m
    pressures = air_pressure(np.array([0.0, 1000.0, 5000.0]))
    assert pressures == pytest.approx([101325.0, 89874.6, 54019.9], rel=1e-4)


def test_a_vector_by_north_first_has_its_axes_and_noise_exchanged() -> None:
    time = np.zeros(1)
    channel = Channel('a', 'velocity', time, np.array([[1.0, 2.0, 3.0]]),
                      np.array([[0.1, 0.2, 0.3]]), time, time)  # fmt: skip
    north_first(channel, np.random.default_rng(0))
    assert channel.value.tolist() == [[2.0, 1.0, -3.0]]
    assert channel.noise.tolist() == [[0.2, 0.1, -0.3]]


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('wheelchair_wheels_apart', 'scale', 'odom.omega', True),
        ('wheelchair_wheels_apart', 'scale', 'odom.v', False),
        ('wheelchair_scanner_turned', 'rotated', 'amcl', True),
        ('wheelchair_joystick_late', 'input delay', 'v', True),
        ('ebike_child_seat', 'parameter', 'accelerometer.mass', True),
        ('ebike_accelerometer_nods', 'bias', 'accelerometer', True),
        ('kiwi_marker_ahead', 'lever arm', 'mocap', True),
        ('hexacopter_imu_arrow_left', 'input rotated', 'wx', True),
        ('hexacopter_imu_arrow_left', 'rotated', 'compass', True),
        ('hexacopter_imu_arrow_left', 'rotated', 'gnss', False),
        ('hexacopter_low_pressure', 'parameter', 'barometer.altitude', True),
        ('hexacopter_velocity_ned', 'rotated', 'velocity', True),
        ('cyclist_closing_is_positive', 'sign', 'radar.range_rate', True),
        ('cyclist_closing_is_positive', 'sign', 'radar.bearing', False),
        ('canal_gauges_exchanged', 'swapped', 'middle', True),
        ('canal_silted', 'parameter', 'A[1]', True),
        ('canal_stolen_water', 'disturbance', 'offtake', True),
        ('reactor_thermowell_thick', 'stamps late', 'thermowell', True),
        ('hydrofoil_bow_bracket', 'parameter', 'bow.C[2]', True),
    ],
)
def test_findings_match_the_kinds_of_the_eighth_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_the_eighth_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'eighth', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'eighth', '--out', str(tmp_path), 'canal_silted'])
    assert {path.name for path in (tmp_path / 'canal_silted').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip
