# SPDX-License-Identifier: Apache-2.0
"""Leave-one-out prediction: the readings of a sensor as the other sensors predict them."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .evidence import Evidence
from .examination import Examination
from .filter_pass import passage, usable
from .passage import Passage

#: The smallest number of readings that are compared.
_FEWEST = 50


class LeftOut(NamedTuple):
    """The usable readings of a sensor in order of stamps, and their leave-one-out prediction.

    Parameters
    ----------
    evidence, without
        Recording without the sensor, and its filter pass.
    record, predicted
        Readings of the sensor, and their predictions (N, k).
    rows
        Last event of the pass before each reading, by index (N,).
    """

    evidence: Evidence
    without: Passage
    record: SensorRecord
    predicted: Array
    rows: Any


def left_out(
    case: Examination, name: str, until: float = np.inf, fewest: int = _FEWEST
) -> LeftOut | None:
    """Return a sensor's readings and predictions up to a stamp (s); None below the ``fewest``."""
    record = case.evidence.sensors[name]
    rest = case.evidence.with_sensor(name, record.select(slice(0)))
    without = passage(rest, until, strict=False)
    record = record.select(usable(record) & (record.stamp <= until))
    if len(record) < fewest or len(without.events) < _FEWEST:
        return None
    record = record.select(np.argsort(record.stamp, kind='stable'))
    rows = np.searchsorted(without.series('time'), record.stamp, 'right') - 1
    rows = np.maximum(rows, 0)
    sensor = case.evidence.scenario.sensors[name].sensor
    predicted = sensor.measure(without.series('x')[rows])
    return LeftOut(rest, without, record, predicted, rows)
