# SPDX-License-Identifier: Apache-2.0
"""`kr.tune`: published estimates, identified systems, intervals, and what is not determined."""

import csv
import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from recorded import data
from simulated_recordings import readings, square_wave
from tuned_cases import COVERED, likelihood, recorded

import kalman_ros as kr
from kalman_ros.analysis.tuning import ascent
from kalman_ros.analysis.tuning.likelihood import Likelihood
from kalman_ros.compiled.parts import VARIABLE

NILE = {'model_parameters.noise_density': 100.0, 'reading.noise': [10.0]}
#: Readings a second, and seconds.
RATE, DURATION = 50.0, 60.0


def nile():
    with data('nile.csv').open() as file:
        return np.array([float(row['flow']) for row in csv.DictReader(file)])


@pytest.mark.slow
def test_the_nile_has_the_noise_of_durbin_and_koopman():
    flow = nile()
    # a first belief that says nothing, as theirs
    found = kr.tune(
        {'model': 'level', 'initial_std': [1e6], 'initial_estimate': [0.0], **NILE},
        np.arange(len(flow)), flow,
    )  # fmt: skip
    fitted = found.values
    assert fitted['model_parameters.noise_density'] == pytest.approx(1469.1, rel=1e-4)
    assert fitted['reading.noise'] ** 2 == pytest.approx(15099, rel=1e-4)
    assert found.converged


def gaps(flow):
    """Return the flow without the years 21 to 40 and 61 to 80, as in Durbin and Koopman, 2.7."""
    missing = flow.copy()
    missing[20:40] = missing[60:80] = np.nan
    return missing


