# SPDX-License-Identifier: Apache-2.0
"""Compiled models and sensors compute what numpy does, with exact derivatives."""

import copy
import pickle

import numpy as np
import pytest
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.core import DiscreteLinearSystem, LinearSystem, Model, Sensor, Space
from kalman_ros.core import rotations as so3
from kalman_ros.core.stacked import stacked
from kalman_ros.linear import batched
from kalman_ros.scenario import shipped
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.sensors.euler import Euler
from kalman_ros.sensors.landmarks import Landmarks

pytest.importorskip('casadi', reason='the extra kalman_ros[compiled] is not installed')
from kalman_ros.compiled import attempt, compiled
from kalman_ros.compiled.interpreted import interpreted_model, interpreted_sensor
from kalman_ros.compiled.tracing import trace
from kalman_ros.compiled.untraceable import UntraceableError

C = pytest.mark.slow  # the compiler is another process
NONLINEAR = (
    'bearing_tracker', 'cart_pole', 'constant_velocity', 'diff_drive', 'gnss_imu', 'inertial',
    'navsat', 'robot_2d', 'robot_3d', 'submersible', 'turn_rate', 'two_bearings',
)  # fmt: skip
#: A few that hold all kinds of functions, for what is slower or said of each arithmetic.
FEW = ('cart_pole', 'inertial', 'navsat')


