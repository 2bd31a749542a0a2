# SPDX-License-Identifier: Apache-2.0
"""Instruments that are turned about the vertical, and of which a file reads one level axis alone.

The recording has the other axis, too: an IMU that is turned reads a part of the acceleration
across as one ahead.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from math import cos, degrees, pi, sin
from typing import Any

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array, rotations
from kalman_ros.core.quantity import PLACE, quantity
from kalman_ros.scenario import SensorSource

from .evidence import Evidence
from .examination import CHANCE, Examination
from .finding import Finding
from .responses import Columns, Fit, responses

#: The smallest angle that is a finding, in rad.
_SMALL = 0.01
#: Seconds in which two opposite mountings are compared, and by how much they differ at least: by
#: nothing if arrays stand for messages, or if a driver leaves the other axis at zero.
_GLANCE, _ROUNDED = 5.0, 1e-9
_LEVEL = ('x', 'y')


def find(case: Examination) -> Iterator[Finding]:
    """Yield the sensors whose readings fit once the instrument is turned about the vertical."""
    for name in case.judged:
        partial = _PartlyRead.of(case.evidence, name)
        if partial is None:
            continue
        fit = partial.fit(case, 0.0)
        angle = float(fit.size[0])
        if fit.gain > CHANCE and abs(angle) > max(_SMALL, 4.0 * float(fit.std[0])):
            yield partial.turned(angle, fit)


@dataclass(frozen=True, eq=False)
class _PartlyRead:
    """A sensor that reads one level axis of a vector.

    Parameters
    ----------
    evidence, name
        Recording, and the sensor.
    ahead, across
        Readings of that axis, and of the one that a quarter turn brings there (N, k); zero for
        other coordinates.
    """

    evidence: Evidence
    name: str
    ahead: Array
    across: Array

    @staticmethod
    def of(evidence: Evidence, name: str) -> _PartlyRead | None:
        """Return what a recording has of a sensor; None if it reads no vector partly."""
        indices = _indices(evidence.scenario.sensors[name])
        record = evidence.sensors[name]
        if not indices or not len(record):
            return None
        rerun: Any = evidence.rerun
        turns = (_mounted(evidence, name, angle) for angle in (0.5 * pi, -0.5 * pi))
        turned = _quarter_turn(rerun, name, *turns)
        if turned is None or not len(turned):
            return None
        rows = np.searchsorted(turned.received, record.received)
        rows = np.minimum(rows, len(turned) - 1)
        if not np.array_equal(turned.received[rows], record.received):
            return None
        ahead, across = np.zeros_like(record.value), np.zeros_like(record.value)
        ahead[:, indices] = record.value[:, indices]
        across[:, indices] = turned.value[rows][:, indices]
        return _PartlyRead(evidence, name, ahead, across)

    def fit(self, case: Examination, angle: float) -> Fit:
        """Return the fit of a further turn, in rad, of readings that are turned by an angle."""
        index = case.passage.series('index', self.name)
        change = sin(angle) * self.ahead[index] - cos(angle) * self.across[index]
        columns = Columns([('turned', self.name)], {self.name: [(0, change[:, :, np.newaxis])]})
        return responses(case.passage, columns).alone(0)

    def turned(self, angle: float, fit: Fit) -> Finding:
        """Return the finding that the instrument is turned by an angle."""
        option = f'{self.name}.mount.rotation'
        mount = [round(euler, 4) for euler in _mounted(self.evidence, self.name, angle)]
        value = self.evidence.sensors[self.name].value
        moved = value + (cos(angle) - 1.0) * self.ahead + sin(angle) * self.across

        def again(after: Examination) -> Finding | None:
            more = self.fit(after, angle)
            if not more.remains:
                return None
            return self.turned(angle + float(more.size[0]), replace(more, gain=0.0))

        return Finding(
            'rotated', self.name,
            f'readings of {self.name} fit once it is turned by {degrees(angle):+.3g} ± '
            f'{degrees(float(fit.std[0])):.1g} deg about the vertical: it is mounted at an angle, '
            f'and reads a part of the other axis. {option}: {mount}.',
            fit.gain**0.5, {option: mount}, gain=fit.gain, again=again,
            mended=lambda: self.evidence.with_values(self.name, moved),
        )  # fmt: skip


def _indices(source: SensorSource) -> list[int]:
    """Return the coordinates that are one of the level axes of a vector, without the other one."""
    fields = source.signal.fields
    level = [
        (index, read.siblings()[:2])
        for index, read in enumerate(map(quantity, fields))
        if read is not None and read.names[:2] == _LEVEL and read.axis < 2 and read.kind != PLACE
    ]
    return [index for index, pair in level if not {*pair} <= {*fields}]


def _mounted(evidence: Evidence, name: str, angle: float) -> tuple[float, ...]:
    """Return the Euler angles of a mounting that is turned about the vertical by an angle."""
    known = np.array(evidence.scenario.sensors[name].signal.mounting.rotation)
    turn = rotations.exp(np.array([0.0, 0.0, angle])) @ rotations.exp(rotations.from_euler(known))
    return tuple(rotations.to_euler(rotations.log(turn)).tolist())


@lru_cache(maxsize=8)
def _quarter_turn(
    rerun: Any, name: str, mount: tuple[float, ...], opposite: tuple[float, ...]
) -> SensorRecord | None:
    """Return the readings of a sensor with another mounting; None where that changes nothing."""
    option = f'{name}.mount.rotation'
    try:
        first, second = (
            rerun({option: [*angles]}, _GLANCE).sensors[name].value for angles in (mount, opposite)
        )
        with np.errstate(invalid='ignore'):
            apart = np.abs(np.nan_to_num(first - second)).max(initial=0.0)
        if apart <= _ROUNDED:
            return None
        record: SensorRecord = rerun({option: [*mount]}).sensors[name]
    except ValueError:  # its messages have no such vector
        return None
    return record
