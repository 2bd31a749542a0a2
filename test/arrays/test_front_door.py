# SPDX-License-Identifier: Apache-2.0
"""``import kalman_ros as kr``: what it offers, and what it costs."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path
from statistics import median

import numpy as np
import pytest

import kalman_ros as kr

ROOT = Path(__file__).parents[2]
HEAVY = ('scipy', 'matplotlib', 'rclpy', 'rich', 'yaml', 'PIL', 'filterpy')


def run(code, *flags):
    result = subprocess.run(
        [sys.executable, *flags, '-c', code], capture_output=True, text=True, timeout=60, cwd=ROOT
    )
    assert result.returncode == 0, result.stderr
    return result


@pytest.mark.slow
def test_the_import_loads_nothing():
    out = run('import sys, kalman_ros; print(sorted(sys.modules))').stdout
    loaded = {name.partition('.')[0] for name in ast.literal_eval(out)}
    assert not loaded.intersection({*HEAVY, 'numpy'})
    assert "'kalman_ros.core'" not in out


@pytest.mark.slow
def test_the_import_takes_a_fraction_of_that_of_numpy():
    """By Python's own account of one process, so that the load of a machine strikes both."""

    def ratio():
        report = run('import numpy, kalman_ros', '-X', 'importtime').stderr.splitlines()
        fields = (line.removeprefix('import time:').split('|') for line in report)
        took = {name.strip(): int(total) for _, total, name in fields if total.strip().isdigit()}
        return took['kalman_ros'] / took['numpy']

    assert median(ratio() for _ in range(5)) < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ('use', 'not_loaded'),
    [
        ('kr.Gaussian([0, 0], [[1, 0], [0, 1]])', HEAVY),
        ('kr.discretize([[0, 1], [0, 0]], [0, 1], 0.1)', ('matplotlib', 'rclpy', 'yaml', 'rich')),
        ('kr.filter(kr.discrete_model([[1]], Q=1), (1, 1), None, [1, 2], initial=(0, 1))',
         ('matplotlib', 'rclpy', 'rich', 'filterpy')),
        ("kr.simulate(seconds=0.1)", ('matplotlib', 'rclpy', 'rich', 'filterpy')),
    ],
)  # fmt: skip
def test_what_is_used_loads_what_it_needs(use, not_loaded):
    out = run(f'import sys, kalman_ros as kr; {use}; print(sorted(sys.modules))').stdout
    loaded = {name.partition('.')[0] for name in ast.literal_eval(out)}
    assert not loaded.intersection(not_loaded)


@pytest.mark.slow
def test_it_works_without_ros():
    block = "import sys; sys.modules.update(dict.fromkeys(['rclpy', 'ament_index_python']))"
    code = 'import kalman_ros as kr; print(kr.simulate("cart_pole", seconds=0.2, seed=1))'
    assert 'CartPole for 0.2 s' in run(f'{block}; {code}').stdout
    wanted = 'kalman_ros.Run needs ROS 2, and there is no'
    code = f'{block}; import kalman_ros as kr\ntry: kr.Run\nexcept ImportError as e: print(e)'
    assert wanted in run(code).stdout


def test_every_name_is_there_and_says_what_it_does():
    tree = ast.parse(Path(kr.__file__).read_text())
    typed = {
        alias.asname: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
    }
    assert typed == kr._MODULES
    assert sorted(kr._MODULES) == kr.__all__
    assert set(kr.__all__) <= set(dir(kr))
    for name in kr.__all__:
        if name == 'Run':
            pytest.importorskip('rclpy')
        assert getattr(kr, name).__doc__, name
        assert f'`{name}`' in kr.__doc__ or name == 'DesignError', name


def test_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="module 'kalman_ros' has no attribute 'kalman'"):
        _ = kr.kalman


@pytest.mark.slow
def test_run_without_a_sourced_workspace_says_what_to_do():
    pytest.importorskip('rclpy')
    code = (
        "import os; os.environ.pop('AMENT_PREFIX_PATH', None)\n"
        'import kalman_ros as kr\n'
        'try: kr.Run()\nexcept RuntimeError as error: print(error)'
    )
    assert 'build it with colcon and source install/setup.bash' in run(code).stdout


@pytest.mark.slow
def test_a_design_has_what_it_prints():
    design = kr.design('cart_pole')
    report = design.report
    np.testing.assert_array_equal(design.K, report.regulator.feedback.gain)
    np.testing.assert_array_equal(design.L['joint_states'], report.estimator.gains['joint_states'])
    np.testing.assert_array_equal(design.std, report.estimator.std)
    A = kr.linearize(kr.load('cart_pole').model).A
    np.testing.assert_allclose(np.sort(design.poles.real), np.sort(np.linalg.eigvals(A).real))
    (at,) = design.margins.values()
    assert f'{at.lag.value * 180 / np.pi:.3g}' in repr(design)
    spring = kr.design('mass_spring_damper')
    assert len(spring.poles) == 2 and spring.poles[0] == spring.poles[1].conjugate()
    blind = kr.design('constant_velocity')
    with pytest.raises(ValueError, match='there is no input'):
        _ = blind.K


def test_what_is_absent_is_where_it_is_said():
    from kalman_ros.elsewhere import ABSENT

    pytest.importorskip('control')
    where = {'python-control': 'control'}
    for name, library in ABSENT.items():
        if library:
            module = importlib.import_module(where.get(library, library))
            assert hasattr(module, name), name
