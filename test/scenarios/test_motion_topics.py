# SPDX-License-Identifier: Apache-2.0
"""Motions over topics: a path and a trajectory are followed, and what is none leaves the loop."""

from pathlib import Path as Path_

import numpy as np
import pytest

pytest.importorskip('rclpy')

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import kalman_ros as kr
from kalman_ros.harness import Run
from kalman_ros.harness.followed_path import deliver as send

ROBOT = {'model': 'diff_drive', 'model_parameters.command_time': 0.2, 'initial_state': [0.0] * 5}
CORNER = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]


def path(points, frame='', **orientation):
    message = Path()
    message.header.frame_id = frame
    for x, y in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        message.poses.append(pose)
    return message


def trajectory(names, rows, times=None):
    message = JointTrajectory(joint_names=names)
    for k, row in enumerate(rows):
        at = float(k if times is None else times[k])
        start = Duration(sec=int(at), nanosec=round(at % 1 * 1e9))
        message.points.append(JointTrajectoryPoint(positions=row, time_from_start=start))
    return message


def publisher_of(run, kind, topic):
    publisher = run.node.create_publisher(kind, topic, 10)
    run.wait(publisher.get_subscription_count, 60.0, lambda: f'no subscriber of {topic}')
    return publisher


def test_the_nodes_follow_a_path_as_the_simulation_does():
    motion = kr.motion(ROBOT, path=CORNER)
    with Run(ROBOT, seed=3) as run:
        send(run, publisher_of(run, Path, 'reference/path'), path(CORNER))
        run.advance(3.0)
        run.refresh('controller')
        assert run.reported('controller', 'motion') == f'3.00 of {motion.duration:.2f} s'
        assert 0.5 < float(run.reported('controller', 'remaining distance [m]')) < 1.9
        assert run.reported('controller', 'motions planned') == '1'
        run.advance(4.0)
        followed = run.trajectory()
    simulated = kr.simulate(ROBOT, seconds=7.0, seed=3, reference=motion)
    np.testing.assert_allclose(followed.input, simulated.input, atol=1e-12)
    np.testing.assert_allclose(followed.truth, simulated.truth, atol=1e-12)
    np.testing.assert_allclose(followed.truth[-1, :2], [1.0, 1.0], atol=0.1)


@pytest.mark.thorough
def test_what_is_no_motion_is_refused_in_one_line_and_the_loop_goes_on():
    back = path(CORNER)
    for k, pose in enumerate(back.poses):
        pose.header.stamp.sec = 5 - k
    elsewhere = path(CORNER)
    elsewhere.poses[2].header.frame_id = 'third'
    with Run(ROBOT) as run:
        paths = publisher_of(run, Path, 'reference/path')
        trajectories = publisher_of(run, JointTrajectory, 'reference/trajectory')
        states = publisher_of(run, Odometry, 'reference')
        log = run.processes['controller'].output
        run.advance(0.2)
        for publisher, message, reason in (
            (paths, path(CORNER[:1]), 'got 1;'),
            (paths, path([(0.0, 0.0), (np.nan, 1.0)]), 'expected finite positions'),
            (paths, path(CORNER, 'elsewhere'), "got 'elsewhere'"),
            (paths, elsewhere, "got 'third'"),
            (paths, path([(0.0, 0.0), (1e9, 0.0)]), 'at most 60000 steps'),
            (paths, back, 'expected increasing times'),
            (trajectories, trajectory(['x'], [[0.0], [0.0]], [1.0, 1.0]), 'increasing times'),
            (trajectories, trajectory(['wheel'], [[0.0], [1.0]]), "got 'wheel'"),
            (trajectories, trajectory(['x', 'y'], [[0.0], [1.0]]), 'one a joint, got 1'),
            (trajectories, JointTrajectory(joint_names=['x']), 'expected positions'),
            (states, Odometry(), 'publish a path'),
        ):
            publisher.publish(message)
            run.wait(lambda: reason in log(), 60.0, lambda: f'no {reason}: {log()}')  # noqa: B023
        run.advance(0.5)
        run.refresh('controller')
        assert run.reported('controller', 'motions refused') == '10'
        assert run.reported('controller', 'set points refused') == '1'
        assert run.reported('controller', 'motions planned') == '0'
        reason = run.reported('controller', 'reason of the last refusal')
        assert reason == 'reference/trajectory: expected positions'
        assert not run.trajectory().input.any()
        assert 'Traceback' not in log()


