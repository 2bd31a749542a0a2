# SPDX-License-Identifier: Apache-2.0
"""The arrays part runs where there are no processes, sockets and compilers, as in a browser."""

import subprocess
import sys

import pytest
from thorough import mostly_thorough

#: What a Python in a browser does not have, or has without a function.
ABSENT = (
    'multiprocessing', '_multiprocessing', '_posixsubprocess', 'subprocess', 'socket', '_socket',
    'asyncio', 'ctypes', 'fcntl', 'resource', 'termios', 'pty',
)  # fmt: skip
EXTRAS = ('casadi', 'rclpy', 'matplotlib', 'distributed', 'dask', 'websockets', 'pandas')

GUARD = f"""
import sys

sys.modules.update(dict.fromkeys({EXTRAS!r}))
ABSENT, ALLOWED = {ABSENT!r}, ('kalman_ros', 'numpy', 'scipy', 'yaml', 'rich')


class Guard:
    def find_spec(self, name, path=None, target=None):
        frame = sys._getframe(1)
        while 'importlib' in frame.f_code.co_filename:
            frame = frame.f_back
        top = name.partition('.')[0]
        other = top not in sys.stdlib_module_names and top not in ALLOWED
        if 'kalman_ros' in frame.f_code.co_filename and (top in ABSENT or other):
            raise ModuleNotFoundError(f'{{name}}: imported by {{frame.f_code.co_filename}}')


# what numpy and scipy need is not ours; reports are printed by rich, which is pure Python
import numpy as np, scipy.linalg, scipy.stats, scipy.optimize, scipy.integrate, yaml
for name in ABSENT:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Guard())
import kalman_ros as kr
A, B, C = [[0, 1], [0, 0]], [[0], [1]], [[1, 0]]
model, times = kr.continuous_model(A, B, W=[0, 0.1]), np.arange(50) * 0.1
sensors = {{'p': kr.sensor([1, 0], 0.01)}}
"""

CALLS = {
    'designs': 'kr.margins(kr.lqr(A, B, np.diag([1, 0]), [[1]])); kr.lqe(A, C, np.eye(2), [[1]])',
    'filters': (
        'found = kr.filter(model, sensors, times, np.sin(times), initial=([0, 0], [1, 1]));'
        'kr.smooth(found); kr.consistency(found); print(found)'
    ),
    'loops': "print(kr.simulate('cart_pole', seconds=1))",
    'many loops': "print(kr.monte_carlo('mass_spring_damper', runs=3, seconds=1))",
    'reports': "print(kr.design('mass_spring_damper'))",
    'fits': (
        'level = lambda q=1.0, r=1.0: (kr.discrete_model([[1]], Q=[[q]]), ([[1]], [[r]]));'
        'y = np.cumsum(np.random.default_rng(1).normal(size=60));'
        'print(kr.tune(level, readings=y, initial=([0.0], [[10.0]])))'
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize('what', mostly_thorough(CALLS, 'fits'))
def test_it_runs_without(what):
    done = subprocess.run(
        [sys.executable, '-c', GUARD + CALLS[what]], capture_output=True, text=True, timeout=100
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_guard_guards():
    use = "kr.monte_carlo('mass_spring_damper', runs=3, seconds=1, workers=2)"
    done = subprocess.run(
        [sys.executable, '-c', GUARD + use], capture_output=True, text=True, timeout=100
    )
    assert 'multiprocessing: imported by' in done.stderr
