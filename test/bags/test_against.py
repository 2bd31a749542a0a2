# SPDX-License-Identifier: Apache-2.0
"""A replay beside another estimator's output in the recording, and beside true poses."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rclpy')

from recorded_bags import of_twist, written

from kalman_ros.bags.replay import replay
from kalman_ros.programs.from_robot_localization.program import main as translate
from kalman_ros.programs.replay.program import main

SPEED, TURN, SECONDS = 1.0, 0.2, 40.0
JUMP = 25.0
TOPICS = {
    'odom': 'nav_msgs/Odometry',
    'odometry/filtered': 'nav_msgs/Odometry',
    'truth': 'geometry_msgs/PoseStamped',
    'words': 'geometry_msgs/TwistStamped',
    'alone': 'geometry_msgs/PoseStamped',
}
ROBOT = {
    'model': 'robot_2d',
    'sensors': ['odometry'],
    'odometry.noise': [0.02, 0.02, 0.02],
    'frame': 'odom',
    'initial_estimate': [0.0, 0.0, 0.0, SPEED, 0.0, TURN, 0.0, SPEED * TURN],
    'initial_std': [0.01, 0.01, 0.01, 0.1, 0.1, 0.1, 0.1, 0.1],
}


def place(seconds):
    a = TURN * seconds
    return SPEED / TURN * np.sin(a), SPEED / TURN * (1.0 - np.cos(a)), a


def of_pose(x, y, yaw, frame, variance=None):
    def fill(message):
        message.header.frame_id = frame
        pose = message.pose if variance is None else message.pose.pose
        pose.position.x, pose.position.y = float(x), float(y)
        pose.orientation.z, pose.orientation.w = np.sin(yaw / 2), np.cos(yaw / 2)
        if variance is not None:
            message.pose.covariance[:] = (variance * np.eye(6)).ravel()

    return fill


def without_rotation(message):
    message.pose.orientation.w = 0.0


def in_the_body(fill):
    def both(message):
        message.child_frame_id = 'base_link'
        fill(message)

    return both


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a recording of wheels, of another filter that jumps by 2 m, and of the truth."""
    rng, entries = np.random.default_rng(1), []
    for seconds in np.arange(0.0, SECONDS, 0.05):
        noisy = rng.normal(scale=0.02, size=3)
        twist = of_twist(SPEED + noisy[0], noisy[1], 0.0, turn=TURN + noisy[2])
        entries.append((seconds, 'odom', in_the_body(twist)))
        x, y, yaw = place(seconds)
        entries.append((seconds, 'truth', of_pose(x, y, yaw, 'odom')))
        off = 2.0 if seconds >= JUMP else 0.0
        entries.append((seconds, 'odometry/filtered', of_pose(x + off, y, yaw, 'odom', 0.01)))
    entries.append((1.0, 'words', lambda message: None))
    entries.append((2.0, 'alone', of_pose(0.0, 0.0, 0.0, 'odom')))
    entries.append((3.0, 'alone', of_pose(np.nan, 0.0, 0.0, 'odom')))
    entries.append((4.0, 'alone', without_rotation))
    topics = {f'/{name}': kind for name, kind in TOPICS.items()}
    entries = [(seconds, f'/{topic}', fill) for seconds, topic, fill in entries]
    return written(tmp_path_factory.mktemp('against') / 'bag', topics, entries)


def of_robot(folder):
    """Return the arguments for the robot, with the results in a folder."""
    lines = '\n'.join(f'    {name}: {json.dumps(value)}' for name, value in ROBOT.items())
    (folder / 'robot.yaml').write_text(f'/**:\n  ros__parameters:\n{lines}\n')
    return ['--params-file', str(folder / 'robot.yaml'), '--out', str(folder / 'out')]


@pytest.mark.slow
def test_both_are_compared_with_the_truth_and_with_each_other(bag):
    run = replay(bag, ROBOT, against='odometry/filtered', truth='truth')
    assert run.truth is None and len(run.true_poses.time) == len(run.against.time) == 800
    assert run.against.frame == run.poses().frame == 'odom'
    np.testing.assert_allclose(run.against.covariance[0], 0.01 * np.eye(3))
    assert run.true_poses.covariance is None
    assert not any('publish_rate' in note for note in run.notes)


@pytest.mark.slow
def test_estimates_of_a_timer_are_compared_with_a_note(bag):
    run = replay(bag, {**ROBOT, 'publish_rate': 10.0}, against='odometry/filtered', end=4.0)
    assert any('publish_rate:=0.0 compares' in note for note in run.notes)
    run = replay(bag, {**ROBOT, 'publish_rate': 10.0}, end=4.0)
    assert not run.notes


