# SPDX-License-Identifier: Apache-2.0
"""The real nodes as processes, over real topics."""

import numpy as np
import pytest
from thorough import mostly_thorough

pytest.importorskip('rclpy')

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from tools.bench.ring import Ring
from tools.soak.machine import Withheld

from kalman_ros.analysis import checks as verdicts
from kalman_ros.codecs.signal_codec import SignalCodec
from kalman_ros.harness import NodeError, Run
from kalman_ros.harness.executables import executable
from kalman_ros.harness.process import NodeProcess, isolated
from kalman_ros.simulation import closed_loop

SECONDS = 2.0


def record(*args, **kwargs):
    """Return the bytes of ``estimate`` and the trajectory of a short run."""
    with Run(*args, **kwargs) as run:
        run.advance(SECONDS)
        return b''.join(run.recorder.raw['estimate']), run.trajectory(), run.scenario


@pytest.fixture(scope='module')
def default_run():
    return record(seed=3)


@pytest.mark.parametrize(
    'order',
    mostly_thorough(
        [
            ('controller', 'plant', 'monitor', 'estimator'),
            ('plant', 'monitor', 'estimator', 'controller'),
        ],
        ('controller', 'plant', 'monitor', 'estimator'),
    ),
)
def test_the_same_seed_gives_the_same_bytes_in_any_order_of_start(default_run, order):
    estimate, trajectory, _ = default_run
    again, same, _ = record(seed=3, nodes=order)
    assert len(trajectory.time) == round(SECONDS * 100) + 1
    assert again == estimate
    np.testing.assert_array_equal(same.truth, trajectory.truth)


@pytest.mark.thorough
def test_another_seed_gives_other_bytes(default_run):
    assert record(seed=4)[0] != default_run[0]


@pytest.mark.thorough
def test_stamps_that_are_late_by_a_known_offset_change_nothing(default_run):
    # the plant stamps so, too
    late = {'position.stamp_offset': -0.15, 'velocity.stamp_offset': 0.05}
    assert record(overrides=late, seed=3)[0] == default_run[0]


def reported_at_the_end(run, key):
    """Return what the estimator reports once it counts all positions of `SECONDS`."""
    counted = lambda: int(run.reported('estimator', 'position: readings') or 0)  # noqa: E731
    run.wait(lambda: counted() > 20.0 * SECONDS, 60.0, lambda: f'{counted()} readings')
    return run.reported('estimator', key)


@pytest.mark.thorough
def test_an_estimator_with_a_bias_state_follows_a_sensor_that_is_off(default_run):
    off = {'position.bias': [0.5, 0.5]}
    believed = {'position.bias_std': [1.0]}
    errors, said = [], []
    for overrides in (off, {**off, **believed}):
        with Run(overrides=overrides, seed=3) as run:
            run.advance(SECONDS)
            found = run.trajectory()
            errors.append(np.abs(found.truth - found.estimate)[-1, [0, 2]].max())
            said.append(reported_at_the_end(run, 'position: bias'))
    assert errors[0] > 0.3
    assert errors[1] < 0.1
    assert said[0] == ''
    for part in said[1].split(', '):
        mean, std = map(float, part.split(' ± '))
        assert std < 0.3
        assert abs(mean - 0.5) < 3.0 * std


def test_separation_over_topics(default_run):
    _, one, _ = default_run
    _, two, _ = record(overrides={'input_cost': [0.05, 0.05]}, seed=3)
    assert np.abs(one.truth - two.truth).max() > 0.05
    assert np.abs(one.input - two.input).max() > 1.0
    np.testing.assert_allclose(
        one.truth - one.estimate, two.truth - two.estimate, rtol=0.0, atol=1e-9
    )


def test_the_nodes_do_what_the_loop_in_one_process_does(default_run):
    _, run, scenario = default_run
    gain = verdicts.theory(scenario).feedback.gain
    alone = closed_loop.run(scenario, gain, SECONDS, 3)
    np.testing.assert_allclose(run.truth, alone.truth, atol=1e-12)
    np.testing.assert_allclose(run.estimate, alone.estimate, atol=1e-12)
    np.testing.assert_allclose(run.covariance, alone.covariance, atol=1e-12)
    np.testing.assert_allclose(run.input, alone.input, atol=1e-11)
    for name, series in run.readings.items():
        np.testing.assert_allclose(series.values, alone.readings[name].values, atol=1e-12)
        np.testing.assert_allclose(
            run.innovations[name].nis, alone.innovations[name].nis, rtol=1e-9
        )


@pytest.mark.thorough
def test_a_sensor_can_be_switched_off_and_the_model_changed():
    only = {'plant': {'position.enabled': False, 'model': 'mass_spring_damper'}}
    only['estimator'] = only['plant']
    overrides = {'model': 'mass_spring_damper'}
    with Run('mass_spring_damper', overrides, only=only) as run:
        run.advance(1.0)
        found = run.trajectory()
    assert list(found.readings) == ['velocity']
    assert len(found.time) == 101
    assert found.covariance[-1, 0, 0] > 0.05**2


