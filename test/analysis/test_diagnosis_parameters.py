# SPDX-License-Identifier: Apache-2.0
"""Numbers of the model and of the sensors that a recording contradicts."""

from collections.abc import Sequence
from typing import Annotated

import numpy as np
import pytest
from tools.strangers.injected.array_replay import replay

from kalman_ros.analysis.diagnosis import contradicted_parameters
from kalman_ros.analysis.diagnosis.diagnose import diagnose
from kalman_ros.analysis.diagnosis.examination import Examination
from kalman_ros.analysis.diagnosis.parameters import parameters
from kalman_ros.analysis.records import InputRecord
from kalman_ros.core import About, Model, Sensor, Space, variances

DT, START, LAG = 0.05, 1000.0, 2.0
Base = Annotated[float, About('distance from the speed to the turn rate', 'm', minimum=0.1)]


class Truck(Model):
    """A truck that is steered by a constant angle: its heading, and its speed, which wanders."""

    state = Space(('psi', 'v'), ('rad', 'm/s'))
    input = Space(())

    def __init__(self, base: Base = 1.4, lag: float = LAG) -> None:
        self._base, self._lag = base, lag

    def derivative(self, x, u):
        return np.stack([x[..., 1] / self._base, -x[..., 1] / self._lag], axis=-1)

    def noise_density(self, x):
        return np.diag([0.0, 0.5])


class Gyro(Sensor):
    """The turn rate of the truck."""

    def __init__(self, state: Space, noise: Sequence[float], base: Base = 1.4) -> None:
        self._base = base
        self.output = Space(('rate',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x):
        return x[..., 1:] / self._base


class Wheel(Sensor):
    """The turn rate of a wheel of the truck."""

    def __init__(self, state: Space, noise: Sequence[float], radius: float = 0.2) -> None:
        self._radius = radius
        self.output = Space(('rate',), ('rad/s',))
        self.covariance = variances('noise', noise, 1)

    def measure(self, x):
        return x[..., 1:] / self._radius


def recorded(base=1.4, radius=0.2, **configured):
    """Return the evidence of 20 s of a truck that truly has these numbers."""
    rng, x, states = np.random.default_rng(7), np.zeros(2), []
    for _ in range(400):
        states.append(x)
        v = x[1] * np.exp(-DT / LAG) + rng.normal() * (0.5 * DT) ** 0.5
        x = np.array([x[0] + 0.5 * (x[1] + v) / base * DT, v])
    psi, v = np.array(states).T
    stamp = START + DT * np.arange(len(v))
    values = {
        'heading': (psi, 0.02), 'speed': (v, 0.05),
        'gyro': (v / base, 0.02), 'wheel': (v / radius, 0.2),
    }  # fmt: skip
    readings = {
        name: (stamp + 1e-3, stamp, (value + std * rng.normal(size=len(v)))[:, None], None)
        for name, (value, std) in values.items()
    }
    own = {'gyro': f'{__name__}:Gyro', 'wheel': f'{__name__}:Wheel'}
    kinds = {**own, 'heading': 'states', 'speed': 'states'}
    given = {
        'model': f'{__name__}:Truck', 'rate': 20.0, 'sensors': [*kinds],
        'heading.measures': ['psi'], 'speed.measures': ['v'],
        'initial_estimate': [0.0, 0.0], 'initial_std': [0.1, 0.1],
        **{f'{name}.kind': kind for name, kind in kinds.items()},
        **{f'{name}.noise': [std] for name, (_, std) in values.items()},
        **{f'{name}.rate': 20.0 for name in kinds},
        **{f'{name}.type': 'sensor_msgs/JointState' for name in kinds},
        **{f'{name}.fields': ['velocity[0]'] for name in kinds},
        **configured,
    }  # fmt: skip
    none = InputRecord(np.zeros(0), np.zeros(0), np.zeros((0, 0)))
    return replay(given, readings, none)


@pytest.mark.slow
def test_a_number_that_model_and_sensor_share_is_one():
    found = {each.name: each for each in parameters(recorded())}
    assert {*found} == {'base', 'lag', 'wheel.radius'}
    both = {'model_parameters.base': 1.5, 'gyro.base': 1.5}
    assert found['base'].change(1.5) == both
    apart = {each.name: each.value for each in parameters(recorded(**{'gyro.base': 1.5}))}
    assert apart == {'base': 1.4, 'lag': LAG, 'gyro.base': 1.5, 'wheel.radius': 0.2}


@pytest.mark.slow
@pytest.mark.parametrize(
    ('truth', 'name', 'keys'),
    [
        ({'base': 1.6}, 'base', ('model_parameters.base', 'gyro.base')),
        ({'radius': 0.21}, 'wheel.radius', ('wheel.radius',)),
    ],
)
def test_a_wrong_number_is_found_with_its_value(truth, name, keys):
    case = Examination(recorded(**truth))
    finding = max(contradicted_parameters.find(case), key=lambda each: each.gain)
    assert (finding.kind, finding.subject) == ('parameter', name)
    nearer = finding.again(Examination(finding.mended())) or finding
    (true,) = truth.values()
    assert [nearer.change[key] for key in keys] == pytest.approx([true] * len(keys), rel=0.02)


@pytest.mark.slow
def test_what_is_right_is_not_contradicted():
    assert contradicted_parameters.find(Examination(recorded())) == []


@pytest.mark.slow
def test_a_step_beyond_the_range_of_a_parameter_is_shortened():
    """Rates are v / base: from a base that is thrice too long a whole step ends below 0."""
    evidence = recorded(**{'model_parameters.base': 4.2, 'gyro.base': 4.2})
    case = Examination(evidence)
    column = case.responses.columns('parameter', 'base')
    step = float(case.responses.alone(column[0]).size[0])
    assert 4.2 + step < 0.1

    def misfit(base):
        changed = evidence.adopting({'model_parameters.base': base, 'gyro.base': base})
        return Examination(changed).passage.misfit

    trials = [4.2 * np.exp(share * step / 4.2) for share in (1.0, 0.5, 0.25)]
    (promised,) = (each for each in contradicted_parameters.find(case) if each.subject == 'base')
    tried = promised.exact().change['model_parameters.base']
    assert tried == pytest.approx(min(trials, key=misfit), rel=0.01)
    first = diagnose(evidence).findings[0]
    assert (first.kind, first.subject) == ('parameter', 'base')
    assert first.change['model_parameters.base'] == pytest.approx(1.4, rel=0.1)
    assert first.sentence.endswith(' 4.2 is configured.')