@pytest.mark.slow
def test_the_program_prints_where_they_part_most_and_why(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv('COLUMNS', '100')
    words = ['--against', 'odometry/filtered', '--truth', 'truth']
    with pytest.raises(SystemExit):
        main([str(bag), *of_robot(tmp_path), *words])
    said = ' '.join(capsys.readouterr().out.split())
    assert 'Poses beside others: RMS in m, headings in deg' in said
    assert 'odometry/filtered jumps by ' in said
    assert 'They part most at ' in said and ' sigma of the estimate' in said
    page = (Path(__file__).parents[2] / 'docs' / 'how_to' / 'record_and_replay.md').read_text()
    (shown,) = re.findall(r'^(They part most.*?)\n```$', page, re.M | re.S)
    assert ' '.join(shown.split()) in said
    found = json.loads((tmp_path / 'out' / 'summary.json').read_text())['against']
    assert set(found) == {
        'estimate - truth', 'odometry/filtered - truth', 'estimate - odometry/filtered',
        'estimate - odometry/filtered, aligned',
    }  # fmt: skip
    theirs = found['odometry/filtered - truth']
    # 2 m for 15 of 40 s
    assert theirs['ate'] == pytest.approx(2.0 * np.sqrt(15.0 / 40.0), rel=0.01)
    assert theirs['nees'] == pytest.approx(4.0 / 0.01 * 15.0 / 40.0 / 3.0, rel=0.01)
    assert found['estimate - truth']['ate'] < 1.0
    assert (tmp_path / 'out' / 'against.png').exists()


@pytest.mark.thorough
@pytest.mark.slow
def test_what_is_not_compared_is_told(bag, tmp_path, capsys):
    with pytest.raises(SystemExit):
        main([str(bag), *of_robot(tmp_path), '--against', 'alone', '--truth', 'truth'])
    said = ' '.join(capsys.readouterr().out.split())
    assert (
        'There is no time at which the estimate and alone are both known, which takes two poses.'
        in said
    )
    assert 'There is no time at which alone and the truth are both known.' in said
    assert '2 messages of alone are not compared: without a stamp, not finite' in said
    found = json.loads((tmp_path / 'out' / 'summary.json').read_text())['against']
    assert set(found) == {'estimate - truth'}
    assert found['estimate - truth']['seconds'] == pytest.approx(SECONDS, abs=0.2)


@pytest.mark.parametrize(
    ('topic', 'why'),
    [
        ('nowhere', 'against: the recording has no topic /nowhere'),
        ('words', 'against: expected nav_msgs/Odometry, geometry_msgs/PoseWithCovarianceStamped'),
    ],
)
def test_what_is_no_pose_is_refused(bag, topic, why):
    with pytest.raises(ValueError, match=why):
        replay(bag, ROBOT, against=topic)


@pytest.mark.thorough
@pytest.mark.slow
def test_a_file_of_theirs_is_compared_with_their_filter(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('COLUMNS', '100')
    flags = ['false'] * 15
    for used in (6, 7, 11):
        flags[used] = 'true'
    theirs = tmp_path / 'ekf.yaml'
    theirs.write_text(
        'ekf_filter_node:\n  ros__parameters:\n    two_d_mode: true\n    odom0: /odom\n'
        f'    odom0_config: [{", ".join(flags)}]\n    publish_tf: false\n'
    )
    with pytest.raises(SystemExit):
        translate([str(theirs), '--compare', str(bag), '--truth', '/truth'])
    said = ' '.join(capsys.readouterr().out.split())
    assert '/odometry/filtered - truth' in said and '/odometry/filtered jumps by ' in said
    assert 'publish_rate' not in said.partition('/odometry/filtered - truth')[2]  # at readings
    assert (tmp_path / 'out' / 'ekf_kalman_ros' / 'replay' / 'against.png').exists()


@pytest.mark.parametrize(
    ('words', 'why'),
    [
        (['--against', 'x'], '--against, --truth: expected a recording, --compare BAG'),
        (['--compare', 'nowhere'], "there is no recording 'nowhere'"),
    ],
)
def test_a_comparison_that_cannot_be_is_refused_in_one_line(tmp_path, capsys, words, why):
    with pytest.raises(SystemExit) as end:
        translate([str(tmp_path / 'ekf.yaml'), *words])
    assert end.value.code == 2
    error = capsys.readouterr().err
    assert why in error and error.count('\n') == 1
