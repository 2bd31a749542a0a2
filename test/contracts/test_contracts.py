# SPDX-License-Identifier: Apache-2.0
"""What every registered model, sensor and filter keeps to."""

from contextlib import suppress
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
from monte_carlo import consistency, truths

from kalman_ros import models, scenario, sensors
from kalman_ros.analysis.observability import observability
from kalman_ros.core import Gaussian, Model, Sensor, numerical_jacobian
from kalman_ros.estimators import FILTERS, build_filter, filter_class
from kalman_ros.scenario import wiring
from kalman_ros.scenario.parameter_files import from_file

CONFIG = Path(__file__).parents[2] / 'config'
CONFIGS = sorted(CONFIG.glob('*.yaml'))
MODELS = models.names()
WIRED = [(m, s) for m in MODELS for s in wiring.system(m).sensors]


@cache
def unwired():
    """Return by the kinds that no shipped model has, the first model and size that they take."""
    used = {wiring.system(m).sensors[s].kind for m, s in WIRED}
    found = {}
    for kind in sorted({*sensors.names()} - used):
        for model, size in product(MODELS, range(1, 10)):
            with suppress(ValueError):
                sensors.build(kind, models.find_model(model)().state, [0.1] * size, {})
                found[kind] = model, size
                break
    return found


CASES = [*WIRED, *((model, kind) for kind, (model, _) in unwired().items())]
PAIRS = [(m, f) for m in MODELS for f in FILTERS]
GENERAL = [f for f in FILTERS if not filter_class(f).needs_linear]  # of any model and sensor


def plan_of(name):
    return scenario.build({'model': name}).plan


SERVED = [(m, f) for m, f in PAIRS if f in GENERAL or plan_of(m).linear]


def points(model, count=5):
    rng = np.random.default_rng(0)
    return rng.normal(size=(count, model.state.size)), rng.normal(size=(count, model.input.size))


def sensor_of(name, sensor):
    system = wiring.system(name)
    if sensor not in system.sensors:
        built = sensors.build(sensor, system.build().state, [0.1] * unwired()[sensor][1], {})
        built.name = sensor
        return built
    setup = system.sensors[sensor]
    built = sensors.build(setup.kind, system.build().state, setup.noise, setup.options)
    built.name = sensor
    return built


def symmetric_positive(P):
    np.testing.assert_array_equal(P, P.T)
    assert np.linalg.eigvalsh(P)[0] >= -1e-12 * np.abs(P).max()


@pytest.mark.parametrize('name', MODELS)
class TestModel:
    def test_dimensions_match_the_spaces(self, name):
        model = models.find_model(name)()
        xs, us = points(model)
        n, m = model.state.size, model.input.size
        assert isinstance(model, Model)
        assert model.derivative(xs, us).shape == xs.shape
        assert model.step(xs, us, 0.01).shape == xs.shape
        assert model.noise_density(xs[0]).shape == (n, n)
        assert model.state_jacobian(xs[0], us[0]).shape == (n, n)
        assert model.input_jacobian(xs[0], us[0]).shape == (n, m)

    def test_many_points_are_as_one_by_one(self, name):
        model = models.find_model(name)()
        xs, us = points(model)
        for function in (model.derivative, lambda x, u: model.step(x, u, 0.02)):
            together = function(xs, us)
            one_by_one = [function(x, u) for x, u in zip(xs, us)]
            np.testing.assert_allclose(together, one_by_one, atol=1e-12)
        for jacobian in (model.state_jacobian, model.input_jacobian):
            one_by_one = np.array([jacobian(x, u) for x, u in zip(xs, us)])
            together = np.broadcast_to(jacobian(xs, us), one_by_one.shape)
            np.testing.assert_allclose(together, one_by_one, atol=1e-9)

    def test_analytic_jacobians_are_the_numerical_ones(self, name):
        model = models.find_model(name)()
        for x, u in zip(*points(model)):
            # those of the base class are numerical
            A, B = Model.state_jacobian(model, x, u), Model.input_jacobian(model, x, u)
            np.testing.assert_allclose(model.state_jacobian(x, u), A, atol=1e-6)
            np.testing.assert_allclose(model.input_jacobian(x, u), B, atol=1e-6)

    def test_a_short_step_follows_the_derivative(self, name):
        model = models.find_model(name)()
        xs, us = points(model)
        dt = 1e-6
        slope = model.state.subtract(model.step(xs, us, dt), xs) / dt
        np.testing.assert_allclose(slope, model.derivative(xs, us), rtol=1e-4, atol=1e-4)

    def test_noise_is_a_covariance_and_grows_with_time(self, name):
        model = models.find_model(name)()
        x, u = (p[0] for p in points(model))
        symmetric_positive(model.noise_density(x))
        short, long = (model.transition(x, u, dt).Q for dt in (0.01, 0.1))
        symmetric_positive(short)
        symmetric_positive(long)
        assert np.trace(long) > np.trace(short)

    def test_inputs_are_not_changed(self, name):
        model = models.find_model(name)()
        xs, us = points(model)
        before = xs.copy(), us.copy()
        model.derivative(xs, us)
        model.step(xs, us, 0.1)
        model.transition(xs[0], us[0], 0.1)
        np.testing.assert_array_equal(xs, before[0])
        np.testing.assert_array_equal(us, before[1])

    def test_it_rests_at_its_equilibrium(self, name):
        model = models.find_model(name)()
        x, u = model.equilibrium
        np.testing.assert_allclose(model.derivative(x, u), np.zeros(model.state.size), atol=1e-9)

    def test_its_sensors_see_what_grows(self, name):
        found = observability(scenario.build({'model': name}))
        assert {*found.seen, *found.unseen} == {*models.find_model(name)().state.names}

    def test_the_filter_that_it_names_serves_it(self, name):
        built = scenario.build({'model': name})
        assert build_filter(built.filter, built.plan)

    def test_a_model_without_inputs_has_no_options_of_an_input(self, name):
        found = scenario.options({'model': name})
        there = models.find_model(name)().input.size > 0
        for option in ('input.topic', 'input.fields', 'state_cost', 'input_cost'):
            assert (option in found) is there

    def test_the_built_in_wiring_is_whole(self, name):
        built = scenario.build({'model': name})
        system = wiring.system(name)
        assert len(system.input.fields) == built.model.input.size
        assert len(system.state.fields) == built.model.state.size
        assert built.enabled
        assert all(
            len(option.description) > 5 for option in scenario.options({'model': name}).values()
        )

    def test_the_parameter_file_has_the_defaults_of_the_model(self, name):
        path = CONFIG / f'{name}.yaml'
        values = from_file(path, 'plant')
        known = scenario.options({'model': name})
        assert set(values) <= set(known)
        assert values.pop('model') == name
        for key, value in values.items():
            assert known[key].check(value) == known[key].default, key
        assert yaml.safe_load(path.read_text())


