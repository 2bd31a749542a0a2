# SPDX-License-Identifier: Apache-2.0
"""Estimator and controller of kalman_ros around the plant by MuJoCo, as processes, to arrays.

python3 run.py cart_pole leaning --seconds 10 -p law:=mpc
"""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path as PathMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

import kalman_ros as kr

FOLDER = Path(__file__).parent


def run(
    name,
    start='',
    overrides=None,
    *,
    seconds=10.0,
    seed=0,
    lockstep=True,
    parameters=None,
    reference=None,
    record=None,
):
    """Run the loop of a robot of this folder from a keyframe; return its topics as arrays.

    A ``reference``, of `path_of` or `circle_of`, is published before the first step, and
    ``record`` is a folder for a recording.
    """
    modules = [str(FOLDER), os.environ.get('PYTHONPATH', '')]  # of the quadrotor
    os.environ['PYTHONPATH'] = os.pathsep.join(filter(None, modules))
    nodes = ('estimator', 'controller')
    options = {'start': start, 'seed': seed, 'lockstep': lockstep, 'run_until': float(seconds)}
    program = [sys.executable, FOLDER / 'plant.py', FOLDER / f'{name}.xml', '--ros-args']
    for key, value in options.items():
        program += ['-p', f'{key}:={yaml.safe_dump(value).split()[0]}']
    with kr.Run(
        file_of(name, parameters), overrides, nodes=nodes, lockstep=lockstep, recording=record
    ) as loop:
        if reference is not None:
            publish(loop, *reference)
        plant = subprocess.Popen(program, env=loop.environment)
        while plant.poll() is None:
            loop.spin()
        if plant.returncode:
            raise RuntimeError(f'the plant ended with {plant.returncode}')
        steps, received = round(seconds * loop.scenario.rate) + 1, -1
        while received < len(loop.trajectory().time) < steps:  # until nothing more arrives
            received = len(loop.trajectory().time)
            loop.spin(2.0)
        return loop.trajectory()


def file_of(name, parameters=None):
    """Return the parameter file of a robot: that of its name, or another one of this folder."""
    return str(FOLDER / (parameters or f'{name}.yaml'))


def path_of(points):
    """Return positions in the plane as a path."""
    message = PathMessage()
    for x, y in points:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        message.poses.append(pose)
    return 'reference/path', message


def circle_of(radius, seconds):
    """Return a circle of the states x and z from rest to rest, whose jerk is zero at both ends."""
    times = np.arange(0.0, seconds + 0.05, 0.1)
    turn = 2.0 * np.pi * np.polyval([-20.0, 70.0, -84.0, 35.0, 0, 0, 0, 0], times / seconds)
    rows = radius * np.stack((np.sin(turn), 1.0 - np.cos(turn)), axis=-1)
    return trajectory_of(['x', 'z'], 1.0 + times, rows)


def trajectory_of(names, times, rows):
    """Return values of states by name, at times in seconds, as a trajectory."""
    message = JointTrajectory(joint_names=names)
    for time, row in zip(times, rows):
        start = Duration(sec=int(time), nanosec=round(time % 1 * 1e9))
        values = [float(value) for value in row]
        message.points.append(JointTrajectoryPoint(positions=values, time_from_start=start))
    return 'reference/trajectory', message


def publish(loop, topic, message):
    """Publish a reference, and wait until it is received."""
    publisher = loop.node.create_publisher(type(message), topic, 1)
    loop.wait(publisher.get_subscription_count, 10.0, lambda: f'no subscriber of {topic}')
    publisher.publish(message)
    publisher.wait_for_all_acked()


def report(loop, name, parameters=None):
    """Print errors and the largest values of a run beside what the estimator claims."""
    space = kr.load(file_of(name, parameters)).model.state
    error = space.subtract(loop.estimate, loop.truth)
    claimed = np.sqrt(np.mean(np.diagonal(loop.covariance, axis1=1, axis2=2), axis=0))
    nees = np.einsum('ki,kij,kj->k', error, np.linalg.inv(loop.covariance), error)
    print(
        f'{len(loop.time)} steps, {loop.time[-1]:.1f} s; NEES / {space.size}: '
        f'{nees.mean() / space.size:.2f}; input at most {np.abs(loop.input).max():.2f}'
    )
    for i, (state, unit) in enumerate(zip(space.names, space.units)):
        rms = np.sqrt(np.mean(error[:, i] ** 2))
        print(
            f'{state:>6} [{unit}]: RMS error {rms:.4f}, claimed {claimed[i]:.4f}, '
            f'{loop.truth[:, i].min():.3f} to {loop.truth[:, i].max():.3f}, '
            f'at the end {loop.truth[-1, i]:.4f}'
        )


def main():
    """Run a robot and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('name')
    parser.add_argument('start', nargs='?', default='')
    parser.add_argument('--params-file', help='of this folder (default: NAME.yaml)')
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--realtime', action='store_true')
    parser.add_argument('--path', nargs='*', help='points, for example 0,0 3,0 3,3')
    parser.add_argument('--circle', nargs=2, type=float, metavar=('RADIUS', 'SECONDS'))
    parser.add_argument('--record', metavar='DIR', help='a folder for a recording')
    parser.add_argument('-p', action='append', default=[], metavar='NAME:=VALUE')
    options = parser.parse_args()
    values = (text.split(':=') for text in options.p)
    overrides = {name: yaml.safe_load(value) for name, value in values}
    reference = None
    if options.path:
        reference = path_of([map(float, point.split(',')) for point in options.path])
    elif options.circle:
        reference = circle_of(*options.circle)
    loop = run(
        options.name,
        options.start,
        overrides,
        seconds=options.seconds,
        seed=options.seed,
        lockstep=not options.realtime,
        parameters=options.params_file,
        reference=reference,
        record=options.record,
    )
    report(loop, options.name, options.params_file)


if __name__ == '__main__':
    main()