@pytest.fixture(scope='module', autouse=True)
def _own_cache(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('XDG_CACHE_HOME', str(tmp_path_factory.mktemp('cache')))
        yield


def believed(name, **changes):
    values = {**from_file(shipped.file(name), 'estimator'), **changes}
    return scenario.build(values, with_law=False).believed


def points(model, count=20, seed=3):
    """Return states and inputs, with rotations and angles of any size."""
    rng, rest = np.random.default_rng(seed), model.equilibrium
    x = rest.state + rng.standard_normal((count, model.state.size))
    return x, rest.input + rng.standard_normal((count, model.input.size))


def assert_same(mine, theirs, close=1e-12):
    scale = max(1.0, np.abs(theirs).max(initial=0.0))
    np.testing.assert_allclose(mine, theirs, rtol=close, atol=close * scale)


def exact_jacobian(function, x, h=1e-5):
    """Return d function / d x in extended precision, by differences of fourth order."""
    x = np.asarray(x, np.longdouble)
    moves = h * np.eye(x.size, dtype=np.longdouble)
    return np.stack(
        [
            (8 * (function(x + d) - function(x - d)) - function(x + 2 * d) + function(x - 2 * d))
            / (12 * np.longdouble(h))
            for d in moves
        ],
        axis=-1,
    )


def kinds(names, always=None):
    """Return names with an arithmetic; compiled by C are ``always`` some, or all."""
    often = names if always is None else always
    marks = {name: [C] if name in often else [C, pytest.mark.thorough] for name in names}
    return [
        *(pytest.param(name, 'C', marks=marks[name], id=f'{name}-C') for name in names),
        *(pytest.param(name, 'CasADi', id=f'{name}-CasADi') for name in FEW),
    ]


def fast(part, state, arithmetic):
    """Return a model or sensor computed by one arithmetic."""
    if arithmetic == 'C':
        found = attempt(part, state)
        assert (found.arithmetic, found.reason) == ('C', '')
        return found.result
    return interpreted_model(part) if isinstance(part, Model) else interpreted_sensor(part, state)


@pytest.mark.parametrize(('name', 'arithmetic'), kinds(NONLINEAR, ('cart_pole', 'robot_3d')))
def test_every_shipped_model_steps_as_in_numpy(name, arithmetic):
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    found = fast(model, None, arithmetic)
    dt = 0.013
    for x, u in zip(*points(model)):
        for mine, theirs in zip(found.linearized_step(x, u, dt), model.linearized_step(x, u, dt)):
            assert_same(mine, theirs)
        assert_same(found.step(x, u, dt), model.step(x, u, dt))
        Q = model.noise_covariance(x, u, dt)
        np.testing.assert_allclose(found.noise_covariance(x, u, dt), Q, atol=1e-12 * Q.max())
        assert_same(found.derivative(x, u), model.derivative(x, u))


@C
@pytest.mark.parametrize('name', mostly_thorough(NONLINEAR, 'robot_3d', 'cart_pole'))
def test_every_shipped_model_moves_any_number_of_states(name):
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    fast, plain = stacked(compiled(model)), stacked(model)
    x, u = points(model)
    x, u, dt = np.stack((x, x[::-1]), axis=1), np.stack((u, u[::-1]), axis=1), 0.013
    P = np.random.default_rng(3).standard_normal((*x.shape, x.shape[-1]))
    P = P @ P.swapaxes(-1, -2)
    for mine, theirs in (
        ([fast.derivative(x, u)], [plain.derivative(x, u)]),
        ([fast.step(x, u, dt)], [plain.step(x, u, dt)]),
        (fast.linearized_step(x, u, dt), plain.linearized_step(x, u, dt)),
        (fast.predicted_moments(x, P, u, dt), plain.predicted_moments(x, P, u, dt)),
        (fast.predicted_moments(x, P, u, dt, 4), plain.predicted_moments(x, P, u, dt, 4)),
        ([fast.step_noise(x, u, 1e-6)], [plain.step_noise(x, u, 1e-6)]),
    ):
        for one, other in zip(mine, theirs):
            assert_same(one, np.broadcast_to(other, one.shape))


@C
@pytest.mark.parametrize('name', mostly_thorough(NONLINEAR, 'robot_3d', 'cart_pole'))
def test_the_noise_alone_is_that_of_the_whole_step(name):
    """Also where a step is so long that it is halved, and where a state is lost."""
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    fast, (x, u) = stacked(compiled(model)), points(model)
    x, u = (np.tile(each, (4, 1)) for each in (x, u))  # several members in one register
    x[[1, 9]] = 1e200
    for dt in (1e-6, 0.013, 3.0):
        with np.errstate(over='ignore'):
            found, whole = fast.step_noise(x, u, dt), fast.linearized_step(x, u, dt).Q
        assert np.array_equal(found, whole, equal_nan=True)
        assert np.isfinite(found[0]).all()


@C
@pytest.mark.parametrize('dt', [0.013, 2.0])
@pytest.mark.parametrize('name', mostly_thorough(NONLINEAR, 'robot_3d', 'cart_pole'))
def test_members_in_one_register_are_those_one_by_one(name, dt):
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    fast, (x, u) = stacked(compiled(model)), points(model)
    x, u = (np.tile(each, (4, 1)) for each in (x, u))
    x += 0.01 * np.random.default_rng(5).standard_normal(x.shape)
    P = np.broadcast_to(0.1 * np.eye(x.shape[1]), (*x.shape, x.shape[1]))
    for at_once, one_by_one in (
        (fast.linearized_step(x, u, dt), [fast.linearized_step(*at, dt) for at in zip(x, u)]),
        (
            fast.predicted_moments(x, P, u, dt, 2),
            [fast.predicted_moments(*at, dt, 2) for at in zip(x, P, u)],
        ),
    ):
        for together, alone in zip(at_once, zip(*one_by_one)):
            assert_same(together, np.stack(alone))


@C
@pytest.mark.parametrize('count', [2, 3])
def test_members_in_one_register_have_numbers_that_differ(count):
    parameters = [{'model_parameters.friction': 0.1 * (1 + k)} for k in range(count)]
    models = [scenario.build({'model': 'cart_pole', **each}).model for each in parameters]
    whole = compiled(models[0]).merged_numbers([compiled(each) for each in models[1:]])
    rng = np.random.default_rng(9)
    x, u = 0.3 * rng.standard_normal((5, count, 4)), rng.standard_normal((5, count, 1))
    found = whole.linearized_step(x, u, 0.013)
    for k, model in enumerate(models):
        for row in range(5):
            alone = model.linearized_step(x[row, k], u[row, k], 0.013)
            for together, one in zip(found, alone):
                assert_same(together[row, k], one)


@C
@pytest.mark.parametrize('name', mostly_thorough(NONLINEAR, 'robot_3d', 'cart_pole'))
def test_noise_disturbs_a_step_by_its_covariance(name):
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    fast, (x, u) = stacked(compiled(model)), points(model)
    n, dt = x.shape[1], 0.013
    for at, input in zip(x, u):
        normal = np.vstack((np.zeros(n), np.eye(n)))
        found = fast.noisy_step(np.tile(at, (n + 1, 1)), np.tile(input, (n + 1, 1)), dt, normal)
        assert_same(found[0], model.step(at, input, dt))
        moved = model.state.subtract(found[1:], found[:1])
        Q = model.noise_covariance(at, input, dt)
        scale = np.sqrt(Q.diagonal())
        scale[scale == 0.0] = np.inf
        relative = (moved.T @ moved - Q) / np.outer(scale, scale)
        assert np.abs(relative).max() < 1e-9
    lost = x.copy()
    lost[1] = np.nan
    with np.errstate(all='ignore'):
        found = fast.noisy_step(lost, u, dt, np.zeros(x.shape))
    assert np.isnan(found[1]).any()
    assert_same(found[0], model.step(x[0], u[0], dt))


@C
def test_noise_that_changes_far_away_is_compared_of_one_of_many_too():
    class Config:
        density = 1.0

    class Drifting(Model):
        state, input = Space(['x', 'v']), Space([])
        config = None

        def derivative(self, x, u):
            return np.stack((x[..., 1], -np.sin(x[..., 0])), axis=-1)

        def noise_density(self, x):
            return np.where(np.abs(x[0]) > 5.0, self.config.density, 1.0) * np.diag([0.0, 0.5])

    model = Drifting()
    model.config = config = Config()
    for density in (1.0, 50.0):
        config.density = density
        outcome = attempt(model, one_of_many=True)
        assert outcome.arithmetic == 'C', outcome.reason
        found = outcome.result
        at = np.array([900.0, 0.0]), np.zeros(0), 0.01
        # the original takes its Jacobian by differences
        assert_same(found.noise_covariance(*at), model.noise_covariance(*at), 1e-9)


@C
def test_factors_of_many_members_are_those_of_numpy():
    model, rng = compiled(believed('cart_pole').model), np.random.default_rng(8)
    root = rng.standard_normal((5, 3, 4, 4))
    P = root @ root.swapaxes(-1, -2)
    P[0, 0], P[1, 1], P[2, 0, 3, 1], P[4, 2] = (
        0.0,
        -P[1, 1],
        np.nan,
        np.diag([np.inf, 1.0, 1.0, 1.0]),
    )
    with np.errstate(all='ignore'):
        found, expected = model.covariance_factor(P), batched.factor(P)
    lost = ~np.isfinite(expected).all(axis=(-2, -1))
    assert lost.sum() == 4
    diagonal = found.diagonal(axis1=-2, axis2=-1)
    assert np.array_equal(lost, ~np.isfinite(diagonal).all(axis=-1))
    assert_same(found[~lost], expected[~lost])


@C
@pytest.mark.parametrize('name', mostly_thorough(NONLINEAR, *FEW, 'robot_3d'))
def test_several_steps_at_once_are_those_one_by_one(name):
    model = believed(name).model
    if isinstance(model, LinearSystem):
        pytest.skip('the model is linear')
    found, rng = compiled(model), np.random.default_rng(4)
    for x, u in zip(*points(model)):
        P = rng.standard_normal((x.size, x.size))
        P = P @ P.T
        at_once = found.predicted_moments(x, P, u, 0.013, 5)
        for mine, theirs in zip(at_once, model.predicted_moments(x, P, u, 0.013, 5)):
            assert_same(mine, theirs)
        mean, covariance = x, P
        for _ in range(5):
            mean, covariance = found.predicted_moments(mean, covariance, u, 0.013)
        assert_same(at_once[0], mean)
        assert_same(at_once[1], covariance)


@pytest.mark.parametrize(('name', 'arithmetic'), kinds(NONLINEAR))
def test_every_shipped_sensor_reads_as_in_numpy_and_its_jacobian_is_exact(name, arithmetic):
    parts = believed(name)
    x, _ = points(parts.model)
    for sensor in parts.sensors.values():
        if sensor.linear:
            continue
        found = fast(sensor, parts.model.state, arithmetic)
        for each in x:
            assert_same(found.measure(each), sensor.measure(each))
            numerical = type(sensor).jacobian is Sensor.jacobian or 'gnss' in sensor.name
            assert_same(found.jacobian(each), sensor.jacobian(each), 1e-6 if numerical else 1e-12)
        assert_same(found.measure(x), sensor.measure(x))
        assert_same(found.measure(x[:, None]), sensor.measure(x[:, None]))


@pytest.mark.parametrize('angles', [['yaw'], ['roll', 'pitch'], ['roll', 'pitch', 'yaw']])
def test_angles_of_a_rotation_are_compiled(angles):
    model = believed('robot_3d').model
    sensor = Euler(model.state, [0.1] * len(angles), angles=angles)
    found = interpreted_sensor(sensor, model.state)
    x, _ = points(model)
    assert_same(found.measure(x), sensor.measure(x))
    assert_same(found.jacobian(x), sensor.jacobian(x), 1e-9)


def test_numerical_jacobians_become_exact():
    parts = believed('inertial')
    sensor = parts.sensors['barometer']
    found = interpreted_sensor(sensor, parts.model.state)
    x = np.zeros(parts.model.state.size)
    x[2] = 300.0
    exact = exact_jacobian(sensor.measure, x, 1e-2)
    error = np.abs(found.jacobian(x) - exact).max()
    assert error < 1e-12 * np.abs(exact).max()
    assert error < 0.1 * np.abs(sensor.jacobian(x) - exact).max()


@C
@pytest.mark.parametrize('name', ['inertial', 'robot_3d'])
def test_rotations_move_as_in_numpy(name):
    space = believed(name).model.state
    found = compiled(believed(name).model).state
    assert found == space
    assert space == found
    assert hash(found) == hash(space)
    rng = np.random.default_rng(5)
    for scale in (0.0, 1e-9, 0.1, 1.0, 3.0):
        a, b = scale * rng.standard_normal((2, space.size))
        P = rng.standard_normal((space.size, space.size))
        P = P @ P.T
        assert_same(found.subtract(a, b), space.subtract(a, b))
        for mine, theirs in zip(found.arrived(a, b, P), space.arrived(a, b, P)):
            assert_same(mine, theirs)
    a, b = rng.standard_normal((2, 7, space.size))
    assert_same(found.subtract(a, b), space.subtract(a, b))


@C
def test_biases_and_lever_arms_that_a_scenario_adds_are_compiled():
    parts = believed('navsat', **{'imu.bias_std': [0.01], 'imu.bias_noise': [1e-6]})
    found = attempt(parts.model)
    assert found.arithmetic == 'C'
    for x, u in zip(*points(parts.model)):
        for mine, theirs in zip(
            found.result.linearized_step(x, u, 0.01), parts.model.linearized_step(x, u, 0.01)
        ):
            assert_same(mine, theirs)
    gnss = parts.sensors['gnss']
    assert attempt(gnss, parts.model.state).arithmetic == 'C'


# --- models of users ----------------------------------------------------------------------------


class Pendulum(Model):
    """As in the README: no Jacobian."""

    state = Space('angle rate', ('rad', 'rad/s'), angles='angle')
    input = Space('torque')

    def __init__(self, length=1.3, damping=0.1):
        self.length, self.damping = length, damping
        self.gains = np.array([1.0, 0.5])

    def derivative(self, x, u):
        angle, rate = x[..., 0], x[..., 1]
        pull = -9.81 / self.length * np.sin(angle) - self.damping * rate
        return np.stack((rate, pull + self.gains[1] * u[..., 0]), axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.02])


