# SPDX-License-Identifier: Apache-2.0
"""The ANEES of inertial navigation from a heading that is wrong by 90 degrees, over many drives.

    python test/heading_survey.py [--runs 200] [--first 0] [--filters gaussian_sum ekf]

prints the ANEES with its band of 99.9 %, and the largest error of the heading. The exit code is 1
if the first filter is outside.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

if __name__ == '__main__':
    sys.path.insert(0, str(Path(__file__).parents[1]))

from kalman_ros import sensors
from kalman_ros.core import Gaussian, TimedSensor
from kalman_ros.core import rotations as so3
from kalman_ros.estimators import build_filter
from kalman_ros.estimators.batch_estimator import for_many
from kalman_ros.estimators.consistency import chi_square_bounds, nees
from kalman_ros.estimators.plan import Plan
from kalman_ros.models.inertial import Inertial

MODEL, STEP, STEPS = Inertial(1e-5, 1e-3, 1e-8, 1e-6), 0.05, 240
STD = np.repeat([0.5, 0.03, 0.3, 0.005, 0.05], 3)
#: Of the heading; the drive begins with it as an error.
WRONG = np.pi / 2


def first_heading():
    """Return the state (15,) that is believed at first."""
    start = np.zeros(15)
    start[5] = 0.7
    return start


@dataclass(frozen=True)
class Drives:
    """Inputs (steps, N, 6) and fixes (steps, N, 3) of N drives, and the states at their ends."""

    inputs: np.ndarray
    fixes: np.ndarray
    ends: np.ndarray

    def of(self, which):
        """Return some of the drives, or one."""
        return Drives(self.inputs[:, which], self.fixes[:, which], self.ends[which])


def drives(runs, first=0):
    """Return drives, each with the noise of a seed of its own."""
    space, gravity = MODEL.state, MODEL.equilibrium.input[3:]
    Q = STEP * MODEL.noise_density(np.zeros(15)).diagonal()
    generators = [np.random.default_rng(seed) for seed in range(first, first + runs)]
    wrong = np.array([rng.normal(size=15) for rng in generators]) * STD
    wrong[:, 5] = WRONG
    noise = np.array([rng.normal(size=(STEPS, 18)) for rng in generators]).swapaxes(0, 1)
    x, inputs, fixes = space.add(first_heading(), wrong), [], []
    for k, drawn in enumerate(noise):
        t = k * STEP
        pushed = [1.5 * np.cos(0.8 * t), 0.5 * np.sin(0.5 * t), 0.0]
        rate = [0.05 * np.sin(t), 0.05 * np.cos(0.7 * t), 0.4 * np.sin(0.3 * t)]
        force = pushed + so3.rotate_back(x[:, 3:6], gravity)
        u = np.hstack((rate + x[:, 9:12], force + x[:, 12:]))
        x = space.add(MODEL.step(x, u, STEP), drawn[:, :15] * np.sqrt(Q))
        inputs.append(u)
        fixes.append(x[:, :3] + 0.5 * drawn[:, 15:])
    return Drives(np.array(inputs), np.array(fixes), x)


def scores(kind, driven, model=MODEL):
    """Return the NEES over its dimension, and the error of the heading, of each drive (N,).

    Of a ``model`` whose state is that of `MODEL`, or has roll, pitch and yaw in place of the
    rotation.
    """
    space, truth = model.state, driven.ends
    if not space.rotations:
        truth = np.hstack((truth[:, :3], so3.to_euler(truth[:, 3:6]), truth[:, 6:]))
    gnss = sensors.build('states', space, [0.5] * 3, {'measures': ['x', 'y', 'z']})
    gnss.name = 'gnss'
    filter = build_filter(kind, Plan(model, {'gnss': TimedSensor(gnss, 5.0)}, 1.0 / STEP))
    P = np.diag(np.where(np.arange(15) == 5, WRONG, STD) ** 2)
    if not filter.mixture:
        count = len(truth)
        start = Gaussian(np.tile(first_heading(), (count, 1)), np.tile(P, (count, 1, 1)))
        mean, covariance = _last(for_many(filter), start, driven, gnss)
    else:
        every = (driven.of(which) for which in range(len(truth)))
        start = Gaussian(first_heading(), P)
        mean, covariance = map(np.array, zip(*(_last(filter, start, o, gnss) for o in every)))
    error = space.subtract(truth, mean)
    return nees(error, covariance) / 15.0, np.abs(error[:, 5])


def _last(filter, belief, driven, gnss):
    """Return mean and covariance at the end; every fourth step has a fix."""
    for k, (u, fix) in enumerate(zip(driven.inputs, driven.fixes)):
        belief = filter.predict(belief, u, STEP)
        if k % 4 == 3:
            belief = filter.correct(belief, fix, gnss).posterior
    return belief.mean, belief.covariance


def band(runs):
    """Return the bounds of the ANEES of a consistent filter."""
    return chi_square_bounds(1.0, 2.0 / (15 * runs), 0.001)


def main():
    """Print a line for each filter."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--runs', type=int, default=200, metavar='N')
    parser.add_argument('--first', type=int, default=0, metavar='N')
    parser.add_argument('--filters', nargs='+', default=['gaussian_sum', 'ekf'])
    options = parser.parse_args()
    low, high = band(options.runs)
    driven, outside = drives(options.runs, options.first), []
    for kind in options.filters:
        found, headings = scores(kind, driven)
        outside.append(not low < found.mean() < high)
        print(
            f'{kind}: ANEES {found.mean():.3f} of {options.runs} runs, '
            f'{low:.3f} to {high:.3f} allowed; heading off by {headings.max():.2f} rad at most',
            flush=True,
        )
    sys.exit(outside[0])


if __name__ == '__main__':
    main()
