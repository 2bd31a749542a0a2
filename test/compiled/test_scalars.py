# SPDX-License-Identifier: Apache-2.0
"""Plain functions that compute with `math` and ``float`` are compiled."""

import math
from functools import partial
from math import atan2, cos
from types import ModuleType

import numpy as np
import pytest

pytest.importorskip('casadi')

import casadi

import kalman_ros as kr
from kalman_ros.compiled import attempt
from kalman_ros.compiled.formulas import of_model
from kalman_ros.compiled.free_parameters import Parameters, freed
from kalman_ros.compiled.scalars import of_symbols, scope
from kalman_ros.compiled.symbols import symbols
from kalman_ros.compiled.untraceable import UntraceableError

OF_ONE = (
    'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'sinh', 'cosh', 'tanh', 'asinh', 'atanh', 'exp',
    'expm1', 'log', 'log1p', 'log10', 'sqrt', 'fabs', 'floor', 'ceil', 'degrees', 'radians',
)  # fmt: skip


def half(x):
    return 0.5 * float(x) * math.cos(x)


def rate(x, u, wrapped=math.tanh):
    pull = half(x[0]) + cos(x[1]) * atan2(x[0], 2.0)
    return [x[1], -9.81 * wrapped(float(x[0])) + pull + max(float(u[0]), 0.0)]


def substeps(model):
    """Return the formula of a substep of a model, and its parameters."""
    parameters, found = freed(model, lambda given: of_model(model, given))
    return found.substep.function('f'), parameters.values


@pytest.mark.parametrize('name', OF_ONE)
def test_functions_of_math(name):
    function = getattr(math, name)
    model = kr.continuous_model(lambda x: [function(0.4 * math.tanh(x[0]) + 0.5)], W=[1.0])
    formula, p = substeps(model)
    for x in (-0.8, 0.3, 1.1):
        mine = float(formula([x], [], [0.01], p))
        assert mine == pytest.approx(model.substep(np.array([x]), np.zeros(0), 0.01)[0], rel=1e-13)


def test_functions_of_several_numbers():
    def turn(x):
        power = math.pow(1.5 + math.sin(x[0]), 2.0) + math.log(3.0 + math.sin(x[0]), 2.0)
        return [math.hypot(x[0], 3.0, x[1]) + power, math.atan2(x[1], math.pi + x[0] ** 2)]

    model = kr.continuous_model(turn, W=[1.0, 1.0])
    formula, p = substeps(model)
    x = np.array([0.4, -1.2])
    np.testing.assert_allclose(
        np.array(formula(x, [], [0.01], p))[:, 0], model.substep(x, np.zeros(0), 0.01), rtol=1e-13
    )


def test_decisions_of_each_stage_of_a_step_do_not_multiply():
    def rate(x, u):
        drag = 0.1 * x[1] * abs(x[1]) if x[1] > 0.3 else 0.2 * x[1]
        stop = -50.0 * (x[0] - 1.0) if x[0] > 1.0 else 0.0
        push = max(min(u[0], 2.0), -2.0)
        return [x[1], stop - drag + push if push != 0.0 else stop - drag]

    model = kr.continuous_model(rate, W=[0.1, 0.1], states='a b', inputs='u')
    formula, p = substeps(model)
    for x, u in (([0.5, 0.2], [3.0]), ([1.2, 0.5], [0.0]), ([0.9, 1.9], [-1.0])):
        mine = np.array(formula(x, u, [0.1], p))[:, 0]
        np.testing.assert_allclose(mine, model.substep(np.array(x), np.array(u), 0.1), rtol=1e-13)


@pytest.mark.parametrize('x', [(0.3, 0.7, -0.1), (0.9, -0.2, 0.1)])
def test_extremes_of_numbers_and_of_arrays(x):
    model = kr.continuous_model(
        lambda x: [max(x), min(x[0], x[1], 0.5), max([x[0], x[2]], key=lambda each: -each)],
        W=[1.0, 1.0, 1.0],
    )
    formula, p = substeps(model)
    mine = np.array(formula(x, [], [0.01], p))[:, 0]
    np.testing.assert_allclose(mine, model.substep(np.array(x), np.zeros(0), 0.01), rtol=1e-14)


