# SPDX-License-Identifier: Apache-2.0
"""Evidence with the quantities that all detectors need, each computed once."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from kalman_ros.core import Array

from .evidence import Evidence
from .filter_pass import passage
from .hypotheses import columns, effect
from .model_noise import WHOLE
from .noise_scores import NoiseScores, noise_scores
from .parameters import varied
from .passage import Passage
from .responses import Responses, responses

#: A gain of -2 log likelihood below this is chance. About 200 hypotheses are tested; the gain of
#: each is chi-square with one degree of freedom, and exceeds 30 with a probability of 4e-8.
CHANCE = 30.0


@dataclass(frozen=True)
class Examination:
    """Evidence, the pass of a filter over it, and the responses of its innovations to faults.

    If the filter fails, the pass ends there, or raises an error if it is ``strict``. The pass is
    computed unless it is ``known``, and so are the responses unless they are ``given``.
    """

    evidence: Evidence
    strict: bool = True
    known: Passage | None = None
    given: Responses | None = None

    @cached_property
    def passage(self) -> Passage:
        """Filter pass in the order of stamps."""
        return self.known or passage(self.evidence, strict=self.strict)

    @cached_property
    def judged(self) -> list[str]:
        """Sensors of the pass whose readings can be wrong: zeros that no sensor took cannot."""
        sources = self.evidence.scenario.sensors
        return [name for name in self.passage.names if sources[name].judged]

    @cached_property
    def responses(self) -> Responses:
        """Regression of the innovations on every additive fault."""
        return self.given or responses(
            self.passage, columns(self.evidence, self.passage, self.tones)
        )

    def about(self, subjects: Collection[str]) -> Examination:
        """Return the examination with the responses to faults of some subjects alone.

        It takes less time. The subjects are sensors, or something that is no sensor.
        """
        inputs = self.evidence.scenario.model.input.names
        if self.given or 'responses' in vars(self) or not {*inputs}.isdisjoint(subjects):
            return self
        tones = self.tones if self.evidence.sensors.keys().isdisjoint(subjects) else None
        fault_columns = columns(self.evidence, self.passage, tones, subjects)
        return replace(self, known=self.passage, given=responses(self.passage, fault_columns))

    @cached_property
    def scores(self) -> NoiseScores:
        """Scores of every noise variance."""
        noise = {
            name: np.median(self.evidence.sensors[name].covariance, axis=0).diagonal()
            for name in self.judged
        }
        return noise_scores(self.passage, noise, self.densities)

    @cached_property
    def densities(self) -> dict[str, Array]:
        """Spectral density (n, n) of each parameter of the process noise, by name.

        If there is no such parameter, it is the whole density of the model.
        """
        model, x = self.evidence.scenario.model, self.passage.series('x')[-1]
        by_parameter = {}
        for parameter, size, other, _ in varied(self.evidence):
            change = (other.noise_density(x) - model.noise_density(x)) / size
            if 'noise' in parameter.name and np.any(change):
                by_parameter[parameter.name] = change * parameter.value
        whole = model.noise_density(x)
        return by_parameter or ({WHOLE: whole} if np.any(whole) else {})

    @cached_property
    def tones(self) -> Array | None:
        """Frequency (Hz) of the largest disturbance at each input; None if not determined."""
        m = self.evidence.scenario.model.input.size
        times = self.passage.series('time')
        if not m or len(times) < 100 or times[-1] <= times[0]:
            return None
        rate = min(self.evidence.scenario.rate, 40.0)
        bins = ((times - times[0]) * rate).astype(int)
        series = np.zeros((bins[-1] + 1, m))
        np.add.at(series, bins, self._equivalent_inputs())
        padded = 4 * len(series)  # padded, so that no peak falls between two frequencies
        power = np.abs(np.fft.rfft(series - series.mean(axis=0), padded, axis=0))
        grid = np.fft.rfftfreq(padded, 1.0 / rate)
        return np.asarray(grid[np.argmax(np.where(grid[:, None] > 0.05, power, 0.0), axis=0)])

    def _equivalent_inputs(self) -> Array:
        """Return the inputs (E, m) that are equivalent to the corrections of the events."""
        passage, model = self.passage, self.evidence.scenario.model
        X, U = passage.series('x'), passage.series('u')
        B = np.stack([effect(model, X, U, i) for i in range(model.input.size)], axis=2)
        return np.asarray((np.linalg.pinv(B) @ passage.corrections[:, :, None])[:, :, 0])
