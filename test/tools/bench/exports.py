# SPDX-License-Identifier: Apache-2.0
"""Exported loops in a program in C, without Python around them."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from kalman_ros import scenario
from kalman_ros.compiled.library import compiler
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.source import loop_files
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

from .benchmark import Benchmark
from .filters import second
from .linear import parameters

#: A loop, timed by the clock of its process: {calls} is what each of {count} steps does. Readings
#: are near what is expected, so that gates pass them.
_PROGRAM = """
#include "loop.c"
#include <stdio.h>
#include <time.h>

int main(void)
{{
    static loop_loop loop;
    double y[K_MOST], u[M + 1];
    (void)y, (void)u;
    loop_init(&loop);
    const clock_t start = clock();
    for (long i = 0; i < {count}; i++) {{
        {calls}
    }}
    printf("%.9g", (double)(clock() - start) / CLOCKS_PER_SEC / {count});
    return !isfinite(loop.x[0]);
}}
"""
_COUNT = 50_000
#: Processor seconds of a million steps of the cart-pole, and of an update by a pose, of 15 states,
#: by robot_localization's classes in C++: of its extended and its unscented filter.
_MILLION, _EXTENDED, _UNSCENTED = 0.5, 5.9e-6, 15.5e-6


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmarks: a whole loop, and predictions and corrections of 15 states."""
    with tempfile.TemporaryDirectory(prefix='kalman_ros_') as folder:
        place = Path(folder)
        calls = f'{_correction(0, "joint_states")} loop_control(&loop, 0, u);'
        cart_pole = _program(place / 'cart_pole', _shipped('cart_pole'), calls)
        unscented = parameters(15, 6, 'ukf', 100.0)
        step = _program(place / 'unscented', unscented, _correction(0, 'y'))
        yield [
            Benchmark(
                'million steps of the exported cart-pole, -O3 / 21,750 EKF steps of filterpy',
                1.0, lambda: 1e6 * _seconds(cart_pole), lambda: _MILLION * second(),
            ),
            *_robot(place),
            Benchmark(
                'exported ukf, 15 states, -O3: a step by 6 numbers / an update in C++',
                1.0, lambda: _seconds(step), lambda: _UNSCENTED * second(),
            ),
        ]  # fmt: skip


def _robot(folder: Path) -> Iterator[Benchmark]:
    """Yield a prediction of a robot, and a correction by each of its sensors."""
    values = _shipped('robot_3d')
    prediction = _program(folder / 'prediction', values, _PREDICTION)
    what = 'exported robot_3d, -O3'
    yield Benchmark(
        f'{what}: a prediction / an update in C++', 1.0,
        lambda: _seconds(prediction), lambda: _EXTENDED * second(),
    )  # fmt: skip
    for index, name in enumerate(loop(scenario.build(values)).sensors):
        both = _program(folder / name, values, _correction(index, name))
        yield Benchmark(
            f'{what}: a correction by {name} / the same', 1.0,
            lambda both=both: _seconds(both) - _seconds(prediction),  # type: ignore[misc]
            lambda: _EXTENDED * second(),
        )  # fmt: skip


_PREDICTION = 'loop_predict(&loop, 0.01);'


def _correction(index: int, sensor: str) -> str:
    """Return the calls of a prediction and a correction."""
    reading = f'SENSOR[{index}].measure(loop.x, y); y[0] += 1e-3 * (double)(i % 13 - 6);'
    return f'{_PREDICTION} {reading} loop_correct_{sensor}(&loop, y, 0);'


def _shipped(name: str) -> dict[str, Any]:
    return from_file(shipped.file(name), 'estimator', 'controller')


def _program(folder: Path, values: Mapping[str, Any], calls: str) -> Path:
    """Return a program that repeats calls of the exported loop of a scenario."""
    folder.mkdir()
    for file, text in loop_files(loop(scenario.build(values)), 'loop', 'float64', '').items():
        (folder / file).write_text(text)
    (folder / 'main.c').write_text(_PROGRAM.format(calls=calls, count=_COUNT))
    command = [*compiler(), '-std=c99', '-O3', '-o', 'main', 'main.c', '-lm']
    subprocess.run(command, cwd=folder, check=True, timeout=120)
    return folder / 'main'


def _seconds(program: Path) -> float:
    """Return the processor time of a step."""
    run = partial(subprocess.run, [program], check=True, timeout=120)
    return float(run(capture_output=True, text=True).stdout)
