# SPDX-License-Identifier: Apache-2.0
"""Examinations of readings and of regressions that are given, without a recording."""

from types import SimpleNamespace

import numpy as np

from kalman_ros.analysis.diagnosis.evidence import Evidence
from kalman_ros.analysis.diagnosis.passage import Passage
from kalman_ros.analysis.diagnosis.responses import Responses
from kalman_ros.analysis.records import Beliefs, InputRecord, SensorRecord
from kalman_ros.estimators.outcome import Outcome
from kalman_ros.scenario import build

PARAMETERS = {'model': 'mass_spring_damper', 'position.noise': [0.05], 'position.rate': 20.0}
START = 1000.0


def record(stamp, received=None, value=None, covariance=0.0025, **others):
    """Return readings of one number with these stamps in seconds after the start."""
    N = len(stamp)
    stamp = START + np.asarray(stamp, dtype=float)
    fields = {
        'stamped': np.ones(N, dtype=bool),
        'completed': np.zeros(N, dtype=bool),
        'value': np.arange(N, dtype=float) if value is None else np.asarray(value, dtype=float),
        'covariance': np.broadcast_to(covariance, N),
        'outcome': np.full(N, Outcome.FUSED.name, dtype=object),
        'innovation': np.zeros((N, 1)),
        'innovation_covariance': np.ones((N, 1, 1)),
        'nis': np.zeros(N),
        **others,
    }
    fields['value'] = fields['value'].reshape(N, 1)
    fields['covariance'] = np.array(fields['covariance'], dtype=float).reshape(N, 1, 1)
    return SensorRecord(stamp if received is None else START + np.array(received), stamp, **fields)


def evidence(readings, inputs=(), **parameters):
    """Return the evidence of a recording with some readings of the position, and inputs."""
    parameters = {**PARAMETERS, **parameters}
    given = np.asarray(inputs, dtype=float).reshape(-1, 1)
    times = START + 0.05 * np.arange(len(given))
    none = InputRecord(times, times, given)
    beliefs = Beliefs(np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2, 2)))
    sensors = {'position': readings}
    return Evidence(parameters, build(parameters), sensors, none, beliefs, rerun=None)


def case(readings, squares=None, **parameters):
    """Return an examination whose filter pass has these normalised squares, by reading."""
    squares = np.zeros(len(readings)) if squares is None else squares
    events = [
        SimpleNamespace(
            index=i,
            sensor='position',
            time=readings.stamp[i],
            innovation=np.array([square**0.5]),
            S=np.eye(1),
        )
        for i, square in enumerate(squares)
    ]
    events = [event for event in events if np.isfinite(event.innovation).all()]
    passage = Passage(events, [event.innovation for event in events])
    # an event that is given cannot be moved to another reading
    passage.__dict__['selected'] = lambda name, rows: None
    found = evidence(readings, **parameters)
    return SimpleNamespace(evidence=found, passage=passage, judged=['position'])


def responding(labels, size, std, readings=None, correlation=0.0, **parameters):
    """Return an examination whose regressions find these sizes with these deviations."""
    size, std = np.atleast_1d(size), np.atleast_1d(std)
    mixed = np.eye(len(size)) + correlation * (1.0 - np.eye(len(size)))
    information = np.linalg.inv(mixed * np.outer(std, std))
    found = case(record(np.arange(7.0)) if readings is None else readings, **parameters)
    found.responses = Responses(labels, information @ size, information)
    return found


def kinds(findings):
    return [finding.kind for finding in findings]