@pytest.mark.parametrize('path', CONFIGS, ids=lambda path: path.stem)
def test_a_parameter_file_is_a_whole_scenario(path):
    values = from_file(path, 'plant')
    assert set(values) <= set(scenario.options(values))
    built = scenario.build(values)
    assert build_filter(built.filter, built.plan)


def test_every_kind_of_sensor_is_tried():
    used = {wiring.system(m).sensors[s].kind for m, s in WIRED}
    assert used | unwired().keys() == {*sensors.names()}


@pytest.mark.parametrize(('name', 'sensor'), CASES)
class TestSensor:
    def test_dimensions_match_the_space(self, name, sensor):
        found = sensor_of(name, sensor)
        xs, _ = points(models.find_model(name)())
        assert isinstance(found, Sensor)
        assert found.measure(xs).shape == (len(xs), found.output.size)
        symmetric_positive(found.covariance)
        assert found.covariance.shape == (found.output.size,) * 2

    def test_many_points_are_as_one_by_one(self, name, sensor):
        found = sensor_of(name, sensor)
        # as many as no space has states, and along two axes
        xs = points(models.find_model(name)(), 2 * 29)[0].reshape(2, 29, -1)
        for function in (found.measure, found.jacobian):
            one_by_one = np.array([[function(x) for x in row] for row in xs])
            together = np.broadcast_to(function(xs), one_by_one.shape)
            np.testing.assert_allclose(together, one_by_one, atol=1e-9)

    def test_a_linear_sensor_has_the_same_jacobian_everywhere(self, name, sensor):
        found = sensor_of(name, sensor)
        first, *others = (found.jacobian(x) for x in points(models.find_model(name)())[0])
        same = all(np.allclose(first, other) for other in others)
        assert same is found.linear

    def test_the_analytic_jacobian_is_the_numerical_one(self, name, sensor):
        found = sensor_of(name, sensor)
        for x in points(models.find_model(name)())[0]:
            expected = numerical_jacobian(found.measure, x, found.output.subtract, found.state)
            np.testing.assert_allclose(found.jacobian(x), expected, atol=1e-7)

    def test_another_covariance_leaves_the_sensor_as_it_was(self, name, sensor):
        found = sensor_of(name, sensor)
        before = found.covariance.copy()
        other = found.with_covariance(2.0 * before)
        np.testing.assert_array_equal(found.covariance, before)
        np.testing.assert_array_equal(other.covariance, 2.0 * before)


@pytest.mark.parametrize(('name', 'kind'), [pair for pair in PAIRS if pair not in SERVED])
def test_a_linear_filter_refuses_what_is_not_linear(name, kind):
    with pytest.raises(ValueError, match=f'filter: {kind} needs'):
        build_filter(kind, plan_of(name))