class Slow(Pendulum):
    max_step = 0.01


class Turning(Model):
    """A rotation without a Jacobian."""

    state = Space('rx ry rz', rotations=('rx ry rz',))
    input = Space('wx wy wz')

    def derivative(self, x, u):
        return u + 0.1 * so3.rotate(x, np.array([1.0, 0.0, 0.5]))

    def noise_density(self, x):
        return 0.01 * np.eye(3)


KINDS = ('CasADi', pytest.param('C', marks=C))


@pytest.mark.parametrize('arithmetic', KINDS)
@pytest.mark.parametrize('kind', mostly_thorough([Pendulum, Slow, Turning], Pendulum, Slow))
def test_without_a_jacobian_f_is_the_exact_derivative_of_the_step(kind, arithmetic):
    model = kind()
    found = fast(model, None, arithmetic)
    space, dt = model.state, 0.057
    for x, u in zip(*points(model, 6)):
        mine, theirs = found.linearized_step(x, u, dt), model.linearized_step(x, u, dt)
        assert_same(mine.state, theirs.state)
        assert_same(mine.F, theirs.F, 1e-8)
        np.testing.assert_allclose(mine.Q, theirs.Q, atol=1e-7 * theirs.Q.max())
        if not space.rotations:
            exact = exact_jacobian(lambda at, u=u: model.step(at, u, dt), x)
            assert np.abs(mine.F - exact).max() < 1e-12


