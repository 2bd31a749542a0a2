# SPDX-License-Identifier: Apache-2.0
"""Exported loops in a program in C, without Python around them."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from kalman_ros import scenario
from kalman_ros.compiled.library import compiler
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.source import loop_files
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

from .benchmark import Benchmark
from .filters import second

#: A loop, timed by the clock of its process: {calls} is what each of {count} steps does.
_PROGRAM = """
#include "loop.c"
#include <stdio.h>
#include <time.h>

int main(void)
{{
    static loop_loop loop;
    double y[K_MOST], u[M + 1];
    loop_init(&loop);
    const clock_t start = clock();
    for (long i = 0; i < {count}; i++) {{
        for (int k = 0; k < K_MOST; k++)
            y[k] = 1e-3 * (double)((i * (k + 7)) % 13 - 6);
        {calls}
    }}
    printf("%.9g", (double)(clock() - start) / CLOCKS_PER_SEC / {count});
    return !(loop.P[0] < 1e9 && u == u);
}}
"""
_COUNT = 200_000
#: Processor seconds of a million steps of the cart-pole.
_MILLION = 0.5


@contextmanager
def benchmarks() -> Iterator[list[Benchmark]]:
    """Yield the benchmark of a loop: a prediction, a correction and the law."""
    with tempfile.TemporaryDirectory(prefix='kalman_ros_') as folder:
        calls = 'loop_predict(&loop, 0.01); loop_correct_joint_states(&loop, y, 0);'
        program = _built(Path(folder), 'cart_pole', f'{calls} loop_control(&loop, 0, u);')
        yield [
            Benchmark(
                'million steps of the exported cart-pole, -O3 / 21,750 EKF steps of filterpy',
                1.0, lambda: 1e6 * _seconds(program), lambda: _MILLION * second(),
            )
        ]  # fmt: skip


def _built(folder: Path, name: str, calls: str) -> Path:
    """Return the program of a shipped scenario."""
    values = from_file(shipped.file(name), 'estimator', 'controller')
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
