# SPDX-License-Identifier: Apache-2.0
"""What a sensor should have read, as the others predict it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from kalman_ros.analysis.records import SensorRecord
from kalman_ros.core import Array

from .evidence import Evidence
from .examination import Examination
from .passage import Event, Passage, passage, usable

#: The fewest readings that are compared.
_FEWEST = 50


class LeftOut(NamedTuple):
    """The usable readings of a sensor by stamp, and what a pass without them predicts.

    Parameters
    ----------
    evidence, without
        The recording without the sensor, and its pass.
    record, predicted
        The readings, and their predictions (N, k).
    events
        Of each reading, the last event of the pass before it.
    """

    evidence: Evidence
    without: Passage
    record: SensorRecord
    predicted: Array
    events: list[Event]


def left_out(case: Examination, name: str, until: float = np.inf) -> LeftOut | None:
    """Return the readings of a sensor beside predictions, up to a stamp (s); None if too few."""
    record = case.evidence.sensors[name]
    rest = case.evidence.with_sensor(name, record.select(slice(0)))
    without = passage(rest, until, strict=False)
    record = record.select(usable(record) & (record.stamp <= until))
    if len(record) < _FEWEST or len(without.events) < _FEWEST:
        return None
    record = record.select(np.argsort(record.stamp, kind='stable'))
    at = np.searchsorted([event.time for event in without.events], record.stamp, 'right') - 1
    events = [without.events[i] for i in np.maximum(at, 0)]
    sensor = case.evidence.scenario.sensors[name].sensor
    predicted = np.array([sensor.measure(event.x) for event in events])
    return LeftOut(rest, without, record, predicted, events)
