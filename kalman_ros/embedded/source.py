# SPDX-License-Identifier: Apache-2.0
"""The C of a loop: a header and one source, of generated formulas, numbers and the texts in c/."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import numpy as np

from kalman_ros.compiled.formulas import of_model, of_sensor, of_space
from kalman_ros.compiled.free_parameters import Parameters
from kalman_ros.compiled.source import FAST, places
from kalman_ros.compiled.symbols import UntraceableError
from kalman_ros.compiled.tracing import trace
from kalman_ros.core import Array, Sensor, Space
from kalman_ros.core.discrete_model import _MOST_PERIODS
from kalman_ros.core.model import MOST_SUBSTEPS
from kalman_ros.estimators.filters.ukf import UnscentedKalmanFilter
from kalman_ros.estimators.fixed_gain import FixedGainObserver

from .expressions import FUNCTIONS, function, number, numbers
from .identifiers import comment, identifier, part
from .loop import Law, Loop

#: By precision: its name in C, the repairs of a covariance, what is negligible in a sum, and how
#: near a reference has to be reached.
PRECISIONS: Mapping[str, tuple[str, str, str, str]] = {
    'float64': ('double', '{1e-14, 1e-12, 1e-10, 1e-8}', '1e-16', '1e-9'),
    'float32': ('float', '{1e-6f, 1e-5f, 1e-4f, 1e-3f}', '1e-8f', '1e-4f'),
}


class Texts:
    """The texts of a loop in C, under a name and in a precision.

    Parameters
    ----------
    loop
        What is exported.
    name
        The beginning of every public name.
    precision
        One of `PRECISIONS`.
    source
        Where the loop is from, for the header.

    Raises
    ------
    ValueError
        If C does not accept a name, or a function cannot be traced.
    """

    def __init__(self, loop: Loop, name: str, precision: str, source: str) -> None:
        self._loop, self._name = loop, identifier('name', name)
        if precision not in PRECISIONS:
            raise ValueError(f"precision: expected {' or '.join(PRECISIONS)}, got '{precision}'")
        self._precision, self._source = precision, source
        believed = loop.scenario.believed
        self._model: Any = believed.model
        self._state: Space = believed.model.state
        self._sensors = loop.sensors
        self._names = {each: part('sensors', each) for each in self._sensors}
        _unique('sensors', self._names)
        self.places = _unique('states', {n: part('states', n) for n in self._state.names})
        self.inputs = _unique('inputs', {n: part('inputs', n) for n in self._model.input.names})
        self._ukf = isinstance(loop.estimation.filter, UnscentedKalmanFilter)

    # --- what is written ----------------------------------------------------------------------

    def files(self) -> dict[str, str]:
        """Return the files by name."""
        return {
            f'{self._name}.h': self._named(self._filled('loop.h')),
            f'{self._name}.c': self._named(self._whole()),
            'check.c': self._named(self._filled('check.c')),
            'Makefile': self._named(_text('Makefile')),
        }

    def filter(self) -> str:
        """Return a file with the filter alone, for `FilterInC`."""
        header = self._filled('loop.h')
        head = f'{header}\nunsigned long filter_size(void) {{ return sizeof(NAME_loop); }}\n'
        body = '\n'.join([*self._parts_of_filter(FAST), _text('filter.c')])
        return self._named(head + body.replace('#include "NAME.h"', ''))

    def _named(self, text: str) -> str:
        """Return a text with the name of the loop in the place of NAME and PREFIX."""
        text = re.sub(r'PREFIX_', f'{self._name.upper()}_', text)
        return re.sub(r'NAME(?=[_.]|\b)', self._name, text)

    def _filled(self, file: str) -> str:
        """Return a text with its {{fields}}."""
        fields = self._fields()
        return re.sub(r'\{\{(\w+)\}\}', lambda field: fields[field[1]], _text(file))

    @property
    def _n(self) -> int:
        return self._state.size

    @property
    def _m(self) -> int:
        return int(self._model.input.size)

    def _fields(self) -> dict[str, str]:
        law, n, m = self._loop.law, self._n, self._m
        readings = max(each.output.size for each in self._sensors.values())
        upper = self._name.upper()
        linear = ''
        if self._model.is_linear:
            linear = (
                f'    NAME_real dt, F[{n} * {n}], G[{max(n * m, 1)}], Q[{n} * {n}]; '
                '/* of the last length of a step */\n'
            )
        calls = [' *     NAME_input(&loop, u);                    the input that acts from now on']
        if law is not None:
            calls = [
                ' *     NAME_control(&loop, dt, u);              what to send to the actuators'
            ]
        elif not m:
            calls = [' *']
        return {
            'title': comment(f'{self._name}: {self._summary()}'),
            'summary': f'Precision: {self._precision}. Rate: {self._loop.rate:g} steps a second.',
            'source': comment(self._source),
            'real': PRECISIONS[self._precision][0],
            'STATES': str(n),
            'INPUTS': str(m),
            'SENSORS': str(len(self._sensors)),
            'most_inputs': str(max(m, 1)),
            'most_sensors': str(len(self._sensors)),
            'readings': str(readings),
            'states': _listed(self._state),
            'inputs': _listed(self._model.input),
            'sensors': '\n'.join(self._sensor_lines()),
            'calls': '\n'.join(calls),
            'state_places': ',\n'.join(
                f'    {upper}_X_{each} = {k}' for k, each in enumerate(self.places.values())
            ),
            'input_places': self._input_places(),
            'model_fields': linear,
            'law_fields': '' if law is None else _law_fields(law),
            'corrections': '\n'.join(
                f'NAME_outcome NAME_correct_{own}(NAME_loop *loop, const NAME_real *y, '
                'const NAME_real *R);'
                for own in self._names.values()
            ),
            'law_functions': '' if law is None else _LAW_FUNCTIONS,
            'cases': '\n'.join(self._cases()),
            'sizes': ', '.join(str(each.output.size) for each in self._sensors.values()),
            'law_cases': '' if law is None else _LAW_CASES,
            'dt': repr(1.0 / self._loop.rate),
            'control': '' if law is None else _TIMED.format(dt=1.0 / self._loop.rate),
            'allowed': '1e-9',
            'allowed_float': '1e-2',
        }

    def _summary(self) -> str:
        filter, law = self._loop.scenario.filter, self._loop.law
        control = f' and its law ({self._loop.scenario.law})' if law else ''
        return f'an estimator ({filter}){control} in C99, without heap'

    def _sensor_lines(self) -> list[str]:
        lines = []
        for name, each in self._sensors.items():
            signal = self._loop.scenario.sensors[name].signal
            turned = ', in the axes of the body' if signal.mounting.turned else ''
            std = ', '.join(f'{value:g}' for value in np.sqrt(each.covariance.diagonal()))
            lines.append(
                f' *     {self._names[name]}: {comment(str(each.output))}{turned}; '
                f'standard deviation {std}'
            )
        return lines

    def _input_places(self) -> str:
        if not self.inputs:
            return ''
        upper = self._name.upper()
        listed = ',\n'.join(
            f'    {upper}_U_{each} = {k}' for k, each in enumerate(self.inputs.values())
        )
        return f'\n/* Places in u. */\nenum {{\n{listed}\n}};\n'

    def _cases(self) -> list[str]:
        """Return the corrections of check.c."""
        return [
            f'    case {k}: return NAME_correct_{own}(loop, y, R);'
            for k, own in enumerate(self._names.values())
        ]

    # --- the source ---------------------------------------------------------------------------

    def _whole(self) -> str:
        law = self._loop.law
        return '\n'.join(
            [
                *self._parts_of_filter('#define FAST\n#define INLINE static inline\n'),
                _text('gate.c'),
                *(() if law is None else _of_law(law, self._loop.rate)),
                _text('estimator.c'),
                *self._corrections(),
            ]
        )

    def _parts_of_filter(self, fast: str) -> list[str]:
        """Return the texts up to the update, for a processor that ``fast`` is about."""
        try:
            return self._parts(fast)
        except UntraceableError as error:
            raise ValueError(f'{error}, so that there is no C of it') from None

    def _parts(self, fast: str) -> list[str]:
        _, repairs, negligible, reached = PRECISIONS[self._precision]
        policy, first = self._loop.estimation.policy, self._loop.estimation.initial
        defined = {
            'N': str(self._n),
            'M': str(self._m),
            'SENSORS': str(len(self._sensors)),
            'K_MOST': str(max(each.output.size for each in self._sensors.values())),
            'REPAIRS': repairs,
            'NEGLIGIBLE': negligible,
            'REACHED': reached,
            'MAX_GAP': f'INT64_C({round(policy.max_gap * 1e9)})',
            'RECOVER_AFTER': str(policy.recover_after),
        }
        update = 'unscented_update.c' if self._ukf else 'linear_update.c'
        return [
            _text('head.c'),
            fast,
            *([_SINGLE] if self._precision == 'float32' else ()),
            ''.join(f'#define {key} {value}\n' for key, value in defined.items()),
            numbers('FIRST_MEAN', first.mean),
            numbers('FIRST_COVARIANCE', first.covariance),
            numbers('IDLE', self._loop.idle),
            *self._of_model(),
            _text('matrices.c'),
            *self._of_sensors(),
            *(self._of_points() if self._ukf else ()),
            _text('update.c'),
            _text(update),
        ]

    def _of_model(self) -> list[str]:
        if not self._model.is_linear:
            return self._of_nonlinear_model()
        wrap = trace(self._state.wrap, *((each,) for each in _probes(self._n)))
        texts = [function('wrap', wrap, ['x'])]
        zeros = np.zeros(self._n), np.zeros(self._m)
        if self._model.is_discrete:
            step = self._model.transition(*zeros, self._model.period)
            return [
                f'enum {{ DONE = 0, OVERFLOW_WITHIN = 2 }};\n'
                f'#define PERIOD {number(self._model.period)}\n#define MOST_PERIODS '
                f'{_MOST_PERIODS}\n',
                numbers('STATE_MATRIX', step.F),
                *([numbers('INPUT_MATRIX', step.G)]),
                numbers('NOISE_COVARIANCE', step.Q),
                *texts,
                _text('periods.c'),
                _text('linear_model.c'),
            ]
        A, B = self._model.state_jacobian(*zeros), self._model.input_jacobian(*zeros)
        order = self._n + self._m
        whole, density = np.zeros((order, order)), np.zeros((order, order))
        whole[: self._n, : self._n], whole[: self._n, self._n :] = A, B
        density[: self._n, : self._n] = self._model.noise_density(zeros[0])
        constant = {'jacobian': (whole, 'xup'), 'density': (density, 'xp')}
        for name, (matrix, arguments) in constant.items():
            texts.append(_constant(name, matrix, arguments))
        return [
            '#define ORDER (N + M)\n',
            *texts,
            _places('A', whole),
            _places('W', density),
            _compiled('flow.c'),
            _text('sample.c'),
            _text('linear_model.c'),
        ]

    def _of_nonlinear_model(self) -> list[str]:
        parameters = Parameters(self._model)
        formulas = of_model(self._model, parameters)
        longest = self._model.max_step
        texts = [
            f'#define ORDER N\n#define MOST_SUBSTEPS {min(formulas.most, MOST_SUBSTEPS)}\n'
            f'#define MAX_STEP {number(longest)}\n',
            numbers('NUMBERS', parameters.values),
            function('substep', formulas.substep, ['x', 'u', 'h', 'p']),
            function('wrap', formulas.wrap, ['x']),
        ]
        sparse = {'A': ('jacobian', formulas.jacobian, 'xup'),
                  'W': ('density', formulas.density, 'xp')}  # fmt: skip
        if formulas.slope is not None:
            texts.append('#define SLOPE\n')
            sparse['F'] = ('slope', formulas.slope, 'xuhp')
        for key, (name, formula, arguments) in sparse.items():
            texts.append(function(name, formula, [*arguments], by_rows=True, dense=False))
            texts.append(places(key, formula.result))
        texts += [_compiled('flow.c'), _compiled('step.c'), _text('nonlinear_model.c')]
        return [*texts, _text('nonlinear_points.c')] if self._ukf else texts

    def _of_sensors(self) -> list[str]:
        texts, rows = [_text('sensors.c')], []
        gates = self._loop.estimation.policy.gates or {}
        filter: Any = self._loop.estimation.filter
        for name, sensor in self._sensors.items():
            own = self._names[name]
            texts += self._of_sensor(own, sensor)
            gain = '0'
            if isinstance(filter, FixedGainObserver):
                gain = f'GAIN_{own}'
                texts.append(numbers(gain, np.asarray(filter.gains[name])))
            rows.append(
                f'    {{{sensor.output.size}, COVARIANCE_{own}, {number(gates.get(name, 0.0))}, '
                f'measure_{own}, jacobian_{own}, difference_{own}, {gain}, ANGLES_{own}}},\n'
            )
        texts.append(f'static const sensor SENSOR[] = {{\n{"".join(rows)}}};\n')
        texts.append(self._arrived())
        return texts

    def _of_sensor(self, own: str, sensor: Sensor) -> list[str]:
        parameters = Parameters(sensor)
        formulas = of_sensor(sensor, self._state, parameters)
        given = numbers(f'NUMBERS_{own}', parameters.values)
        texts = [given]
        for kind, formula in (('measure', formulas.measure), ('jacobian', formulas.jacobian)):
            called = f'{kind}_{own}'
            texts.append(function(f'{called}_of', formula, ['x', 'p'], by_rows=kind == 'jacobian'))
            texts.append(
                f'static void {called}(const real *x, real *result)\n{{\n'
                f'    {called}_of(x, NUMBERS_{own}, result);\n}}\n'
            )
        return [
            *texts,
            _difference(f'difference_{own}', sensor.output),
            numbers(f'COVARIANCE_{own}', sensor.covariance),
            _angles(f'ANGLES_{own}', sensor.output),
        ]

    def _arrived(self) -> str:
        head = (
            'static void arrived(const real *total, const real *origin, const real *P, real *x,\n'
            '                    real *P_x)\n{\n'
        )
        if not self._state.rotations:
            plain = (
                '    (void)origin;\n    wrap(total, x);\n    memcpy(P_x, P, N * N * sizeof *P);\n'
            )
            return f'{head}{plain}}}\n'
        moved = function('arrive', of_space(self._state).arrived, ['total', 'origin', 'P'])
        return (
            f'{moved}\n{head}    real both[N + N * N];\n    arrive(total, origin, P, both);\n'
            '    memcpy(x, both, N * sizeof *x);\n'
            '    memcpy(P_x, both + N, N * N * sizeof *P);\n}\n'
        )

    def _of_points(self) -> list[str]:
        filter: Any = self._loop.estimation.filter
        weights, n = filter.covariance_weights, self._n
        spread = float(filter.directions[0, 1])
        return [
            f'enum {{ POINTS = {2 * n + 1} }};\n#define SPREAD {number(spread)}\n'
            f'#define CENTRE_OF_MEAN {float(filter.mean_weights[0])!r}\n'
            f'#define CENTRE {float(weights[0])!r}\n#define OTHERS {float(weights[1])!r}\n',
            _angles('ANGLES', self._state),
            _difference('state_difference', self._state),
        ]

    def _corrections(self) -> list[str]:
        return [
            f'NAME_outcome NAME_correct_{own}(NAME_loop *s, const real *y, const real *R_y)\n'
            f'{{\n    return correct(s, {k}, y, R_y);\n}}\n'
            for k, own in enumerate(self._names.values())
        ]


def _of_law(law: Law, rate: float) -> list[str]:
    feedback = law.feedback
    limits = law.limits
    texts = [
        f'#define LAW\n#define N_MODEL {law.space.size}\n#define STEP {1.0 / rate!r}\n',
        numbers('GAIN', feedback.gain),
        numbers('REST_STATE', law.rest.state),
        numbers('REST_INPUT', law.rest.input),
        numbers('STATE_GAIN', law.equilibria.state_gain),
        numbers('INPUT_GAIN', law.equilibria.input_gain),
        numbers('MAGNITUDE', limits.magnitude),
        numbers('RATE', limits.rate),
        _difference('model_difference', law.space),
    ]
    if feedback.tracked:
        listed = ', '.join(map(str, feedback.tracked))
        texts += [
            f'#define TRACKED {len(feedback.tracked)}\n'
            f'static const int PLACES[] = {{{listed}}};\n',
            numbers('INTEGRAL_GAIN', feedback.integral_gain),
        ]
    return [*texts, _text('law.c')]


def _law_fields(law: Law) -> str:
    n, m, p = law.space.size, law.rest.input.size, len(law.feedback.tracked)
    integral = f'    NAME_real integral[{p}]; /* of the errors of tracked states */\n' if p else ''
    begun = '    int8_t begun;\n' if p else ''
    return (
        f'    NAME_real state[{n}], held[{m}]; /* what is held, and the input that holds it */\n'
        f'    NAME_real output[{m}];          /* the last input, within its limits */\n'
        f'{integral + begun if p else ""}'
    )


_LAW_FUNCTIONS = """
/* Hold a state of the model from now on, if an input holds it there. */
NAME_outcome NAME_hold(NAME_loop *loop, const NAME_real *reference);

