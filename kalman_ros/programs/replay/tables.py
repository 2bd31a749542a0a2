# SPDX-License-Identifier: Apache-2.0
"""Results of a replay as a table and sentences for the terminal, and as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict
from math import isfinite
from typing import Any

from kalman_ros.analysis.checks import Check
from kalman_ros.bags.replayed import Replayed
from kalman_ros.report.run_tables import checks_json, plain
from kalman_ros.report.sheet import Sheet

from .statistics import Errors, SensorStatistics, largest_change, statistics, unjudged


def _cell(value: float, scale: float = 1.0) -> str:
    return '' if value != value else f'{value * scale:.3g}'


def sensor_sheet(replayed: Replayed) -> Sheet:
    """Return the statistics of the sensors, one row for each sensor."""
    rows = [statistics(sensor) for sensor in replayed.sensors.values()]

    def column(title: str, name: str, scale: float = 1.0) -> tuple[str, list[str]]:
        return title, [_cell(getattr(row, name), scale) for row in rows]

    def count(title: str, name: str) -> tuple[str, list[str]]:
        return title, [str(getattr(row, name)) for row in rows]

    return Sheet(
        list(replayed.sensors),
        [
            column('Hz', 'rate'),
            column('gap', 'gap'),
            column('delay', 'delay', 1e3),
            column('99 %', 'slowest', 1e3),
            count('fused', 'fused'),
            count('rejected', 'rejected'),
            count('dropped', 'dropped'),
            column('NIS', 'nis'),
            column('white', 'whiteness'),
        ],
    )


def sentences(replayed: Replayed, errors: Errors | None) -> Iterator[str]:
    """Yield the outcomes of readings, restarts, notes, smoothing and errors, line by line."""
    for name, sensor in replayed.sensors.items():
        for outcome, number in sensor.counts.items():
            if number and outcome.name != 'FUSED':
                yield f'{name}: {number} {outcome.value}'
        numbers = statistics(sensor)
        if numbers.rejected and isfinite(numbers.accepted_nis):
            yield f'{name}: NIS {numbers.accepted_nis:.3g} without the rejected readings'
        if sensor.undecodable:
            yield f'{name}: {sensor.undecodable} dropped: not decodable, or too long'
    if replayed.restarts:
        yield f'The estimator restarted {replayed.restarts} times.'
    yield from replayed.notes
    change = largest_change(replayed)
    if change is not None:
        state, time, size, sigmas = change
        yield f'Smoothing changed {state} most: by {size:.3g} ({sigmas:.2g} sigma) at {time:.4g} s'
    if replayed.truth is not None:
        yield from _truth_sentences(replayed, errors)


def claim(replayed: Replayed) -> str:
    """Return the claim of a replay that passes all checks."""
    few = ', '.join(f'{name} ({count})' for name, count in unjudged(replayed).items())
    if not few:
        return 'The filter is consistent.'
    return f'what could be judged is consistent; too few innovations of {few}'


def _truth_sentences(replayed: Replayed, errors: Errors | None) -> Iterator[str]:
    if errors is None:
        yield 'The truth is not known at the time of any estimate.'
        return
    space = replayed.scenario.model.state
    named = (f'{space.label(n)} {e:.3g}' for n, e in zip(space.names, errors.rms.tolist()))
    yield f'RMS errors: {", ".join(named)}; NEES / {space.size}: {errors.nees:.3g}'
    if errors.ate == errors.ate:
        yield f'Absolute trajectory error (ATE): {errors.ate:.4g} m'


def summary(
    replayed: Replayed, errors: Errors | None, checks: list[Check], passed: bool
) -> dict[str, Any]:
    """Return all results for ``summary.json``."""
    result: dict[str, Any] = {
        'duration': replayed.duration,
        'lockstep': replayed.lockstep,
        'estimates': len(replayed.beliefs.time),
        'inputs': len(replayed.inputs.stamp),
        'restarts': replayed.restarts,
        'repairs': replayed.repairs,
        'passed': passed,
        'sensors': {
            name: {
                **_statistics_json(statistics(sensor)),
                'outcomes': {outcome.name: n for outcome, n in sensor.counts.items() if n},
                'undecodable': sensor.undecodable,
            }
            for name, sensor in replayed.sensors.items()
        },
        'checks': checks_json(checks),
        'notes': list(replayed.notes),
        'arithmetic': replayed.arithmetic,
    }
    if errors is not None:
        names = replayed.scenario.model.state.names
        result['truth'] = {
            'rms': dict(zip(names, errors.rms.tolist())),
            'nees': plain(errors.nees),
            'ate': plain(errors.ate),
            'estimates': errors.count,
        }
    change = largest_change(replayed)
    if change is not None:
        result['smoothing'] = dict(zip(('state', 'time', 'change', 'sigmas'), change))
    return result


def _statistics_json(numbers: SensorStatistics) -> dict[str, Any]:
    return {name: plain(value) for name, value in asdict(numbers).items()}
