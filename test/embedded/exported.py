# SPDX-License-Identifier: Apache-2.0
"""An exported loop, compiled and called from Python."""

import ctypes
import subprocess

import numpy as np
import pytest

from kalman_ros import scenario
from kalman_ros.compiled.library import compiler
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.source import loop_files
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file

WARNINGS = ['-std=c99', '-Wall', '-Wextra', '-Wconversion', '-Wshadow', '-Werror']
#: What tests read of the struct.
_SHIM = """
#include "{name}.c"
unsigned long size(void) {{ return sizeof({name}_loop); }}
const real *mean(const {name}_loop *s) {{ return s->x; }}
const real *covariance(const {name}_loop *s) {{ return s->P; }}
const real *input(const {name}_loop *s) {{ return s->input; }}
unsigned repairs(const {name}_loop *s) {{ return s->repairs; }}
unsigned restarts(const {name}_loop *s) {{ return s->restarts; }}
"""
needs_a_compiler = pytest.mark.skipif(not compiler(), reason='there is no C compiler')


def of_scenario(name, changes=None, *, policy=None, limits=None, motion=None, blend=0.0):
    """Return the loop of a shipped scenario."""
    values = {**from_file(shipped.file(name), 'estimator', 'controller'), **(changes or {})}
    built = scenario.build(values)
    return loop(built, policy, limits, motion=motion, blend=blend)


class Exported:
    """A loop in C, with the calls of `vectors.Calls`."""

    def __init__(self, loop, folder, precision='float64', flags=('-O2',)):
        self.number = ctypes.c_double if precision == 'float64' else ctypes.c_float
        for file, text in loop_files(loop, 'loop', precision, 'a test').items():
            (folder / file).write_text(text)
        (folder / 'shim.c').write_text(_SHIM.format(name='loop'))
        library = folder / 'loop.so'
        subprocess.run(
            [*compiler(), *WARNINGS, *flags, '-shared', '-fPIC', '-o', library,
             folder / 'shim.c', '-lm'], check=True, timeout=120,
        )  # fmt: skip
        self.library = ctypes.CDLL(str(library))
        for name in ('mean', 'covariance', 'input'):
            getattr(self.library, name).restype = ctypes.POINTER(self.number)
        self.library.size.restype = ctypes.c_ulong
        self._loop = ctypes.create_string_buffer(self.library.size())
        self._n, self._m = loop.scenario.believed.model.state.size, loop.idle.size
        self._sizes = [each.output.size for each in loop.sensors.values()]
        self._corrections = [
            getattr(self.library, f'loop_correct_{name.replace(".", "_")}')
            for name in loop.sensors
        ]
        self._u = (self.number * max(self._m, 1))()
        self.library.loop_init(self._loop)

    def call(self, kind, index, given):
        """Make a call; return its outcome."""
        numbers = (self.number * max(len(given), 1))(*given)
        if kind == 'C':
            k = self._sizes[index]
            R = ctypes.byref(numbers, k * ctypes.sizeof(self.number)) if len(given) > k else None
            return self._corrections[index](self._loop, numbers, R)
        if kind == 'M':
            self.library.loop_follow(self._loop)
            return 0
        first = self.number(given[0])
        if kind == 'P':
            return self.library.loop_predict(self._loop, first)
        if kind == 'U':
            return self.library.loop_control(self._loop, first, self._u)
        if kind == 'O':
            self.library.loop_idle(self._loop, first, self._u)
            return 0
        called = {'I': 'loop_input', 'H': 'loop_hold'}[kind]
        return getattr(self.library, called)(self._loop, numbers)

    def _read(self, name, size):
        return np.array(getattr(self.library, name)(self._loop)[:size])

    @property
    def mean(self):
        """The estimate (n,)."""
        return self._read('mean', self._n)

    @property
    def covariance(self):
        """Its covariance (n, n)."""
        return self._read('covariance', self._n**2).reshape(self._n, self._n)

    @property
    def input(self):
        """The input that acts (m,)."""
        return self._read('input', self._m)

    @property
    def repairs(self):
        """Number of repaired covariances."""
        return self.library.repairs(self._loop)

    @property
    def restarts(self):
        """Number of restarts."""
        return self.library.restarts(self._loop)


def differences(exported, calls):
    """Return the largest relative differences of mean, deviations and input from recorded calls.

    They are relative to the largest magnitude of each number in the recording. Outcomes are the
    same, or the call is named.
    """
    largest, found = 0.0, []
    for k, each in enumerate(calls):
        outcome = exported.call(each.kind, each.sensor, each.given)
        assert outcome == each.outcome, f'call {k}, {each.kind} {each.sensor}: {outcome}'
        expected = np.concatenate((each.mean, each.std, each.input))
        got = np.concatenate(
            (exported.mean, np.sqrt(exported.covariance.diagonal()), exported.input)
        )
        largest = np.maximum(largest, np.abs(expected))
        found.append(np.abs(got - expected))
    return np.max(found, axis=0) / np.where(largest > 0.0, largest, 1.0)
