# SPDX-License-Identifier: Apache-2.0
"""The recordings of the fourth set are deterministic and finite, and the package reads them."""

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
from ..simulation import Readings
from .messages import FORMS
from .recordings import RECORDINGS, TABLE, write
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


def test_the_fourth_set_is_large_and_its_names_and_seeds_are_unique() -> None:
    clean = sum(recording.kind == 'clean' for recording in TABLE)
    assert clean >= 10
    assert len(TABLE) - clean >= 60
    assert {recording.system for recording in TABLE} == {*SYSTEMS}
    assert len(EVERYTHING) == sum(len(table) for table in SETS.values())
    assert len({recording.seed for recording in TABLE}) == len(TABLE)


def test_only_clean_recordings_of_the_fourth_set_are_without_a_fault() -> None:
    for recording in TABLE:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.parametrize('system', SYSTEMS)
def test_two_seconds_of_a_system_are_the_same_again_and_are_read(
    system: str, tmp_path: Path
) -> None:
    recording = Recording(system, 'short', 1, physics={'seconds': 2.2})
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
def test_the_parameter_files_of_the_fourth_set_are_accepted(system: str, tmp_path: Path) -> None:
    texts = {edited(r, SYSTEMS[system]) for r in TABLE if r.system == system}
    for text in texts:
        (tmp_path / 'robot.yaml').write_text(text)
        assert len(kr.load(tmp_path / 'robot.yaml').sensors) > 1


@pytest.mark.parametrize('angles', [(0.3, 0, 0), (0, -0.4, 0), (0.2, -0.5, 2.0)])
def test_an_attitude_is_the_product_of_its_turns(angles: tuple[float, float, float]) -> None:
    body = FORMS['attitude'][1](0, angles)
    x, y, z, w = struct.unpack_from('<4d', body, body.index(b'base_link\0') - 4 + 16)
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x**2 + y**2))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y**2 + z**2))
    assert (roll, math.asin(2.0 * (w * y - z * x)), yaw) == pytest.approx(angles)


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('name', RECORDINGS)
def test_a_recording_of_the_fourth_set_is_finite_the_same_again_and_whole(
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
def test_a_fault_of_the_fourth_set_changes_the_readings_or_the_file(name: str) -> None:
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
def test_clean_recordings_of_the_fourth_set_are_consistent_and_a_fault_is_not(
    tmp_path: Path,
) -> None:
    ratio = {}
    for name in ('vessel_clean', 'vessel_ais_late'):
        write(name, tmp_path / name)
        run = kr.replay(tmp_path / name / 'recording.mcap', tmp_path / name / 'robot.yaml')
        ratio[name] = 0.5 * run.sensors['ais'].nis.mean()
    assert abs(ratio['vessel_clean'] - 1.0) < 0.25
    assert ratio['vessel_ais_late'] > 3.0


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('shuttle_anchor_offset', 'bias', 'anchor_b', True),
        ('shuttle_anchor_offset', 'parameter', 'anchor_b.range_offset', True),
        ('shuttle_anchor_moved', 'parameter', 'positions[0]', True),
        ('shuttle_anchor_moved', 'bias', 'anchor_c', False),
        ('mecanum_worn_wheel', 'scale', 'wheels.fr', True),
        ('mecanum_worn_wheel', 'scale', 'wheels.fl', False),
        ('mecanum_strafe_reversed', 'input sign', 'vy', True),
        ('aeroplane_declination', 'rotated', 'gnss', True),
        ('aeroplane_declination', 'rotated', 'pitot', False),
        ('auv_aft_weak', 'input gain', 'aft', True),
        ('altitude_weather', 'drift', 'laser', True),
        ('suspension_correlated', 'correlated noise', 'hub', True),
        ('vessel_west_turned', 'bias', 'west', True),
    ],
)
def test_findings_match_the_kinds_of_the_fourth_set(
    name: str, kind: str, subject: str, right: bool
) -> None:
    claim = {'kind': kind, 'subject': subject, 'sentence': '', 'same as': []}
    assert is_right(claim, RECORDINGS[name]) is right


def test_the_program_lists_and_writes_the_fourth_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(['--set', 'fourth', '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(TABLE)
    main(['--set', 'fourth', '--out', str(tmp_path), 'vessel_clean'])
    assert {path.name for path in (tmp_path / 'vessel_clean').iterdir()} == {
        'recording.mcap', 'robot.yaml'
    }  # fmt: skip