class Height(Sensor):
    """Beside a reading that is always zero: on a floor, a robot says so."""

    output = Space('zero angle', ('m', 'rad'))
    covariance = np.eye(2)

    def measure(self, x):
        return np.stack((np.zeros_like(x[..., 0]), np.sin(x[..., 0])), axis=-1)


@pytest.mark.parametrize('arithmetic', KINDS)
def test_what_is_always_zero_has_its_place(arithmetic):
    sensor, found = Height(), fast(Height(), Pendulum.state, arithmetic)
    x = np.array([[0.4, -1.0], [0.2, 3.0]])
    assert_same(found.measure(x), sensor.measure(x))
    assert_same(found.measure(x[0]), sensor.measure(x[0]))
    assert_same(found.jacobian(x[0]), sensor.jacobian(x[0]), 1e-8)


class Bounded(Pendulum):
    """A step of a user: nothing passes the stop."""

    def step(self, x, u, dt):
        return np.minimum(super().step(x, u, dt), 2.0)


class Gapped(Pendulum):
    """More noise after a gap."""

    def noise_covariance(self, x, u, dt):
        return super().noise_covariance(x, u, dt) * (100.0 if dt > 0.05 else 1.0)


class Limited(Pendulum):
    """A limit far from where the formulas are tried first."""

    limit = 10.0

    def derivative(self, x, u):
        pull = np.clip(u[..., 0] - x[..., 0], -self.limit, self.limit)
        return np.stack((x[..., 1], pull), axis=-1)