@pytest.mark.slow
def test_the_nile_from_a_diffuse_start_has_the_published_likelihood():
    """That of R's KFAS (J. Helske, J. Statistical Software 78(10), 2017) and of statsmodels."""
    flow = nile()
    found = kr.tune(level, np.arange(len(flow)), flow, initial='diffuse', fit={'q': 1e3, 'r': 1e4})
    assert found.log_likelihood[1] == pytest.approx(-632.54563, abs=1e-5)
    assert found.values['r'] == pytest.approx(15098.5, rel=1e-4)
    assert found.values['q'] == pytest.approx(1469.18, rel=1e-4)
    assert found.changes == found.values  # arguments of the function
    by_scenario = kr.tune(
        {'model': 'level', 'initial_std': [1.0], **NILE}, np.arange(len(flow)), flow,
        initial='diffuse',
    )  # fmt: skip
    assert by_scenario.log_likelihood[1] == pytest.approx(-632.54563, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(
    ('kind', 'start'), [('llevel', (15099.0, 1469.1)), ('lltrend', (1e4, 1e3, 10.0))]
)
@pytest.mark.parametrize('missing', [False, True])
@pytest.mark.filterwarnings('ignore:Care should be used')
def test_statsmodels_starts_as_diffuse(kind, start, missing):
    structural = pytest.importorskip('statsmodels.tsa.statespace.structural')
    flow = gaps(nile()) if missing else nile()
    other = structural.UnobservedComponents(flow, kind)
    other.ssm.initialize_diffuse()
    r, *rest = start
    model, sensors = {'llevel': level, 'lltrend': trend}[kind](*rest, r=r)
    found = kr.filter(model, sensors, np.arange(len(flow)), flow, initial='diffuse')
    assert found.log_likelihood == pytest.approx(other.loglike(start), abs=1e-8)
    back, theirs = kr.smooth(found), other.smooth(start)
    np.testing.assert_allclose(back.mean, theirs.smoothed_state.T, rtol=1e-7, atol=1e-5)
    np.testing.assert_allclose(
        back.covariance, np.moveaxis(theirs.smoothed_state_cov, -1, 0), rtol=1e-7, atol=1e-5
    )


def test_the_nile_with_gaps_from_a_diffuse_start():
    flow = gaps(nile())
    model, sensors = level(1469.1, 15099.0)
    found = kr.filter(model, sensors, np.arange(len(flow)), flow, initial='diffuse')
    # by statsmodels 0.14
    assert found.log_likelihood == pytest.approx(-380.5870627753, abs=1e-9)
    fitted = kr.tune(
        level, np.arange(len(flow)), flow, initial='diffuse', fit={'q': 1e3, 'r': 1e4}
    )
    assert fitted.log_likelihood[1] == pytest.approx(-380.0077291, abs=1e-6)
    assert fitted.values['r'] == pytest.approx(17899.8, rel=1e-4)
    assert fitted.values['q'] == pytest.approx(685.82, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('kind', ['llevel', 'lltrend'])
def test_statsmodels_agrees_on_random_structural_models(kind, seed):
    structural = pytest.importorskip('statsmodels.tsa.statespace.structural')
    rng, problem = np.random.default_rng(seed), {'llevel': level, 'lltrend': trend}[kind]
    names = ['r', 'q', 'p'][: 2 if kind == 'llevel' else 3]
    true, start = (dict(zip(names, np.exp(rng.uniform(-2.0, 2.0, 3)))) for _ in range(2))
    n = len(names) - 1
    slope = np.cumsum(rng.normal(0.0, np.sqrt(true.get('p', 0.0)), 150))
    y = np.cumsum(slope + rng.normal(0.0, np.sqrt(true['q']), 150))
    y += rng.normal(0.0, np.sqrt(true['r']), 150)
    other = structural.UnobservedComponents(y, kind)
    other.loglikelihood_burn = 0
    other.ssm.initialize_known(np.zeros(n), 100.0 * np.eye(n))
    highest = other.fit(disp=False)
    found = kr.tune(
        problem, np.arange(150), y, initial=(np.zeros(n), 100.0 * np.eye(n)), fit=start
    )
    before, after = found.log_likelihood
    assert before == pytest.approx(other.loglike([start[name] for name in names]), abs=1e-6)
    assert after == pytest.approx(highest.llf, abs=1e-4)
    for name, value in zip(names, highest.params):
        assert name in found.undetermined or found.values[name] == pytest.approx(value, rel=2e-3)


def level(q=1.0, r=1.0):
    return kr.discrete_model([[1.0]], Q=[[q]]), ([[1.0]], [[r]])


def trend(q=1.0, p=1.0, r=1.0):
    return kr.discrete_model([[1.0, 1.0], [0.0, 1.0]], Q=np.diag([q, p])), ([[1.0, 0.0]], [[r]])


def spring(**changes):
    return {
        'model': 'mass_spring_damper', 'model_parameters.force_noise': 1e-3, 'rate': RATE,
        'position.rate': RATE / 2, 'position.noise': [0.01], 'sensors': ['position'], **changes,
    }  # fmt: skip


@pytest.mark.thorough
@pytest.mark.slow
def test_the_mass_and_the_damping_of_a_spring_are_identified():
    time = np.arange(0.0, DURATION, 1.0 / RATE)
    force = square_wave(time, 3.0, 5.0)[:, None]
    _, times, values = readings(spring(), time, force, seed=1)
    start = spring(**{
        'model_parameters.mass': 1.5, 'model_parameters.damping': 0.8,
        'model_parameters.stiffness': 3.0, 'position.noise': [0.03],
    })  # fmt: skip
    found = kr.tune(
        start, times, values, force, input_times=time, hold_out=0.25,
        fit=['mass', 'damping', 'stiffness', 'position.noise'],
    )  # fmt: skip
    fitted = found.values
    assert fitted['model_parameters.mass'] == pytest.approx(1.0, rel=0.03)
    assert fitted['model_parameters.damping'] == pytest.approx(0.4, rel=0.03)
    assert fitted['position.noise'] == pytest.approx(0.01, rel=0.1)
    before, after = found.held_out
    assert after.consistent and not before.consistent
    assert after.log_likelihood > before.log_likelihood
    assert found.aic[1] < found.aic[0] and not found.undetermined


def motor(**changes):
    return {
        'model': 'dc_motor', 'rate': RATE, 'encoder.rate': RATE / 2, 'encoder.noise': [1e-3],
        **changes,
    }  # fmt: skip


def motor_readings():
    time = np.arange(0.0, DURATION, 1.0 / RATE)
    voltage = square_wave(time, 6.0, 3.0)[:, None]
    return time, voltage, readings(motor(), time, voltage, seed=2)[1:]


@pytest.mark.slow
def test_the_constants_of_a_motor_are_identified():
    time, voltage, (times, values) = motor_readings()
    start = motor(**{'model_parameters.constant': 0.02, 'model_parameters.friction': 0.05})
    found = kr.tune(
        start, times, values, voltage, input_times=time, fit=['constant', 'friction']
    ).parameters
    for name, true in (('constant', 0.01), ('friction', 0.1)):
        each = found[f'model_parameters.{name}']
        assert each.value == pytest.approx(true, rel=0.03)
        assert each.low < true < each.high


@pytest.mark.slow
def test_a_gain_in_two_factors_is_called_so():
    rng = np.random.default_rng(4)
    inputs = rng.choice([-1.0, 1.0], 300)
    x = np.zeros(300)
    for k in range(299):
        x[k + 1] = 0.8 * x[k] + 1.5 * inputs[k] + 0.1 * rng.standard_normal()

    def amplifier(first=1.0, second=1.0, r=0.01):
        model = kr.discrete_model([[0.8]], Q=[[0.01]], G=[[first * second]])
        return model, ([[1.0]], [[r]])

    found = kr.tune(
        amplifier, None, x + 0.2 * rng.standard_normal(300), inputs[:, None],
        initial=([0.0], [[1.0]]),
    )  # fmt: skip
    assert set(found.undetermined) == {'first', 'second'}
    assert 'combination with second' in found.undetermined['first']
    assert np.prod([found.values[n] for n in ('first', 'second')]) == pytest.approx(1.5, rel=0.03)
    assert np.isnan(found.parameters['first'].low) and np.isfinite(found.parameters['r'].low)
    assert 'not determined' in repr(found)


def test_an_input_that_never_acts_determines_no_gain():
    rng = np.random.default_rng(5)

    def driven(gain=1.0, r=1.0):
        return kr.discrete_model([[0.9]], Q=[[1.0]], G=[[gain]]), ([[1.0]], [[r]])

    found = kr.tune(
        driven, None, rng.standard_normal(100), np.zeros((100, 1)), initial=([0.0], [[1.0]])
    )
    assert 'do not depend' in found.undetermined['gain']
    assert found.values['gain'] == 1.0


@pytest.mark.slow
def test_noise_that_shrinks_until_it_no_longer_shows_does_not_return_to_its_start():
    """Of a level that is read exactly: any small enough noise is as likely, the start is not."""
    y = np.cumsum(np.random.default_rng(6).normal(0.0, 1.0, 300))
    start = {'q': 0.5, 'r': 2.0}
    found = kr.tune(level, np.arange(300), y, initial=([0.0], [[2.0]]), fit=start)
    assert found.undetermined == {'r': 'it is too small for these data to show it'}
    assert 1e-5 < found.values['r'] < 0.01
    assert found.values['q'] == pytest.approx(1.0, rel=0.2)


def coverage(runs):
    """Return how often the intervals of a level's noise cover the truth."""
    hits, count = np.zeros(2), np.zeros(2)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        y = np.cumsum(rng.normal(0.0, 1.0, 150)) + rng.normal(0.0, 1.0, 150)
        found = kr.tune(
            level, np.arange(150), y, initial=([0.0], [[2.0]]), fit={'q': 0.5, 'r': 2.0}
        )
        for index, each in enumerate(found.parameters.values()):
            count[index] += each.determined
            hits[index] += each.determined and each.low < 1.0 < each.high
    return hits / count


@pytest.mark.thorough
@pytest.mark.slow
def test_most_intervals_cover_the_truth():
    # of 12 intervals of 95 %, 8 or fewer cover with a probability of 2e-4
    assert (coverage(12) >= 9 / 12).all()


def test_a_prior_counts_as_data_do():
    y = np.random.default_rng(6).normal(3.0, 1.0, 20)

    def constant(bias=1.0):
        return kr.discrete_model([[1.0]], Q=[[1e-12]]), ([[1.0]], [[1.0]]), ([bias], [[1e-9]])

    alone = kr.tune(constant, np.arange(20), y, linear=['bias'])
    known = kr.tune(constant, np.arange(20), y, linear=['bias'], priors={'bias': (0.0, 0.1)})
    # the mean of normal readings with a normal prior
    assert alone.values['bias'] == pytest.approx(y.mean(), abs=1e-4)
    assert known.values['bias'] == pytest.approx(y.sum() / (20 + 100), abs=1e-4)


@pytest.mark.slow
def test_gates_keep_outliers_out():
    rng = np.random.default_rng(7)
    y = np.cumsum(rng.normal(0.0, 0.1, 300)) + rng.normal(0.0, 1.0, 300)
    y[::20] += 50.0 * rng.choice([-1.0, 1.0], 15)
    starts = {'q': 0.1, 'r': 4.0}
    given = {'initial': ([0.0], [[1.0]]), 'fit': starts}
    gated = kr.tune(level, np.arange(300), y, gates=0.999, **given)
    assert gated.values['r'] == pytest.approx(1.0, rel=0.25)
    assert kr.tune(level, np.arange(300), y, **given).values['r'] > 50.0


@pytest.mark.parametrize(('arguments', 'words'), [
    ({'fit': ['model_parameters.masss']}, "did you mean 'model_parameters.mass'"),
    ({'fit': ['noise']}, 'position.noise or velocity.noise'),
    ({'fit': {'mass': 1.0}}, 'expected the names'),
    ({'fit': ['mass'], 'bounds': {'mass': (2.0, 3.0)}}, 'exclude the start'),
    ({'fit': ['mass'], 'bounds': {'damping': (2.0, 3.0)}}, 'damping is not fitted'),
    ({'fit': ['mass'], 'priors': {'mass': (1.0, 0.0)}}, 'standard deviation above 0'),
    ({'fit': ['mass'], 'hold_out': 1.5}, 'hold_out'),
])  # fmt: skip
def test_a_wrong_argument_is_refused_in_one_line(arguments, words):
    time = np.arange(5) * 0.1
    values = {'position': np.zeros(5), 'velocity': np.zeros(5)}
    with pytest.raises(ValueError) as error:
        kr.tune('mass_spring_damper', time, values, **arguments)
    assert words in str(error.value) and '\n' not in str(error.value)


def test_readings_that_no_filter_explains_are_refused():
    with pytest.raises(ValueError, match='no likelihood'):
        kr.tune(
            lambda a=1.0: (kr.discrete_model([[1e200 * a]], Q=[[1.0]]), ([[1.0]], [[1.0]])),
            np.arange(50), np.ones(50), initial=([1.0], [[1.0]]),
        )  # fmt: skip


@pytest.mark.thorough
@pytest.mark.slow
def test_an_ascent_ends_at_a_known_maximum_once_it_is_near():
    spring = COVERED[0]
    surface = likelihood(spring, recorded(spring, 0))
    start = surface.expand(surface.start)
    (whole,) = ascent.climb(surface, [start])
    _, again = ascent.climb(surface, [whole.top, start])
    assert again.top is whole.top and 0 < again.steps < whole.steps
    lower = replace(whole.top, value=start.value - 1.0)
    _, past = ascent.climb(surface, [lower, start])
    assert past.top.value > whole.top.value - 1e-3


@pytest.mark.slow
def test_ascents_in_step_lead_where_each_leads_alone():
    spring = replace(COVERED[0], fitted=['mass', 'damping', 'stiffness'], seconds=4.0)
    surface = likelihood(spring, recorded(spring, 0))
    starts = [surface.expand(surface.start + away) for away in (0.0, 1.0)]
    together = ascent.climb(surface, starts)
    alone = [ascent.climb(surface, [each])[0] for each in starts]
    assert sorted(each.steps for each in together) <= sorted(each.steps for each in alone)
    for end in together:
        assert end.top.z == pytest.approx(alone[0].top.z, abs=1e-3)


def test_all_ascents_end_where_one_is_interrupted(monkeypatch):
    spring = replace(COVERED[0], fitted=['mass', 'damping', 'stiffness'], seconds=4.0)
    surface = likelihood(spring, recorded(spring, 0))
    starts = [surface.expand(surface.start + away) for away in (0.0, 1.0)]
    expand_all, left = Likelihood.expand_all, iter(range(3))

    def interrupted(*arguments):
        if next(left, None) is None:
            raise KeyboardInterrupt
        return expand_all(*arguments)

    monkeypatch.setattr(Likelihood, 'expand_all', interrupted)
    for end, start in zip(ascent.climb(surface, starts), starts):
        assert end.stopped == ascent.INTERRUPTED and end.top.value > start.value


def test_a_fit_to_the_first_readings_is_kept_where_all_have_no_likelihood(monkeypatch):
    rng = np.random.default_rng(8)
    y = np.cumsum(rng.normal(0.0, 0.7, 150)) + rng.normal(0.0, 1.3, 150)
    given = {'initial': ([0.0], [[1.0]]), 'fit': {'q': 1.0, 'r': 1.0}}
    expected = kr.tune(level, np.arange(51), y[:51], **given)
    expand_all = Likelihood.expand_all

    def of_the_first(self, points, *rest):
        return expand_all(self, points, *rest) if self.until else [None] * len(points)

    monkeypatch.setattr(Likelihood, 'expand_all', of_the_first)
    monkeypatch.setattr(ascent, 'SHORT', 50)
    found = kr.tune(level, np.arange(150), y, **given)
    assert not found.converged and found.stopped == 'all readings together have no likelihood'
    assert found.count == 51 and found.stopped in ' '.join(repr(found).split())
    assert found.values == pytest.approx(expected.values, rel=0.2)


def test_an_interrupted_fit_in_python_is_an_interrupt(monkeypatch):
    def interrupted(self, steps, *_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ascent, 'scoring_step', interrupted)
    with pytest.raises(KeyboardInterrupt):
        kr.tune(level, np.arange(9), np.ones(9), initial=([0.0], [[1.0]]))


@pytest.mark.slow
def test_a_function_that_is_no_formula_says_that_python_computes(monkeypatch):
    monkeypatch.setenv(VARIABLE, 'compiled')

    def swing(root, k=2.0):
        def rate(x, u):
            return np.array([x[1], -k * root(x[0])])

        model = kr.continuous_model(rate, W=[0.0, 0.01], states=['a', 'b'], max_step=0.1)
        return model, ([1.0, 0.0], 0.01), ([0.5, 0.0], [0.1, 0.1])

    times = 0.1 * np.arange(20)
    readings = 0.5 * np.cos(1.4 * times)
    slow = kr.tune(partial(swing, lambda a: math.sin(np.float64(a))), times, readings)
    assert slow.arithmetic.startswith('numpy (') or '; model: numpy (' in slow.arithmetic
    assert 'computed by' in str(slow)
    fast = kr.tune(partial(swing, np.sin), times, readings)
    assert 'computed by' not in str(fast) and fast.arithmetic == 'C'
    assert fast.values['k'] == pytest.approx(slow.values['k'], rel=1e-4)
