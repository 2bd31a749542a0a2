# SPDX-License-Identifier: Apache-2.0
"""What stands between the input that a plant is told and the one that acts: a gain and a delay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array


class Actuator:
    """Holds inputs over steps, and lets them act with a gain, and late.

    With a delay of d dt + r, 0 <= r < dt, the input that was told d + 1 steps ago acts for r
    seconds of a step, and the one after it for the rest; before the first step it was zero. This
    is what `kalman_ros.control.delay.sampled_plant` computes with. Where a delay grows, the
    oldest input still known is held meanwhile.

    Parameters
    ----------
    gain
        Factor of each input (m,).
    delay
        In seconds.
    """

    def __init__(self, gain: Array, delay: float = 0.0) -> None:
        self.gain, self.delay = gain, delay
        self._told: list[Array] = [np.zeros_like(gain)]

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
        """Return what was told so many steps ago, or the oldest that is known."""
        return self._told[max(-steps - 1, -len(self._told))]
