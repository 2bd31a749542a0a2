# SPDX-License-Identifier: Apache-2.0
"""Systems of other libraries, complex numbers, and names with units in one string."""

import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

import kalman_ros as kr
from kalman_ros.arrays.foreign import read_system

A, B, C, D = [[0, 1], [-2, -0.5]], [[0], [1]], [[1, 0]], [[0]]
W = np.diag([0.1, 0.2])


def check(model, dt=None):
    assert np.array_equal(model.A if dt is None else model.F, A)
    assert np.array_equal(model.B if dt is None else model.G, B)
    assert dt is None or model.period == dt


def test_the_order_of_the_textbook():
    model = kr.continuous_model(A, B, W)
    check(model)
    np.testing.assert_array_equal(model.noise_density(np.zeros(2)), W)
    model = kr.discrete_model(A, B, W, period=0.1)
    np.testing.assert_allclose(model.next_jacobian(np.zeros(2), np.zeros(1))[1], B)
    np.testing.assert_array_equal(model.noise(np.zeros(2)), W)


@pytest.mark.parametrize('square', [np.eye(2), 1.0, [0, 1], [[0], [1]]])
def test_an_input_matrix_is_not_taken_as_noise(square):
    with pytest.raises(ValueError, match='^W: expected the noise, got nothing; continuous_model'):
        kr.continuous_model(A, square)
    with pytest.raises(ValueError, match='^Q: expected the noise, got nothing; discrete_model'):
        kr.discrete_model(A, square)


def test_systems_of_scipy():
    system = signal.lti(A, B, C, D)
    check(kr.continuous_model(system, W))
    check(kr.continuous_model(system, W=W))
    np.testing.assert_allclose(kr.lqr(system, 1, 1).gain, kr.lqr(A, B, 1, 1).gain)
    with pytest.raises(ValueError, match='^F: discrete_model got a system in continuous time'):
        kr.discrete_model(system, W)
    sampled = signal.dlti(A, B, C, D, dt=0.2)
    assert kr.discrete_model(sampled, W).period == 0.2
    assert kr.discrete_model(signal.dlti(A, B, C, D), W).period == 1.0
    with pytest.raises(ValueError, match='^A: continuous_model got a system in discrete time'):
        kr.continuous_model(sampled, W)
    with pytest.raises(ValueError, match='^period: expected that of the system, 0.2 s, got 0.1'):
        kr.discrete_model(sampled, W, period=0.1)
    with pytest.raises(ValueError, match='^F: expected a system in discrete time, got one in con'):
        kr.dlqr(system, 1, 1)


def test_names_of_a_system_are_kept():
    system = SimpleNamespace(
        A=A, B=B, C=C, D=D, dt=0, state_labels=['place', 'speed'], input_labels=['force']
    )
    for model in (
        kr.continuous_model(system, W),
        kr.make_scenario((system, W), (C, 1.0), rate=9).model,
    ):
        assert model.state.names == ('place', 'speed') and model.input.names == ('force',)
    assert kr.continuous_model(system, W, states='a b').state.names == ('a', 'b')
    assert 'K force' in str(kr.lqr(system, 1, 1))
    # those that python-control makes up are no names
    system.state_labels, system.input_labels = ['x[0]', 'x[1]'], ['u[0]']
    assert kr.continuous_model(system, W).state.names == ('x0', 'x1')
    for labels, names in (
        (['place', 'speed [m/s]'], ('place', 'speed_m_s')),
        (['place', 'x[1]'], ('place', 'x_1')),
        (['place', '2nd'], ('x0', 'x1')),
        (['a b', 'a-b'], ('x0', 'x1')),
        (['place', '-'], ('x0', 'x1')),
    ):
        system.state_labels = labels
        assert kr.continuous_model(system, W).state.names == names


@pytest.mark.parametrize(
    ('call', 'why'),
    [
        (lambda s: kr.simulate(s), r'make_scenario\(\(system, W\), sensors, rate='),
        (lambda s: kr.worst_case((s, W), {}), r'make_scenario\(\(system, W\), sensors'),
        (lambda s: kr.trim(s), 'a linear system rests at 0'),
        (lambda s: kr.linearize('cart_pole'), r"is kr\.load\('cart_pole'\)\.model"),
        (lambda s: kr.lqr(np.zeros((0, 0)), np.zeros((0, 1)), 1, 1), 'at least one state'),
        (lambda s: kr.linearize(kr.continuous_model(A, B, W), input=[0.0]), 'a state beside it'),
    ],
)
def test_what_takes_no_system_names_what_makes_one(call, why):
    with pytest.raises(ValueError, match=why):
        call(signal.lti(A, B, C, D))


