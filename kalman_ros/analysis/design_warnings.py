# SPDX-License-Identifier: Apache-2.0
"""Notes and warnings about a design, as sentences."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import degrees

from kalman_ros.control.laws import OPTIMAL
from kalman_ros.control.margins import Margins
from kalman_ros.control.stability import Mode
from kalman_ros.scenario.estimation import placed_poles
from kalman_ros.scenario.regulator import steered

from .curvature import curved
from .design_report import DesignReport, Regulator
from .input_loops import InputLoops, Loop
from .jacobians import wrong_jacobians

#: A disk margin below this value is small: less than 4.4 dB of gain and 28 degrees of phase.
SMALL_DISK = 0.5
#: A pole is where it was placed within this share of its size.
_PLACED = 0.2
#: A time constant counts as longer than another if it exceeds it by this factor.
_SLOWER = 1.001


def notes(report: DesignReport) -> tuple[str, ...]:
    """Return the assumptions of a report, one sentence each."""
    return tuple(_notes(report))


def warnings(report: DesignReport, latency: float) -> tuple[str, ...]:
    """Return the warnings for a loop with a response time of ``latency`` seconds."""
    return tuple(_warnings(report, latency))


def _notes(report: DesignReport) -> Iterator[str]:
    plan = report.scenario.plan
    if not plan.linear:
        where = 'its equilibrium' if report.regulator else 'the first belief'
        yield (
            f'The scenario is not linear: modes, gains and margins hold for small deviations '
            f'from {where}.'
        )
        yield from _path_notes(report)
    if report.regulator is None and steered(report.scenario):
        yield (
            'At rest the input does not move every state: such a model is regulated along '
            'motions, of which a demo with a path shows one, and kr.motion. The path here is '
            'without commands.'
        )
    prediction = report.regulator and report.regulator.feedback.prediction
    if prediction:
        seconds = prediction.steps * prediction.dt
        yield (
            f'Limits are predicted {seconds:.3g} s ahead. Margins and the least cost hold where '
            'no limit acts.'
        )
    yield from _placed(report)
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
        yield f'The input is {report.delay:g} s late; margins are in addition to that delay.'


def _placed(report: DesignReport) -> Iterator[str]:
    """Yield the poles that an observer was asked for, where the rates of sensors change them."""
    if report.estimator is None:
        return
    asked = [s for s in placed_poles(report.scenario) if s.imag >= 0.0]
    poles = [mode.pole for mode in report.estimator.modes]
    if any(min(abs(s - pole) for pole in poles) > _PLACED * abs(s) for s in asked):
        wanted = ', '.join(_pole(s) for s in sorted(asked, key=abs))
        yield (
            f'The observer is asked for poles at {wanted} 1/s, by a gain in continuous time. With '
            'sensors at these rates its poles are those of the table.'
        )


def _pole(s: complex) -> str:
    return f'{s.real:.3g} ± {s.imag:.3g}j' if s.imag else f'{s.real:.3g}'


def _path_notes(report: DesignReport) -> Iterator[str]:
    """Yield the states that the readings determine along the path, by window where they vary."""
    path = report.path
    if path is None:
        return
    always, sometimes = path.observed(throughout=True), path.observed(throughout=False)
    never = [name for name in path.names if name not in sometimes]
    text = f'Along a simulated path of {path.time[-1]:.4g} s, '
    if always:
        text += f'the readings of each quarter determine {", ".join(always)}'
        text += f', and never {", ".join(never)}' if never else ''
    elif sometimes:
        text += 'no state is determined by the readings of every quarter'
    else:
        text += 'the readings determine no state'
    yield f'{text}.'
    for name in sometimes:
        if name not in always:
            spans = ', '.join(
                f'{w.start:.4g} to {w.end:.4g} s' for w in path.windows if name in w.observed
            )
            yield f'State {name} is determined by the readings of {spans} only.'
    if path.growing:
        yield (
            f'The error of {", ".join(path.growing)} still grows in the second half of the path.'
        )


def _warnings(report: DesignReport, latency: float) -> Iterator[str]:
    yield from wrong_jacobians(report.scenario)
    yield from curved(report.scenario)
    yield from _observability_warnings(report)
    if report.controllability and report.controllability.unreached:
        names = ', '.join(report.controllability.unreached)
        yield f'The input does not control {names}; disturbances of them decay without it.'
    if report.regulator and report.estimator:
        estimator, regulator = _slowest(report.estimator.modes), _slowest(report.regulator.modes)
        if estimator > _SLOWER * regulator:
            yield (
                f'The estimator is slower than the regulator: its slowest mode has a time '
                f"constant of {estimator:.3g} s, the regulator's {regulator:.3g} s. The input "
                'answers errors of the estimate long after they began.'
            )
    if report.regulator:
        loops = loop_names(report.scenario.law)
        yield from _loop_warnings(report.regulator, loops, report.delay, latency)


def _observability_warnings(report: DesignReport) -> Iterator[str]:
    observability = report.observability
    names = ', '.join(observability.unseen)
    if report.path is not None:
        if names:
            growing = [name for name in observability.unseen if name in report.path.growing]
            grows = f' The error of {", ".join(growing)} grows.' if growing else ''
            yield (
                f'The readings do not determine {names} along the simulated path; they rest on '
                f'the first belief and the model.{grows}'
            )
    elif not observability.detectable:
        yield (
            f'No sensor observes {names or "some mode that does not decay"}: the error grows '
            'without bound, and there is no estimator in steady state.'
        )
    elif report.estimator is None:
        yield (
            'The error has no steady state: a mode that does not decay has no process noise, so '
            'that the filter ends up ignoring its sensors.'
        )
    elif names:
        yield f'No sensor observes {names}: only the model predicts them, and the errors decay.'


def _slowest(modes: Sequence[Mode]) -> float:
    return max(mode.time_constant for mode in modes)


def loop_names(law: str) -> tuple[str, str]:
    """Return the names of the loops of a law: with all states known, and with the estimate."""
    return ('LQR', 'LQG') if law in OPTIMAL else ('state feedback', 'output feedback')


def _loop_warnings(
    regulator: Regulator, names: tuple[str, str], delay: float, latency: float
) -> Iterator[str]:
    for channel in regulator.loops:
        name, loop = (
            (names[0], channel.known)
            if channel.estimated is None
            else (names[1], channel.estimated)
        )
        yield from _delay_warning(f'Input {channel.input}: the {name} loop', loop, delay, latency)
        if loop.margins and loop.margins.disk.alpha < SMALL_DISK:
            yield _margin_warning(channel, name, loop.margins)
    if regulator.together is not None:
        yield from _joint_warning(regulator, names)


def _joint_warning(regulator: Regulator, names: tuple[str, str]) -> Iterator[str]:
    """Warn of inputs whose margins are large one at a time, but small together."""
    joint = regulator.together
    if joint is None:
        return
    estimated = [loop.estimated for loop in regulator.loops if loop.estimated is not None]
    name, margin, loops = names[1], joint.estimated, estimated
    if not estimated:
        name, margin, loops = names[0], joint.known, [loop.known for loop in regulator.loops]
    alone_alpha = min((loop.margins.disk.alpha for loop in loops if loop.margins), default=0.0)
    if margin is not None and margin.alpha < SMALL_DISK <= alone_alpha:
        yield (
            f'All inputs at once: the {name} loop has small margins, gain {margin.lower_gain:.3g} '
            f'to {margin.upper_gain:.3g} and phase {degrees(margin.phase):.3g} deg in every input '
            'together, although each input alone has more.'
        )


def _delay_warning(subject: str, loop: Loop, delay: float, latency: float) -> Iterator[str]:
    margin = loop.prompt.delay.value
    if loop.margins is None:
        yield (
            f'{subject} is unstable with {delay:g} s of delay; its delay margin is {margin:.3g} s.'
        )
    elif margin < latency:
        yield (
            f'{subject} has a delay margin of {margin:.3g} s, less than its latency of '
            f'{latency:g} s.'
        )


def _margin_warning(channel: InputLoops, name: str, loop_margins: Margins) -> str:
    text = f'Input {channel.input}: the {name} loop has small margins, {bounds(loop_margins)}'
    if channel.estimated is not None and channel.known.margins:
        text += f'; with all states known they would be {bounds(channel.known.margins)}'
    return f'{text}.'


def bounds(loop_margins: Margins) -> str:
    """Return the gain and phase margins as text: ``gain 0.5 to 2 and phase 30 deg``."""
    phase = degrees(min(loop_margins.lead.value, loop_margins.lag.value))
    gains = f'gain {loop_margins.lower_gain.value:.3g} to {loop_margins.upper_gain.value:.3g}'
    return f'{gains} and phase {phase:.3g} deg'
