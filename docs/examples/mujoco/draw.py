# SPDX-License-Identifier: Apache-2.0
"""Draws what MuJoCo's plants do: ``docs/mujoco.png`` and the animation ``docs/mujoco.gif``.

python3 draw.py
"""

import numpy as np
from matplotlib import animation
from matplotlib import pyplot as plt
from run import FOLDER, circle_of, path_of, run

PATH = [(0, 0), (3, 0), (3, 3), (0, 3)]
LIMITS = {'law': 'mpc', 'state_limit.x': [-0.75, 0.75], 'state_limit.theta': [-0.1, 0.1]}
FAR = {'initial_estimate': [0.7, 0.0, 0.0, 0.0]}
TRUTH, WISH, LIMIT = 'tab:blue', '0.6', 'tab:red'


def runs():
    """Return the four runs: the cart with and without limits, the robot, the quadrotor."""
    return (
        run('cart_pole', 'far', {**FAR, **LIMITS}, seconds=4.0),
        run('cart_pole', 'far', FAR, seconds=4.0),
        run('robot', seconds=24.0, reference=path_of(PATH)),
        run('quadrotor', seconds=7.0, reference=circle_of(1.0, 5.0)),
    )


def circle():
    """Return the positions of the wished circle."""
    angle = np.linspace(0.0, 2.0 * np.pi)
    return np.sin(angle), 1.0 - np.cos(angle)


def picture(limited, free, robot, quadrotor):
    """Draw the paths and the limits."""
    figure, axes = plt.subplots(2, 2, figsize=(9, 6), layout='constrained')
    limits = (axes[0, 0], 0, 'x [m]', 0.75), (axes[1, 0], 2, 'theta [rad]', 0.1)
    for ax, index, name, limit in limits:
        ax.axhline(limit, color=LIMIT, lw=0.8, label='limit')
        ax.axhline(-limit, color=LIMIT, lw=0.8)
        ax.plot(free.time, free.truth[:, index], WISH, label='lqr')
        ax.plot(limited.time, limited.truth[:, index], TRUTH, label='mpc')
        ax.set(xlabel='time [s]', ylabel=name, xlim=(0.0, 4.0))
        ax.legend()
    axes[0, 0].set_title('cart-pole: limits of track and lean')
    axes[0, 1].plot(*np.transpose(PATH), WISH, label='path')
    axes[0, 1].plot(*robot.truth[:, :2].T, TRUTH, label='true position')
    axes[0, 1].set(title='robot on wheels: a path', xlabel='x [m]', ylabel='y [m]')
    axes[1, 1].plot(*circle(), WISH, label='motion')
    axes[1, 1].plot(*quadrotor.truth[:, :2].T, TRUTH, label='true position')
    axes[1, 1].set(title='quadrotor: a circle', xlabel='x [m]', ylabel='z [m]')
    for ax in axes[:, 1]:
        ax.set_aspect('equal', 'datalim')
        ax.legend()
    figure.savefig(FOLDER.parents[1] / 'mujoco.png', dpi=90)
    plt.close(figure)


def animate(limited, robot, quadrotor, frames=84):
    """Draw the three robots side by side, each over its whole run."""
    figure, axes = plt.subplots(1, 3, figsize=(8, 2.9), layout='constrained')
    for ax in axes:
        ax.set_aspect('equal')
        ax.tick_params(labelsize=6)
    axes[0].set(xlim=(-1.1, 1.1), ylim=(-0.5, 1.3), title='cart-pole keeps limits')
    axes[1].set(xlim=(-0.6, 3.6), ylim=(-0.5, 3.5), title='robot follows a path')
    axes[2].set(xlim=(-1.6, 1.6), ylim=(-0.6, 2.6), title='quadrotor flies a circle')
    axes[0].plot([-0.75, -0.75, np.nan, 0.75, 0.75], [-0.3, 0.3, np.nan, -0.3, 0.3], LIMIT)
    axes[0].axhline(-0.08, color=WISH, lw=1)
    axes[1].plot(*np.transpose(PATH), WISH)
    axes[2].plot(*circle(), WISH)
    trails = [ax.plot([], [], TRUTH, lw=1, alpha=0.6)[0] for ax in axes]
    bodies = [ax.plot([], [], 'k', lw=4, solid_capstyle='round')[0] for ax in axes]
    poles = [ax.plot([], [], 'tab:orange', lw=3, solid_capstyle='round')[0] for ax in axes]

    def show(frame):
        k = [
            int(frame / (frames - 1) * (len(run.time) - 1)) for run in (limited, robot, quadrotor)
        ]
        x, _, theta, _ = limited.truth[k[0]]
        tip = x - 0.8 * np.sin(theta), 0.8 * np.cos(theta)
        bodies[0].set_data([x - 0.1, x + 0.1], [0.0, 0.0])
        poles[0].set_data([x, tip[0]], [0.0, tip[1]])
        x, y, _, heading, _ = robot.truth[k[1]]
        ahead = np.array([np.cos(heading), np.sin(heading)])
        aside = np.array([-ahead[1], ahead[0]])
        axle = np.array([[x, y] - 0.2 * aside, [x, y] + 0.2 * aside])
        bodies[1].set_data(*axle.T)
        poles[1].set_data(*np.array([[x, y], [x, y] + 0.35 * ahead]).T)
        trails[1].set_data(*robot.truth[: k[1] + 1, :2].T)
        *place, pitch = quadrotor.truth[k[2], :3]
        arm = 0.3 * np.array([np.cos(pitch), -np.sin(pitch)])
        up = 0.15 * np.array([np.sin(pitch), np.cos(pitch)])
        bodies[2].set_data(*np.transpose([np.subtract(place, arm), np.add(place, arm)]))
        poles[2].set_data(*np.transpose([place, np.add(place, up)]))
        trails[2].set_data(*quadrotor.truth[: k[2] + 1, :2].T)
        return [*trails, *bodies, *poles]

    film = animation.FuncAnimation(figure, show, frames=frames)
    film.save(FOLDER.parents[1] / 'mujoco.gif', writer=animation.PillowWriter(fps=14), dpi=80)


if __name__ == '__main__':
    limited, free, robot, quadrotor = runs()
    picture(limited, free, robot, quadrotor)
    animate(limited, robot, quadrotor)