def test_a_design_of_a_system_has_its_noise():
    small, large = (kr.design((signal.lti(A, B, C, D), s * W)).std for s in (0.01, 1.0))
    assert (small < large).all()


def test_a_point_of_two_arguments_is_that_of_a_pair():
    pole = kr.load('cart_pole').model
    x, u = [0.0, 0.0, 1.0, 0.0], [2.0]
    np.testing.assert_array_equal(kr.linearize(pole, x, u).A, kr.linearize(pole, (x, u)).A)


@pytest.mark.parametrize(
    ('name', 'here'),
    [('x', '.mean'), ('P', '.covariance'), ('llf', '.log_likelihood'), ('K', 'of a correction')],
)
def test_an_attribute_of_elsewhere_names_ours(name, here):
    walk = kr.continuous_model([[0.0]], W=[1.0])
    found = kr.filter(walk, ([1.0], 1.0), [0.0], [0.0], initial=(0, 1))
    with pytest.raises(AttributeError, match=f"^Estimates has no '{name}'; here it is {here}"):
        getattr(found, name)
    with pytest.raises(AttributeError) as error:
        found.nothing  # noqa: B018
    assert 'mean' in str(error.value) and 'other_names' not in str(error.value)


@pytest.mark.parametrize('name', ['gm', 'pm', 'wcg', 'wcp', 'sm', 'dm'])
def test_a_margin_of_elsewhere_names_ours(name):
    at = kr.margins(kr.lqr(A, B, 1, 1))
    with pytest.raises(AttributeError, match=f"has no '{name}'; here it is ") as error:
        getattr(at, name)
    path = str(error.value).rpartition(' here it is .')[2].partition(',')[0]
    found = at
    for part in path.split('.'):
        found = getattr(found, part)
    assert isinstance(found, float)


def test_systems_of_python_control():
    pytest.importorskip('control.statesp', reason='python-control is not installed')
    control = pytest.importorskip('control')
    check(kr.continuous_model(control.ss(A, B, C, D), W))
    assert kr.discrete_model(control.ss(A, B, C, D, 0.2), W).period == 0.2
    with pytest.raises(ValueError, match='^A: continuous_model got a system in discrete time'):
        kr.continuous_model(control.ss(A, B, C, D, 0.2), W)
    with pytest.raises(ValueError, match='^F: discrete_model got a system in continuous time'):
        kr.discrete_model(control.ss(A, B, C, D), W)
    static = control.nlsys(None, lambda t, x, u, p: u, inputs=1, outputs=1)
    for wrong in (static, control.frd([1, 2], [1, 2])):
        with pytest.raises(ValueError, match='^A: expected a linear system, got'):
            kr.continuous_model(wrong, W)
    for wrong, why in (
        (control.tf([[[1], [1]]], [[[1, 1], [1, 2]]]), 'it has 2 inputs and 1 outputs'),
        (control.tf([1, 2, 3], [1, 1]), 'Improper transfer function'),
        (control.tf([2], [1]), 'it has no pole'),
    ):
        with pytest.raises(ValueError, match='^A: expected a system with st.*' + why):
            kr.lqr(wrong, 1, 1)


def systems():
    """Return 1 / (s^2 + s / 2 + 2) in every form, with the same poles."""
    found = [signal.lti(A, B, C, D), signal.lti([1], [1, 0.5, 2])]
    found.append(found[1].to_zpk())
    try:
        import control
    except ImportError:
        return found
    return [*found, control.ss(A, B, C, D), control.tf([1], [1, 0.5, 2])]