@pytest.mark.thorough
def test_a_plant_that_differs_from_what_is_believed_shows_in_the_nis():
    with Run(only={'plant': {'velocity.noise': [1.5, 1.5]}, 'estimator': {
        'velocity.covariance_from': 'configuration'}}) as run:  # fmt: skip
        run.advance(5.0)
        run.wait(
            lambda: 'NIS of velocity' in run.diagnostics['monitor'].message,
            10.0,
            lambda: 'no diagnostics',
        )
        nis = run.trajectory().innovations['velocity'].nis
    assert nis.mean() / 2 > 3.0


@pytest.mark.thorough
def test_a_run_goes_on_where_it_paused():
    with Run(seed=3) as run:
        for _ in range(4):
            run.advance(SECONDS / 4)
        pieces = b''.join(run.recorder.raw['estimate'])
    assert pieces == record(seed=3)[0]


@pytest.mark.thorough
def test_a_report_that_arrives_late_is_not_taken_for_a_new_one():
    with Run(nodes=('plant', 'estimator', 'controller')) as run:
        run.advance(1.0)
        run.refresh('plant')
        old = run.diagnostics['plant']
        run.advance(1.0)
        again = run.node.create_publisher(DiagnosticArray, '/diagnostics', 10)
        run.wait(lambda: again.get_subscription_count() > 0, 60.0, lambda: 'not connected')
        again.publish(DiagnosticArray(status=[old]))
        assert again.wait_for_all_acked(Duration(seconds=10.0))  # it waits to be taken
        run.refresh('plant')
        assert run.reported('plant', 'steps') == '201'


@pytest.mark.thorough
def test_a_dead_node_is_named():
    with pytest.raises(NodeError, match='the estimator died'), Run() as run:
        run.advance(0.5)
        run.processes['estimator'].signal(9)
        run.advance(30.0)


@pytest.mark.thorough
@pytest.mark.parametrize(('node', 'what'), [('controller', 'force'), ('estimator', 'estimate')])
def test_who_does_not_answer_is_named_and_may_come_back(node, what):
    with Run(overrides={'lockstep_timeout': 0.4}) as run:
        run.advance(0.5)
        run.kill(node)
        with pytest.raises(NodeError, match=f'no {what} for step .*: the {node} did not answer'):
            run.advance(1.0)
        run.start(node)
        run.set_parameter('run_until', 2.0)
        run.wait(lambda: run.elapsed > 1.995, 30.0, lambda: f'lockstep stands at {run.elapsed}')
        found = run.trajectory()
    assert np.abs(found.truth[-1]).max() < 1.5


@pytest.mark.real_time
def test_real_time_pauses_for_nobody_and_resumes():
    """The controller dies: the force goes to zero; it comes back: the loop is closed again."""
    with Run(lockstep=False, overrides={'force_timeout': 0.3}) as run:
        run.advance(1.0)
        assert run.diagnostics['plant'].message == 'running'
        run.kill('controller')
        run.set_parameter('run_until', 1e6)
        quiet = 'no force received: it is zero'
        run.wait(lambda: run.diagnostics['plant'].message == quiet, 60.0, lambda: 'still a force')
        run.start('controller')
        run.wait(
            lambda: run.diagnostics['plant'].message == 'running', 20.0, lambda: 'no force again'
        )


@pytest.mark.real_time
def test_real_time_keeps_its_statistics():
    with Run(lockstep=False, seed=1) as run:
        withheld = Withheld(process.pid for process in run.processes.values())
        run.advance(14.0)
        waited = withheld()
        found = run.trajectory()
        run.refresh('plant')
        missed = int(run.reported('plant', 'missed steps'))
        steps = len(run.recorder['ground_truth'].stamp)
        checks = verdicts.checks(run.scenario, verdicts.theory(run.scenario), found)
    # a step that is missed is late, and none is but while the machine does other things
    assert steps == 1401
    assert missed <= 14 + waited * 100.0
    assert not [check for check in checks if not check.passed]


def test_a_nan_reading_is_refused_and_nothing_good_is_lost():
    with Run(lockstep=False) as run:
        codec = SignalCodec(run.scenario.sensors['position'].signal)
        publisher = run.node.create_publisher(codec.message_type, 'position', 10)
        run.advance(1.0)
        run.wait(lambda: publisher.get_subscription_count() > 0, 60.0, lambda: 'no subscriber')
        for value in (np.nan, np.inf):
            now = run.node.get_clock().now().nanoseconds
            publisher.publish(codec.encode(now, np.array([value, 0.0]), np.eye(2)))
        run.advance(1.0)
        key = 'position: dropped: not finite'
        run.wait(lambda: run.reported('estimator', key) == '2', 60.0, lambda: 'not counted')
        assert 'reading of position dropped: not finite' in run.processes['estimator'].output()
        found = run.trajectory()
        fused = int(run.reported('estimator', 'position: fused'))
        total = int(run.reported('estimator', 'position: readings'))
    assert total == fused + 2
    assert np.isfinite(found.estimate).all()
    assert np.abs(found.truth[-1] - found.estimate[-1]).max() < 0.6


