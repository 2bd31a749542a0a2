# SPDX-License-Identifier: Apache-2.0
"""What stands between the input that a plant is told and the one that acts: a gain and a delay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array


class Actuator:
    """Holds inputs over steps, and lets them act with a gain, and late.

    With a delay of d dt + r, 0 <= r < dt, the input that was told d + 1 steps ago acts for r
    seconds of a step, and the one after it for the rest; what was told before the first step is
    ``before``. This is what `kalman_ros.control.delay.sampled_plant` computes with. Where a delay
    grows, the oldest input still known is held meanwhile.

    Parameters
    ----------
    gain
        Factor of each input (m,).
    delay
        In seconds.
    before
        The input (m,) before the first step; zero if it is not given.
    """

    def __init__(self, gain: Array, delay: float = 0.0, before: Array | None = None) -> None:
        self.gain, self.delay = gain, delay
        self._told: list[Array] = [np.zeros_like(gain) if before is None else before]

    def __call__(self, u: Array, dt: float) -> Iterator[tuple[float, Array]]:
        """Yield for how long (s) which input (m,) acts in a step of ``dt`` told ``u`` (m,)."""
        late, part = divmod(self.delay / dt, 1.0)
        late = int(late)
        self._told = [*self._told[-late - 1 :], u]
        if part:
            yield part * dt, self.gain * self._before(late + 1)
        yield (1.0 - part) * dt, self.gain * self._before(late)

    def adopt(self, gain: Array, delay: float) -> None:
        """Use another gain and delay from now on."""
        self.gain, self.delay = gain, delay

    def _before(self, steps: int) -> Array:
        """Return the command of N steps ago, or the oldest that is known."""
        return self._told[max(-steps - 1, -len(self._told))]
