# SPDX-License-Identifier: Apache-2.0
"""Noise by restricted maximum likelihood, and the degrees of freedom of fits.

Maximum likelihood underestimates noise, since the other parameters are fitted to a part of it. The
restricted likelihood has one more term, with the information I_bb of these other parameters b at
the noise s,

    log L(s) - 1/2 log |I_bb(s)|

(H. Patterson and R. Thompson, Biometrika 58(3), 1971; D. Cox and N. Reid, Parameter Orthogonality
and Approximate Conditional Inference, J. Royal Statistical Society B 49(1), 1987). One step of
scoring leads from the maximum of L to the maximum of the restricted likelihood. A variance V that
depends on fitted noise has 2 V^2 / var(V) degrees of freedom (F. Satterthwaite,
Biometrics Bulletin 2(6), 1946).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from kalman_ros.core import Array

from .ascent import Report
from .candidate import Candidate
from .identifiability import Determination, determination
from .likelihood import Expansion, Likelihood

#: Step of finite differences of the information, on a logarithmic scale.
_STEP = 0.05
#: Longest step (a factor of 2.7), and number of times that it is halved until it leads upwards.
_LONGEST, _HALVED = 1.0, 4
#: Noise that would change by a smaller share of its standard deviation is not changed.
_LITTLE = 0.1
#: Number of states and inputs at which models are compared.
_COMPARED = 3
#: Lower limit of a variance that divides a change.
_TINY = 1e-300


@dataclass(frozen=True)
class Restricted:
    """The maximum of the restricted likelihood.

    Parameters
    ----------
    top
        Expansion at the maximum.
    found
        Determination of the parameters.
    power
        Powers (p,) of noise, whose covariances are proportional to exp(power z); 0 for other
        parameters.
    freedom
        Degrees of freedom of the error variance of each other parameter (p,).
    """

    top: Expansion
    found: Determination
    power: Array
    freedom: Array


def unrestricted(likelihood: Likelihood, top: Expansion) -> Restricted:
    """Return a maximum of the likelihood in the form of a restricted maximum."""
    p = len(top.z)
    power = np.array([noise_power(likelihood, top.z, index) for index in range(p)])
    determined = determination(likelihood.parameters, top.information, top.z, power)
    return Restricted(top, determined, power, np.full(p, np.inf))


def restricted(likelihood: Likelihood, top: Expansion, report: Report) -> Restricted | None:
    """Return the maximum of the restricted likelihood, one step from that of the likelihood.

    Return None if both are the same: no noise is fitted, nothing else is fitted, or the noise is
    known so well that the difference is negligible.
    """
    initial = unrestricted(likelihood, top)
    determined, power = initial.found, initial.power
    known = np.isfinite(determined.std)
    noise = known & (power != 0.0)
    others = known & ~noise
    # doubling all noise leaves a quarter of the information on each other parameter, so a noise
    # changes by at most the number of other parameters times its variance
    uncertain = noise & (np.where(noise, determined.std, 0.0) * others.sum() > _LITTLE)
    if not uncertain.any():
        return None
    slopes = _information_slopes(likelihood, top, np.flatnonzero(uncertain).tolist(), report)
    if slopes is None:
        return None
    C = determined.covariance
    b = np.ix_(others, others)
    inverse = np.linalg.inv(top.information[b])
    term = np.array([-0.5 * np.trace(inverse @ slope[b]) for slope in slopes])
    step = C @ (top.gradient + term)
    end = _step_upwards(likelihood, top, step, others) or top
    final = determination(likelihood.parameters, end.information, end.z, power)
    return Restricted(end, final, power, _degrees_of_freedom(C, slopes))


def _information_slopes(
    likelihood: Likelihood, top: Expansion, uncertain: list[int], report: Report
) -> Array | None:
    """Return the derivatives of the information (p, p, p), zero for all but ``uncertain``.

    Return None if they cannot be computed.
    """
    p = len(top.z)
    offsets = _STEP * np.eye(p)[uncertain]
    expansions = likelihood.expand_all(
        [*(top.z + offsets), *(top.z - offsets)], partial(report, 'restricting the likelihood')
    )
    slopes = np.zeros((p, p, p))
    for index, above, below in zip(uncertain, expansions, expansions[len(offsets) :]):
        if above is None or below is None:
            return None
        slopes[index] = (above.information - below.information) / (2.0 * _STEP)
    return slopes


def _step_upwards(
    likelihood: Likelihood, top: Expansion, step: Array, others: Array
) -> Expansion | None:
    """Return the end of a step, shortened until the restricted likelihood increases."""

    def value(expansion: Expansion) -> float:
        sign, size = np.linalg.slogdet(expansion.information[np.ix_(others, others)])
        return expansion.value - 0.5 * float(size) if sign > 0.0 else -np.inf

    limits = np.array([free.limits for free in likelihood.parameters])
    step = step * min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
    for _ in range(_HALVED):
        end = likelihood.expand(np.clip(top.z + step, limits[:, 0], limits[:, 1]))
        if end is not None and value(end) > value(top):
            return end
        step = 0.5 * step
    return None


def _degrees_of_freedom(C: Array, slopes: Array) -> Array:
    """Return the degrees of freedom (p,) of the variances in the covariance C (p, p) of a fit."""
    V = C.diagonal()
    change = np.array([-(C @ slope @ C).diagonal() for slope in slopes])  # dV/ds
    variance = np.einsum('ik,ij,jk->k', change, C, change)
    unknown = np.full(len(V), np.inf)
    return np.asarray(np.divide(2.0 * V**2, variance, where=variance > 0.0, out=unknown))


def noise_power(likelihood: Likelihood, z: Array, index: int) -> float:
    """Return k of a parameter that changes covariances alone, as exp(k z); 0 for any other.

    That is 2 for a standard deviation, and 1 for a variance. A variance a exp(k z) + b shows it in
    the differences on both sides of z, whose ratio is exp(k step).
    """
    if not likelihood.parameters[index].positive:
        return 0.0
    offset = _STEP * np.eye(len(z))[index]
    try:
        three = [likelihood.candidate(point) for point in (z - offset, z, z + offset)]
        means, variances = zip(
            *(_moments(candidate, likelihood.conditions.input) for candidate in three)
        )
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return 0.0
    for candidate, mean in zip(three, means):
        if candidate.delays != three[0].delays or not np.array_equal(mean, means[0]):
            return 0.0
    below, above = np.diff(variances, axis=0)
    clearest = int(np.argmax(np.abs(below) / np.maximum(variances[1], _TINY)))
    ratio = above[clearest] / below[clearest] if below[clearest] else 1.0
    return float(np.log(ratio) / _STEP) if ratio > 0.0 else 0.0


def _moments(candidate: Candidate, input: Array) -> tuple[Array, Array]:
    """Return the means that a candidate predicts at several states, and the variances."""
    rng, model, space = np.random.default_rng(0), candidate.model, candidate.model.state
    dt = model.period if model.is_discrete else 0.01
    means = [candidate.initial.mean, *candidate.biases.values()]
    first = candidate.initial.covariance
    covariances = [
        np.where(np.isinf(first), 0.0, first),
        *(sensor.covariance for sensor in candidate.sensors.values()),
    ]
    for _ in range(_COMPARED):
        x = space.add(candidate.initial.mean, rng.standard_normal(space.size))
        u = input + rng.standard_normal(len(input))
        means += [
            model.step(x, u, dt),
            *(sensor.measure(x) for sensor in candidate.sensors.values()),
        ]
        covariances.append(model.noise_covariance(x, u, dt))
    all_variances = np.concatenate([covariance.diagonal() for covariance in covariances])
    return np.concatenate([np.ravel(mean) for mean in means]), all_variances