def test_parameters_change_live_as_a_whole_or_not_at_all():
    with Run() as run:
        run.advance(0.5)
        with pytest.raises(ValueError, match=r'position\.noise: expected 2 numbers, got 1'):
            run.set_parameter('position.noise', [1.0])
        with pytest.raises(ValueError, match='read-only'):
            run.set_parameter('seed', 5)
        with pytest.raises(ValueError, match='input_cost: expected a positive def'):
            run.set_parameter('input_cost', [-1.0, 1.0], node='controller')
        before = run.reported('controller', 'gain')
        run.set_parameter('input_cost', [100, 100], node='controller')  # whole numbers will do
        run.set_parameter('velocity.noise', [5.0, 5.0])
        run.wait(
            lambda: run.reported('controller', 'gain') != before, 5.0, lambda: 'the same gain'
        )
        run.advance(2.0)
        readings = run.trajectory().readings['velocity']
    late = readings.values[readings.time > 1.0]
    assert late.std() > 3.0


@pytest.mark.thorough
def test_parameters_explain_themselves():
    from rcl_interfaces.srv import DescribeParameters

    with Run() as run:
        client = run.node.create_client(DescribeParameters, 'plant/describe_parameters')
        run.wait(client.service_is_ready, 60.0, lambda: 'no service')
        names = ['model_parameters.mass', 'seed', 'velocity.noise']
        future = client.call_async(DescribeParameters.Request(names=names))
        run.wait(future.done, 60.0, lambda: 'no answer')
        mass, seed, noise = future.result().descriptors
    assert mass.description == 'mass of the body [kg]'
    assert mass.floating_point_range[0].from_value == 1e-9
    assert not mass.read_only
    assert seed.read_only
    assert seed.integer_range[0].from_value == 0
    assert 'standard deviation' in noise.description


@pytest.mark.thorough
def test_two_robots_side_by_side_in_namespaces(tmp_path):
    names = ('plant', 'estimator', 'controller')
    heard = {'/estimate': [], '/r2/estimate': []}
    with Run(lockstep=False, nodes=names) as run:
        for topic, messages in heard.items():
            run.node.create_subscription(Odometry, topic, messages.append, 50)
        others = []
        for name in names:
            command = [str(executable(name)), '--ros-args', '-r', '__ns:=/r2']
            log = tmp_path / f'{name}.log'
            others.append(NodeProcess(name, command, isolated(run.domain), log))
        try:
            enough = lambda: all(len(messages) > 20 for messages in heard.values())  # noqa: E731
            run.advance(2.0)
            run.wait(enough, 60.0, lambda: 'estimates of both robots have not come')
            assert {p for p, *_ in run.node.get_topic_names_and_types()} >= {'/force', '/r2/force'}
            for topic in ('/estimate', '/r2/estimate', '/force', '/r2/force', '/r2/velocity'):
                one = lambda: run.node.count_publishers(topic) == 1  # noqa: B023, E731
                run.wait(one, 60.0, lambda: f'{topic}: {run.node.count_publishers(topic)}')  # noqa: B023
            both = {'plant', 'r2/plant'}
            run.wait(
                lambda: both <= set(run.diagnostics), 5.0, lambda: 'nothing received from r2/plant'
            )
        finally:
            for process in others:
                process.stop()


@pytest.mark.thorough
def test_the_controller_may_use_the_truth_by_a_remap(default_run):
    _, lqg, _ = default_run
    remaps = {'controller': {'estimate': 'ground_truth'}}
    _, full_state, scenario = record(seed=3, remaps=remaps)
    gain = verdicts.theory(scenario).feedback.gain
    np.testing.assert_allclose(full_state.input, -full_state.truth @ gain.T, atol=1e-12)
    assert np.abs(lqg.input + lqg.truth @ gain.T).max() > 0.01


@pytest.mark.thorough
def test_the_ring_of_bare_nodes_goes_round():
    """What `bench` measures the loop against."""
    with Ring() as ring:
        assert 0.0 < ring.rounds(50) < 1.0


@pytest.mark.thorough
def test_an_input_off_the_centre_moves_the_body_as_one_at_it():
    """The controller writes it at the place, and plant, estimator and recorder read it back."""
    driven = []
    for place in ([0.0, 0.0, 0.0], [0.3, -0.5, 0.2]):
        with Run('inertial', {'input.mount.translation': place}) as run:
            run.advance(1.5)
            driven.append(run.trajectory())
    centre, off = driven
    np.testing.assert_allclose(off.truth, centre.truth, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(off.estimate, centre.estimate, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(off.input, centre.input, rtol=0.0, atol=1e-8)
