# SPDX-License-Identifier: Apache-2.0
"""Noise by restricted maximum likelihood, and the degrees of freedom of fits.

Maximum likelihood takes noise too small, since the other parameters are fitted to a part of it.
The likelihood that is restricted to what they leave has one more term, with the information I_bb
of these parameters b at the noise s,

    log L(s) - 1/2 log |I_bb(s)|

(H. Patterson and R. Thompson, Biometrika 58(3), 1971; D. Cox and N. Reid, Parameter Orthogonality
and Approximate Conditional Inference, J. Royal Statistical Society B 49(1), 1987). One step of
scoring leads from the maximum of L to that of the sum. A variance V that depends on fitted noise
has 2 V^2 / var(V) degrees of freedom (F. Satterthwaite, Biometrics Bulletin 2(6), 1946).
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

#: The step of differences of the information, on a logarithmic scale.
_STEP = 0.05
#: The longest step, a factor of 2.7, and the number of times it is halved until it leads up.
_LONGEST, _HALVED = 1.0, 4
#: Noise that would move by a smaller part of its standard deviation stays where it is.
_LITTLE = 0.1
#: States and inputs at which models are compared.
_COMPARED = 3
#: The least variance that a change is compared with.
_TINY = 1e-300


@dataclass(frozen=True)
class Restricted:
    """The maximum of the restricted likelihood.

    Parameters
    ----------
    top
        The expansion there.
    found
        What it determines.
    power
        Noise has covariances proportional to exp(power z) (p,); 0 for other parameters.
    freedom
        The degrees of freedom of the variance of the error of each other parameter (p,).
    """

    top: Expansion
    found: Determination
    power: Array
    freedom: Array


def unrestricted(likelihood: Likelihood, top: Expansion) -> Restricted:
    """Return a maximum of the likelihood as that of the restricted one."""
    p = len(top.z)
    power = np.array([noise_power(likelihood, top.z, index) for index in range(p)])
    found = determination(likelihood.parameters, top.information, top.z, power)
    return Restricted(top, found, power, np.full(p, np.inf))


def restricted(likelihood: Likelihood, top: Expansion, report: Report) -> Restricted | None:
    """Return the maximum of the restricted likelihood, one step from near that of the likelihood.

    None if it is the same: where no noise is fitted, nothing else is, or the noise is known so
    well that the difference is negligible.
    """
    same = unrestricted(likelihood, top)
    found, power = same.found, same.power
    known = np.isfinite(found.std)
    noise = known & (power != 0.0)
    others = known & ~noise
    # all noise twice as large leaves a quarter of the information on each other parameter, so a
    # noise moves by at most their number times its variance
    uncertain = noise & (np.where(noise, found.std, 0.0) * others.sum() > _LITTLE)
    if not uncertain.any():
        return None
    slopes = _slopes(likelihood, top, np.flatnonzero(uncertain).tolist(), report)
    if slopes is None:
        return None
    C = found.covariance
    b = np.ix_(others, others)
    inverse = np.linalg.inv(top.information[b])
    term = np.array([-0.5 * np.trace(inverse @ slope[b]) for slope in slopes])
    step = C @ (top.gradient + term)
    moved = _moved(likelihood, top, step, others) or top
    at_it = determination(likelihood.parameters, moved.information, moved.z, power)
    return Restricted(moved, at_it, power, _freedom(C, slopes))


def _slopes(
    likelihood: Likelihood, top: Expansion, uncertain: list[int], report: Report
) -> Array | None:
    """Return the derivatives of the information (p, p, p); zero for all noise but ``uncertain``.

    None if they cannot be computed.
    """
    p = len(top.z)
    away = _STEP * np.eye(p)[uncertain]
    both = likelihood.expand_all(
        [*(top.z + away), *(top.z - away)], partial(report, 'restricting the likelihood')
    )
    slopes = np.zeros((p, p, p))
    for index, above, below in zip(uncertain, both, both[len(away) :]):
        if above is None or below is None:
            return None
        slopes[index] = (above.information - below.information) / (2.0 * _STEP)
    return slopes


def _moved(likelihood: Likelihood, top: Expansion, step: Array, others: Array) -> Expansion | None:
    """Return the end of a step, shortened until the restricted likelihood is higher there."""

    def value(at: Expansion) -> float:
        sign, size = np.linalg.slogdet(at.information[np.ix_(others, others)])
        return at.value - 0.5 * float(size) if sign > 0.0 else -np.inf

    limits = np.array([each.limits for each in likelihood.parameters])
    step = step * min(1.0, _LONGEST / max(float(np.abs(step).max()), 1e-300))
    for _ in range(_HALVED):
        there = likelihood.expand(np.clip(top.z + step, limits[:, 0], limits[:, 1]))
        if there is not None and value(there) > value(top):
            return there
        step = 0.5 * step
    return None


def _freedom(C: Array, slopes: Array) -> Array:
    """Return the degrees of freedom of variances (p,), of the covariance C (p, p) of the fit."""
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
    away = _STEP * np.eye(len(z))[index]
    try:
        three = [likelihood.candidate(each) for each in (z - away, z, z + away)]
        means, variances = zip(*(_moments(each, likelihood.conditions.input) for each in three))
    except (ValueError, ArithmeticError, np.linalg.LinAlgError):
        return 0.0
    for candidate, mean in zip(three, means):
        if candidate.delays != three[0].delays or not np.array_equal(mean, means[0]):
            return 0.0
    below, above = np.diff(variances, axis=0)
    clearest = int(np.argmax(np.abs(below) / np.maximum(variances[1], _TINY)))
    ratio = above[clearest] / below[clearest] if below[clearest] else 1.0
    return float(np.log(ratio) / _STEP) if ratio > 0.0 else 0.0


def _moments(of: Candidate, input: Array) -> tuple[Array, Array]:
    """Return all means that a candidate predicts at some states, and all variances."""
    rng, model, space = np.random.default_rng(0), of.model, of.model.state
    dt = model.period if model.is_discrete else 0.01
    means = [of.initial.mean, *of.biases.values()]
    variances = [of.initial.covariance, *(each.covariance for each in of.sensors.values())]
    for _ in range(_COMPARED):
        x = space.add(of.initial.mean, rng.standard_normal(space.size))
        u = input + rng.standard_normal(len(input))
        means += [model.step(x, u, dt), *(each.measure(x) for each in of.sensors.values())]
        variances.append(model.noise_covariance(x, u, dt))
    every = np.concatenate([each.diagonal() for each in variances])
    return np.concatenate([np.ravel(each) for each in means]), every
