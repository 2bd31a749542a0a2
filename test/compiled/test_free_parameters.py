# SPDX-License-Identifier: Apache-2.0
"""Numbers within functions are parameters, where the formulas hold for any of them."""

import math

import numpy as np
import pytest

pytest.importorskip('casadi')

import kalman_ros as kr
from kalman_ros import scenario
from kalman_ros.compiled import attempt
from kalman_ros.compiled import native_model as native
from kalman_ros.compiled.free_parameters import Parameters, freed
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file


def pendulum(gravity, damping=0.1, function=np.sin):
    def rate(x):
        return np.array([x[1], -gravity * function(x[0]) - damping * x[1]])

    return kr.continuous_model(rate, W=[0.0, 0.1])


def by_default(gravity):
    def rate(x, g=gravity):
        return np.array([x[1], -g * np.sin(x[0])])

    return kr.continuous_model(rate, W=[0.0, 0.1])


def by_name(gravity):
    def rate(x, *, g=gravity):
        return np.array([x[1], -g * np.sin(x[0])])

    return kr.continuous_model(rate, W=[0.0, 0.1])


def nested(gravity):
    def pull(angle):
        return gravity * np.sin(angle)

    return kr.continuous_model(lambda x: np.array([x[1], -pull(x[0])]), W=[0.0, 0.1])


def with_math(gravity):
    def rate(x):
        return np.array([x[1], -math.sqrt(gravity) * np.sin(x[0])])

    return kr.continuous_model(rate, W=[0.0, 0.1])


def with_a_choice(gravity):
    def rate(x):
        return np.array([x[1], -np.sin(x[0]) if gravity > 5.0 else -x[0]])

    return kr.continuous_model(rate, W=[0.0, 0.1])


def in_an_array(gravity):
    A = np.array([[0.0, 1.0], [-gravity, -0.3]])
    return kr.continuous_model(lambda x: A @ np.sin(x), W=[0.0, 0.1])


ALL = [pendulum, by_default, by_name, nested, with_math, with_a_choice, in_an_array]


@pytest.mark.parametrize('build', ALL)
@pytest.mark.slow
def test_a_compiled_function_has_its_numbers(build):
    for gravity in (1.62, 9.81):
        model = build(gravity)
        found = attempt(model)
        assert found.arithmetic != 'numpy', found.reason
        x = np.array([0.4, -0.2])
        np.testing.assert_allclose(
            found.result.step(x, np.zeros(0), 0.05), model.step(x, np.zeros(0), 0.05), rtol=1e-12
        )


@pytest.mark.parametrize('build', [pendulum, by_default, by_name, nested, in_an_array])
def test_functions_that_differ_in_numbers_have_the_same_formulas(build, monkeypatch):
    one, other = (Parameters(build(g), opened=True) for g in (1.62, 9.81))
    assert one == other and one.comparable
    assert 1.62 in abs(one.values) and 9.81 in abs(other.values)
    assert Parameters(build(1.62)) != Parameters(build(9.81))  # as they are
    texts = []
    monkeypatch.setattr(
        native, 'load', lambda text, **_: texts.append(text) or (_ for _ in ()).throw(OSError)
    )
    for model in (one.original, other.original):
        native.forget_formulas()  # each is traced
        with pytest.raises(OSError):
            native.native_model(model)
    assert texts[0] == texts[1]


@pytest.mark.parametrize('name', ['robot_3d', 'navsat', 'gnss_imu', 'inertial', 'submersible'])
def test_parts_of_shipped_scenarios_compare_equal_when_built_again(name):
    values = from_file(shipped.file(name), 'estimator')
    one, other = (scenario.build(values, with_law=False).believed for _ in range(2))
    for each, again in [
        (one.model, other.model),
        *zip(one.sensors.values(), other.sensors.values()),
    ]:
        assert Parameters(each).comparable, each
        assert Parameters(each) == Parameters(again)


def test_functions_that_compute_otherwise_have_others():
    sine, tangent = (Parameters(pendulum(1.0, 0.1, f), opened=True) for f in (np.sin, np.tan))
    assert sine != tangent
    # a term that is absent is not a term with a number
    assert Parameters(pendulum(1.0, 0.0), opened=True) != Parameters(pendulum(1.0), opened=True)


def test_a_function_that_refers_to_itself_is_opened_once():
    def rate(x):
        assert rate is not None
        return np.array([x[1], -2.5 * x[0]])

    model = kr.continuous_model(rate, W=[0.0, 0.1])
    assert Parameters(model, opened=True) == Parameters(model, opened=True)


def test_what_cannot_be_compared_stays_as_it_is():
    table = {'gravity': np.array(['9.81'])}

    def rate(x):
        return np.array([x[1], -float(table['gravity'][0]) * x[0]])

    model = kr.continuous_model(rate, W=[0.0, 0.1])
    assert not Parameters(model, opened=True).comparable
    parameters, _ = freed(model, lambda given: given)
    assert parameters == Parameters(model)


def test_functions_within_functions_take_no_longer_the_deeper_they_are():
    def rate(x):
        return np.array([x[1], -x[0]])

    for k in range(40):

        def rate(x, inner=rate, more=0.01 * k):
            return inner(x) - more * x

    model = kr.continuous_model(rate, W=[0.0, 0.1])
    assert np.sum(Parameters(model, opened=True).values) == pytest.approx(0.01 * 780 + 0.1 + 0.01)
