# SPDX-License-Identifier: Apache-2.0
"""The loop loses stability exactly at the computed margins.

An unstable pendulum is held by the regulator, once with the true state and once with the
estimate. The plant's actuator is then given more gain, less gain, or a delay, unknown to the
other nodes. Noise is so small that growth or decay can be read from the states directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from kalman_ros import scenario as scenarios
from kalman_ros.analysis.checks import Check
from kalman_ros.control.margins import margins

from . import Findings, close
from .loops import growth, lqg_loop, lqr_loop
from .stability_boundary import Trial, root, stability_boundary
from .study_run import ON_TRUTH, StudyRun
from .systems import linear

#: The noise is smaller than the estimator's by this factor; its gain is the same.
SMALL = 1e-10
LOOPS = {'LQR': lqr_loop, 'LQG': lqg_loop}
#: Parameter of each search, its start and its factor.
SEARCHES = {
    'gain, up': ('actuator_gain', 1.0, 1.5),
    'gain, down': ('actuator_gain', 1.0, 1 / 1.5),
    'delay': ('actuator_delay', 0.05, 1.5),
}


def study(size: float = 1.0) -> Findings:
    """Search the six boundaries; a trial lasts 8 s, or 6 s at a small size."""
    system = linear(
        {'angle': 'rad', 'rate': 'rad/s'}, [[0, 1], [4, 0]], [[0], [1]], [0, SMALL**2], [[1, 0]],
        [0.1 * SMALL], rate=20.0, reading__rate=20.0, state_cost=[10.0, 1.0],
        initial_state=[0.1, 0.0], filter='steady_state',
    )  # fmt: skip
    seconds = 8.0 if size >= 1.0 else 6.0
    checks: list[Check] = []
    trials: dict[tuple[str, str], list[Trial]] = {}
    for name in LOOPS:
        remaps = ON_TRUTH if name == 'LQR' else {}
        with StudyRun(system, remaps=remaps) as run:
            for search, (parameter, start, factor) in SEARCHES.items():
                run.set_parameter('actuator_gain', [1.0])  # reset after the last search
                predicted = predict(system, name)[search]
                boundary, trials[name, search] = stability_boundary(
                    run, parameter, start, factor, seconds
                )
                unit = 's' if search == 'delay' else ''
                # the search stops within 0.1 %; the rest is for modes that are not yet gone
                checks.append(
                    close(f'{name}: {search}', unit, predicted, boundary, 0.01 * predicted)
                )
    return Findings(checks, lambda path: _draw(checks, trials, path))


def predict(system: dict[str, Any], name: str) -> dict[str, float]:
    """Return the margins of a loop.

    The delay margin is the delay at which the sampled loop is at the stability boundary: a
    fractional delay also smooths the input, which the delay margin of a fixed loop ignores.
    """
    scenario, loop = scenarios.build(system), LOOPS[name]
    known = margins(loop(scenario))
    near = known.delay.value
    return {
        'gain, up': known.upper_gain.value,
        'gain, down': known.lower_gain.value,
        'delay': root(lambda delay: growth(loop(scenario, delay)), 0.8 * near, 1.2 * near),
    }


def _draw(checks: Sequence[Check], trials: dict[tuple[str, str], list[Trial]], path: Path) -> None:
    from kalman_ros.report.style import ESTIMATE, INPUT, READING, picture

    with picture(path, 1, 2, (9.5, 3.4)) as (_, ((sizes, rates),)):
        ladder = trials['LQG', 'delay']
        for trial in ladder[: 1 + next(i for i, t in enumerate(ladder) if t.rate > 0.0)]:
            grows = trial.rate > 0.0
            sizes.plot(trial.time, trial.size, color=INPUT if grows else ESTIMATE, lw=0.9)
            sizes.annotate(
                f' {1000 * trial.value:.0f} ms', (trial.time[-1], trial.size[-1]), fontsize=7
            )
        sizes.set_yscale('log')
        sizes.set_ylim(1e-6, 1e2)
        sizes.set_ylabel('norm of the state (log)')
        sizes.set_title('LQG with delayed input')
        for check, search in zip(checks, trials.values()):
            of = sorted(search, key=lambda trial: trial.value)
            across = [trial.value / check.expected for trial in of]
            loop, change = check.name.split(': ')
            rates.plot(
                across, [trial.rate for trial in of], ('o' if loop == 'LQR' else 's') + '-',
                ms=3.5, lw=0.8, mfc='white' if loop == 'LQR' else None, label=check.name,
                color={'gain, up': INPUT, 'gain, down': READING, 'delay': ESTIMATE}[change],
            )  # fmt: skip
        rates.axhline(0.0, color='black', lw=0.8)
        rates.axvline(1.0, color='black', lw=0.8, ls=':')
        rates.set_xlim(0.5, 1.5)
        rates.set_ylim(-2.0, 2.0)
        rates.set_xlabel('gain or delay / computed margin')
        rates.set_ylabel('measured growth [1/s]')
        rates.set_title('Growth begins at the margin')
        rates.legend(loc='center left', bbox_to_anchor=(1.0, 0.5))