@pytest.mark.parametrize('kind', [Bounded, Gapped])
def test_a_step_of_a_user_is_not_replaced_by_ours(kind):
    model = kind()
    found = compiled(model)
    for x in ([1.95, 9.0], [0.1, 0.2]):
        for dt in (0.02, 0.2):
            x, u = np.array(x), np.zeros(1)
            assert_same(found.step(x, u, dt), model.step(x, u, dt))
            Q = model.noise_covariance(x, u, dt)
            assert_same(found.noise_covariance(x, u, dt), Q, 1e-6)


def test_a_step_that_is_divided_by_its_length_is_refused_at_once(monkeypatch):
    calls, derivative = [], Pendulum.derivative
    monkeypatch.setattr(
        Pendulum, 'derivative', lambda self, x, u: calls.append(1) or derivative(self, x, u)
    )
    found = attempt(Bounded())
    assert found.arithmetic == 'numpy' and 'divided into substeps' in found.reason
    assert len(calls) < 100


@C
def test_what_changes_without_an_attribute_is_noticed(monkeypatch):
    x, u = np.array([0.3, 1.0]), np.array([60.0])
    assert compiled(Limited()).derivative(x, u)[1] == 10.0
    monkeypatch.setattr(Limited, 'limit', 5.0)
    found = attempt(Limited())
    assert found.arithmetic == 'C'
    assert found.result.derivative(x, u)[1] == 5.0


class Guarded(Sensor):
    """Formulas that look at their numbers where there is no derivative."""

    output = Space('unit distance power angle round')
    covariance = np.eye(5)

    def measure(self, x):
        r = np.sqrt(x[..., 0] ** 2 + x[..., 1] ** 2)
        near = np.where(r == 0.0, 1.0, r)
        unit = np.where(r > 0.0, x[..., 0] / near, 0.5)
        angle = np.arccos(np.clip(x[..., 0], -1.0, 1.0))
        power = (x[..., 0] ** 2 + x[..., 1] ** 2) ** 0.5
        return np.stack((unit, r, power, angle, np.round(x[..., 1])), axis=-1)


@pytest.mark.parametrize('arithmetic', KINDS)
def test_where_there_is_no_derivative_the_original_computes(arithmetic):
    sensor, found = Guarded(), fast(Guarded(), Pendulum.state, arithmetic)
    x = np.array([[0.0, 0.0], [1.0, 0.5], [3.0, 1.5], [-2.0, 2.5], [0.3, 0.2]])
    assert_same(found.measure(x), sensor.measure(x))
    for each in x:
        assert_same(found.measure(each), sensor.measure(each))
        assert np.isfinite(found.jacobian(each)).all()
    assert np.isfinite(found.jacobian(x)).all()
    assert np.array_equal(found.jacobian(x[0]), sensor.jacobian(x[0]))


@C
def test_a_shipped_sensor_at_its_own_place_still_reads():
    parts = believed('two_bearings')
    sensor = parts.sensors['west']
    x = np.zeros(parts.model.state.size)
    x[[0, 1]] = -sensor.line_of_sight(x)  # where it stands
    found = compiled(sensor, parts.model.state)
    assert not sensor.line_of_sight(x).any()
    assert np.array_equal(found.jacobian(x), sensor.jacobian(x))
    assert np.array_equal(found.jacobian(np.stack((x, x)))[1], sensor.jacobian(x))


class Clash(Pendulum):
    """Attributes by names that are ours, too."""

    def __init__(self):
        super().__init__()
        self._p, self._numbers, self._size, self._library = 1.5, [2.0], 3.0, 4.0
        self.predicted, self.leading = 5.0, 6.0

    def input_jacobian(self, x, u):
        return np.array([[0.0], [self._numbers[0]]])


@C
def test_names_of_a_user_stay_his():
    found, x, u = compiled(Clash()), np.array([0.4, -1.0]), np.array([2.0])
    assert found.input_jacobian(x, u)[1, 0] == 2.0
    assert (found._p, found._size, found._library) == (1.5, 3.0, 4.0)
    assert_same(found.step(x, u, 0.02), Clash().step(x, u, 0.02))


