# SPDX-License-Identifier: Apache-2.0
"""Values that do not change under new stamps."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .examination import Examination
from .filter_pass import passage
from .finding import Curve, Figure, Finding

#: A value is frozen if it is repeated this number of times, and for this time in seconds or, of a
#: short recording, this share of it, but no less than the last number.
_REPEATED, _FROZEN, _SHARE, _SHORTEST = 10, 0.5, 0.05, 0.15
#: Mean of normalised squares up to which readings of zero are those of a body at rest, and what is
#: as good as zero, in declared standard deviations.
_AGREES, _NOTHING = 2.0, 1e-6
#: Share of the other readings that repeat the one before where this is usual, and standard
#: deviations beside a step within which the value is the expected one.
_USUAL, _WITHIN = 0.3, 2.0


def find(case: Examination) -> list[Finding]:
    """Return the sensors that repeat one value for a long time, except unjudged sensors."""
    sources = case.evidence.scenario.sensors
    return [
        finding
        for name, record in case.evidence.sensors.items()
        if len(record) > _REPEATED and sources[name].judged
        for finding in _frozen(case, name, record)
    ]


def _rests(case: Examination, name: str, record: SensorRecord, rows: Array) -> bool:
    """Return whether the frozen value is that of a body at rest, and the filter agrees.

    It is zero, or what the arithmetic of a driver leaves in its place.
    """
    std = np.sqrt(np.median(record.covariance, axis=0).diagonal())
    if (np.abs(record.value[rows]) > _NOTHING * std).any():
        return False
    return _agrees(case, name, rows)


def _agrees(case: Examination, name: str, rows: Array) -> bool:
    """Return whether readings of a sensor are those that the filter expects."""
    e = case.passage.whitened_of(name)[np.isin(case.passage.series('index', name), rows)]
    return e.size > 0 and float(np.mean(np.square(e))) < _AGREES


def _is_as_usual(case: Examination, name: str, record: SensorRecord, rows: Array) -> bool:
    """Return whether other values are repeated, too, and the model expects this one at its end.

    A reading that is rounded repeats while what it measures changes by less than a step. The
    prediction of the last reading is without those between the first one and it.
    """
    others = record.unchanged
    others[rows[1:]] = False
    usual = others.sum() > _USUAL * (len(record) - len(rows))
    if not usual or not _agrees(case, name, rows):
        return False
    kept = np.setdiff1d(np.arange(len(record)), rows[1:-1])
    rest = case.evidence.with_sensor(name, record.select(kept))
    last = float(record.stamp[rows[-1]])
    filter_pass = passage(rest, last, strict=False)
    if name not in filter_pass.names or filter_pass.series('time', name)[-1] < last - 1e-9:
        return False
    nu, S = (filter_pass.series(field, name)[-1] for field in ('innovation', 'S'))
    levels = [np.unique(column[np.isfinite(column)]) for column in record.value.T]
    step = np.array([np.diff(values).min(initial=np.inf) for values in levels])
    return bool((np.abs(nu) < step + _WITHIN * np.sqrt(S.diagonal())).all())


def _frozen(case: Examination, name: str, record: SensorRecord) -> Iterator[Finding]:
    rows, evidence = repeats(record), case.evidence
    if rows is None or _rests(case, name, record, rows) or _is_as_usual(case, name, record, rows):
        return
    seconds = float(np.ptp(record.stamp[rows]))
    start = float(record.stamp[rows][0]) - evidence.start
    figure = Figure(
        f'{name}: its values', 'time [s]', name,
        tuple(Curve(label, record.stamp - evidence.start, column)
              for label, column in zip(evidence.scenario.sensors[name].sensor.output.names,
                                       record.value.T)),
    )  # fmt: skip
    keep = np.setdiff1d(np.arange(len(record)), rows[1:])
    yield Finding(
        'frozen', name,
        f'{name} repeats one value for {seconds:.3g} s from t = {start:.3g} s on '
        f'({len(rows)} readings) under new stamps: its driver repeats its last value.',
        inf, figure=figure, mended=lambda: evidence.with_sensor(name, record.select(keep)),
    )  # fmt: skip


def repeats(record: SensorRecord) -> Array | None:
    """Return the indices of the readings of the longest frozen value; None without one."""
    breaks = np.flatnonzero(np.append(~record.unchanged, True))
    lengths = np.diff(breaks)
    longest = int(np.argmax(lengths))
    run = np.arange(breaks[longest], breaks[longest + 1])
    typical = float(np.median(lengths))
    enough = len(run) >= max(_REPEATED, 10.0 * typical) or len(run) == len(record) > _REPEATED
    least = min(_FROZEN, max(_SHARE * np.ptp(record.stamp), _SHORTEST))
    return run if enough and np.ptp(record.stamp[run]) >= least else None
