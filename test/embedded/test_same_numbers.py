# SPDX-License-Identifier: Apache-2.0
"""C computes what Python does, call by call, outcome by outcome."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thorough import mostly_thorough, thorough

import kalman_ros as kr
from kalman_ros.control.limiter import limits_of
from kalman_ros.core import Sensor, Space
from kalman_ros.embedded.loop import loop
from kalman_ros.embedded.vectors import OUTCOMES, Calls, recorded
from kalman_ros.estimators.policy import Policy
from kalman_ros.scenario import shipped

pytest.importorskip('casadi')
from exported import Exported, differences, needs_a_compiler, of_scenario

pytestmark = [pytest.mark.slow, needs_a_compiler]
#: Relative; the difference of two ways of summing.
CLOSE = 1e-12
#: Where for a while little is known, rounding grows as errors do: a heading while a target stands,
#: a place that no reading tells. Seen were 1.0e-12, 2.8e-12, 2.2e-11 and 1.9e-11.
LESS = {'constant_velocity': 1e-11, 'lidar_radar': 1e-11, 'robot_3d': 1e-10, 'turn_rate': 1e-10}
#: Mixtures of Gaussians.
REFUSED = ('bearing_tracker', 'sound_tracker', 'two_bearings')
SHIPPED = [name for name in shipped.names() if name not in REFUSED]
FILTERS = ('kf', 'ekf', 'ukf', 'steady_state', 'luenberger')
GATED = {'position.gate': 0.99, 'velocity.gate': 0.99}


@pytest.fixture(autouse=True)
def _exact_derivatives(monkeypatch):
    """Let Python compute with the formulas that C is made of, not with differences."""
    monkeypatch.setenv('KALMAN_ROS_ARITHMETIC', 'compiled')


@pytest.mark.parametrize('name', mostly_thorough(SHIPPED, 'cart_pole', 'lidar_radar', 'nile'))
def test_a_shipped_scenario_has_the_same_numbers(name, tmp_path):
    loop = of_scenario(name)
    assert differences(Exported(loop, tmp_path), recorded(loop, 300)).max() < CLOSE


@pytest.mark.thorough
@pytest.mark.parametrize('name', SHIPPED)
def test_a_hundred_thousand_steps_have_the_same_numbers(name, tmp_path):
    loop = of_scenario(name)
    steps = recorded(loop, 100_000, hostile=False)
    assert differences(Exported(loop, tmp_path), steps).max() < LESS.get(name, CLOSE)


@pytest.mark.parametrize('filter', mostly_thorough([*FILTERS], 'ukf'))
def test_a_filter_has_the_same_numbers_and_outcomes(filter, tmp_path):
    loop = of_scenario('mass_spring_damper', changes={'filter': filter, **GATED})
    calls = [*recorded(loop, 600)]
    assert differences(Exported(loop, tmp_path), calls).max() < CLOSE
    assert {*OUTCOMES.values()} - {each.outcome for each in calls} <= {1, 3, 4}


def test_it_recovers_and_outvotes_as_python_does(tmp_path):
    gates = {f'{name}.gate': 0.99 for name in ('position', 'odometry', 'imu')}
    loop = of_scenario('robot_2d', changes=gates, policy=Policy(recover_after=5))
    python, random = Calls(loop), np.random.default_rng(3)
    sensors, truth = [*loop.sensors.values()], loop.estimation.initial.mean.copy()
    calls = []
    for step in range(300):
        if step == 150:
            truth[:2] += 50.0  # somebody carries it away
        calls.append(python.predict(0.02))
        for index, sensor in enumerate(sensors):
            noise = np.sqrt(sensor.covariance.diagonal()) * random.standard_normal(
                sensor.output.size
            )
            y = sensor.measure(truth) + noise
            if index == 1 and 60 <= step < 90:
                y += 1.0  # wheels that slip, which the gyroscope contradicts in part
            calls.append(python.correct(index, y))
    # P is up to 1e8 times as large after a recovery as before, and so is what rounding does
    assert differences(Exported(loop, tmp_path), calls).max() < 1e-6
    counts = Counter(each.outcome for each in calls if each.kind == 'C')
    assert min(counts[0], counts[1], counts[2], counts[3]) > 0, counts


def test_integral_action_and_limits_are_the_same(tmp_path):
    changes = {'law': 'lqi', 'integral_cost': [50.0]}
    limits = limits_of(1, {'input_limit': 5.0, 'input_lower_limit': -0.8, 'input_rate_limit': 4.0})
    loop = of_scenario('dc_motor', changes=changes, limits=limits)
    calls = [*recorded(loop, 500)]
    assert differences(Exported(loop, tmp_path), calls).max() < CLOSE
    inputs = np.array([each.input for each in calls])
    assert inputs.min() == -0.8  # the limit acts


def test_a_set_point_that_takes_more_than_the_limits_is_refused(tmp_path):
    limits = limits_of(1, {'input_limit': 2.0, 'input_lower_limit': -1.0})
    loop = of_scenario('mass_spring_damper', limits=limits)
    at_limits = loop.law.equilibria.equilibrium(np.array([1.0, 0.0]), np.zeros(2)).input[0]
    python, calls = Calls(loop), []
    for force in (1.99, 2.01, -0.99, -1.01):
        calls += [python.hold(np.array([force / at_limits, 0.0])), python.control(0.01)]
    assert [each.outcome for each in calls[::2]] == [0, 10, 0, 10]
    assert differences(Exported(loop, tmp_path), calls).max() < CLOSE


def test_an_integral_does_not_grow_where_a_limit_acts(tmp_path):
    changes = {'law': 'lqi', 'integral_cost': [50.0]}
    loop = of_scenario('dc_motor', changes, limits=limits_of(1, {'input_limit': 0.05}))
    assert loop.law.feedback.tracked
    python = Calls(loop)
    far = np.ones(loop.law.space.size)
    calls = [python.hold(loop.law.rest.state + loop.law.equilibria.nearest(far).state)]
    assert calls[0].outcome == 0
    for _ in range(200):
        calls += [python.predict(0.01), python.control(0.01)]
    calls.append(python.hold(loop.law.rest.state))
    for _ in range(200):
        calls += [python.predict(0.01), python.control(0.01)]
    inputs = np.array([each.input[0] for each in calls])
    assert np.count_nonzero(np.abs(inputs) == 0.05) > 100
    assert np.abs(inputs[-100:]).min() < 0.05
    assert differences(Exported(loop, tmp_path), calls).max() < CLOSE


def test_what_is_known_exactly_needs_no_repair(tmp_path):
    loop = of_scenario('cart_pole', {'initial_std': [0.1, 0.0, 0.3, 0.0]})
    python, c = Calls(loop), Exported(loop, tmp_path)
    calls = [python.correct(0, np.array([0.05, 0.1]))]
    assert differences(c, calls).max() < CLOSE
    assert c.repairs == 0
    assert np.array_equal(c.covariance[1], np.zeros(4))


def test_a_long_silence_restarts(tmp_path):
    loop = of_scenario('cart_pole', policy=Policy(max_gap=2.0))
    python, c = Calls(loop), Exported(loop, tmp_path)
    y = [0.1, 0.02]
    calls = [python.predict(0.1), python.correct(0, np.array(y)), python.predict(2.5)]
    assert differences(c, calls).max() < CLOSE
    assert (calls[-1].outcome, c.restarts) == (8, 1)
    assert np.array_equal(c.mean, loop.estimation.initial.mean)


def test_biases_of_sensors_are_states(tmp_path):
    loop = of_scenario('gnss_imu', changes={'imu.bias_std': [0.1], 'imu.bias_noise': [1e-4]})
    assert loop.scenario.believed.model.state.size > loop.scenario.model.state.size
    assert differences(Exported(loop, tmp_path), recorded(loop, 200)).max() < CLOSE


def test_single_precision_is_near(tmp_path):
    loop = of_scenario('cart_pole')
    steps = recorded(loop, 300, hostile=False)
    assert 1e-9 < differences(Exported(loop, tmp_path, 'float32'), steps).max() < 1e-4


@pytest.mark.parametrize(
    'name', mostly_thorough(['cart_pole', 'inertial', 'lidar_radar'], 'lidar_radar')
)
def test_no_reading_makes_it_lose_its_mind(name, tmp_path):
    loop = of_scenario(name, changes=None)
    loop = replace(
        loop,
        estimation=replace(
            loop.estimation,
            policy=replace(loop.estimation.policy, gates=dict.fromkeys(loop.sensors, 9.0)),
        ),
    )
    python, c = Calls(loop), Exported(loop, tmp_path)
    random = np.random.default_rng(0)
    values = [np.nan, np.inf, -np.inf, 1e308, -1e308, 1e154, 5e-324, -0.0, 1e-300, 0.0, 0.1]
    sizes = [each.output.size for each in loop.sensors.values()]
    calls = []
    for _ in range(400):
        index = int(random.integers(len(sizes)))
        y = random.choice(values, sizes[index])
        with np.errstate(all='ignore'):
            calls += [python.predict(random.choice([1e-9, 0.0, -1.0, np.nan, np.inf, 1e9]))]
            calls += [python.predict(0.01)]  # Python sorts readings of one time
            calls += [python.correct(index, y)]
    for each in calls:
        assert c.call(each.kind, each.sensor, each.given) == each.outcome
        assert np.isfinite(c.mean).all() and np.isfinite(c.covariance).all()
        np.linalg.cholesky(c.covariance)


@pytest.mark.thorough
def test_absurd_times_break_nothing(tmp_path):
    changes = {'law': 'lqi', 'integral_cost': [50.0], 'encoder.gate': 0.99}
    loop = of_scenario('dc_motor', changes)
    c = Exported(
        loop, tmp_path, flags=('-O1', '-fsanitize=undefined', '-fno-sanitize-recover=all')
    )
    for _ in range(30):
        assert c.call('P', 0, [999999999.0]) == 8
        c.call('C', 0, [np.float64(7.0)])
    for dt in (1e200, 60.0, -1.0, np.nan, np.inf):
        assert c.call('U', 0, [dt]) == 9
        assert np.isfinite(c.input).all()
    for _ in range(100):
        assert c.call('P', 0, [0.01]) == 0
        assert c.call('U', 0, [0.01]) == 0


ROBOT = Path(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
CORNER = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]


@pytest.mark.parametrize(
    ('name', 'changes', 'wanted', 'varying'),
    [
        ('cart_pole', {}, {'start': {'x': 0.0}, 'end': {'x': 0.5}, 'seconds': 2.0}, True),
        thorough(ROBOT, {}, {'path': CORNER, 'speed': 1.0}, True),
        thorough(
            'dc_motor',
            {'law': 'lqi', 'tracked': ['theta']},
            {'values': {'theta': [0.0, 1.0]}, 'times': [0.0, 1.0]},
            False,
        ),
    ],
)
def test_a_motion_is_followed_as_python_does(name, changes, wanted, varying, tmp_path):
    motion = kr.motion(name, changes, **wanted)
    assert (motion.gains is not None) == varying
    loop = of_scenario(name, changes, motion=motion)
    calls = [*recorded(loop, 2 * len(motion.states) + 300)]
    assert sum(call.kind == 'M' for call in calls) == 2
    assert differences(Exported(loop, tmp_path), calls).max() < CLOSE


@pytest.mark.thorough
def test_a_motion_in_uneven_steps_that_is_interrupted(tmp_path):
    motion = kr.motion('cart_pole', start={'x': 0.0}, end={'x': 0.5}, seconds=2.0)
    loop = of_scenario('cart_pole', motion=motion)
    python, random, calls = Calls(loop), np.random.default_rng(2), []
    for step in range(500):
        dt = float(random.choice([0.0, 0.003, 0.01, 0.013, 0.02]))
        calls += [python.predict(dt)]
        if step in (10, 60):
            calls.append(python.follow())
        if step in (5, 200):
            calls.append(python.hold(loop.law.rest.state))
        if step in (30, 31):
            calls.append(python.idle(dt))  # the motion waits
        else:
            calls.append(python.control(dt))
    found = differences(Exported(loop, tmp_path), calls)
    assert found.max() < 1e-10
    assert np.ptp([call.input for call in calls[400:]]) > 0.1


@pytest.mark.thorough
def test_a_motion_in_single_precision(tmp_path):
    motion = kr.motion('cart_pole', start={'x': 0.0}, end={'x': 0.5}, seconds=2.0)
    loop = of_scenario('cart_pole', motion=motion)
    exported = Exported(loop, tmp_path, 'float32')
    assert differences(exported, recorded(loop, 500)).max() < 1e-4


@pytest.mark.parametrize(
    ('name', 'changes'),
    [
        ('cart_pole', {'law': 'lqi', 'tracked': ['x']}),
        thorough('cart_pole', {}),
        thorough('dc_motor', {}),
    ],
)
def test_the_input_goes_on_from_the_idle_one(name, changes, tmp_path):
    """As that of the node: what was integrated is gone, and the jump decays in half a second."""
    first = []
    for blend in (0.5, 0.0):
        loop = of_scenario(name, changes, blend=blend)
        python, size = Calls(loop), next(iter(loop.sensors.values())).output.size
        calls = [python.correct(0, np.full(size, 0.1))]
        for step in range(250):
            idle = 100 <= step < 150
            calls += [python.predict(0.01), python.idle(0.01) if idle else python.control(0.01)]
        calls += [python.predict(0.01), python.control(5.0)]  # of which half a second counts
        calls += [python.predict(0.01), python.control(0.01)]
        folder = tmp_path / str(blend)
        folder.mkdir()
        assert differences(Exported(loop, folder), calls).max() < CLOSE
        first.append(np.abs(calls[302].input).max())
    assert calls[300].kind == 'O' and calls[302].kind == 'U'
    assert 0.0 < first[0] < 0.1 * first[1]


def test_a_motion_begins_and_ends_without_a_jump(tmp_path):
    motion = kr.motion('cart_pole', start={'x': 0.0}, end={'x': 0.5}, seconds=2.0)
    loop = of_scenario('cart_pole', motion=motion, blend=0.3)
    python, calls = Calls(loop), []
    for step in range(400):
        calls += [python.predict(0.01)]
        if step in (30, 200):
            calls.append(python.follow())
        if step == 120:
            calls.append(python.hold(loop.law.rest.state))
        calls.append(python.idle(0.01) if 250 <= step < 260 else python.control(0.01))
    assert differences(Exported(loop, tmp_path), calls).max() < 1e-10
    assert sum(call.kind == 'M' for call in calls) == 2


class Elbow(Sensor):
    """The angle of a cosine that is limited, and a bearing: derivatives that are not finite."""

    state = Space('x y', 'm m')
    output = Space('angle bearing', 'rad rad', angles='bearing')
    covariance = np.diag([0.01, 0.02])

    def measure(self, x):
        a, b = x[..., 0], x[..., 1]
        return np.stack([np.arccos(np.clip(a, -1.0, 1.0)), np.arctan2(b, a)], axis=-1)


@pytest.mark.parametrize(
    'at',
    mostly_thorough([(2.0, 0.5), (-3.0, 1.0), (0.0, 0.0), (1.0, 0.0), (0.3, -0.2)], (0.0, 0.0)),
)
def test_where_a_formula_has_no_derivative_differences_are_those_of_python(at, tmp_path):
    model = kr.continuous_model(np.zeros((2, 2)), W=[0.01, 0.01], states='x y')
    made = kr.make_scenario(
        model, {'elbow': Elbow()}, rate=100.0, initial=(np.array(at), 0.04), filter='ekf'
    )
    loop_ = loop(made)
    python = Calls(loop_)
    calls = [python.correct(0, np.array([1.0, 0.3]))]
    for _ in range(20):
        calls += [python.predict(0.01), python.correct(0, np.array([1.0, 0.3]))]
    assert {call.outcome for call in calls} == {0}
    assert differences(Exported(loop_, tmp_path), calls).max() < 1e-9


@pytest.mark.parametrize('rate', [60.0, 7.0])
def test_a_period_that_is_no_whole_number_of_nanoseconds(rate, tmp_path):
    rates = {'rate': rate, 'position.rate': rate, 'velocity.rate': rate}
    loop = of_scenario('mass_spring_damper', rates)
    assert differences(Exported(loop, tmp_path), recorded(loop, 300)).max() < CLOSE


@pytest.mark.parametrize('dt', [0.04, 0.06, 0.1, 0.25])
def test_steps_of_a_model_in_discrete_time_are_counted_from_the_beginning(dt, tmp_path):
    """Calls more often than each half a period do not stop it."""
    model = kr.discrete_model([[1, 0.1], [-0.05, 0.98]], [[0.005], [0.1]], [0.0, 1e-3], period=0.1)
    built = kr.make_scenario(
        model, kr.sensor([[1.0, 0.0]], 0.01), rate=10.0, initial=([0.0, 0.0], np.eye(2))
    )
    exported = loop(built, control=False)
    calls, rng = Calls(exported), np.random.default_rng(3)
    made = [calls.input(np.array([1.0]))]
    for step in range(100):
        made.append(calls.predict(dt))
        if step % 5 == 0:
            made.append(calls.correct(0, rng.normal(size=1)))
    assert differences(Exported(exported, tmp_path), made).max() < CLOSE
    assert abs(made[-1].mean[0]) > 0.1


def sampled_swing(filter):
    """Return a scenario of a plain function in discrete time, which decides by the state."""

    def swing(x, u):
        drag = 0.1 * x[1] * abs(x[1]) if x[1] > 0.2 else 0.02 * x[1]
        rate = x[1] + 0.05 * (u[0] - 9.81 * math.sin(x[0]) - drag)
        return [x[0] + 0.05 * rate, rate]

    model = kr.discrete_model(swing, Q=[1e-6, 1e-2], states='a w', inputs='u', period=0.05)
    sensor = kr.sensor(lambda x: [math.sin(x[0]), math.cos(x[0])], [0.01, 0.01], outputs=2)
    return kr.make_scenario(
        model, sensor, rate=20.0, initial=([0.1, 0.0], [0.1, 0.1]), filter=filter
    )


@pytest.mark.parametrize('filter', ['ekf', 'ukf'])
@pytest.mark.parametrize('dt', [0.02, 0.05, 0.16])
def test_a_function_in_discrete_time(filter, dt, tmp_path):
    exported = loop(sampled_swing(filter), control=False)
    calls, rng = Calls(exported), np.random.default_rng(3)
    made = [calls.input(np.array([1.0]))]
    for _ in range(100):
        y = np.array([0.1, 1.0]) + rng.normal(0.0, 0.1, 2)
        made += [calls.predict(dt), calls.correct(0, y)]
    assert {call.outcome for call in made} == {0}
    assert differences(Exported(exported, tmp_path), made).max() < CLOSE
    assert abs(made[-1].mean[0]) > 0.01


@pytest.mark.parametrize(
    'model',
    [
        lambda: sampled_swing('ekf'),
        lambda: kr.make_scenario(
            kr.discrete_model([[1, 0.1], [0, 1]], [[0.005], [0.1]], [0.0, 1e-3], period=0.1),
            kr.sensor([[1.0, 0.0]], 0.01), rate=10.0, initial=([0.0, 0.0], np.eye(2)),
        ),
    ],
)  # fmt: skip
def test_models_in_discrete_time_in_single_precision(model, tmp_path):
    built = kr.export(model(), tmp_path / 'c', precision='float32').built
    assert 0.0 < built.difference < 1e-4


def test_the_law_goes_on_from_an_input_that_comes_from_elsewhere(tmp_path):
    """Within the limit of the rate, and within the limits if that input is beyond them."""
    limits = limits_of(1, {'input_limit': [4.0], 'input_rate_limit': [20.0]})
    loop = of_scenario('mass_spring_damper', limits=limits)
    c = Exported(loop, tmp_path)
    for given, least, most in ((4.0, 3.8, 4.0), (-1e6, -4.0, -3.8), (0.5, 0.3, 0.7)):
        c.call('P', 0, [0.01])
        assert c.call('I', 0, [given]) == 0
        assert c.input[0] == given
        c.call('P', 0, [0.01])
        assert c.call('U', 0, [0.01]) == 0
        assert least - 1e-12 <= c.input[0] <= most + 1e-12