@C
def test_a_copy_keeps_what_was_changed_after_it_was_compiled():
    parts = believed('two_bearings')
    sensor = compiled(parts.sensors['west'], parts.model.state)
    other = sensor.with_covariance(np.array([[7.0]]))
    assert pickle.loads(pickle.dumps(other)).covariance == 7.0
    assert copy.deepcopy(other).covariance == 7.0


class Broken(Pendulum):
    def derivative(self, x, u):
        if x.dtype == float:
            raise ArithmeticError('not within the earth')
        return super().derivative(x, u)


class Catching(Pendulum):
    """It would go on with other formulas."""

    def derivative(self, x, u):
        try:
            return float(x[0]) * np.ones(2)
        except (TypeError, ValueError, ArithmeticError):
            return super().derivative(x, u)


@pytest.mark.parametrize(
    ('kind', 'reason'),
    [(Broken, 'ArithmeticError: not within the earth'), (Catching, 'its state_jacobian is not')],
)
def test_a_model_that_fails_in_any_way_is_left_to_numpy(kind, reason):
    found = attempt(kind())
    assert found.arithmetic == 'numpy'
    assert found.reason.startswith(reason)


@pytest.mark.parametrize(
    'function',
    [
        lambda x: np.max(x, axis=-1, initial=5.0),
        lambda x: (x[..., 0] > 5.0) + (x[..., 1] > 5.0),
        lambda x: np.nan_to_num(x[..., 0], nan=1.0),
        lambda x: np.clip(x[..., 0], -5.0, 5.0, out=np.zeros(())),
        lambda x: np.round(x[..., 0], 1),
    ],
)
def test_options_that_have_no_formula_are_refused(function):
    with pytest.raises(UntraceableError):
        trace(function, (np.array([0.3, 0.4]),))


@C
def test_other_numbers_use_the_same_library_and_no_number_is_forgotten():
    first, second = Pendulum(1.3, 0.1), Pendulum(0.7, 0.4)
    second.gains = np.array([3.0, 2.0])
    one, two = compiled(first), compiled(second)
    assert one._c_library is two._c_library
    x, u = np.array([0.4, -1.0]), np.array([2.0])
    for model, found in ((first, one), (second, two)):
        assert_same(found.step(x, u, 0.02), model.step(x, u, 0.02))
    assert not np.allclose(one.step(x, u, 0.02), two.step(x, u, 0.02))


@C
def test_it_is_the_same_model_to_all_else():
    model = Pendulum()
    found = compiled(model)
    assert isinstance(found, Pendulum)
    assert type(found).__name__ == 'Pendulum'
    assert repr(found) == repr(model)
    assert found.length == model.length
    assert type(model) is Pendulum  # which stays as it is
    assert compiled(found) is found
    x, u = np.array([0.4, -1.0]), np.array([2.0])
    for other in (copy.copy(found), copy.deepcopy(found), pickle.loads(pickle.dumps(found))):
        assert type(other) is type(found)
        assert np.array_equal(other.step(x, u, 0.02), found.step(x, u, 0.02))


@C
def test_a_sensor_with_another_covariance_still_reads():
    parts = believed('two_bearings')
    sensor = compiled(parts.sensors['west'], parts.model.state)
    other = sensor.with_covariance(np.array([[4.0]]))
    x = np.ones(parts.model.state.size)
    assert other.covariance == 4.0
    assert np.array_equal(other.measure(x), sensor.measure(x))
    del sensor
    assert np.isfinite(other.jacobian(x)).all()


@pytest.mark.parametrize('arithmetic', KINDS)
def test_whatever_the_shape_of_the_arguments_the_result_is_that_of_numpy(arithmetic):
    model = Slow()
    found = fast(model, None, arithmetic)
    rng = np.random.default_rng(2)
    for x_shape, u_shape in (
        ((2,), (1,)), ((4, 2), (1,)), ((4, 2), (4, 1)), ((3, 4, 2), (4, 1)),
        ((3, 4, 2), (3, 4, 1)), ((0, 2), (1,)),
    ):  # fmt: skip
        x, u = rng.standard_normal(x_shape), rng.standard_normal(u_shape)
        assert_same(found.step(x, u, 0.033), model.step(x, u, 0.033))
    x = np.asfortranarray(rng.standard_normal((5, 2)))[::2]
    assert_same(found.step(x, np.ones(1), 0.01), model.step(x, np.ones(1), 0.01))
    assert_same(
        found.linearized_step(np.array([1, 2]), np.array([1]), 0.01).F,
        model.linearized_step(np.array([1.0, 2.0]), np.array([1.0]), 0.01).F,
        1e-8,
    )
    for x, u in ((np.zeros(1), np.zeros(1)), (np.zeros(2), np.zeros(0))):
        for part in (model, found):  # none reads what is not there
            with pytest.raises((IndexError, ValueError)):
                part.step(x, u, 0.01)


