# SPDX-License-Identifier: Apache-2.0
"""Evidence from a bag and a parameter file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from itertools import islice
from math import inf
from pathlib import Path
from typing import Any

import numpy as np

from kalman_ros import models
from kalman_ros.analysis.checks import Check
from kalman_ros.analysis.diagnosis.evidence import Evidence, changed
from kalman_ros.analysis.records import SensorRecord
from kalman_ros.bags.feed import resolver
from kalman_ros.bags.reading import Bag
from kalman_ros.bags.replay import estimator_settings, replay_bag
from kalman_ros.codecs.messages import (
    UndecodableError,
    decode,
    full_type,
    has_header,
    message_type,
)
from kalman_ros.core import Array
from kalman_ros.programs.replay.statistics import checks
from kalman_ros.scenario import Scenario, shipped
from kalman_ros.scenario.parameter_files import from_file

_IMU = 'sensor_msgs/Imu'
#: Number of first messages of an IMU by which its attitude is judged.
_FIRST = 50


def load(
    bag: str | Path,
    params: str | Path | None,
    changes: Mapping[str, Any] | None = None,
    part: tuple[float, float] = (0.0, inf),
) -> Evidence:
    """Replay a bag through the estimator of a parameter file, and return the evidence.

    Parameters
    ----------
    bag
        A folder of rosbag2, one of its files, or a bag of ROS 1.
    params
        A parameter file, or the name of a scenario; None for the default one.
    changes
        Parameters over those of the file.
    part
        Start and end of the part that is replayed, in seconds of the recording.

    Raises
    ------
    ValueError
        If the bag cannot be replayed.
    """
    values = from_file(shipped.file(params or models.DEFAULT), 'estimator')
    return replayed(Bag(bag), {'model': models.DEFAULT, **values, **(changes or {})}, part)


def failed_checks(evidence: Evidence) -> list[Check]:
    """Return the checks of its replay that `replayed` evidence fails."""
    run: Any = evidence
    return [check for check in checks(run, None) if not check.passed]


def replayed(
    bag: Bag, parameters: Mapping[str, Any], part: tuple[float, float] = (0.0, inf)
) -> Evidence:
    """Return the evidence of a part of a bag with the estimator's parameters."""
    start, end = part
    result = replay_bag(bag, estimator_settings(parameters), start=start, end=end)

    def again(changes: Mapping[str, Any], seconds: float = inf) -> Evidence:
        return replayed(bag, changed(parameters, changes), (start, min(end, start + seconds)))

    sensors: dict[str, SensorRecord] = dict(result.sensors)
    signals = {name: source.signal for name, source in result.scenario.sensors.items()}
    signals['input'] = result.scenario.input
    headerless = frozenset(name for name, signal in signals.items() if not has_header(signal.type))
    forces = dict(_forces(bag, result.scenario, start))
    return Evidence(
        parameters, result.scenario, sensors, result.inputs, result.beliefs, again, headerless,
        forces, result.start,
    )  # fmt: skip


def _forces(bag: Bag, scenario: Scenario, start: float) -> Iterator[tuple[str, Array]]:
    """Yield each sensor of an IMU, and the input, with the force that it reads at first."""
    signals = {name: source.signal for name, source in scenario.enabled.items()}
    for name, signal in {**signals, 'input': scenario.input}.items():
        topic = resolver('/')(signal.topic)
        if signal.type != _IMU or bag.topics.get(topic) != {full_type(_IMU)}:
            continue
        read = []
        for message in islice(bag.messages([topic], bag.start + round(start * 1e9)), _FIRST):
            with suppress(UndecodableError):
                force = decode(message.data, message_type(_IMU)).linear_acceleration
                read.append((force.x, force.y, force.z))
        finite = [reading for reading in read if np.isfinite(reading).all()]
        if finite:
            yield name, np.median(finite, axis=0)