@pytest.mark.slow
@pytest.mark.parametrize('system', systems(), ids=lambda system: type(system).__name__)
def test_a_system_is_a_system_everywhere(system):
    """Its states may be others, but what goes from inputs to outputs is the same."""
    poles = np.sort_complex(np.roots([1, 0.5, 2]))
    gain = kr.place(system, [-3, -4])
    np.testing.assert_allclose(sorted(gain.poles.real), [-4, -3])
    np.testing.assert_allclose(np.linalg.eigvals(kr.continuous_model(system, 0.1).A).sum(), -0.5)
    F, *_ = kr.discretize(system, 0.1)
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(F)), np.exp(poles * 0.1))
    # the noise acts where the input does: the error of the output depends on no coordinates
    C_of = read_system('A', system).C
    found, wanted = kr.lqe(system, 1, 0.1), kr.lqe(A, B, C, 1, 0.1)
    np.testing.assert_allclose(C_of @ found.P @ C_of.T, np.atleast_2d(wanted.P[0, 0]))
    assert kr.margins(system).delay.value == pytest.approx(kr.margins(A, B, C).delay.value)
    feedback = kr.lqr(system, 1, 1)
    at = kr.margins(system, feedback.gain)
    assert at.lag.value == pytest.approx(kr.margins(feedback).lag.value)
    wanted = kr.loop_shaping(A, B, C).least
    assert kr.loop_shaping(system).least == pytest.approx(wanted, rel=1e-6)
    report = kr.design(system).report
    assert [mode.pole for mode in report.modes] == pytest.approx([poles[1]])


def test_a_system_with_its_noise_is_a_model():
    times, readings = np.arange(50) * 0.1, np.sin(np.arange(50) * 0.1)
    model, sensor = kr.continuous_model(A, B, W), (C, 0.1)
    pair = (signal.lti(A, B, C, D), W)
    wanted = kr.filter(model, sensor, times, readings, initial=([0, 0], 1))
    found = kr.filter(pair, sensor, times, readings, initial=([0, 0], 1))
    np.testing.assert_array_equal(found.mean, wanted.mean)
    belief = kr.KalmanFilter(pair).predict(([0, 0], 1), dt=0.3)
    np.testing.assert_array_equal(
        belief.covariance, kr.KalmanFilter(model).predict(([0, 0], 1), dt=0.3).covariance
    )
    assert kr.make_scenario(pair, sensor, rate=10).model.A.tolist() == A
    with pytest.raises(ValueError, match=r'^model: expected a pair \(system, W\), with the noise'):
        kr.filter(pair[0], sensor, times, readings, initial=([0, 0], 1))
    sampled = (signal.dlti(A, B, C, D, dt=0.1), W)
    assert kr.KalmanFilter(sampled).model.period == 0.1


def test_a_design_of_a_system_alone():
    """It is that of a loop with noise and costs of 1."""
    report = kr.design(signal.lti(A, B, C, D)).report
    scenario = kr.make_scenario(
        kr.continuous_model(A, B, np.array(B) @ np.transpose(B)), (C, 1.0), rate=20 * np.sqrt(2)
    )
    wanted = kr.design(scenario).report
    np.testing.assert_allclose(report.regulator.feedback.gain, wanted.regulator.feedback.gain)
    np.testing.assert_allclose(report.estimator.gains['y'], wanted.estimator.gains['y'])
    with pytest.raises(ValueError, match='^scenario: expected readings of the state alone'):
        kr.design(signal.lti(A, B, C, [[1]]))
    with pytest.raises(ValueError, match='^model: the theory of a loop needs one in continuous'):
        kr.design(signal.dlti(A, B, C, D, dt=0.1))


@pytest.mark.parametrize('wrong', [kr.Model, kr.continuous_model(0, W=1)])
def test_what_is_no_function_of_the_state_is_refused(wrong):
    with pytest.raises(ValueError, match='^A: expected a'):
        kr.continuous_model(wrong, 1.0)


def test_a_function_and_a_system_have_no_input_matrix():
    for whole in (lambda x: -x, SimpleNamespace(A=A, B=B)):
        with pytest.raises(ValueError, match='^B: expected none beside a'):
            kr.continuous_model(whole, B, W)
    with pytest.raises(ValueError, match='^B: expected none beside a whole system'):
        kr.lqr(SimpleNamespace(A=A, B=B), B, W, 1, [0, 0])


@pytest.mark.slow
def test_python_control_is_not_imported():
    code = (
        'import sys, kalman_ros as kr; from scipy import signal\n'
        'kr.continuous_model(signal.lti([[0]], [[1]], [[1]], [[0]]), 1)\n'
        'print("control" in sys.modules)'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, timeout=60)
    assert done.stdout.strip() == 'False', done.stderr


@pytest.mark.parametrize(
    'names', ['x [m] v [m/s]', ['x [m]', 'v [m/s]'], 'x  [m]  v  [m/s]', ('x [m]', 'v [m/s]')]
)
def test_names_with_units_in_one_string(names):
    model = kr.continuous_model(A, B, W, states=names)
    assert (model.state.names, model.state.units) == (('x', 'v'), ('m', 'm/s'))
    model = kr.continuous_model(lambda x: [x[1], -x[0]], 0.1, states=names)
    assert model.state.units == ('m', 'm/s')


