# SPDX-License-Identifier: Apache-2.0
"""Recordings of all sets are the same again and whole; they obey their files or show a fault."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough

import kalman_ros as kr
from kalman_ros.bags.reading import Bag

from .eleventh.systems import MUJOCO as LAST
from .program import main
from .recordings import Recording, edited
from .sets import RECORDINGS, SETS, RecordingSet, write
from .tenth.systems import MUJOCO as OTHERS
from .third.systems import MUJOCO

#: Sets that are simulated; the one of real recordings has tests of its data.
SIMULATED = {name: each for name, each in SETS.items() if name != 'real'}
#: Number of clean recordings of each set, and fewest with a fault.
SIZES = {
    'first': (13, 60), 'second': (21, 100), 'third': (14, 60), 'fourth': (12, 60),
    'fifth': (12, 70), 'sixth': (13, 70), 'seventh': (12, 58), 'eighth': (12, 58),
    'ninth': (12, 78), 'tenth': (12, 78), 'eleventh': (12, 78),
    'twelfth': (12, 78), 'thirteenth': (12, 78), 'real': (6, 50),
}  # fmt: skip
_BODIES = {each.name for each in (*MUJOCO, *OTHERS, *LAST)}
#: All systems; one whose import starts a process is slow.
SYSTEMS = [
    pytest.param(some, system, marks=[pytest.mark.slow] if system in _BODIES else [])
    for some, each in SIMULATED.items()
    for system in each.systems
]
#: Simulated recordings of which each takes seconds: one of a set is tested always.
WHOLE = mostly_thorough(
    [name for each in SIMULATED.values() for name in each.recordings],
    'tank_clean', 'blimp_fix_swapped', 'conveyor_correlated', 'vessel_ais_late', 'silo_dust',
    'mower_base_moved', 'ram_hum', 'canal_silted', 'microgrid_old_capacitor',
)  # fmt: skip
#: Sets whose systems obey the models of their files exactly, and by how much a mean NIS may be off
#: beside chance.
OBEDIENT = {
    'sixth': 0.03, 'seventh': 0.05, 'eighth': 0.035, 'ninth': 0.05, 'tenth': 0.05,
    'eleventh': 0.05, 'twelfth': 0.05, 'thirteenth': 0.05,
}  # fmt: skip
#: Of these systems, those that are tested always.
OFTEN = {'canal', 'cyclist'}


def set_of(name: str) -> RecordingSet:
    """Return the set that has a recording."""
    return next(each for each in SETS.values() if name in each.recordings)


def innocent(recording: Recording) -> Recording:
    """Return the recording with the same seed and without its fault."""
    return replace(recording, fault=Recording.fault, physics={}, edits={})


def judged(some: RecordingSet, recording: Recording, folder: Path) -> dict[str, tuple[float, int]]:
    """Return the sum of the NIS, and the count of numbers with an innovation, of each sensor."""
    some.write(recording, folder)
    run = kr.replay(folder / 'recording.mcap', folder / 'robot.yaml')
    return {
        name: (float(np.nansum(sensor.nis)), int(np.isfinite(sensor.innovation).sum()))
        for name, sensor in run.sensors.items()
    }


def same_files(one: Path, other: Path) -> bool:
    """Return whether two folders have the same recording and the same parameters."""
    return all(
        (one / file).read_bytes() == (other / file).read_bytes()
        for file in ('recording.mcap', 'robot.yaml')
    )


def test_names_are_unique_among_all_sets_and_seeds_in_each() -> None:
    assert len(RECORDINGS) == sum(len(each.recordings) for each in SETS.values())
    for each in SETS.values():
        assert len({recording.seed for recording in each.table}) == len(each.table)


@pytest.mark.parametrize('some', SETS)
def test_a_set_is_large_and_says_what_is_wrong(some: str) -> None:
    table = SETS[some].table
    clean, least = SIZES[some]
    assert sum(recording.kind == 'clean' for recording in table) == clean
    assert len(table) >= clean + least
    for recording in table:
        changed = recording.fault is not Recording.fault or recording.physics or recording.edits
        assert recording.kind == 'clean' or (changed and recording.subject), recording.name


@pytest.mark.parametrize('some', SETS)
def test_a_set_has_recordings_of_each_of_its_systems(some: str) -> None:
    assert {each.system for each in SETS[some].recordings.values()} == {*SETS[some].systems}


def test_no_system_of_the_last_set_is_in_another_one() -> None:
    *others, last = ({*each.systems} for each in SIMULATED.values())
    assert not last & set().union(*others)


@pytest.mark.parametrize(
    ('some', 'system'), [each for each in SYSTEMS if each.values[0] != 'first']
)
def test_the_start_of_a_system_has_the_same_bytes_again_and_is_read(
    some: str, system: str, tmp_path: Path
) -> None:
    physics = SETS[some].systems[system].physics
    recording = Recording(system, 'short', 1, physics={'seconds': 0.06 * physics['seconds']})
    sums = judged(SETS[some], recording, tmp_path / 'a')
    assert all(count > 0 and np.isfinite(total) for total, count in sums.values())
    SETS[some].write(recording, tmp_path / 'b')
    assert same_files(tmp_path / 'a', tmp_path / 'b')
    SETS[some].write(replace(recording, seed=2), tmp_path / 'c')
    assert not same_files(tmp_path / 'a', tmp_path / 'c')


@pytest.mark.parametrize('some', SETS)
def test_the_files_of_a_set_are_edited_and_accepted(some: str, tmp_path: Path) -> None:
    each, file = SETS[some], tmp_path / 'robot.yaml'
    texts = set()
    for recording in each.recordings.values():
        system = each.systems[recording.system]
        text = edited(recording, system.parameters)
        assert (text != system.parameters) is bool(recording.edits), recording.name
        assert {*recording.physics} <= {*system.physics}, recording.name
        texts.add(text)
    for text in texts:
        file.write_text(text)
        assert len(kr.load(file).sensors) >= 1


@pytest.mark.slow
@pytest.mark.parametrize('name', WHOLE)
def test_a_recording_is_finite_the_same_again_and_whole(name: str, tmp_path: Path) -> None:
    some, recording = set_of(name), RECORDINGS[name]
    readings, again = some.readings(recording), some.readings(recording)
    assert [*readings] == [*again]
    for sensor, channel in readings.items():
        for part in ('time', 'value', 'noise', 'stamp', 'received'):
            numbers = getattr(channel, part)
            assert len(numbers) == len(channel.time) > 15
            assert np.isfinite(numbers).all(), f'{sensor} {part}'
            assert (numbers == getattr(again[sensor], part)).all(), f'{sensor} {part}'
    for folder in 'ab':
        write(name, tmp_path / folder)
    assert same_files(tmp_path / 'a', tmp_path / 'b')
    bag = Bag(tmp_path / 'a' / 'recording.mcap')
    assert not bag.damage
    sent: Counter[str] = Counter()
    for channel in readings.values():
        sent[f'/{channel.topic}'] += len(channel.time)
    assert Counter(message.topic for message in bag.messages(bag.topics)) == sent


@pytest.mark.slow
@pytest.mark.parametrize('name', WHOLE)
def test_a_fault_changes_the_readings_or_the_file(name: str) -> None:
    some, recording = set_of(name), RECORDINGS[name]
    if recording.kind == 'clean' or recording.edits:
        return
    faulty, good = some.readings(recording), some.readings(innocent(recording))

    def differs(sensor: str) -> bool:
        one, other = faulty[sensor], good[sensor]
        return one.topic != other.topic or any(
            not np.array_equal(getattr(one, part), getattr(other, part))
            for part in ('value', 'noise', 'stamp', 'received')
        )

    assert any(differs(sensor) for sensor in good)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('clean', 'faulty', 'sensor', 'ratio'),
    [
        ('tank_clean', 'tank_valve', 'lower', 1.5),
        ('diver_clean', 'diver_fresh_water', 'sounder', 5.0),
        ('heater_clean', 'heater_warm_room', 'air', 1.5),
        ('vessel_clean', 'vessel_ais_late', 'ais', 3.0),
        ('silo_clean', 'silo_cells_creep', 'cells', 3.0),
        ('trolley_clean_blocks', 'trolley_odometer_worn', 'odometer', 2.0),
    ],
)
def test_a_clean_recording_is_consistent_and_a_fault_is_not(
    clean: str, faulty: str, sensor: str, ratio: float, tmp_path: Path
) -> None:
    sums = {name: judged(set_of(name), RECORDINGS[name], tmp_path / name)
            for name in (clean, faulty)}  # fmt: skip
    for total, count in sums[clean].values():
        assert abs(total / count - 1.0) < max(0.15, 5.0 * np.sqrt(2.0 / count))
    total, count = sums[faulty][sensor]
    assert total / count > ratio


@pytest.mark.slow
@pytest.mark.parametrize(
    ('some', 'system'),
    [
        pytest.param(some, system, marks=[] if system in OFTEN else [pytest.mark.thorough])
        for some in OBEDIENT
        for system in SETS[some].systems
    ],
)
def test_a_system_obeys_the_model_of_its_file(some: str, system: str, tmp_path: Path) -> None:
    runs = [
        judged(SETS[some], Recording(system, 'again', 9000 + seed), tmp_path / str(seed))
        for seed in range(8)
    ]
    for name in runs[0]:
        total, count = np.sum([run[name] for run in runs], axis=0)
        # the NIS has a variance of 2 for each number that is read
        assert abs(total / count - 1.0) < max(OBEDIENT[some], 4.5 * np.sqrt(2.0 / count)), name


@pytest.mark.slow
@pytest.mark.parametrize(
    'name',
    mostly_thorough(
        [
            name
            for some in OBEDIENT
            for name, recording in SETS[some].recordings.items()
            if recording.kind not in ('clean', 'correlated noise')
        ],
        'buoy_storm',
    ),
)
def test_a_fault_is_visible(name: str, tmp_path: Path) -> None:
    some, recording = set_of(name), RECORDINGS[name]
    faulty = judged(some, recording, tmp_path / 'faulty')
    good = judged(some, innocent(recording), tmp_path / 'good')
    change = sum(faulty[sensor][0] - good[sensor][0] for sensor in good)
    missing = sum(good[sensor][1] - faulty[sensor][1] for sensor in good)
    assert abs(change) > 150.0 or missing > 100


@pytest.mark.parametrize('some', SETS)
def test_the_program_lists_a_set(some: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(['--set', some, '--list'])
    assert len(capsys.readouterr().out.splitlines()) == len(SETS[some].recordings)


def test_the_program_writes_a_recording(tmp_path: Path) -> None:
    main(['--set', 'ninth', '--out', str(tmp_path), 'mill_slab'])
    write('mill_slab', tmp_path / 'again')
    assert same_files(tmp_path / 'mill_slab', tmp_path / 'again')