@pytest.mark.parametrize(('name', 'kind'), SERVED)
class TestFilter:
    def run(self, name, kind, steps=50):
        system = wiring.system(name)
        model = system.build()
        built = scenario.build({'model': name})
        filter = build_filter(kind, built.plan)
        rng = np.random.default_rng(0)
        belief = built.initial_belief
        every = [sensor_of(name, sensor_name) for sensor_name in system.sensors]
        for _ in range(steps):
            dt, u = rng.uniform(0.0, 0.05), rng.normal(size=model.input.size)
            belief = filter.predict(belief, u, dt)
            yield belief
            for sensor in every:
                noise = np.sqrt(sensor.covariance.diagonal()) * rng.normal(size=sensor.output.size)
                y = sensor.measure(belief.mean) + noise
                correction = filter.correct(belief, y, sensor)
                assert correction.innovation.shape == (sensor.output.size,)
                assert correction.nis >= 0.0
                belief = correction.posterior
                yield belief

    def test_the_covariance_stays_a_covariance(self, name, kind):
        for belief in self.run(name, kind):
            assert np.isfinite(belief.mean).all()
            np.testing.assert_allclose(
                belief.covariance, belief.covariance.T, rtol=0.0,
                atol=1e-15 * np.abs(belief.covariance).max(),
            )  # fmt: skip
            assert np.linalg.eigvalsh(belief.covariance)[0] > -1e-13

    def test_beliefs_are_not_changed(self, name, kind):
        system = wiring.system(name)
        model = system.build()
        filter = build_filter(kind, scenario.build({'model': name}).plan)
        n = model.state.size
        belief = Gaussian(np.full(n, 0.1), np.eye(n))
        sensor = sensor_of(name, next(iter(system.sensors)))
        filter.predict(belief, np.zeros(model.input.size), 0.1)
        filter.correct(belief, np.zeros(sensor.output.size), sensor)
        np.testing.assert_array_equal(belief.mean, np.full(n, 0.1))
        np.testing.assert_array_equal(belief.covariance, np.eye(n))


@cache
def started(name):
    """Return the scenario of a model that is nearly linear across its first belief."""
    system, plan = wiring.system(name), plan_of(name)
    chosen = {'model': name, 'rate': max(timed.rate for timed in plan.sensors.values())}
    if not plan.linear:
        chosen['initial_estimate'] = list(system.initial_state)
        chosen['initial_std'] = [0.1 * std for std in system.initial_std]
    return scenario.build(chosen)


@cache
def drawn(name):
    """Return what happens from the first belief, the same for every filter."""
    return truths(started(name), RUNS, 15 if started(name).plan.linear else 10)


RUNS = 200
LIKE_EKF = ('square_root', 'gaussian_sum', 'iterated_ekf')
#: The quick tests have the model that the linear filters serve, too, and that is no scalar.
MARKED = [
    pytest.param(
        *pair,
        marks=[
            *([] if pair[0] == 'mass_spring_damper' else [pytest.mark.slow]),
            # others hold that these are the extended filter where one Gaussian is enough
            *([pytest.mark.thorough] if pair[1] in LIKE_EKF and pair[0] != 'two_bearings' else []),
        ],
    )
    for pair in SERVED
]


@pytest.mark.parametrize(('name', 'kind'), MARKED)
class TestConsistency:
    """The average of 200 runs is in its 95 % bounds at most steps, but not with wrong noise.

    Errors of one run are alike from step to step, so the share of steps is not 95 % sharp.
    A model that is not linear is nearly so across a belief that is narrow enough.
    """

    def shares(self, name, kind, runs=RUNS, settled=0, **options):
        built, truth = started(name), drawn(name)
        filter = build_filter(kind, built.plan)
        if settled and built.plan.linear:
            belief = self.settled(built, filter, settled)
            built = replace(built, initial_belief=belief._replace(mean=built.initial_belief.mean))
            truth = truths(built, runs, len(truth[0]))
        found = consistency(built, filter, runs, len(truth[0]), drawn=truth[:runs], **options)
        return [found.share_inside(which) for which in found.degrees]

    def settled(self, built, filter, steps):
        """Return what becomes of the first belief, which a slow observer long remembers."""
        belief, plan = built.initial_belief, built.plan
        for step in range(steps):
            for name in plan.due(step):
                sensor = plan.sensors[name].sensor
                belief = filter.correct(belief, sensor.measure(belief.mean), sensor).posterior
            belief = filter.predict(belief, built.model.equilibrium.input, plan.dt)
        return belief

    def test_the_errors_scatter_as_the_filter_says(self, name, kind):
        assert min(self.shares(name, kind)) >= 0.8

    @pytest.mark.thorough
    def test_wrong_noise_shows(self, name, kind):
        assert min(self.shares(name, kind, settled=500, noise=3.0)) < 0.5