def test_names_with_an_index_have_no_unit():
    state = kr.continuous_model(A, B, W, states='x[0] x[1] [m s]').state
    assert (state.names, state.units) == (('x[0]', 'x[1]'), ('', 'm s'))


MODEL, FREE, SENSOR = kr.continuous_model(A, B, W), kr.continuous_model(A, W=W), kr.sensor(C, 1)
T, Y, PRIOR = np.arange(3.0), np.ones(3), ([0, 0], 1)
ESTIMATES = kr.filter(FREE, SENSOR, T, Y, initial=PRIOR)


def filtered(model=FREE, times=T, readings=Y, initial=PRIOR, **others):
    return kr.filter(model, SENSOR, times, readings, initial=initial, **others)


def array(value):
    return np.asarray(value) + 0j


COMPLEX = [
    ('A', lambda: kr.lqr(array(A), B, 1, 1)),
    ('B', lambda: kr.lqr(A, array(B), 1, 1)),
    ('Q', lambda: kr.lqr(A, B, array(W), 1)),
    ('R', lambda: kr.lqr(A, B, W, np.complex128(1))),
    ('N', lambda: kr.lqr(A, B, 1, 1, array(B))),
    ('dt', lambda: kr.lqr(A, B, 1, 1, dt=np.complex128(1))),
    ('A', lambda: kr.dlqr(array(A), B, 1, 1)),
    ('B', lambda: kr.dlqr(A, array(B), 1, 1)),
    ('A', lambda: kr.lqe(array(A), C, 1, 1)),
    ('G', lambda: kr.lqe(A, array(B), C, 1, 1)),
    ('C', lambda: kr.lqe(A, array(C), 1, 1)),
    ('W', lambda: kr.lqe(A, C, array(W), 1)),
    ('V', lambda: kr.lqe(A, C, W, np.array([[1j]]))),
    ('N', lambda: kr.lqe(A, B, C, 1, 1, np.array([[0j]]))),
    ('C', lambda: kr.dlqe(A, array(C), 1, 1)),
    ('A', lambda: kr.place(array(A), B, [-1, -2])),
    ('B', lambda: kr.place(A, array(B), [-1, -2])),
    ('A', lambda: kr.margins(array(A), B, C)),
    ('C', lambda: kr.margins(A, B, array(C))),
    ('D', lambda: kr.margins(A, B, C, array(D))),
    ('A', lambda: kr.discretize(array(A), B, 0.1)),
    ('B', lambda: kr.discretize(A, array(B), 0.1)),
    ('dt', lambda: kr.discretize(A, B, np.complex128(0.1))),
    ('W', lambda: kr.discretize(A, B, 0.1, array(W))),
    ('A', lambda: kr.continuous_model(array(A), B, W)),
    ('B', lambda: kr.continuous_model(A, array(B), W)),
    ('W', lambda: kr.continuous_model(A, B, array(W))),
    ('A', lambda: kr.continuous_model(lambda x: array(x), W)),
    ('max_step', lambda: kr.continuous_model(lambda x: x, W, max_step=np.complex128(1))),
    ('F', lambda: kr.discrete_model(array(A), B, W)),
    ('G', lambda: kr.discrete_model(A, array(B), W)),
    ('Q', lambda: kr.discrete_model(A, B, array(W))),
    ('period', lambda: kr.discrete_model(A, B, W, period=np.complex128(1))),
    ('H', lambda: kr.sensor(array(C), 1)),
    ('R', lambda: kr.sensor(C, np.array([[1j]]))),
    ('times', lambda: filtered(times=array(T))),
    ('readings', lambda: filtered(readings=array(Y))),
    ('inputs', lambda: filtered(MODEL, inputs=array(Y))),
    ('input_times', lambda: filtered(MODEL, inputs=Y, input_times=array(T))),
    ('initial mean', lambda: filtered(initial=(array([0, 0]), 1))),
    ('initial covariance', lambda: filtered(initial=([0, 0], array(W)))),
    ('mean', lambda: kr.Gaussian(array([0, 0]), W)),
    ('covariance', lambda: kr.Gaussian([0, 0], array(W))),
    ('truth', lambda: kr.consistency(ESTIMATES, array(ESTIMATES.mean))),
    ('initial_state', lambda: kr.make_scenario(
        MODEL, SENSOR, rate=10, initial_state=array([0, 0]))),
    ('Q', lambda: kr.make_scenario(MODEL, SENSOR, rate=10, Q=array(W))),
    ('gain', lambda: kr.simulate('cart_pole', seconds=0.1, gain=np.ones((1, 4)) + 0j)),
    ('input_limit', lambda: kr.simulate('cart_pole', seconds=0.1, input_limit=array([1]))),
    ('reference', lambda: kr.simulate('cart_pole', seconds=0.1, reference=array([0, 0, 0, 0]))),
    ('gain', lambda: kr.monte_carlo('cart_pole', runs=2, seconds=0.1, gain=np.ones((1, 4)) + 0j)),
    ('readings', lambda: kr.tune(
        lambda r=1.0: (FREE, (C, [[r]])), T, array(Y), initial=PRIOR)),
]  # fmt: skip


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(('name', 'call'), COMPLEX)
def test_complex_numbers_are_refused_by_name(name, call):
    with pytest.raises(ValueError, match=f'^{name}\\b.*expected real numbers, got complex ones'):
        call()


