# SPDX-License-Identifier: Apache-2.0
"""What a lag of the first order adds to readings: tau dm_l/dt + m_l = m.

With the prediction of a filter in the place of the measured quantity m, m_l - m is the effect of
the lag on a reading, one for each of some times tau.
"""

from __future__ import annotations

import numpy as np

from kalman_ros.core import Array, Space

#: Number of trial lags, the shortest in usual intervals of the readings, and the longest (s), also
#: as a share of the recording.
_TRIALS, _SHORTEST, _LONGEST, _SHARE = 8, 1.0, 20.0, 0.05


def lags(times: Array) -> Array:
    """Return the trial lags (T,) of a sensor that reads at times (N,), in seconds."""
    if len(times) < 3:
        return np.zeros(0)
    usual = float(np.median(np.diff(times)))
    longest = min(_LONGEST, _SHARE * float(times[-1] - times[0]))
    shortest = _SHORTEST * max(usual, 1e-3)
    return np.geomspace(shortest, longest, _TRIALS) if longest > shortest else np.zeros(0)


def behind(times: Array, values: Array, lag: float) -> Array:
    """Return what a lag makes of values (N, k) at times (N,), less the values; it begins at rest.

    Between two of them they change linearly, for which the lag has an exact solution.
    """
    error = np.zeros_like(values)
    for i in range(1, len(times)):
        dt = float(times[i] - times[i - 1])
        left = np.exp(-dt / lag)
        share = lag / dt * (1.0 - left) if dt > 0.0 else 1.0
        error[i] = left * error[i - 1] - share * (values[i] - values[i - 1])
    return error


def columns(times: Array, values: Array, output: Space) -> tuple[list[tuple[str, ...]], Array]:
    """Return labels and effects (N, k, T) of each trial lag on predicted readings (N, k)."""
    if output.rotations:
        return [], np.zeros((*values.shape, 0))
    values, found = continuous(values, output), lags(times)
    effects = [behind(times, values, lag) for lag in found.tolist()]
    block = np.stack(effects, axis=2) if effects else np.zeros((*values.shape, 0))
    return [('lag of', repr(lag)) for lag in found.tolist()], block


def continuous(values: Array, space: Space) -> Array:
    """Return values (N, k) whose angles do not jump."""
    values, turning = values.copy(), space.indices(space.angles)
    values[:, turning] = np.unwrap(values[:, turning], axis=0)
    return values
