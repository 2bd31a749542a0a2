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

import kalman_ros as kr

FOLDER = Path(__file__).parent


def run(
    name, start='', overrides=None, *, seconds=10.0, seed=0, lockstep=True, path=None, record=None
):
    """Run the loop of a robot of this folder from a keyframe; return a `kr.Trajectory`.

    With a ``path`` (N, 2), it is published on ``reference/path`` before the first step; ``record`` is a
    folder for a recording.
    """
    os.environ['PYTHONPATH'] = os.pathsep.join([str(FOLDER), os.environ.get('PYTHONPATH', '')])
    nodes = ('estimator', 'controller')
    parameters = str(FOLDER / f'{name}.yaml')
    options = {'start': start, 'seed': seed, 'lockstep': lockstep, 'run_until': seconds}
    program = [sys.executable, FOLDER / 'plant.py', FOLDER / f'{name}.xml', '--ros-args']
    for key, value in options.items():
        program += ['-p', f'{key}:={yaml.safe_dump(value).split()[0]}']
    with kr.Run(
        parameters, overrides, nodes=nodes, lockstep=lockstep, recording=record
    ) as loop:
        if path is not None:
            publish(loop, path)
        plant = subprocess.Popen(program, env=loop.environment)
        while plant.poll() is None:
            loop.spin()
        loop.spin(0.5)
        return loop.trajectory()


def publish(loop, path):
    """Publish a path of positions in the plane."""
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Path as PathMessage

    message = PathMessage()
    for x, y in path:
        pose = PoseStamped()
        pose.pose.position.x, pose.pose.position.y = float(x), float(y)
        message.poses.append(pose)
    publisher = loop.node.create_publisher(PathMessage, 'reference/path', 1)
    loop.wait(publisher.get_subscription_count, 10.0, lambda: 'no controller for the path')
    publisher.publish(message)


def report(loop, name):
    """Print errors and the largest values of a run beside what the estimator claims."""
    space = kr.load(str(FOLDER / f'{name}.yaml')).model.state
    error = space.subtract(loop.estimate, loop.truth)
    claimed = np.sqrt(np.mean(np.diagonal(loop.covariance, axis1=1, axis2=2), axis=0))
    nees = np.einsum('ki,kij,kj->k', error, np.linalg.inv(loop.covariance), error)
    print(f'{len(loop.time)} steps, {loop.time[-1]:.1f} s; NEES / {space.size}: '
          f'{nees.mean() / space.size:.2f}; input at most {np.abs(loop.input).max():.2f}')
    for i, (state, unit) in enumerate(zip(space.names, space.units)):
        rms = np.sqrt(np.mean(error[:, i] ** 2))
        print(f'{state:>6} [{unit}]: RMS error {rms:.4f}, claimed {claimed[i]:.4f}, '
              f'{loop.truth[:, i].min():.3f} to {loop.truth[:, i].max():.3f}, '
              f'at the end {loop.truth[-1, i]:.4f}')


def main():
    """Run a robot and report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('name')
    parser.add_argument('start', nargs='?', default='')
    parser.add_argument('--seconds', type=float, default=10.0)
    parser.add_argument('--seed', type=int, default=0)
    parser.add_argument('--realtime', action='store_true')
    parser.add_argument('--path', help='points of a path, for example 0,0 3,0 3,3', nargs='*')
    parser.add_argument('--record', metavar='DIR', help='a folder for a recording')
    parser.add_argument('-p', action='append', default=[], metavar='NAME:=VALUE')
    options = parser.parse_args()
    values = (text.split(':=') for text in options.p)
    overrides = {name: yaml.safe_load(value) for name, value in values}
    path = [[float(x) for x in point.split(',')] for point in options.path or ()]
    loop = run(
        options.name, options.start, overrides, seconds=options.seconds, seed=options.seed,
        lockstep=not options.realtime, path=path or None, record=options.record,
    )
    report(loop, options.name)


if __name__ == '__main__':
    main()