@C
@pytest.mark.parametrize('dt', [0.0, -0.05, 1e-9, 3.0, 1e6])
def test_steps_of_any_length(dt):
    model = Slow()
    found = compiled(model)
    x, u = np.array([0.4, -1.0]), np.array([2.0])
    with np.errstate(all='ignore'):
        assert_same(found.step(x, u, dt), model.step(x, u, dt), 1e-9)


@C
@pytest.mark.filterwarnings('ignore')
@pytest.mark.parametrize('bad', [np.nan, np.inf, 1e200])
@pytest.mark.parametrize('name', ['cart_pole', 'robot_3d'])
def test_what_is_not_finite_fails_as_in_numpy(name, bad):
    model = believed(name).model
    found = compiled(model)
    for k in range(model.state.size):
        x, u = np.zeros(model.state.size), np.zeros(model.input.size)
        x[k] = bad
        try:
            theirs = model.linearized_step(x, u, 0.01)
        except np.linalg.LinAlgError as error:
            try:
                step = found.linearized_step(x, u, 0.01)
            except np.linalg.LinAlgError as raised:
                assert str(raised) == str(error)
            else:  # zeros of the Jacobian times what has overflown are zeros here
                assert np.isfinite(step.F).all()
                assert np.isfinite(step.Q).all()
            continue
        for mine, expected in zip(found.linearized_step(x, u, 0.01), theirs):
            assert np.array_equal(np.isfinite(mine), np.isfinite(expected))


# --- what cannot be traced ----------------------------------------------------------------------


class Settling(Pendulum):
    def derivative(self, x, u):
        while abs(u[..., 0]).max() > 1.0:
            u = 0.5 * u
        return super().derivative(x, u)


class Storing(Pendulum):
    def derivative(self, x, u):
        rates = np.frombuffer(bytearray(16))  # of a kind that nobody expects
        rates[0] = x[..., 1]
        return rates


class Foreign(Pendulum):
    def derivative(self, x, u):
        from scipy.special import erf

        return np.stack((x[..., 1], erf(x[..., 0])), axis=-1)


class Wrong(Pendulum):
    def state_jacobian(self, x, u):
        return np.array([[0.0, 1.0], [1.0, 0.0]])


class OtherTransition(Pendulum):
    def transition(self, x, u, dt):
        return super().transition(x, u, 2.0 * dt)


class Random(Pendulum):
    def derivative(self, x, u):
        return super().derivative(x, u) + np.random.default_rng().standard_normal(2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('kind', 'reason'),
    [
        (Settling, 'it decides by the value of the state in more than 64 ways: if, max, while'),
        (Storing, 'it stores what depends on the state in an array of plain numbers'),
        (Foreign, 'TypeError'),
        (Wrong, 'its state_jacobian is not that of its derivative'),
        (OtherTransition, 'its class defines transition'),
        (Random, 'its formulas are not what it returns'),
    ],
)
def test_what_cannot_be_traced_stays_numpy_with_the_reason(kind, reason):
    model = kind()
    found = attempt(model)
    assert found.arithmetic == 'numpy'
    assert found.reason.startswith(reason)
    assert '\n' not in found.reason
    assert found.result is model


class Rubbing(Pendulum):
    """Dry friction, whose derivative changes within a fraction of a rad/s."""

    def derivative(self, x, u):
        friction = 0.18 * np.arctan(100.0 * x[..., 1]) + 0.05 * x[..., 1]
        pull = 0.1 * np.sin(x[..., 0])
        return np.stack((x[..., 1], (u[..., 0] - pull - friction) / 0.06), axis=-1)


class Reacting(Pendulum):
    """A rate that grows beyond all numbers far from where states are."""

    def derivative(self, x, u):
        rate = np.exp(0.5 * x[..., 0])
        return np.stack((x[..., 1] - rate, u[..., 0] - 0.1 * rate), axis=-1)


@C
@pytest.mark.parametrize('kind', [Rubbing, Reacting])
def test_what_is_steep_is_compiled(kind):
    """Differences and short steps, with which formulas are compared, are exact nowhere else."""
    model = kind()
    found = attempt(model)
    assert (found.arithmetic, found.reason) == ('C', '')
    x, u = points(model)
    assert_same(found.result.step(x, u, 0.01), model.step(x, u, 0.01))


