# SPDX-License-Identifier: Apache-2.0
"""The recordings of the fifth set are deterministic and finite, and the package reads them."""

import math
import struct
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from ..matching import is_right
from ..program import main
from ..recordings import Recording, edited, write_files
from ..sets import RECORDINGS as EVERYTHING
from ..sets import SETS
from ..simulation import Channel, Readings
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, shaken, write
from .rotations import exponential, logarithm, product, rotated
from .systems import SYSTEMS


def simulated(name: str, fault: bool = True) -> Readings:
    """Return the readings of a recording in full length, with its fault or without."""
    recording = RECORDINGS[name]
    system = SYSTEMS[recording.system]
    rng = np.random.default_rng(recording.seed)
    readings = system.simulate(rng, {**system.physics, **(recording.physics if fault else {})})
    if fault:
        recording.fault(readings, rng)
    return readings


def test_the_fifth_set_is_large_and_its_names_and_seeds_are_unique() -> None:
    clean = sum(recording.kind == 'clean' for recording in TABLE)
    assert clean >= 10
    assert len(TABLE) - clean >= 70
    assert {recording.system for recording in TABLE} == {*SYSTEMS}
    assert len(EVERYTHING) == sum(len(table) for table in SETS.values())
    assert len({recording.seed for recording in TABLE}) == len(TABLE)


def test_only_clean_recordings_of_the_fifth_set_are_without_a_fault() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.parametrize('system', SYSTEMS)
def test_two_seconds_of_a_system_of_the_fifth_set_are_the_same_again_and_are_read(
    system: str, tmp_path: Path
) -> None:
    recording = Recording(system, 'short', 1, physics={'seconds': 2.4})
    for folder in 'ab':
        write_files(recording, SYSTEMS[system], tmp_path / folder, FORMS)
    for file in ('recording.mcap', 'robot.yaml'):
        once, again = ((tmp_path / folder / file).read_bytes() for folder in 'ab')
        assert once == again
    run = kr.replay(tmp_path / 'a' / 'recording.mcap', tmp_path / 'a' / 'robot.yaml')
    for name, sensor in run.sensors.items():
        assert len(sensor.nis) > 0, name
        assert np.isfinite(sensor.nis).all(), name


@pytest.mark.parametrize('system', SYSTEMS)
def test_the_parameter_files_of_the_fifth_set_are_accepted(system: str, tmp_path: Path) -> None:
    texts = {edited(r, SYSTEMS[system]) for r in TABLE if r.system == system}
    for text in texts:
        (tmp_path / 'robot.yaml').write_text(text)
        assert kr.load(tmp_path / 'robot.yaml').sensors


def test_quaternions_turn_vectors_by_the_right_hand_and_have_logarithms() -> None:
    quarter = exponential((0.0, 0.0, 0.5 * math.pi))
    assert rotated(quarter, (1.0, 0.0, 0.0)) == pytest.approx([0.0, 1.0, 0.0])
    assert logarithm(product(quarter, quarter)) == pytest.approx([0.0, 0.0, math.pi])
    for vector in ((0.3, -2.0, 1.0), (0.0, 0.0, 0.0), (1e-10, 0.0, 0.0)):
        assert logarithm(exponential(vector)) == pytest.approx(vector)


def test_the_error_of_a_pose_is_a_turn_about_the_axes_of_the_map() -> None:
    half = math.pi / 2
    body = FORMS['pose'][1](0, [1.0, 2.0, 3.0, half, 0.0, 0.0, 0.0, 0.0, half])
    numbers = struct.unpack_from('<7d', body, len(body) - 7 * 8)
    assert numbers == pytest.approx([1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5])


def test_a_shaken_sensor_is_rough_for_a_stretch_alone() -> None:
    time = np.arange(6.0)
    ones = np.ones((6, 1))
    channel = Channel('a', 'range', time, ones.copy(), ones.copy(), time, time)
    shaken(channel, np.random.default_rng(0), 2.0, 2.0, 5.0)
    assert channel.noise[:, 0].tolist() == [1.0, 1.0, 5.0, 5.0, 1.0, 1.0]


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_recording_of_the_fifth_set_is_finite_the_same_again_and_whole(
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
@pytest.mark.thorough
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_fault_of_the_fifth_set_changes_the_readings_or_the_file(name: str) -> None:
    faulty, good = simulated(name), simulated(name, fault=False)

    def differs(sensor: str) -> bool:
        one, other = faulty[sensor], good[sensor]
        return len(one.time) != len(other.time) or any(
            not np.array_equal(getattr(one, part), getattr(other, part))
            for part in ('value', 'noise', 'stamp')
        )

    injected = RECORDINGS[name].kind != 'clean' and not RECORDINGS[name].edits
    assert not injected or any(differs(sensor) for sensor in good)


@pytest.mark.slow
def test_clean_recordings_of_the_fifth_set_are_consistent_and_a_fault_is_not(
    tmp_path: Path,
) -> None:
    ratio = {}
    for name in ('silo_clean', 'silo_cells_creep'):
        write(name, tmp_path / name)
        run = kr.replay(tmp_path / name / 'recording.mcap', tmp_path / name / 'robot.yaml')
        ratio[name] = run.sensors['cells'].nis.mean()
    assert abs(ratio['silo_clean'] - 1.0) < 0.25
    assert ratio['silo_cells_creep'] > 3.0


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('courier_left_tyre', 'scale', 'wheels.left', True),
        ('courier_left_tyre', 'scale', 'wheels.right', False),
        ('courier_declination', 'rotated', 'gnss', True),
        ('racer_worn_tyres', 'parameter', 'imu.stiffness', True),
        ('racer_linkage', 'input gain', 'wheel', True),
        ('scout_attitude_slips', 'bias step', 'attitude.pitch', True),
        ('scout_attitude_slips', 'bias step', 'attitude.roll', False),
        ('target_mast_misplaced', 'parameter', 'mast.position[0]', True),
        ('tag_anchors_exchanged', 'swapped', 'uwb', True),
        ('tag_shelf', 'outliers', 'uwb.range_3', True),
        ('tag_shelf', 'outliers', 'uwb.range_1', False),
        ('headset_markers_turned', 'input rotated', 'w', True),
        ('headset_camera_late', 'input delay', 'w', True),
        ('headset_imu_in_g', 'input gain', 'fx', True),
        ('gantry_laser_averages', 'stamps late', 'laser', True),
        ('silo_dust', 'correlated noise', 'ultrasound', True),
        ('turbine_wake', 'bias', 'anemometer', True),
        ('plate_slow_servos', 'input delay', 'to_alpha', True),
    ],
)
def test_findings_match_the_kinds_of_the_fifth_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_the_fifth_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'fifth', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'fifth', '--out', str(tmp_path), 'silo_clean'])
    assert {path.name for path in (tmp_path / 'silo_clean').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip
