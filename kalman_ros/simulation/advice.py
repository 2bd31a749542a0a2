# SPDX-License-Identifier: Apache-2.0
"""What a person should know of a design, in sentences: what it rests on, and what may go wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import degrees

from kalman_ros.control.margins import Margins
from kalman_ros.control.stability import Mode

from .design import DesignReport, Regulator
from .input_loops import InputLoops, Loop

#: A disk margin below this is small: gain and phase bear less than 4.4 dB and 28 degrees.
SMALL_DISK = 0.5


def notes(report: DesignReport) -> tuple[str, ...]:
    """Return what the numbers of a report rest on."""
    return tuple(_notes(report))


def warnings(report: DesignReport, latency: float) -> tuple[str, ...]:
    """Return what may go wrong, with ``latency`` the seconds that the loop takes to answer."""
    return tuple(_warnings(report, latency))


def _notes(report: DesignReport) -> Iterator[str]:
    plan = report.scenario.plan
    if not plan.linear:
        where = 'its equilibrium' if report.regulator else 'the first belief'
        yield f'Not linear: everything is of small deviations from {where}.'
    if report.scenario.filter == 'luenberger':
        yield 'The scenario asks for a luenberger filter; all numbers are of the Kalman filter.'
    if plan.period > 1 and report.estimator:
        yield (
            f'The sensors repeat every {plan.period} steps: estimator gains and standard '
            'deviations are means over that period.'
        )
        if report.regulator:
            yield (
                'Margins with the estimate are of the loop in which each sensor reads at every '
                'step, with as much information a second.'
            )
    if report.delay:
        yield f'The input is {report.delay:g} s late; margins are what is left beyond that.'


def _warnings(report: DesignReport, latency: float) -> Iterator[str]:
    yield from _unseen(report)
    if report.controllability and report.controllability.unreached:
        names = ', '.join(report.controllability.unreached)
        yield f'The input does not control {names}; what disturbs them dies out by itself.'
    if report.regulator and report.estimator:
        slow, wanted = _slowest(report.estimator.modes), _slowest(report.regulator.modes)
        if slow > wanted:
            yield (
                f'The estimator is slower than the regulator: its slowest mode has a time '
                f"constant of {slow:.3g} s, the regulator's {wanted:.3g} s. The input answers "
                'errors of the estimate long after they began.'
            )
    if report.regulator:
        loops = loop_names(report.scenario.law)
        yield from _of_loops(report.regulator, loops, report.delay, latency)


def _unseen(report: DesignReport) -> Iterator[str]:
    seen = report.observability
    names = ', '.join(seen.unseen)
    if not seen.detectable:
        yield (
            f'No sensor observes {names or "some mode that stays"}: the error grows without '
            'bound, and there is no estimator in steady state.'
        )
    elif report.estimator is None:
        yield (
            'The error has no steady state: a mode that does not decay has no process noise, so '
            'that the filter ends up ignoring its sensors.'
        )
    elif names:
        yield f'No sensor observes {names}: the model alone tells, and its errors die out.'


def _slowest(modes: Sequence[Mode]) -> float:
    return max(mode.time_constant for mode in modes)


def loop_names(law: str) -> tuple[str, str]:
    """Return what the loops of a law are called, with all states known and with the estimate."""
    return ('LQR', 'LQG') if law == 'lqr' else ('state feedback', 'output feedback')


def _of_loops(
    regulator: Regulator, names: tuple[str, str], delay: float, latency: float
) -> Iterator[str]:
    for at in regulator.loops:
        name, loop = (names[0], at.known) if at.estimated is None else (names[1], at.estimated)
        yield from _late(f'Input {at.input}: the {name} loop', loop, delay, latency)
        if loop.margins and loop.margins.disk.alpha < SMALL_DISK:
            yield _small(at, name, loop.margins)


def _late(subject: str, loop: Loop, delay: float, latency: float) -> Iterator[str]:
    bears = loop.prompt.delay.value
    if loop.margins is None:
        yield f'{subject} is unstable with {delay:g} s of delay; it bears {bears:.3g} s.'
    elif bears < latency:
        yield f'{subject} bears {bears:.3g} s of delay, less than the {latency:g} s that it takes.'


def _small(at: InputLoops, name: str, found: Margins) -> str:
    text = f'Input {at.input}: the {name} loop bears little, {bounds(found)}'
    if at.estimated is not None and at.known.margins:
        text += f'; with all states known it would be {bounds(at.known.margins)}'
    return f'{text}.'


def bounds(found: Margins) -> str:
    """Return gain and phase margins as text, ``gain 0.5 to 2 and phase 30 deg``."""
    phase = degrees(min(found.lead.value, found.lag.value))
    gains = f'gain {found.lower_gain.value:.3g} to {found.upper_gain.value:.3g}'
    return f'{gains} and phase {phase:.3g} deg'
