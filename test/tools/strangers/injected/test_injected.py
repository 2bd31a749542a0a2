# SPDX-License-Identifier: Apache-2.0
"""Every fault of the injector has a recording, which the doctor's score can judge."""

from dataclasses import fields
from pathlib import Path

import pytest

import kalman_ros as kr
from kalman_ros.simulation.faults import FAULTS
from kalman_ros.simulation.faults.body import BodyOptions

from ..scored import RECORDINGS, SCORED, write
from .cases import TABLE


def test_every_fault_of_the_injector_has_a_recording() -> None:
    injected = {case.label for case in TABLE}
    options = {next(iter(vars(kind)['__dataclass_fields__'])) for kind in FAULTS}
    assert options <= injected
    assert {'actuator_loss', 'actuator_dead_zone', 'disturbance_constant'} <= injected
    assert {'disturbance_noise'} <= {one.name for one in fields(BodyOptions)} & injected
    assert {'unit', 'sign', 'swap', 'rotation', 'clock_offset', 'unrelated'} <= injected
    assert {'input_gain', 'input_sign'} <= injected


def test_names_are_unique_among_all_that_is_scored() -> None:
    assert len(RECORDINGS) == sum(len(some.recordings) for some in SCORED.values())


def test_recordings_have_one_fault_or_two_or_none() -> None:
    clean = [case for case in TABLE if case.kind == 'clean']
    pairs = [case for case in TABLE if case.own]
    assert (len(TABLE), len(clean), len(pairs)) == (230, 100, 26)
    assert len({case.seed for case in TABLE}) == len(TABLE)
    assert all(case.injection != clean[0].injection or case.edits for case in TABLE[:130])


@pytest.mark.slow
def test_a_recording_is_written_and_replayed_with_its_fault(tmp_path: Path) -> None:
    for name in ('diff_drive_nan', 'cart_pole_first_belief', 'cart_pole_clean_01'):
        write(name, tmp_path / name)
    run = kr.replay(tmp_path / 'diff_drive_nan' / 'recording.mcap',
                    tmp_path / 'diff_drive_nan' / 'robot.yaml')  # fmt: skip
    assert 100 < (run.sensors['imu'].outcome == 'NOT_FINITE').sum() < 220
    run = kr.replay(tmp_path / 'cart_pole_clean_01' / 'recording.mcap',
                    tmp_path / 'cart_pole_clean_01' / 'robot.yaml')  # fmt: skip
    assert run.sensors['joint_states'].nis.mean() == pytest.approx(2.0, abs=0.15)
    narrow = kr.load(tmp_path / 'cart_pole_first_belief' / 'robot.yaml')
    assert narrow.initial_belief[1][0, 0] == pytest.approx(1e-4)
