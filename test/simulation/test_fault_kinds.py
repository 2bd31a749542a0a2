# SPDX-License-Identifier: Apache-2.0
"""Each fault as statistics, and faults together: order, windows, separate streams."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import binomtest

from kalman_ros import scenario
from kalman_ros.core import About, Space, TimedSensor
from kalman_ros.sensors import states
from kalman_ros.simulation import faults
from kalman_ros.simulation.faults.body import BodyFaults, BodyOptions
from kalman_ros.simulation.faults.fault import Fault
from kalman_ros.simulation.faults.links import Links
from kalman_ros.simulation.simulated_plant import SimulatedPlant

DT = 10_000_000  # ns
SPACE = Space(('x', 'v'), ('m', 'm/s'))
SENSOR = states.SENSOR(SPACE, [0.1, 0.5], ('x', 'v'))
TIMED = TimedSensor(SENSOR, 100.0)
N = 4000


def send(settings, count=N, seed=0, values=None, change=lambda step, links: None):
    """Return (step of arrival, stamp, values) of all that arrives; a reading a step is taken."""
    links = Links(seed)
    links.configure({'a': TIMED}, {'a': settings})
    found = []
    for step in range(count + 200):
        change(step, links)
        y = np.zeros(2) if values is None else values(step)
        taken = {'a': y} if step < count else {}
        for name, stamp, y in links(step * DT, 10**9 + step * DT, taken):
            assert name == 'a'
            found.append((step, (stamp - 10**9) // DT, y))
    return found


def happened(count, probability, of=N):
    """Return whether a count is likely at a probability, with one chance in 10^4 to err."""
    return binomtest(count, of, probability).pvalue > 1e-4


def values_of(found):
    return np.array([y for *_, y in found])


def test_without_faults_everything_goes_through_as_it_is():
    sent = [np.full(2, float(step)) for step in range(10)]
    found = send({}, 10, values=lambda step: sent[min(step, 9)])
    assert [(step, stamp) for step, stamp, _ in found] == [(step, step) for step in range(10)]
    assert all(y is sent[step] for step, _, y in found)


@pytest.mark.parametrize('probability', [0.05, 0.3, 0.9])
def test_dropout(probability):
    found = send({'dropout': probability})
    assert happened(N - len(found), probability)
    # independent: a loss does not affect the next one
    there = np.zeros(N, dtype=bool)
    there[[stamp for _, stamp, _ in found]] = True
    both = int((~there[1:] & ~there[:-1]).sum())
    p = probability
    variance = p**2 * (1.0 - p**2) + 2.0 * p**3 * (1.0 - p)  # neighbouring pairs share one
    assert abs(both / N - p**2) < 4.0 * np.sqrt(variance / N)


@pytest.mark.slow
@pytest.mark.parametrize(('begins', 'length'), [(0.02, 10.0), (0.1, 3.0), (0.05, 1.0)])
def test_losses_come_in_bursts_of_the_length_that_is_asked_for(begins, length):
    n = 40_000
    there = np.zeros(n, dtype=bool)
    there[[stamp for _, stamp, _ in send({'burst_loss': begins, 'burst_length': length}, n)]] = (
        True
    )
    edges = np.flatnonzero(np.diff(np.concatenate(([True], there, [True])).astype(int)))
    lengths = edges[1::2] - edges[::2]
    # lengths are geometric, with this mean, and this standard deviation
    spread = length * np.sqrt(1.0 - 1.0 / length) if length > 1.0 else 0.0
    assert abs(lengths.mean() - length) <= 4.0 * spread / np.sqrt(len(lengths))
    # bursts begin at good readings only, and the first reading after one is good
    good = int(there.sum())
    assert happened(len(lengths), begins, good)
    lost = begins / (begins + 1.0 / length)
    assert abs((~there).mean() - lost) < 0.1 * lost


def test_a_delay_is_exact_and_keeps_stamps_and_order():
    found = send({'delay': 0.05}, 100)
    assert [(step, stamp) for step, stamp, _ in found] == [(k + 5, k) for k in range(100)]
    # what is no whole number of steps arrives at the next one
    assert send({'delay': 0.051}, 10)[0][0] == 6


def test_jitter_is_evenly_distributed_and_overtakes():
    late = np.array([step - stamp for step, stamp, _ in send({'jitter': 0.08})])
    counts = np.bincount(late, minlength=9)
    # steps 1 to 8 each take an eighth; none comes exactly at its own step
    assert counts[0] == 0
    assert all(happened(count, 1.0 / 8.0) for count in counts[1:])
    stamps = [stamp for _, stamp, _ in send({'jitter': 0.08})]
    assert sorted(stamps) == list(range(N))
    assert stamps != sorted(stamps)


def test_reordering_swaps_neighbours():
    stamps = [stamp for _, stamp, _ in send({'reordering': 0.2})]
    assert sorted(stamps) == list(range(N))
    ranks = np.argsort(stamps)  # where each came
    late = [k for k in range(N - 1) if ranks[k] > ranks[k + 1]]
    # one is overtaken by its successor unless that is held back, too
    assert happened(len(late), 0.2 * 0.8, N - 1)
    assert all(ranks[k] < ranks[k + 2] for k in late if k + 2 < N)


def test_duplication():
    found = send({'duplication': 0.1})
    assert happened(len(found) - N, 0.1)
    assert len({stamp for _, stamp, _ in found}) == N
    twice = [k for k in range(len(found) - 1) if found[k][1] == found[k + 1][1]]
    assert len(twice) == len(found) - N  # the copy comes at once
    assert all(found[k][0] == found[k + 1][0] for k in twice)


def test_a_fault_goes_with_the_noise_of_its_sensor():
    links, settings = Links(0), {'outliers': 1.0, 'outlier_size': 10.0}
    found = []
    for time, noise in enumerate((0.1, 5.0)):
        sensor = states.SENSOR(SPACE, [noise, noise], ('x', 'v'))
        links.configure({'a': TimedSensor(sensor, 100.0)}, {'a': settings})
        ((_, _, y),) = links(time, 0, {'a': np.zeros(2)})
        found.append(np.abs(y))
    np.testing.assert_allclose(found, [[1.0, 1.0], [50.0, 50.0]])


def test_outliers_are_far_off_by_the_noise_of_each_coordinate_either_way():
    y = values_of(send({'outliers': 0.1, 'outlier_size': 30.0}))
    off = np.abs(y) > 0.0
    assert happened(int(off[:, 0].sum()), 0.1)
    np.testing.assert_array_equal(off[:, 0], off[:, 1])
    np.testing.assert_allclose(np.abs(y[off[:, 0]]), [[3.0, 15.0]] * int(off[:, 0].sum()))
    ups = (y[off[:, 0]] > 0.0).sum(axis=0)
    assert all(happened(int(up), 0.5, int(off[:, 0].sum())) for up in ups)


def test_bias_drift_and_random_walk():
    np.testing.assert_array_equal(values_of(send({'bias': [1.0, -2.0]}, 5)), [[1.0, -2.0]] * 5)
    np.testing.assert_array_equal(values_of(send({'bias': [3.0]}, 5)), [[3.0, 3.0]] * 5)
    ramp = values_of(send({'drift': [2.0, 0.0]}, 101))
    np.testing.assert_allclose(ramp[:, 0], 0.02 * np.arange(101), atol=1e-12)
    walk = values_of(send({'random_walk': [0.5, 2.0]}, 20_000))
    steps = np.diff(walk, axis=0) / np.sqrt(0.01) / [0.5, 2.0]
    np.testing.assert_allclose(steps.var(axis=0), 1.0, atol=4.0 * np.sqrt(2.0 / len(steps)))
    assert np.abs(walk[0]).max() == 0.0
    correlation = float(np.mean(steps[1:, 0] * steps[:-1, 0]))
    assert abs(correlation) < 4.0 / np.sqrt(len(steps))


def test_a_frozen_sensor_says_the_first_again_with_new_stamps():
    found = send({'freeze': True}, 50, values=lambda step: np.full(2, float(step)))
    np.testing.assert_array_equal(values_of(found), np.zeros((50, 2)))
    assert [stamp for _, stamp, _ in found] == list(range(50))


def test_nan():
    y = values_of(send({'nan': 0.2}))
    assert happened(int(np.isnan(y[:, 0]).sum()), 0.2)
    np.testing.assert_array_equal(np.isnan(y[:, 0]), np.isnan(y[:, 1]))


@pytest.mark.parametrize(
    'settings',
    [
        {'bias': [1.0]}, {'drift': [1.0]}, {'random_walk': [1.0]}, {'outliers': 1.0},
        {'freeze': True}, {'nan': 1.0},
    ],
    ids=lambda settings: next(iter(settings)),
)  # fmt: skip
def test_outside_its_window_no_fault_acts_on_values(settings):
    window = {'fault_window': [0.1, 0.2]}
    true = lambda step: np.full(2, 0.001 * step)  # noqa: E731
    found = values_of(send({**settings, **window}, 40, values=true))
    wrong = ~(found == [true(step) for step in range(40)]).all(axis=1)
    assert not wrong[:10].any()
    assert not wrong[20:].any()
    assert wrong[12:20].all()


@pytest.mark.parametrize(
    'settings',
    [
        {'dropout': 1.0}, {'burst_loss': 1.0, 'burst_length': 1e9}, {'delay': 0.05},
        {'jitter': 5.0}, {'reordering': 1.0}, {'duplication': 1.0},
    ],
    ids=lambda settings: next(iter(settings)),
)  # fmt: skip
def test_outside_its_window_no_fault_acts_on_the_way(settings):
    found = send({**settings, 'fault_window': [0.1, 0.2]}, 40)
    direct = [k for k in range(40) if [stamp for _, stamp, _ in found].count(k) == 1
              and (k, k) in [(step, stamp) for step, stamp, _ in found]]  # fmt: skip
    assert direct == [*range(10), *range(20, 40)]


#: Draws of each are distinguished by their effect.
MARKS = {
    'dropout': {'dropout': 0.3},
    'burst_loss': {'burst_loss': 0.1},
    'outliers': {'outliers': 0.3},
    'nan': {'nan': 0.3},
    'duplication': {'duplication': 0.3},
    'jitter': {'jitter': 0.05},
    'reordering': {'reordering': 0.3},
    'random_walk': {'random_walk': [1.0]},
}


@pytest.mark.parametrize('first', MARKS)
@pytest.mark.parametrize('other', MARKS)
def test_a_fault_that_is_switched_on_leaves_the_draws_of_every_other(first, other):
    """What one does to a reading is the same with and without the other, loss included."""
    if first == other:
        return
    alone, both = (Links(3), Links(3))
    alone.configure({'a': TIMED}, {'a': MARKS[first]})
    both.configure({'a': TIMED}, {'a': {**MARKS[first], **MARKS[other]}})
    for step in range(50):
        for links in (alone, both):
            links(step * DT, step * DT, {'a': np.zeros(2)})
    kind = type(next(iter(alone._links['a']._faults.values())))
    streams = [links._links['a']._faults[kind].random for links in (alone, both)]
    assert streams[0].random() == streams[1].random()


def test_another_sensor_and_another_seed_have_other_draws():
    links = Links(0)
    links.configure({'a': TIMED, 'b': TIMED}, {name: {'dropout': 0.5} for name in 'ab'})
    came = [
        {name for name, *_ in links(step * DT, step * DT, dict.fromkeys('ab', np.zeros(2)))}
        for step in range(64)
    ]
    assert any(names == {'a'} for names in came)
    assert any(names == {'b'} for names in came)
    stamps = [[stamp for _, stamp, _ in send({'dropout': 0.5}, 64, seed)] for seed in (0, 0, 1)]
    assert stamps[0] == stamps[1] != stamps[2]


def test_asked_again_a_step_is_the_same():
    links = Links(0)
    links.configure({'a': TIMED}, {'a': {'random_walk': [1.0], 'duplication': 0.5}})
    for step in range(20):
        first = links(step * DT, 0, {'a': np.zeros(2)})
        assert links(step * DT, 0, {'a': np.zeros(2)}) is first
    assert links.arrived['a'] >= 20


def test_a_change_of_one_fault_lets_the_others_go_on():
    def change(step, links):
        if step == 50:
            links.configure({'a': TIMED}, {'a': {'drift': [1.0], 'delay': 0.02}})
        if step == 60:
            links.configure({'a': TIMED}, {'a': {'drift': [2.0]}})  # begins at zero again

    found = send({'drift': [1.0]}, 100, change=change)
    ramp = values_of(sorted(found, key=lambda arrival: arrival[1]))[:, 0]
    np.testing.assert_allclose(ramp[:60], 0.01 * np.arange(60), atol=1e-12)
    np.testing.assert_allclose(ramp[60:], 0.02 * np.arange(40), atol=1e-12)


def test_what_is_under_way_arrives_when_the_delay_is_switched_off():
    def change(step, links):
        if step == 20:
            links.configure({'a': TIMED}, {'a': {}})

    found = send({'delay': 0.05}, 40, change=change)
    assert sorted(stamp for _, stamp, _ in found) == list(range(40))
    assert [step for step, stamp, _ in found if stamp == 18] == [23]
    assert [step for step, stamp, _ in found if stamp == 21] == [21]


def test_angles_stay_angles():
    space = Space(('theta',), ('rad',), angles=('theta',))
    timed = TimedSensor(states.SENSOR(space, [0.1], ('theta',)), 100.0)
    links = Links(0)
    links.configure({'a': timed}, {'a': {'bias': [3.0]}})
    ((_, _, y),) = links(0, 0, {'a': np.array([1.0])})
    np.testing.assert_allclose(y, 4.0 - 2.0 * np.pi)


@pytest.mark.parametrize(
    ('values', 'says'),
    [
        ({'position.dropout': 1.5}, 'position.dropout: expected 0 to 1, got 1.5'),
        ({'position.bias': [1.0, 2.0, 3.0]}, 'position.bias: expected 1 or 2 numbers, got 3'),
        ({'position.delay': -0.1}, 'position.delay: expected 0 to 10 s, got -0.1'),
        ({'velocity.burst_length': 0.5}, 'velocity.burst_length: expected at least 1, got 0.5'),
        ({'position.fault_window': [2.0, 1.0]}, 'position.fault_window: expected a start before'),
        ({'position.fault_window': [2.0]}, 'position.fault_window: expected a start before'),
        ({'position.freeze': 1}, 'position.freeze: expected true or false, got 1'),
    ],
)
def test_a_fault_that_cannot_be_is_refused(values, says):
    sensors = {name: source.timed for name, source in scenario.build({}).sensors.items()}
    with pytest.raises(ValueError, match=says):
        complete = {o.name: o.check(values.get(o.name, o.default)) for o in
                    faults.options_of_sensors(sensors)}  # fmt: skip
        faults.settings_of_sensors(sensors, complete)


def test_every_fault_is_off_by_default_and_can_be_switched_on():
    assert all(faults.settings_of(kind, {}) is None for kind in faults.FAULTS)
    names = [option.name for option in faults.fault_options()]
    assert len(names) == len(set(names))
    assert all(isinstance(option.about, About) and option.about.live
               for option in faults.fault_options())  # fmt: skip
    sensors = ('position', 'velocity')
    assert [option.name for option in faults.options_of_sensors(sensors)] == [
        f'{sensor}.{name}' for sensor in sensors for name in names
    ]
    # who has no plant knows none of them
    assert not any(name.endswith('.dropout') for name in scenario.options({}))


def test_a_new_fault_is_a_class_and_a_name_in_the_list(monkeypatch):
    @dataclass
    class Saturation(Fault):
        saturation: float = 0.0

        def __call__(self, reading):
            most = self.saturation
            return reading._replace(values=np.clip(reading.values, -most, most))

    for module in ('kalman_ros.simulation.faults', 'kalman_ros.simulation.faults.links'):
        monkeypatch.setattr(f'{module}.FAULTS', (*faults.FAULTS, Saturation))
    monkeypatch.setitem(faults._OPTIONS, Saturation, faults.options_of(Saturation))
    assert values_of(send({'saturation': 0.5, 'bias': [2.0]}, 3)).max() == 0.5


# --- the body ---------------------------------------------------------------------------------


def moved(options, forces, seed=0, **values):
    """Return the forces that acted on a plant, from how its velocities changed."""
    built = scenario.build({'model_parameters.force_noise': 1e-18, **values})
    plant = SimulatedPlant(built.model, {}, built.rate, built.initial_state, seed)
    plant.faults = BodyFaults(options, built.model.input.size)
    step = built.model.transition(*built.model.equilibrium, plant.dt)
    found = []
    for u in forces:
        before = plant.state
        plant.step(np.asarray(u))
        found.append(np.linalg.lstsq(step.G, plant.state - step.F @ before, rcond=None)[0])
    return np.array(found)


def test_a_dead_zone_takes_its_part_of_every_force():
    forces = [[0.2, -0.2], [1.0, -1.0], [0.5, 3.0]]
    found = moved(BodyOptions(actuator_dead_zone=[0.5, 0.25]), forces)
    np.testing.assert_allclose(found, [[0.0, 0.0], [0.5, -0.75], [0.0, 2.75]], atol=1e-5)


def test_a_lost_command_leaves_the_one_before_in_effect():
    n = 2000
    forces = np.random.default_rng(0).normal(size=(n, 2))
    found = moved(BodyOptions(actuator_loss=0.3), forces)
    lost = np.abs(found - forces).max(axis=1) > 1e-4
    assert happened(int(lost.sum()), 0.3, n)
    for step in range(1, n):
        if lost[step]:
            np.testing.assert_allclose(found[step], found[step - 1], atol=1e-4)


def test_disturbances_push_as_they_are_told():
    still = np.zeros((500, 2))
    constant = moved(BodyOptions(disturbance_constant=[0.5, -1.0]), still)
    np.testing.assert_allclose(constant, [[0.5, -1.0]] * 500, atol=1e-4)
    sine = moved(BodyOptions(disturbance_amplitude=[2.0, 0.0], disturbance_frequency=0.5), still)
    times = 0.01 * np.arange(500)
    np.testing.assert_allclose(sine[:, 0], 2.0 * np.sin(np.pi * times), atol=1e-4)
    np.testing.assert_allclose(sine[:, 1], 0.0, atol=1e-4)
    white = moved(BodyOptions(disturbance_noise=[0.04]), still)
    # variance of the average over a step: density / dt
    np.testing.assert_allclose(white.var(axis=0), 4.0, rtol=4.0 * np.sqrt(2.0 / 500))


def test_the_body_has_a_window_and_is_sound_outside():
    still = np.zeros((40, 2))
    options = BodyOptions(disturbance_constant=[1.0], fault_window=[0.1, 0.2])
    found = moved(options, still)[:, 0]
    np.testing.assert_allclose(found, (np.arange(40) // 10 == 1).astype(float), atol=1e-4)


def test_faults_of_the_body_leave_the_process_noise_and_each_other_as_they_were():
    forces = np.random.default_rng(1).normal(size=(50, 2))

    def states_of(**options):
        built = scenario.build({})
        plant = SimulatedPlant(built.model, {}, 100.0, built.initial_state, 0)
        plant.faults = BodyFaults(BodyOptions(**options), 2)
        found = []
        for u in forces:
            plant.step(u)
            found.append(plant.state)
        return np.array(found)

    sound, pushed = states_of(), states_of(disturbance_noise=[0.1])
    lost, both = (
        states_of(actuator_loss=0.5),
        states_of(actuator_loss=0.5, disturbance_noise=[0.1]),
    )
    assert np.abs(pushed - sound).max() > 1e-3
    np.testing.assert_allclose(both - lost, pushed - sound, atol=1e-12)  # linear: they add up


def test_the_body_refuses_what_is_not_for_its_inputs():
    with pytest.raises(ValueError, match='actuator_dead_zone: expected 1 or 2 numbers, got 3'):
        BodyFaults(BodyOptions(actuator_dead_zone=[0.1, 0.1, 0.1]), 2)
    with pytest.raises(ValueError, match='fault_window: expected a start before an end'):
        BodyFaults(BodyOptions(fault_window=[1.0, 1.0]), 2)
