# SPDX-License-Identifier: Apache-2.0
"""The recordings of the sixth set are the same again, and show what is wrong with them."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from ..matching import is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..sets import RECORDINGS as EVERYTHING
from ..sets import SETS
from ..simulation import Channel, Readings
from .faults import connected, failing, geared, jittering, unsteady
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, write
from .systems import SYSTEMS

#: Least change of the sum of the NIS by a fault.
_VISIBLE = 150.0
#: The only fault that mainly shows in the gaps.
_GAPS = 'buoy_height_drops'


def judged(recording: Recording, folder: Path) -> Mapping[str, tuple[float, int]]:
    """Return the sum of the NIS, and the count of all numbers read, of each sensor."""
    write_files(recording, SYSTEMS[recording.system], folder, FORMS)
    run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml')
    return {
        name: (float(np.nansum(sensor.nis)), int(np.isfinite(sensor.innovation).sum()))
        for name, sensor in run.sensors.items()
    }


def flawless(recording: Recording) -> Recording:
    """Return the same recording without its fault."""
    return replace(recording, fault=Recording.fault, physics={}, edits={})


def channel(*numbers: float) -> Channel:
    """Return readings with these values and a noise of 0.1, one in a second."""
    time = np.arange(float(len(numbers)))
    value = np.array(numbers, dtype=float)[:, np.newaxis]
    noise = np.full_like(value, 0.1)
    return Channel('a', 'range', time, value, noise, time.copy(), time.copy())


def test_the_sixth_set_is_large_and_its_names_and_seeds_are_unique() -> None:
    clean = sum(recording.kind == 'clean' for recording in TABLE)
    assert clean >= 12
    assert 85 <= len(TABLE) <= 95
    assert {recording.system for recording in TABLE} == {*SYSTEMS}
    assert SETS['sixth'] is RECORDINGS
    assert len(EVERYTHING) == sum(len(table) for table in SETS.values())
    assert len({recording.seed for recording in TABLE}) == len(TABLE) == len(RECORDINGS)


def test_what_is_wrong_in_the_sixth_set_is_said() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        said = bool(recording.subject and recording.size is not None and changed)
        assert said is (recording.kind != 'clean'), recording.name


@pytest.mark.parametrize('system', SYSTEMS)
def test_the_start_of_a_system_of_the_sixth_set_has_the_same_bytes_again_and_is_read(
    system: str, tmp_path: Path
) -> None:
    seconds = 0.07 * SYSTEMS[system].physics['seconds']
    recording = Recording(system, 'short', 1, physics={'seconds': seconds})
    counts = judged(recording, tmp_path / 'a')
    judged(recording, tmp_path / 'b')
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    assert all(count > 0 and np.isfinite(total) for total, count in counts.values())


@pytest.mark.parametrize('system', SYSTEMS)
def test_the_parameter_files_of_the_sixth_set_are_accepted(system: str, tmp_path: Path) -> None:
    texts = {edited(r, SYSTEMS[system]) for r in TABLE if r.system == system}
    for text in texts:
        (tmp_path / 'robot.yaml').write_text(text)
        assert kr.load(tmp_path / 'robot.yaml').sensors


def test_a_reading_behind_a_gear_with_play_rests_after_a_reversal() -> None:
    driven = channel(0.0, 1.0, 2.0, 1.5, 1.0, 0.0)
    geared(driven, np.random.default_rng(0), 1.0)
    assert driven.value[:, 0].tolist() == [0.0, 0.5, 1.5, 1.5, 1.5, 0.5]


def test_a_sensor_that_fails_reads_its_error_without_noise() -> None:
    failed = channel(*range(200))
    failing(failed, np.random.default_rng(0), 0.25, -7.0)
    rows = failed.value[:, 0] == -7.0
    assert 30 < rows.sum() < 70
    assert (failed.noise[rows] == 0.0).all()
    assert (failed.noise[~rows] == 0.1).all()


def test_jitter_moves_stamps_and_an_unsteady_line_does_not() -> None:
    shaky, slow = channel(1.0, 2.0, 3.0), channel(1.0, 2.0, 3.0)
    jittering(shaky, np.random.default_rng(0), 0.1)
    unsteady(slow, np.random.default_rng(0), 0.1)
    assert (shaky.stamp > shaky.time).all()
    assert (slow.stamp == slow.time).all()
    assert (slow.received > slow.time).all()


def test_exchanged_sensors_send_on_the_topic_of_the_other() -> None:
    readings: Readings = {'one': channel(1.0), 'two': channel(2.0)}
    readings['two'].topic = 'b'
    connected('one', 'two')(readings, np.random.default_rng(0))
    assert [each.topic for each in readings.values()] == ['b', 'a']


def test_a_disabled_sensor_and_late_blocks_are_as_their_owners_want(tmp_path: Path) -> None:
    counts = judged(RECORDINGS['knee_clean_without_gauge'], tmp_path / 'knee')
    assert [*counts] == ['joint', 'motor']
    counts = judged(RECORDINGS['greenhouse_clean_blocks'], tmp_path / 'greenhouse')
    assert counts['floor'][1] == counts['air_a'][1] > 300


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('mower_gyro_overhead', 'sign', 'gyro', True),
        ('mower_base_moved', 'bias', 'gnss.x', True),
        ('mower_base_moved', 'bias', 'gnss.y', False),
        ('mower_right_clogged', 'scale', 'wheels.right', True),
        ('dog_legs_mirrored', 'sign', 'legs.vy', True),
        ('bus_antennas_across', 'rotated', 'heading', True),
        ('kite_imu_turned', 'rotated', 'magnetometer', True),
        ('kite_imu_turned', 'rotated', 'gnss', False),
        ('kite_winch_moved', 'parameter', 'tether.positions[0]', True),
        ('sailboat_rudder_reversed', 'input sign', 'rudder', True),
        ('sailboat_tide', 'drift', 'gnss.x', True),
        ('knee_spring_soft', 'parameter', 'gauge.C[0]', True),
        ('knee_torque_offset', 'disturbance', 'torque', True),
        ('knee_torque_offset', 'bias', 'joint', False),
        ('cylinder_one_rod', 'asymmetric gain', 'valve', True),
        ('greenhouse_door', 'process noise too small', 'air', True),
        ('greenhouse_probes_exchanged', 'swapped', 'air_a', True),
        ('stage_correlated', 'correlated noise', 'geophones', True),
    ],
)
def test_findings_match_the_kinds_of_the_sixth_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_the_sixth_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'sixth', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'sixth', '--out', str(tmp_path), 'greenhouse_door'])
    assert {path.name for path in (tmp_path / 'greenhouse_door').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('system', SYSTEMS)
def test_a_system_of_the_sixth_set_obeys_the_model_of_its_file(
    system: str, tmp_path: Path
) -> None:
    sums: dict[str, list[tuple[float, int]]] = {}
    for seed in range(6):
        recording = Recording(system, 'again', 9000 + seed)
        for name, numbers in judged(recording, tmp_path / str(seed)).items():
            sums.setdefault(name, []).append(numbers)
    for name, each in sums.items():
        total, count = np.sum(each, axis=0)
        # the NIS has a variance of 2 for each number that is read
        assert abs(total / count - 1.0) < max(0.03, 4.5 * np.sqrt(2.0 / count)), name


@pytest.mark.slow
@pytest.mark.parametrize(
    'name',
    mostly_thorough(
        [recording.name for recording in TABLE if recording.kind != 'clean'], 'buoy_storm'
    ),
)
def test_a_fault_of_the_sixth_set_is_visible_and_the_recording_is_whole(
    name: str, tmp_path: Path
) -> None:
    recording = RECORDINGS[name]
    faulty = judged(recording, tmp_path / 'faulty')
    good = judged(flawless(recording), tmp_path / 'good')
    change = sum(total for total, _ in faulty.values()) - sum(total for total, _ in good.values())
    assert abs(change) > _VISIBLE
    if name == _GAPS:
        assert faulty['height'][1] < 0.7 * good['height'][1]
    assert not Bag(tmp_path / 'faulty' / 'recording.mcap').damage


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_recording_of_the_sixth_set_has_the_same_bytes_again(name: str, tmp_path: Path) -> None:
    for folder in 'ab':
        write(name, tmp_path / folder)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    bag = Bag(tmp_path / 'a' / 'recording.mcap')
    assert len([*bag.messages(bag.topics)]) > 100
