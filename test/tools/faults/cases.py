# SPDX-License-Identifier: Apache-2.0
"""The fault matrix: faults, and the promises that hold nevertheless.

All cases here use the scenario ``mass_spring_damper_2d``, with positions at 20 Hz and a standard
deviation of 0.05 m, and velocities at 100 Hz and 0.5 m/s.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum

from kalman_ros.core import Value

SCENARIO = 'mass_spring_damper_2d'


class Promise(Enum):
    """How a filter must handle a fault that it does not model."""

    COVERED = 'the covariance covers the error'
    WARNED = 'the error is bounded, and the innovations give it away'
    BOUNDED = 'the error is bounded'


@dataclass(frozen=True)
class Schedule:
    """When faults act, and when a run ends, in seconds."""

    start: float = 0.5
    end: float = 3.5
    stop: float = 7.0


#: For tests.
SHORT = Schedule(end=1.6, stop=3.2)


@dataclass(frozen=True)
class Case:
    """One fault, or several at once.

    Parameters
    ----------
    name
        For people.
    promise
        The promise.
    plant
        The parameters of the plant during the fault; options with a window use the schedule's.
    estimator
        The parameters of the estimator.
    bound
        The largest error of a position, in m, that is allowed.
    pose
        A position to which the estimator is reset, with a standard deviation of a millimetre.
    """

    name: str
    promise: Promise
    plant: Mapping[str, Value]
    estimator: Mapping[str, Value] = field(default_factory=dict)
    bound: float = 0.5
    pose: tuple[float, float] | None = None

    def windows(self, schedule: Schedule, sensors: Iterable[str]) -> dict[str, Value]:
        """Return the parameters that limit the faults of plant and sensors to their time."""
        window = [schedule.start, schedule.end]
        names = ('fault_window', *(f'{sensor}.fault_window' for sensor in sensors))
        return {name: list(window) for name in names}

    @property
    def lasts(self) -> bool:
        """Whether its fault has no window, and so lasts for the whole run."""
        return any(name.startswith(_LASTING) for name in self.plant)


#: Parameters of the plant that no window limits.
_LASTING = ('model_parameters.', 'actuator_gain', 'actuator_delay')


def _both(**settings: Value) -> dict[str, Value]:
    """Return the same faults of both sensors."""
    return {f'{name}.{key}': v for name in ('position', 'velocity') for key, v in settings.items()}


_GATES = _both(gate=0.999)
_COVERED, _WARNED, _BOUNDED = Promise.COVERED, Promise.WARNED, Promise.BOUNDED

CASES: tuple[Case, ...] = (
    Case('none', _COVERED, {}),
    Case('dropout 0.3 of position', _COVERED, {'position.dropout': 0.3}),
    Case('dropout 0.7 of both', _COVERED, _both(dropout=0.7)),
    Case('loss of all positions', _COVERED, {'position.dropout': 1.0}),
    Case('loss of everything', _COVERED, _both(dropout=1.0), bound=1.5),
    Case('bursts of 5 lost, a third of all', _COVERED, _both(burst_loss=0.1, burst_length=5.0)),
    Case('bursts of 30 lost, half of all', _COVERED, _both(burst_loss=0.03, burst_length=30.0)),
    Case('delay 0.05 s of position', _COVERED, {'position.delay': 0.05}),
    Case('delay 0.3 s of both', _COVERED, _both(delay=0.3)),
    Case('delay 1.2 s of position, beyond the window', _COVERED, {'position.delay': 1.2}),
    Case('jitter 0.05 s of both', _COVERED, _both(jitter=0.05)),
    Case('jitter 0.4 s of both', _COVERED, _both(jitter=0.4)),
    Case('reordering 0.3 of both', _COVERED, _both(reordering=0.3)),
    Case('duplication 0.5 of both', _COVERED, _both(duplication=0.5)),
    Case('NaN 0.2 of both', _COVERED, _both(nan=0.2)),
    Case('NaN always, of position', _COVERED, {'position.nan': 1.0}),
    Case('outliers 0.05 of both, gates', _COVERED, _both(outliers=0.05), _GATES),
    Case('outliers 0.3 of both, gates', _COVERED, _both(outliers=0.3), _GATES),
    Case('outliers 0.3 of position, no gate', _WARNED, {'position.outliers': 0.3}, bound=2.0),
    Case('bias 0.1 m', _BOUNDED, {'position.bias': [0.1]}),
    Case('bias 1 m', _WARNED, {'position.bias': [1.0]}, bound=1.5),
    Case('bias 5 m/s of velocity', _WARNED, {'velocity.bias': [5.0]}, bound=2.5),
    Case('drift 0.1 m/s', _BOUNDED, {'position.drift': [0.1]}, bound=1.5),
    Case('drift 2 m/s', _WARNED, {'position.drift': [2.0]}, bound=25.0),
    Case('random walk 1 m in a second', _WARNED, {'position.random_walk': [1.0]}, bound=10.0),
    Case('freeze of position', _WARNED, {'position.freeze': True}, bound=1.5),
    Case('freeze of velocity', _BOUNDED, {'velocity.freeze': True}, bound=1.5),
    Case('actuator gain 0.5', _BOUNDED, {'actuator_gain': [0.5]}),
    Case('actuator delay 0.1 s', _BOUNDED, {'actuator_delay': 0.1}),
    Case('actuator dead zone 0.5 N', _BOUNDED, {'actuator_dead_zone': [0.5]}),
    Case('actuator loses 0.5 of all commands', _BOUNDED, {'actuator_loss': 0.5}),
    Case('actuator loses every command', _BOUNDED, {'actuator_loss': 1.0}, bound=1.5),
    Case('mass 1.5 kg, believed 1 kg', _BOUNDED, {'model_parameters.mass': 1.5}),
    Case('stiffness x 8 N/m, believed 2', _BOUNDED, {'model_parameters.stiffness_x': 8.0}),
    Case('process noise ten times', _WARNED, {'model_parameters.force_noise': 1.0}),
    Case('constant push 2 N', _BOUNDED, {'disturbance_constant': [2.0]}, bound=1.0),
    Case('sine push 5 N, 1 Hz', _BOUNDED, {'disturbance_amplitude': [5.0]}, bound=1.0),
    Case('white push, 1 N^2 s', _BOUNDED, {'disturbance_noise': [1.0]}),
    Case(
        'dropout, jitter, duplication, reordering, NaN',
        _COVERED,
        _both(dropout=0.2, jitter=0.1, duplication=0.2, reordering=0.2, nan=0.1),
    ),
    Case(
        'bursts, delay and outliers, gates',
        _COVERED,
        _both(burst_loss=0.05, burst_length=5.0, delay=0.1, outliers=0.05),
        _GATES,
    ),
    Case(
        'bias 1 m, push 1 N, half of the commands lost',
        _WARNED,
        {'position.bias': [1.0], 'disturbance_constant': [1.0], 'actuator_loss': 0.5},
        bound=2.0,
    ),
    Case(
        'bias 2 m that a gate locks in',
        _WARNED,
        {'position.bias': [2.0]},
        {**_GATES, 'gate_recover_after': 10},
        bound=3.0,
    ),
    Case('sure of a place 10 m off, gates', _WARNED, {}, _GATES, bound=20.0, pose=(11.0, -0.5)),
)
