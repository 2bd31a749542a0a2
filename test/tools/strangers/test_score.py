# SPDX-License-Identifier: Apache-2.0
"""Findings are matched to the truth by kind, subject, direction and size."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from .matching import NAMES, interval, is_right, is_tied
from .score import Row, examine, judge, shares
from .sets import RECORDINGS, SETS

#: Kinds of faults without names of findings: only a finding of the same word names them.
UNNAMED = {'model', 'clean'}


def finding(
    kind: str, subject: str, sentence: str = '', share: float = 1.0, z: float | None = 9.0,
    same: Sequence[tuple[str, str]] = (), certainty: float = 1.0,
) -> dict[str, Any]:  # fmt: skip
    return {
        'kind': kind, 'subject': subject, 'sentence': sentence, 'share': share, 'gain': share,
        'z': z, 'certainty': certainty, 'same as': [list(pair) for pair in same],
    }  # fmt: skip


def row(name: str, *findings: dict[str, Any]) -> Row:
    return judge(name, {'findings': [*findings], 'seconds': 1.0})


def test_every_kind_of_fault_has_names_or_is_known_to_have_none() -> None:
    assert {recording.kind for recording in SETS['first'].table} <= {*NAMES} | UNNAMED


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'right'),
    [
        ('rover_track', 'scale', 'wheels.omega', True),
        ('rover_track', 'scale', 'wheels.v', False),
        ('rover_radius', 'scale', 'wheels.v', True),
        ('rover_radius', 'random walk', 'wheels', False),
        ('rover_radius', 'scale', 'gyro.omega', False),
        ('rover_gnss_delay', 'stamps late', 'gnss', True),
        ('rover_gnss_delay', 'stamps early', 'gnss', False),
        ('rover_command_delay', 'input delay', 'v', False),
        ('rover_command_delay', 'stamps late', 'gnss', False),
        ('rover_command_delay', 'parameter', 'command_time', True),
        ('rover_command_delay', 'parameter', 'wheels.command_time', True),
        ('rover_command_delay', 'parameter', 'wheels.radius', False),
        ('rover_gyro_on_its_side', 'unrelated', 'gyro', True),
        ('boat_compass_7_degrees', 'bias', 'compass', True),
        ('boat_current', 'drift', 'gnss', True),
        ('boat_gnss_noise', 'noise too small', 'gnss', True),
        ('boat_gnss_noise', 'noise too large', 'gnss', False),
        ('car_all_noise_third', 'noise too large', 'wheels.v', True),
        ('balloon_lower_offset', 'bias', 'upper', True),
        ('spring_mass', 'process noise too small', 'noise_density', True),
        ('tank_valve', 'parameter', 'A', True),
        ('tank_inflow_scale', 'input gain', 'inflow', True),
        ('quadrotor_mass', 'input gain', 'thrust', True),
        ('oven_core_fahrenheit', 'bias', 'core', False),
        ('oven_core_fahrenheit', 'scale', 'core.core', True),
        ('balloon_correlated', 'noise too small', 'upper', False),
    ],
)
def test_a_finding_is_right_by_kind_and_subject(
    name: str, kind: str, subject: str, right: bool
) -> None:
    assert is_right(finding(kind, subject), RECORDINGS[name]) is right


@pytest.mark.parametrize(('factor', 'right'), [('0.01745', True), ('0.1047', False)])
def test_a_unit_must_have_the_right_factor(factor: str, right: bool) -> None:
    sentence = f'readings of gyro.omega fit the model once multiplied by {factor}: they are in x.'
    claim = finding('unit', 'gyro.omega', sentence)
    assert is_right(claim, RECORDINGS['rover_gyro_degrees']) is right


def test_what_fits_as_well_is_tied() -> None:
    other = finding('bias', 'gyro', same=[('sign', 'gyro.omega'), ('noise too large', 'gnss')])
    assert is_tied(other, RECORDINGS['rover_gyro_sign'])
    assert not is_tied(other, RECORDINGS['boat_gnss_noise'])
    scored = row('rover_gyro_sign', other)
    assert (scored.verdict, scored.tied, scored.confident) == ('first', True, False)


@pytest.mark.parametrize(
    ('name', 'kind', 'subject', 'sentence', 'expected'),
    [
        ('boat_log_10_percent', 'scale', 'log.v', 'multiplied by 0.912 ± 0.002: x', 'in'),
        ('boat_log_10_percent', 'scale', 'log.v', 'multiplied by 0.95 ± 0.01: x', 'out'),
        ('rover_gnss_delay', 'stamps late', 'gnss', 'fit the state 0.203 ± 0.002 s before', 'in'),
        ('elevator_gravity', 'bias', 'accelerometer', 'off: a [m/s^2] by +9.8 ± 0.01.', 'in'),
        ('pendulum_length', 'parameter', 'length', 'length: 0.56 ± 0.001 fits', 'out'),
        ('oven_room_noise', 'noise too small', 'room.room', 'of 3.1 (2.9 to 3.2, 95 %): 1', 'in'),
        ('balloon_upper_quiet', 'noise too large', 'upper', 'of 3.4 (3.2 to 4, 95 %): x', 'out'),
        ('oven_wall_drift', 'drift', 'wall', 'wall drifts by +0.005 a second', ''),
        ('balloon_lower_offset', 'bias', 'lower', 'x by +3.1 ± 0.1, y by +0.1 ± 0.1', 'out'),
        ('boat_compass_7_degrees', 'bias', 'compass', 'psi [rad] by +0.12 ± 0.01', ''),
    ],
)
def test_an_interval_has_the_size_or_not(
    name: str, kind: str, subject: str, sentence: str, expected: str
) -> None:
    assert interval(finding(kind, subject, sentence), RECORDINGS[name]) == expected


def test_verdicts() -> None:
    rate, wrong = (
        finding('rate', 'gyro', z=None, share=0.0),
        finding('drift', 'gnss', certainty=0.9),
    )
    right = finding('sign', 'gyro.omega', share=0.4)
    assert row('rover_clean', rate).verdict == 'clean'
    assert row('rover_clean', rate).flagged
    assert row('rover_clean', wrong, rate).verdict == 'flagged'
    assert row('elevator_barometer_drift').verdict == 'clean'
    assert row('rover_gyro_sign', rate).verdict == 'missed'
    assert row('rover_gyro_sign', wrong).verdict == 'wrong'
    scored = row('rover_gyro_sign', rate, wrong, right)
    assert (scored.verdict, scored.rank, scored.printed) == ('within three', 2, 3)
    assert scored.confident
    assert not row('rover_gyro_sign', {**wrong, 'certainty': 0.89}, right).confident
    assert judge('rover_gyro_sign', {'findings': None, 'seconds': 1.0}).verdict == 'failed'


def test_shares_count_what_shows() -> None:
    rows = [row('rover_clean'), row('rover_gyro_sign', finding('sign', 'gyro.omega'))]
    text = [*shares(rows)]
    assert text[0].split() == ['first', '1', 'of', '1', '100', '%']
    assert any(line.split()[:4] == ['sign', '1', 'of', '1'] for line in text)


def test_a_result_is_not_computed_twice(tmp_path: Path) -> None:
    (tmp_path / 'doctor').mkdir()
    run = {'findings': [], 'seconds': 2.0}
    (tmp_path / 'doctor' / 'result.json').write_text(json.dumps(run))
    assert examine('tank_clean', tmp_path, 1.0) == run
