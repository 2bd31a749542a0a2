# SPDX-License-Identifier: Apache-2.0
"""The actuator of a plant: a gain and a delay between the commanded and the acting input."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kalman_ros.core import Array


class Actuator:
    """Actuator that holds inputs over steps, and applies a gain and a delay.

    With a delay of d dt + r, 0 <= r < dt, the input commanded d + 1 steps ago acts for r
    seconds of a step, and the next one for the rest; before the first step it is
    ``before``. `kalman_ros.control.delay.sampled_plant` uses the same rule. When the delay
    grows, the oldest known input is held meanwhile.

    Parameters
    ----------
    gain
        Factor of each input (m,).
    delay
        Delay in seconds.
    before
        Input (m,) before the first step; zero by default.
    """

    def __init__(self, gain: Array, delay: float = 0.0, before: Array | None = None) -> None:
        self.gain, self.delay = gain, delay
        self._commands: list[Array] = [np.zeros_like(gain) if before is None else before]

    def __call__(self, u: Array, dt: float) -> Iterator[tuple[float, Array]]:
        """Yield each acting input (m,) and its seconds, for a step of ``dt`` commanded ``u``."""
        late, part = divmod(self.delay / dt, 1.0)
        late = int(late)
        self._commands = [*self._commands[-late - 1 :], u]
        if part:
            yield part * dt, self.gain * self._before(late + 1)
        yield (1.0 - part) * dt, self.gain * self._before(late)

    def adopt(self, gain: Array, delay: float) -> None:
        """Use another gain and delay from now on."""
        self.gain, self.delay = gain, delay

    def _before(self, steps: int) -> Array:
        """Return the command of N steps ago, or the oldest known one."""
        return self._commands[max(-steps - 1, -len(self._commands))]