@pytest.mark.thorough
def test_a_cart_follows_a_trajectory_from_what_is_held():
    with Run('cart_pole', {'initial_state': [0.0] * 4}) as run:
        trajectories = publisher_of(run, JointTrajectory, 'reference/trajectory')
        run.advance(0.5)
        send(run, trajectories, trajectory(['x'], [[0.3], [0.3]], [3.0, 4.0]))
        run.advance(5.0)
        followed = run.trajectory()
    assert np.abs(followed.truth[-50:, 0] - 0.3).max() < 0.1
    assert np.abs(followed.truth[:, 2]).max() < 0.3


@pytest.mark.thorough
def test_a_new_path_in_the_middle_is_followed_without_a_jump():
    limits = {'transition_time': 0.5}
    with Run(ROBOT, only={'controller': limits}) as run:
        paths = publisher_of(run, Path, 'reference/path')
        send(run, paths, path(CORNER))
        run.advance(2.0)
        send(run, paths, path([(0.5, 0.1), (2.0, 0.1)]))
        run.advance(6.0)
        followed = run.trajectory()
    around = slice(195, 206)
    assert np.abs(np.diff(followed.input[around], axis=0)).max() < 0.6
    np.testing.assert_allclose(followed.truth[-1, :2], [2.0, 0.1], atol=0.15)


@pytest.mark.thorough
def test_a_path_that_a_planner_publishes_again_and_again_does_not_slow_the_robot():
    with Run(ROBOT, seed=2) as run:
        paths = publisher_of(run, Path, 'reference/path')
        for k in range(12):  # from where the robot is, as a planner does
            x, y = (0.0, 0.0) if k == 0 else run.trajectory().estimate[-1, :2]
            send(run, paths, path([(x, y), (0.5 * (x + 3.0), 0.5 * y), (3.0, 0.0)]))
            run.advance(0.5)
        followed = run.trajectory()
    speeds = followed.truth[150:450, 2]
    assert speeds.min() > 0.35 and speeds.max() < 0.65
    assert np.abs(np.diff(followed.input, axis=0)).max() < 0.5
    assert followed.truth[-1, 0] > 2.4


@pytest.mark.thorough
def test_the_example_of_the_page_follows_its_path():
    file = Path_(__file__).parents[2] / 'docs' / 'examples' / 'robot_on_a_path.yaml'
    with Run(str(file)) as run:
        paths = publisher_of(run, Path, 'reference/path')
        send(run, paths, path([(0.0, 0.0), (3.0, 0.0), (3.0, 3.0)]))
        run.advance(12.0)
        followed = run.trajectory()
    np.testing.assert_allclose(followed.truth[-1, :2], [3.0, 3.0], atol=0.1)
    assert 0.7 < followed.truth[:, 2].max() < 0.95


@pytest.mark.thorough
def test_a_path_that_begins_elsewhere_is_reached_first():
    close = {'state_cost': [20.0, 20.0, 0.1, 1.0, 0.1], 'input_cost': [0.1, 0.1]}
    with Run(ROBOT, close) as run:
        paths = publisher_of(run, Path, 'reference/path')
        run.advance(0.2)
        send(run, paths, path([(0.0, 2.0), (2.0, 2.0)]))
        run.advance(13.0)
        followed = run.trajectory()
    np.testing.assert_allclose(followed.truth[-1, :2], [2.0, 2.0], atol=0.15)
    assert np.linalg.norm(followed.truth[:, :2] - [0.0, 2.0], axis=1).min() < 0.15


@pytest.mark.thorough
@pytest.mark.parametrize('rate', [1, 5])
def test_masses_that_get_their_path_again_and_again_do_not_run_away(rate):
    line = [(0.0, 0.0), (3.0, 0.0)]
    with Run('mass_spring_damper_2d', {'initial_state': [0.0] * 4}, seed=1) as run:
        paths = publisher_of(run, Path, 'reference/path')
        for _ in range(8 * rate):
            send(run, paths, path(line))
            run.advance(1.0 / rate)
        followed = run.trajectory()
    assert np.abs(followed.truth[:, 0]).max() < 3.6
    assert np.abs(followed.input).max() < 20.0
    assert followed.truth[-1, 0] > 2.0


@pytest.mark.thorough
def test_a_cart_pole_that_gets_its_trajectory_again_and_again_stands():
    with Run('cart_pole', {'initial_state': [0.0] * 4}, seed=1) as run:
        trajectories = publisher_of(run, JointTrajectory, 'reference/trajectory')
        for k in range(5):
            left = max(2.0 - 0.4 * k, 0.5)
            send(run, trajectories, trajectory(['x'], [[0.3]], [left]))
            run.advance(0.4)
        run.advance(2.0)
        followed = run.trajectory()
    assert np.abs(followed.truth[:, 2]).max() < 0.4
    np.testing.assert_allclose(followed.truth[-1, 0], 0.3, atol=0.1)