@C
def test_landmarks_in_the_axes_of_a_body_in_space_are_compiled():
    space = believed('inertial').model.state
    sensor = Landmarks(
        space, measures=['x', 'y', 'z', 'rx', 'ry', 'rz'], reads=['range', 'bearing', 'elevation'],
        positions=[13.0, 1.0, 3.0, -4.0, 11.0, 1.0], noise=[0.05, 0.01, 0.01],
    )  # fmt: skip
    found = attempt(sensor, space)
    assert (found.arithmetic, found.reason) == ('C', '')
    for x in np.random.default_rng(2).normal(0.0, 1.0, (20, space.size)):
        assert_same(found.result.measure(x), sensor.measure(x))
        assert_same(found.result.jacobian(x), sensor.jacobian(x), 1e-6)


class OwnStep(Pendulum):
    def step(self, x, u, dt):
        return self.state.wrap(x + dt * self.derivative(x, u))


@C
def test_a_step_of_ones_own_is_compiled_as_it_is():
    model = OwnStep()
    found = attempt(model)
    assert found.arithmetic == 'C'
    x, u = np.array([0.4, -1.0]), np.array([2.0])
    for mine, theirs in zip(
        found.result.linearized_step(x, u, 0.1), model.linearized_step(x, u, 0.1)
    ):
        assert_same(mine, theirs, 1e-8)


def test_where_nothing_is_gained_the_object_is_the_same():
    linear = DiscreteLinearSystem([[1.0]], [[0.0]], [[1.0]], Space('x'), Space('u'))
    for model, reason in ((linear, ''), (believed('mass_spring_damper').model, '')):
        found = attempt(model)
        assert found.result is model
        assert (found.arithmetic, found.reason) == ('numpy', reason)


# --- functions of numpy -------------------------------------------------------------------------

FUNCTIONS = {
    'arithmetic': lambda x: x * 2.0 + 1.0 / (3.0 + x) - 0.5 * x**2 + 2.0**x - (-x),
    'a table': lambda x: np.interp(x, [-0.5, 0.1, 0.8], [2.0, -1.0, 3.0]),
    'modulo': lambda x: (5.0 * x) % 2.0 - np.mod(x, 0.7),
    'trigonometry': lambda x: np.sin(x) * np.cos(x) + np.tan(x) + np.arctan2(x, 1.0 + x * x),
    'inverse': lambda x: np.arcsin(0.3 * x) + np.arccos(0.3 * x) + np.arctan(x),
    'hyperbolic': lambda x: np.sinh(x) + np.cosh(x) * np.tanh(x) + np.arcsinh(x),
    'exponential': lambda x: np.exp(x) + np.log(3.0 + x) + np.expm1(x) + np.log1p(x * x),
    'roots': lambda x: np.sqrt(x * x + 1.0) + np.hypot(x, 2.0) + np.abs(x) + np.square(x),
    'choice': lambda x: (
        np.where(x > 0.1, x, -2.0 * x) + np.maximum(x, 0.2) + np.clip(x, -0.1, 0.3)
    ),
    'rounding': lambda x: np.floor(3.0 * x) + np.ceil(3.0 * x) + np.sign(x) + np.rint(7.3 * x),
    'sinc': lambda x: np.sinc(x),
    'degrees': lambda x: np.deg2rad(x) + np.rad2deg(x),
    'vectors': lambda x: np.concatenate((np.cross(x, [1.0, 2.0, 3.0]), [x @ x, np.sum(x * x)])),
    'norm': lambda x: x / np.sqrt(np.sum(x * x)),
    'linalg': lambda x: np.linalg.norm(x, axis=-1, keepdims=True) * x,
    'matrices': lambda x: np.array([[x[0], 0.0, 1.0], [x[1], x[2], 0.0]]) @ x,
    'einsum': lambda x: np.einsum('i,j->ij', x, x).ravel(),
    'zeros': lambda x: np.stack([np.zeros_like(x[..., 0]), x[..., 1]], axis=-1),
}


@pytest.mark.parametrize('name', FUNCTIONS)
def test_functions_of_numpy(name):
    from kalman_ros.compiled.tracing import trace

    function = FUNCTIONS[name]
    x = np.array([0.31, -0.42, 0.77])
    found = trace(function, (x,), (-x,), (np.array([0.9, 0.05, -0.6]),))
    slope = found.slope(0, x).function('f')
    values = np.array(slope()['o0'] if isinstance(slope(), dict) else slope())
    if name not in ('rounding', 'modulo', 'a table'):
        assert_same(values, np.asarray(exact_jacobian(function, x), float), 1e-10)
