# SPDX-License-Identifier: Apache-2.0
"""The real recordings are the same each time, their faults are as stated, and they are read."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr

from ..matching import is_own, is_right
from ..messages import EPOCH
from ..program import main
from ..recordings import Recording
from ..score import judge
from ..sets import RECORDINGS, SETS, write
from ..simulation import Readings
from .recordings import OWN
from .sources import AbsentError


def written(name: str, folder: Path) -> Path:
    """Write a recording; the test is skipped where its data are not."""
    try:
        write(name, folder)
    except AbsentError as error:
        pytest.skip(str(error))
    return folder


def read(recording: Recording) -> Readings:
    """Return the readings of a recording with its fault; skips as well."""
    try:
        return SETS['real'].readings(recording)
    except AbsentError as error:
        pytest.skip(str(error))


def pair(name: str) -> tuple[Readings, Readings]:
    """Return the readings of a recording with its fault, and as they are."""
    recording = RECORDINGS[name]
    return read(recording), read(RECORDINGS[f'{recording.system}_as_is'])


def test_only_recordings_as_they_are_have_no_fault() -> None:
    assert {*OWN} == {*SETS['real'].systems}
    for recording in SETS['real'].table:
        changed = recording.fault is not Recording.fault or bool(recording.edits)
        assert changed == (recording.label != 'as_is') == (recording.kind != 'clean')


@pytest.mark.parametrize('name', ['lidar_radar_lidar_lost', 'driven_pendulum_position_noise'])
def test_a_real_recording_has_the_same_bytes_again(name: str, tmp_path: Path) -> None:
    first, second = (written(name, tmp_path / folder) for folder in 'ab')
    for file in ('recording.mcap', 'robot.yaml'):
        assert (first / file).read_bytes() == (second / file).read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize('system', SETS['real'].systems)
def test_a_recording_as_it_is_is_replayed(system: str, tmp_path: Path) -> None:
    folder = written(f'{system}_as_is', tmp_path)
    run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml', end=15.0)
    assert run.notes == ()
    assert run.start >= EPOCH * 10**9
    for name, sensor in run.sensors.items():
        assert sensor.fused == len(sensor.nis) > 20, name
        # no more than chance for as many numbers as the widest sensor has, three
        assert sensor.nis.mean() < 3.0, name


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'sensor', 'delay'),
    [
        ('car_60s_gnss_500_ms', 'gnss', 0.5),
        ('diff_drive_gyro_100_ms', 'gyro', 0.1),
        ('uwb_robot_odometry_500_ms', 'odometry', 0.5),
    ],
)
def test_late_readings_are_stamped_and_received_late(name: str, sensor: str, delay: float) -> None:
    faulty, good = pair(name)
    for part in ('stamp', 'received'):
        shift = getattr(faulty[sensor], part) - getattr(good[sensor], part)
        np.testing.assert_allclose(shift, delay, atol=1e-9)
    assert (faulty[sensor].value == good[sensor].value).all()


def test_rounded_stamps_are_multiples_and_arrive_as_before() -> None:
    faulty, good = pair('driven_pendulum_position_rounded')
    stamps, before = faulty['position'].stamp, good['position'].stamp
    np.testing.assert_allclose(stamps / 0.01, np.round(stamps / 0.01), atol=1e-6)
    assert ((before - stamps > -1e-9) & (before - stamps < 0.01)).all()
    assert (faulty['position'].received == good['position'].received).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ('name', 'sensor', 'columns', 'factor'),
    [
        ('diff_drive_gyro_10_percent', 'gyro', (0, 1, 2), 1.1),
        ('uwb_robot_as_documented', 'odometry', (1,), -2.0),
        ('driven_pendulum_torque_sign', 'torque', (0,), -1.0),
        ('imu_optical_magnetometer_gauss', 'magnetometer', (0, 1, 2), 1e4),
    ],
)
def test_a_factor_is_that_of_its_columns_alone(
    name: str, sensor: str, columns: Sequence[int], factor: float
) -> None:
    faulty, good = pair(name)
    expected = good[sensor].value.copy()
    expected[:, columns] *= factor
    np.testing.assert_allclose(faulty[sensor].value, expected, rtol=1e-12)


def test_a_turned_magnetometer_reads_the_same_field_along_other_axes() -> None:
    faulty, good = (each['magnetometer'].value for each in pair(
        'imu_optical_magnetometer_quarter_turn'
    ))  # fmt: skip
    np.testing.assert_allclose(faulty, good[:, [1, 0, 2]] * [1.0, -1.0, 1.0], atol=1e-12)


def test_a_third_is_lost_and_the_rest_is_unchanged() -> None:
    faulty, good = (each['lidar'] for each in pair('lidar_radar_lidar_lost'))
    assert 0.6 < len(faulty.time) / len(good.time) < 0.8
    kept = np.isin(good.time, faulty.time)
    assert (faulty.value == good.value[kept]).all()


def claim(kind: str, subject: str, share: float = 0.4) -> dict[str, object]:
    return {
        'kind': kind, 'subject': subject, 'sentence': '', 'share': share, 'gain': share, 'z': 9.0,
        'certainty': 1.0, 'same as': [],
    }  # fmt: skip


def test_what_a_recording_has_by_itself_comes_before_its_fault() -> None:
    fault, own = claim('outliers', 'anchor_108'), claim('outliers', 'anchor_107')
    recording = RECORDINGS['uwb_robot_anchor_108_outliers']
    assert is_right(fault, recording) and not is_own(fault, recording)
    assert is_own(own, recording) and not is_right(own, recording)
    row = judge(recording.name, {'findings': [own, fault], 'seconds': 1.0})
    assert (row.verdict, row.rank, row.printed) == ('first', 1, 2)
    other = claim('sign', 'odometry.omega')
    row = judge(recording.name, {'findings': [own, other, fault], 'seconds': 1.0})
    assert (row.verdict, row.rank) == ('within three', 2)
    row = judge('uwb_robot_as_is', {'findings': [own, fault], 'seconds': 1.0})
    assert (row.verdict, row.rank) == ('clean', 0)
    row = judge('uwb_robot_as_is', {'findings': [own, other], 'seconds': 1.0})
    assert row.verdict == 'flagged'


def test_without_the_data_the_program_says_so_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv('KALMAN_ROS_DATA', str(tmp_path / 'none'))
    main(['--set', 'real', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(SETS['real'].table)
    with pytest.raises(SystemExit):
        main(['--set', 'real', '--out', str(tmp_path), 'car_60s_as_is'])
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert said.endswith('set KALMAN_ROS_DATA\n')