class Swing:
    """Rates in an array that is filled, by a method or a call."""

    def __init__(self, gravity):
        self.gravity = gravity

    def rates(self, x, u):
        rates, turn = np.zeros(2), np.array([[0.0, 1.0], [-0.1, 0.0]])
        turn[1, 1] = -0.1 * math.cosh(x[0])
        rates[0] = (np.linalg.inv(np.eye(2)) @ turn @ x)[0]
        rates[1] = -self.gravity * math.sin(x[0]) + (turn @ x)[1] + u[0]
        return rates

    __call__ = rates


def filled(x, u):
    return Swing(2.0).gravity * np.array([math.sin(x[1]), float(x[0])], dtype=float)


@pytest.mark.parametrize(
    'function',
    [Swing(9.81), Swing(9.81).rates, partial(lambda k, x, u: [x[1], k * half(x[0])], 3.0), filled],
)
def test_methods_calls_and_arrays_that_are_filled(function):
    model = kr.continuous_model(function, W=[0.1, 0.1], inputs='u')
    formula, p = substeps(model)
    x, u = np.array([0.4, -1.2]), np.array([0.7])
    np.testing.assert_allclose(
        np.array(formula(x, u, [0.1], p))[:, 0], model.substep(x, u, 0.1), rtol=1e-13
    )


class Drag(kr.Model):
    """A class that fills an array with leading axes, and computes with `math` of its numbers."""

    state, input = kr.Space('x v'), kr.Space('u')

    def __init__(self, share=0.3):
        self.share = share

    def drag(self, v):
        return math.sqrt(self.share) * v * np.abs(v)

    def derivative(self, x, u):
        rates = np.zeros_like(x)
        rates[..., 0] = x[..., 1]
        rates[..., 1] = u[..., 0] - self.drag(x[..., 1])
        return rates

    def noise_density(self, x):
        return np.diag([0.0, 0.1])


def test_methods_of_a_class():
    formula, p = substeps(Drag())
    assert p.tolist() == [0.3]
    for v in (-0.4, 0.1, 0.6):
        x, u = np.array([0.4, v]), np.array([0.7])
        np.testing.assert_allclose(
            np.array(formula(x, u, [0.1], p))[:, 0], Drag().substep(x, u, 0.1), rtol=1e-13
        )


def test_a_function_whose_names_do_not_serve_keeps_them():
    def rate(x):
        return np.stack([x[1], -2.0 * x[0] if isinstance(math, ModuleType) else x[0]])

    formula, p = substeps(kr.continuous_model(rate, W=[0.1, 0.1]))
    x = np.array([0.4, -1.2])
    expected = kr.continuous_model(rate, W=[0.1, 0.1]).substep(x, np.zeros(0), 0.1)
    np.testing.assert_allclose(np.array(formula(x, [], [0.1], p))[:, 0], expected, rtol=1e-14)


def test_names_of_a_module_stay_as_they_are():
    before = dict(globals())
    names = scope(globals())
    assert globals() == before
    assert names['math'].sin(0.5) == math.sin(0.5) and names['math'].pi == math.pi
    assert names['cos'](0.5) == cos(0.5) and names['__builtins__']['float']('2.5') == 2.5
    assert names['half'](0.5) == half(0.5) and names['np'].pi is np.pi


def test_a_name_that_is_redefined_is_left_alone():
    names = scope({'float': round})
    assert names['float'] is round


def test_what_a_function_imports_takes_symbols():
    def rate(x):
        import math as m
        from math import sin

        import numpy

        rates = numpy.zeros(2)
        rates[0], rates[1] = m.cos(x[1]), -sin(x[0])
        return rates

    model = kr.continuous_model(rate, W=[0.1, 0.1])
    formula, p = substeps(model)
    x = np.array([0.4, -1.2])
    np.testing.assert_allclose(
        np.array(formula(x, [], [0.1], p))[:, 0], model.substep(x, np.zeros(0), 0.1), rtol=1e-14
    )


@pytest.mark.slow
def test_a_plain_function_with_decisions_is_compiled():
    model = kr.continuous_model(rate, W=[0.1, 0.1], states='a [rad] w [rad/s]', inputs='u')
    found = attempt(model)
    assert (found.arithmetic, found.reason) == ('C', '')
    for x in np.random.default_rng(0).normal(0.0, 3.0, (20, 2)):
        for u in (np.array([-1.0]), np.array([2.0])):
            np.testing.assert_allclose(
                found.result.step(x, u, 0.1), model.step(x, u, 0.1), rtol=1e-12
            )


