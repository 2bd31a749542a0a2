# SPDX-License-Identifier: Apache-2.0
"""The scenarios of the fault matrix, each with its cases."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from kalman_ros.core import Value

from .cases import CASES, SCENARIO, Case, Promise


@dataclass(frozen=True)
class Setting:
    """A scenario, and what goes wrong in it.

    Parameters
    ----------
    scenario
        Its name.
    positions
        Where the positions are in the state, by which errors are measured.
    cases
        The faults.
    filters
        Those that are tried; none for any.
    returns
        Whether the controller brings the positions back to the origin.
    """

    scenario: str
    positions: tuple[int, ...]
    cases: tuple[Case, ...]
    filters: tuple[str, ...] = ()
    returns: bool = False


def _robot(scenario: str, place: str, *others: str) -> Setting:
    """Return the setting of a robot in space; ``place`` is the sensor of its position."""

    def every(**settings: Value) -> dict[str, Value]:
        return {f'{n}.{key}': v for n in (place, *others) for key, v in settings.items()}

    gates, covered = every(gate=0.999), Promise.COVERED

    def cases() -> Iterator[Case]:
        yield Case('none', covered, {})
        yield Case('dropout 0.7 of all', covered, every(dropout=0.7))
        yield Case('loss of all positions', covered, {f'{place}.dropout': 1.0}, bound=3.0)
        yield Case('loss of everything', covered, every(dropout=1.0), bound=5.0)
        yield Case('delay 0.3 s of all', covered, every(delay=0.3))
        yield Case('jitter 0.4 s of all', covered, every(jitter=0.4))
        yield Case('reordering 0.3 of all', covered, every(reordering=0.3))
        yield Case('duplication 0.5 of all', covered, every(duplication=0.5))
        yield Case('NaN 0.2 of all', covered, every(nan=0.2))
        yield Case('outliers 0.05 of all, gates', covered, every(outliers=0.05), gates)
        biased = {f'{place}.bias': [5.0]}
        yield Case('bias 5 m of position', Promise.WARNED, biased, bound=9.0)

    named = (Case(f'{scenario}: {c.name}', c.promise, c.plant, c.estimator, max(c.bound, 1.5))
             for c in cases())  # fmt: skip
    return Setting(scenario, (0, 1, 2), tuple(named), ('ekf', 'ukf'))


SETTINGS: tuple[Setting, ...] = (
    Setting(SCENARIO, (0, 2), CASES, returns=True),
    _robot('robot_3d', 'position', 'odometry', 'imu'),
    _robot('inertial', 'position', 'magnetometer', 'barometer', 'wheels'),
)