def test_poles_may_be_complex():
    assert kr.place(A, B, [-1 + 1j, -1 - 1j]).gain.dtype == float


STEP = signal.dlti([[1, 0.1], [-0.2, 0.95]], B, C, D, dt=0.1)


@pytest.mark.parametrize(
    ('call', 'reason'),
    [
        (lambda: kr.discretize(STEP, 0.1), 'A: expected a system in continuous time, got one'),
        (lambda: kr.lqr(STEP, 1, 1, dt=0.5), 'dt: the system has samples of 0.1 s, got 0.5'),
        (lambda: kr.dlqr(STEP, 1, 1, dt=0.7), 'dt: the system has samples of 0.1 s, got 0.7'),
        (lambda: kr.place(STEP, [-1, -2], dt=0.5), 'dt: the system has samples of 0.1 s, got'),
        (lambda: kr.margins(STEP, dt=0.5), 'dt: the system has samples of 0.1 s, got 0.5'),
        (lambda: kr.margins(STEP, [1, 1], [1, 1], [0]), 'B: expected none'),
        (lambda: kr.margins(kr.lqr(A, B, 1, 1), [1, 2]), 'B: expected nothing beside a gain'),
        (
            lambda: kr.margins(kr.continuous_model(A, B, W), [1, 1], [1, 1], [0]),
            'B: expected none',
        ),
        *(
            (lambda dt=dt: kr.margins(A, B, [1, 1], dt=dt), 'dt: expected ')
            for dt in ('x', '1', [1], {}, 1j, b'1', np.inf, np.nan, 0.0, -1.0)
        ),
    ],
)
def test_nothing_given_is_ignored(call, reason):
    with pytest.raises(ValueError, match=f'^{reason}'):
        call()


def test_the_sample_time_of_a_system_may_be_repeated():
    np.testing.assert_array_equal(kr.lqr(STEP, 1, 1, dt=0.1).gain, kr.lqr(STEP, 1, 1).gain)
    gain = kr.lqr(A, B, 1, 1)
    assert kr.margins(kr.continuous_model(A, B, W), gain) == kr.margins(gain)


@pytest.mark.parametrize('dt', [None, 0.1])
def test_an_observer_of_a_system_has_noise_where_its_input_acts(dt):
    A, B, C = [[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], [[1.0, 0.0]]
    system = signal.StateSpace(A, B, C, [[0.0]])
    if dt is None:
        found, expected = kr.lqe(system, 2.0, 0.5), kr.lqe(A, B, C, 2.0, 0.5)
        with pytest.raises(ValueError, match='F: expected a system in discrete time'):
            kr.dlqe(system, 2.0, 0.5)
    else:
        system = system.to_discrete(dt)
        found = kr.dlqe(system, 2.0, 0.5)
        expected = kr.dlqe(system.A, system.B, system.C, 2.0, 0.5, dt=dt)
        np.testing.assert_array_equal(kr.lqe(system, 2.0, 0.5).L, found.L)
    np.testing.assert_array_equal(found.L, expected.L)
    np.testing.assert_array_equal(found.poles, expected.poles)


def test_fit_is_tune_and_a_scenario_prints_in_five_lines():
    assert kr.fit is kr.tune
    shown = repr(kr.load('robot_2d')).splitlines()
    assert len(shown) == 5
    assert shown[0] == 'Robot2D at 100 Hz, filter ekf'
    assert shown[3].startswith('sensors: position: x [m], y [m] at 5 Hz; odometry: ')