def test_a_sensor_with_math_is_recorded():
    sensor = kr.sensor(lambda x: [math.hypot(x[0], x[1]), math.atan2(x[1], x[0])], [0.1, 0.1])
    sensor.measure(np.array([1.0, 2.0]))
    from kalman_ros.compiled.formulas import of_sensor

    parameters, found = freed(sensor, lambda given: of_sensor(sensor, kr.Space('x y'), given))
    x = np.array([2.0, -1.0])
    H = np.array(found.jacobian.function('f')(x, parameters.values))
    np.testing.assert_allclose(H, sensor.jacobian(x), atol=1e-9)
    assert Parameters(sensor, opened=True).comparable


LIMIT = 1.0
CACHE = {}
CURVE = np.poly1d([1.0, 0.0])  # which has no hash


def limited(x, u):
    return [x[0] + 0.1 * max(-LIMIT, min(LIMIT, u[0] - x[0]))]


def cached(x):
    if 'J' not in CACHE:
        CACHE['J'] = np.diag([1.0, 2.0])
    return CACHE['J'] @ x


def described(function, **options):
    return Parameters(kr.continuous_model(function, W=[1.0], **options), opened=True)


def test_a_global_number_that_changes_is_another_formula(monkeypatch):
    before = described(limited, inputs='u')
    assert described(limited, inputs='u') == before
    monkeypatch.setitem(globals(), 'LIMIT', 2.0)
    assert described(limited, inputs='u') != before
    model = kr.continuous_model(limited, W=[1.0], inputs='u')
    formula, p = substeps(model)
    assert float(formula([0.0], [5.0], [0.1], p)) == pytest.approx(
        kr.continuous_model(limited, W=[1.0], inputs='u').substep(
            np.zeros(1), np.full(1, 5.0), 0.1
        )[0]
    )


def test_what_a_function_keeps_for_later_has_no_symbols():
    model = kr.continuous_model(cached, W=[1.0, 1.0])
    CACHE.clear()  # a model is called with numbers first
    formula, p = substeps(model)
    assert all(value.dtype == float for value in CACHE.values())
    expected = model.substep(np.ones(2), np.zeros(0), 0.1)
    np.testing.assert_allclose(np.array(formula(np.ones(2), [], [0.1], p))[:, 0], expected)


@pytest.mark.slow
def test_a_threshold_between_state_and_input_is_compared():
    """Points of states and of inputs that were alike would never be on one side of it."""
    model = kr.discrete_model(
        lambda x, u: [x[0] + 0.1 * (1.0 if u[0] > x[0] else -0.2 * x[0])], Q=[0.1], inputs='u'
    )
    found = attempt(model)
    assert found.arithmetic == 'C'
    for x in np.random.default_rng(1).normal(0.0, 2.0, (50, 1)):
        np.testing.assert_allclose(
            found.result.step(x, np.zeros(1), 1.0), model.step(x, np.zeros(1), 1.0), rtol=1e-13
        )


class Clipped(kr.Model):
    """A class with a decision for one state, whose method an attribute replaces."""

    state, input = kr.Space('x v'), kr.Space('u')

    def __init__(self, most=3.0):
        self.soft = lambda v: min(max(v, -most), most)

    def soft(self, v):
        return v

    def derivative(self, x, u):
        return np.array([x[1], -self.soft(x[0]) + u[0]])

    def state_jacobian(self, x, u):
        return np.array([[0.0, 1.0], [-1.0 if abs(x[0]) < 3.0 else 0.0, 0.0]])

    def noise_density(self, x):
        return np.diag([0.0, 0.1])


@pytest.mark.slow
def test_a_class_for_one_state_is_compared_point_by_point():
    model = Clipped()
    found = attempt(model)
    for x in np.random.default_rng(1).normal(0.0, 5.0, (50, 2)):
        np.testing.assert_allclose(
            found.result.step(x, np.zeros(1), 0.01), model.step(x, np.zeros(1), 0.01), rtol=1e-12
        )


