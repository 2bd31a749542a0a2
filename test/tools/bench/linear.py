# SPDX-License-Identifier: Apache-2.0
"""A linear system of any size as parameters of a scenario."""

from __future__ import annotations

from typing import Any

import numpy as np


def parameters(n: int, k: int, filter: str, rate: float) -> dict[str, Any]:
    """Return the parameters of a linear system (n states), the first k of which are read."""
    rng = np.random.default_rng(0)
    states = [f'x{index}' for index in range(n)]
    A = 0.3 * rng.normal(size=(n, n)) - 2.0 * np.eye(n)
    return {
        'model': 'linear',
        'model_parameters.states': states,
        'model_parameters.A': A.ravel().tolist(),
        'model_parameters.B': [1.0] * n,
        'model_parameters.noise_density': [0.1] * n,
        'filter': filter,
        'rate': rate,
        'sensors': ['y'],
        'y.kind': 'states',
        'y.measures': states[:k],
        'y.noise': [0.5] * k,
        'y.rate': rate,
        'y.type': 'sensor_msgs/JointState',
        'y.fields': [f'position[{name}]' for name in states[:k]],
        'state.type': 'sensor_msgs/JointState',
        'state.fields': [f'position[{name}]' for name in states],
        'input.type': 'std_msgs/Float64MultiArray',
        'input.fields': ['data[0]'],
        'initial_std': [1.0] * n,
    }
