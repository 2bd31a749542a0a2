# SPDX-License-Identifier: Apache-2.0
"""From the first belief of every parameter file, its filter is consistent."""

from pathlib import Path

import pytest
from monte_carlo import consistency

from kalman_ros import scenario
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.consistency import chi_square_bounds
from kalman_ros.estimators.filters.ekf import ExtendedKalmanFilter
from kalman_ros.scenario.parameter_files import from_file

CONFIGS = sorted((Path(__file__).parents[2] / 'config').glob('*.yaml'))
RUNS = 200
#: Where a step of ten is outside by chance with 200, fifteen times as many tell.
MORE = {'lidar_radar': 3000}
#: Steps at the rate of the fastest sensor; the hull needs some for its product of speeds to tell.
STEPS = {'submersible': 25}


#: Nonlinear ones take seconds, and are slow except one.
QUICK = ('level', 'nile', 'linear', 'mass_spring_damper', 'mass_spring_damper_2d', 'two_bearings')
MARKED = [
    pytest.param(path, id=path.stem, marks=() if path.stem in QUICK else pytest.mark.slow)
    for path in CONFIGS
]


def built(path, **options):
    """Return the scenario of a file, with no step between the readings."""
    values = from_file(path, 'estimator')
    sources = scenario.build(values).enabled.values()
    fastest = max(source.timed.rate for source in sources)
    return scenario.build({**values, 'rate': fastest, **options})


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize('path', MARKED)
def test_the_error_scatters_as_the_first_belief_and_all_after_it_say(path):
    chosen = built(path)
    filter = build_filter(chosen.filter, chosen.plan)
    runs = MORE.get(path.stem, RUNS)
    found = consistency(chosen, filter, runs, STEPS.get(path.stem, 10))
    low, high = chi_square_bounds(1.0, 2.0 / (found.degrees[''] * runs), 1e-3)
    assert low <= found.anees.min()
    assert found.anees.max() <= high


@pytest.mark.parametrize('path', CONFIGS, ids=lambda path: path.stem)
def test_the_plant_starts_where_the_first_belief_may_have_it(path):
    chosen = built(path)
    belief = chosen.initial_belief
    error = chosen.model.state.subtract(chosen.initial_state, belief.mean)
    assert (abs(error) <= 3.0 * belief.std).all()


def test_it_runs_with_the_input_of_the_equilibrium():
    """Without it the submersible rises, which its filter knows as little as its plant forgets."""
    chosen = built(next(path for path in CONFIGS if path.stem == 'submersible'))

    class Watched(ExtendedKalmanFilter):
        def predict(self, belief, u, dt):
            assert (u == chosen.model.equilibrium.input).all()
            assert u.any()
            return belief

    consistency(chosen, Watched(chosen.model), 1, 2)


def test_a_state_may_be_certain_at_first():
    path = next(path for path in CONFIGS if path.stem == 'mass_spring_damper_2d')
    chosen = built(path, initial_std=[0.0, 1.0, 0.0, 1.0])
    found = consistency(chosen, build_filter('kf', chosen.plan), 100, 5)
    # the place is certain, and right; then it moves
    assert 0.35 < found.anees[0] < 0.65
    low, high = chi_square_bounds(1.0, 2.0 / (4 * 100), 1e-3)
    assert low <= found.anees[1:].min() <= found.anees[1:].max() <= high