/* The input u for the estimate, within its limits, dt seconds after the last call; it acts. */
NAME_outcome NAME_control(NAME_loop *loop, NAME_real dt, NAME_real *u);

/* The input u towards the idle one, within its rate limit; it acts. */
void NAME_idle(NAME_loop *loop, NAME_real dt, NAME_real *u);
"""


#: In single precision no number is promoted.
_SINGLE = ''.join(f'#undef {each}\n#define {each} {each}f\n' for each in FUNCTIONS)
_TIMED = '            NAME_control(&loop, (NAME_real){dt!r}, u);'
#: The calls of check.c.
_LAW_CASES = """\
        case 'H': outcome = NAME_hold(&loop, given); break;
        case 'U': outcome = NAME_control(&loop, given[0], u); break;
        case 'O': NAME_idle(&loop, given[0], u); break;"""


def _text(name: str) -> str:
    return files(__package__).joinpath(f'c/{name}').read_text()


def _compiled(name: str) -> str:
    """Return a text that models are compiled with, too."""
    return files('kalman_ros.compiled').joinpath(name).read_text()


def _unique(argument: str, names: Mapping[str, str]) -> dict[str, str]:
    """Return names in C by name; ValueError if two are the same there."""
    found: dict[str, str] = {}
    for name, own in names.items():
        if own in found.values():
            raise ValueError(f"{argument}: expected names that differ in C, got '{own}' twice")
        found[name] = own
    return found


def _listed(space: Space) -> str:
    lines = [f' *     {k}: {comment(space.label(name))}' for k, name in enumerate(space.names)]
    for rotation in space.rotations:
        lines.append(f' *     ({comment(", ".join(rotation))}) is a rotation vector')
    return '\n'.join(lines) or ' *     none'


def _probes(n: int) -> Array:
    """Return vectors (3, n) at which formulas are compared with functions."""
    return 2.0 * np.random.default_rng(0).standard_normal((3, n))


def _difference(name: str, space: Space) -> str:
    points = 0.3 * _probes(space.size)
    found = trace(space.subtract, *zip(points, points[::-1] + 0.1))
    return function(name, found, ['a', 'b'])


def _angles(name: str, space: Space) -> str:
    marks = ', '.join('1' if each in space.angles else '0' for each in space.names)
    return f'static const signed char {name}[] = {{{marks}}};\n'


def _constant(name: str, matrix: Array, arguments: Sequence[str]) -> str:
    """Return a function that writes the numbers of a matrix that are not zero, row by row."""
    entries = matrix[np.nonzero(matrix)].tolist()
    body = ''.join(f'    result[{k}] = {number(value)};\n' for k, value in enumerate(entries))
    unused = ''.join(f'    (void){each};\n' for each in arguments)
    listed = ', '.join(f'const real *{each}' for each in arguments)
    silent = '' if entries else '    (void)result;\n'
    return f'static void {name}({listed}, real *result)\n{{\n{unused}{silent}{body}}}\n'


def _places(name: str, matrix: Array) -> str:
    """Return the rows and columns of the numbers of a matrix that are not zero, as C."""
    where = np.nonzero(matrix)
    text = f'enum {{ {name}_COUNT = {len(where[0])} }};\n'
    for kind, values in zip(('ROW', 'COLUMN'), where):
        listed = ', '.join(map(str, values.tolist())) or '0'
        text += f'static const int {name}_{kind}[] = {{{listed}}};\n'
    return text
