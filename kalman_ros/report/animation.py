# SPDX-License-Identifier: Apache-2.0
"""Animations of a run: a GIF, and an MP4 if ffmpeg is installed."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Sequence
from math import ceil
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from kalman_ros.scenario import Scenario
from kalman_ros.simulation.trajectory import Trajectory

from .drawings import DRAWN, Moments, curves, rows
from .style import BOUND, ESTIMATE, INPUT, READING, SIGMAS, STYLE, TRUTH, time_unit

#: Number of frames of an animation, and duration of each in milliseconds.
FRAMES, _PERIOD = 100, 80
#: Size in inches, and pixels per inch; both sides are even in pixels, as MP4 requires.
_SIZE, _DPI = (4.8, 3.6), 100
#: Number of shades of each colour, from the colour to white.
_SHADES = 8
_LEGEND = f'black: truth; dashed blue: estimate, band of {SIGMAS:g} sigma; grey: readings'
#: Largest size of a GIF in bytes; a larger GIF is written with fewer frames.
LARGEST = 3_000_000
#: A state is at rest within this multiple of its typical deviation in the second half of a run.
_REST = 4.0


def shown_steps(scenario: Scenario, run: Trajectory, frames: int = FRAMES) -> Any:
    """Return the steps (frames,) of an animation.

    The animation of a controlled system covers six times the time that it takes to come to rest,
    and at least a tenth of the run. The animation of any other system covers the whole run.
    """
    last = len(run.time) - 1
    if scenario.law:
        model = scenario.model
        distance = np.abs(model.state.subtract(run.truth, model.equilibrium.state))
        typical = distance[last // 2 :].std(axis=0) + distance[last // 2 :].mean(axis=0)
        moving = np.flatnonzero((distance > _REST * np.maximum(typical, 1e-12)).any(axis=1))
        end = 6 * int(moving[-1]) if len(moving) else 0
        last = min(last, max(end, ceil(0.1 * last)))
    return np.unique(np.linspace(0, last, min(frames, last + 1)).astype(int))


def animate(
    kind: str,
    show: Moments,
    title: str,
    path: Path,
    progress: Callable[[float], None] = lambda done: None,
) -> list[Path]:
    """Write a GIF, and an MP4 beside it if ffmpeg is installed; return the paths of both.

    Parameters
    ----------
    kind
        Kind of the drawing, see `kalman_ros.scenario.drawing`.
    show
        Run and steps to draw.
    title
        Title above the drawing, to which the time is added.
    path
        Path of the GIF, which ends with .gif.
    progress
        Receives the share that is done.

    Raises
    ------
    RuntimeError
        If ffmpeg fails.
    """
    frames = []
    with_input = kind in DRAWN and show.scenario.model.input.size
    legend = f'{_LEGEND}; orange: input' if with_input else _LEGEND
    with mpl.rc_context({**STYLE, 'axes.grid': False}):
        figure = Figure(figsize=_SIZE, dpi=_DPI, layout='constrained')
        canvas = FigureCanvasAgg(figure)
        axes = figure.subplots(rows(kind, show.state), 1, squeeze=False, sharex=True)[:, 0]
        for number, k in enumerate(show.steps):
            for axis in axes:
                axis.clear()
            if kind in DRAWN:
                DRAWN[kind](axes[0], show, k)
            else:
                curves(axes, show, k)
            clock = f'{show.run.time[k]:.{_digits(show)}f} {time_unit()}'
            figure.suptitle(f'{title}   {clock}', fontsize=8, x=0.02, ha='left')
            figure.supxlabel(legend, fontsize=7, color=TRUTH)
            canvas.draw()
            frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())[..., :3].copy()))
            progress((number + 1) / len(show.steps))
    _write_gif(frames, path)
    video = path.with_suffix('.mp4')
    program = shutil.which('ffmpeg')
    if program is None:
        return [path]
    _write_mp4(program, frames, video)
    return [path, video]


def _digits(show: Moments) -> int:
    """Return the number of decimals with which the times of any two frames differ."""
    step = float(show.run.time[show.steps[-1]] - show.run.time[show.steps[0]]) / len(show.steps)
    return int(np.clip(ceil(-np.log10(max(step, 1e-3))), 0, 3))


def _write_gif(frames: Sequence[Image.Image], path: Path) -> None:
    """Write frames with a common palette, and fewer, longer frames if the file is too large."""
    palette = _palette()
    images = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    period = _PERIOD
    while True:
        first, *rest = images
        first.save(path, save_all=True, append_images=rest, loop=0, duration=period, optimize=True)
        if path.stat().st_size <= LARGEST or len(images) < 4:
            return
        images, period = images[::2], 2 * period


def _palette() -> Image.Image:
    """Return an image whose palette has the shades of all colours, for all frames."""
    band = np.array(to_rgb(BOUND)) * 0.35 + 0.65
    share = np.linspace(0.0, 1.0, _SHADES)[:, np.newaxis]
    shades = [
        share * np.array(to_rgb(colour)) + (1.0 - share) * paper
        for colour, paper in (
            *((c, np.ones(3)) for c in (TRUTH, ESTIMATE, READING, INPUT, tuple(band))),
            (ESTIMATE, band),
            (TRUTH, band),
        )
    ]
    values = np.rint(255.0 * np.vstack(shades)).astype(np.uint8)
    image = Image.new('P', (1, 1))
    image.putpalette(values.ravel().tolist())
    return image


def _write_mp4(program: str, frames: Sequence[Image.Image], path: Path) -> None:
    width, height = frames[0].size
    command = [
        program, '-y', '-loglevel', 'error', '-f', 'rawvideo', '-pix_fmt', 'rgb24',
        '-s', f'{width}x{height}', '-r', f'{1e3 / _PERIOD:g}', '-i', '-',
        '-pix_fmt', 'yuv420p', '-movflags', '+faststart', str(path),
    ]  # fmt: skip
    data = b''.join(frame.tobytes() for frame in frames)
    result = subprocess.run(command, input=data, capture_output=True)
    if result.returncode:
        reason = result.stderr.decode(errors='replace').strip().splitlines() or ['no reason']
        raise RuntimeError(f'ffmpeg failed: {reason[-1]}')