class Base(kr.Model):
    state, input = kr.Space('x'), kr.Space('')

    def rate(self, x):
        return -x

    def derivative(self, x, u):
        return self.rate(x)

    def noise_density(self, x):
        return np.eye(1)


class Faster(Base):
    def rate(self, x):
        return -2.0 * x


def test_methods_are_those_of_the_last_class():
    formula, p = substeps(Faster())
    assert float(formula([1.0], [], [0.1], p)) == pytest.approx(math.exp(-0.2), rel=1e-5)


def test_functions_that_call_themselves():
    def falling(x, n=3):
        return math.sin(x) if n == 0 else 0.5 * falling(x, n - 1)

    formula, p = substeps(kr.continuous_model(lambda x: [falling(x[0])], W=[1.0]))
    expected = kr.continuous_model(lambda x: [falling(x[0])], W=[1.0]).substep(
        np.ones(1), np.zeros(0), 0.1
    )[0]
    assert float(formula([1.0], [], [0.1], p)) == pytest.approx(expected, rel=1e-14)


def test_functions_that_call_themselves_and_keep_their_numbers():
    def falling(x, n=3):
        return math.sin(x) if n == 0 else 0.5 * falling(x, n - 1)

    variables, x = symbols(1)
    formula = of_symbols(falling)(x[0]).item().formula
    value = float(casadi.Function('f', [variables], [formula])(0.7))
    assert value == pytest.approx(falling(0.7))


def test_numbers_of_symbols_are_floats_and_whole_numbers_stay_whole():
    def rate(x):
        steps = np.zeros(2, dtype=int)
        steps[0] = 1.9
        scale = 2.0 if isinstance(x[0], float) else 1.0
        return [scale * x[0] + steps[0], max(x[0], x[1], key=lambda value: 1.0)]

    formula, p = substeps(kr.continuous_model(rate, W=[1.0, 1.0]))
    expected = kr.continuous_model(rate, W=[1.0, 1.0]).substep(np.ones(2), np.zeros(0), 0.1)
    np.testing.assert_allclose(np.array(formula(np.ones(2), [], [0.1], p))[:, 0], expected)


@pytest.mark.parametrize(
    'function',
    [lambda x: np.array([x[0], x[1]], dtype=int), lambda x: np.array([x[0], x[1]], 'float32')],
)
def test_other_kinds_of_arrays_are_refused(function):
    with pytest.raises(UntraceableError, match=r'np\.array with options'):
        freed(kr.continuous_model(function, W=[1.0, 1.0]), lambda p: of_model(p.original, p))


class Beam(kr.Model):
    """A beam whose inertia is made an array on its way."""

    state = kr.Space(('pitch', 'nod'), ('rad', 'rad/s'))
    input = kr.Space((), ())

    def _inertia(self, pitch):
        return np.asarray(1.0 + 0.2 * np.sin(pitch) ** 2)

    def derivative(self, x, u):
        rates = np.broadcast_arrays(x[..., 1], -np.cos(x[..., 0]) / self._inertia(x[..., 0]))
        return np.stack(rates, axis=-1)

    def noise_density(self, x):
        density = np.zeros((*x.shape, 2))
        density[..., 1, 1] = 0.1 / self._inertia(x[..., 0]) ** 2
        return density


def test_numbers_in_arrays_of_objects_have_their_functions():
    """A function that takes symbols is probed with numbers, of which it makes objects."""
    formula, p = substeps(Beam())
    x = np.array([0.3, -0.7])
    expected = Beam().substep(x, np.zeros(0), 0.1)
    np.testing.assert_allclose(np.array(formula(x, [], [0.1], p))[:, 0], expected, rtol=1e-12)


def test_each_way_has_its_arguments():
    def rate(x):
        y = np.asarray(x)
        if x[0] > 0.5:
            y[1] = 3.0
        return [y[1], -x[0]]

    formula, p = substeps(kr.continuous_model(rate, W=[1.0, 1.0]))
    for x in ([0.2, 0.1], [0.9, 0.1]):
        expected = kr.continuous_model(rate, W=[1.0, 1.0]).substep(np.array(x), np.zeros(0), 0.01)
        np.testing.assert_allclose(np.array(formula(x, [], [0.01], p))[:, 0], expected)
