# SPDX-License-Identifier: Apache-2.0
"""Animations show every scenario in motion, in files that a page can hold."""

import stat

import matplotlib
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image
from thorough import mostly_thorough

from kalman_ros import scenario
from kalman_ros.report import animation
from kalman_ros.report.animation import animate, shown_steps
from kalman_ros.report.drawings import DRAWN, Moments
from kalman_ros.report.style import INPUT, caption
from kalman_ros.scenario import shipped
from kalman_ros.scenario.drawing import drawing
from kalman_ros.scenario.parameter_files import from_file
from kalman_ros.simulation import closed_loop

matplotlib.use('agg')
NAMES = [name for name in shipped.names() if name != 'cart_pole_ros2_control']


def moments(name, seconds=0.3, count=2):
    values = from_file(shipped.file(name), 'plant', 'estimator', 'controller')
    built = scenario.build(values)
    run = closed_loop.run(built, None, max(seconds, 2.0 / built.rate), 0)
    how = drawing(values.get('model', 'mass_spring_damper_2d'), built.model.state)
    steps = np.unique(np.linspace(0, len(run.time) - 1, count).astype(int))
    return how.kind, Moments(built, run, steps, how.heading, 0.3)


@pytest.fixture(autouse=True)
def no_film(monkeypatch):
    monkeypatch.setattr(animation.shutil, 'which', lambda name: None)


@pytest.mark.slow
@pytest.mark.parametrize('name', mostly_thorough(NAMES, 'cart_pole', 'robot_3d', 'diff_drive'))
def test_every_scenario_moves(name, tmp_path):
    kind, show = moments(name)
    done = []
    (path,) = animate(kind, show, name, tmp_path / 'a.gif', done.append)
    with Image.open(path) as image:
        assert image.size == (480, 360)
        assert image.n_frames == len(show.steps)
        first = np.asarray(image.convert('RGB'))
        image.seek(image.n_frames - 1)
        assert (first != np.asarray(image.convert('RGB'))).any()
    assert done[-1] == 1.0


def drawn(kind, show, k):
    axis = Figure().subplots()
    FigureCanvasAgg(axis.figure)
    DRAWN[kind](axis, show, k)
    return axis


def test_a_pole_leans_as_its_angle_is():
    """A positive angle is counter-clockwise, as in the model."""
    kind, show = moments('cart_pole')
    axis = drawn(kind, show, 3)
    x, theta = show.run.truth[3, 0], show.run.truth[3, 2]
    (pole,) = (line for line in axis.lines if line.get_linewidth() == 2.2)
    (foot, tip) = pole.get_xydata()
    np.testing.assert_allclose(foot[0], x)
    np.testing.assert_allclose(tip - foot, 0.6 * np.array([-np.sin(theta), np.cos(theta)]))


def test_positive_pitch_is_nose_down():
    kind, show = moments('submersible')
    show.run.truth[2, 2] = 0.5
    axis = drawn(kind, show, 2)
    body = axis.patches[1]  # the estimate's ellipse is first
    ends = body.get_transform().transform([[0.0, 0.0], [1.0, 0.0]])
    ahead = np.diff(axis.transData.inverted().transform(ends), axis=0)[0]
    assert np.arctan2(ahead[1], ahead[0]) == pytest.approx(-0.5)


def test_the_way_to_rest_is_shown_and_of_a_tracker_all():
    built = scenario.build({'model': 'mass_spring_damper'})
    _, show = moments('mass_spring_damper')
    time = np.arange(2001) / 100.0
    x = np.exp(-time)[:, np.newaxis] * [1.0, -1.0] + 0.01 * np.sin(time)[:, np.newaxis]
    run = type(show.run)(time, x, x, np.zeros((2001, 2, 2)), np.zeros((2001, 1)), {}, {})
    steps = shown_steps(built, run)
    assert len(steps) == 100
    assert 15.0 < time[steps[-1]] < 20.0  # e^-t is below four times .01 from 3 s on
    tracker = scenario.build({'model': 'level'})
    assert shown_steps(tracker, run)[-1] == 2000


def test_an_arrow_keeps_its_colour(tmp_path):
    """All frames share a palette, in which rare colours are not lost."""
    kind, show = moments('dc_motor', 1.0, 3)
    show.run.input[:] = np.linspace(-12.0, 12.0, len(show.run.time))[:, np.newaxis]
    (path,) = animate(kind, show, 'dc_motor', tmp_path / 'a.gif')
    with Image.open(path) as image:
        colours = np.asarray(image.convert('RGB')).reshape(-1, 3)
    wanted = np.rint(255.0 * np.array(matplotlib.colors.to_rgb(INPUT)))
    assert np.sum(np.abs(colours - wanted).max(axis=1) < 3) > 50


@pytest.mark.thorough
@pytest.mark.slow
def test_a_large_animation_has_fewer_frames_that_last_longer(tmp_path, monkeypatch):
    kind, show = moments('level', 0.5, 8)
    (path,) = animate(kind, show, 'level', tmp_path / 'a.gif')
    with Image.open(path) as image:
        count, period = image.n_frames, image.info['duration']
    monkeypatch.setattr(animation, 'LARGEST', path.stat().st_size - 1)
    animate(kind, show, 'level', path)
    with Image.open(path) as image:
        assert (image.n_frames, image.info['duration']) == (count // 2, 2 * period)


def test_the_clock_has_the_unit_of_the_caption(tmp_path, monkeypatch):
    kind, show = moments('nile', 9.0, 2)
    texts = []
    monkeypatch.setattr(Figure, 'suptitle', lambda self, text, **_: texts.append(text))
    with caption('', 'years'):
        animate(kind, show, 'nile', tmp_path / 'a.gif')
    assert texts == ['nile   0 years', 'nile   9 years']


@pytest.mark.slow
@pytest.mark.parametrize('fails', [False, True])
def test_a_film_is_written_where_ffmpeg_is(tmp_path, monkeypatch, fails):
    """A program in its place counts the bytes of the frames."""
    program = tmp_path / 'ffmpeg'
    end = 'echo no encoder >&2; exit 1' if fails else 'eval "last=\\${$#}"; wc -c > "$last"'
    program.write_text(f'#!/bin/sh\n{end}\n')
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(animation.shutil, 'which', lambda name: str(program))
    kind, show = moments('level', 0.1, 2)
    if fails:
        with pytest.raises(RuntimeError, match='ffmpeg failed: no encoder'):
            animate(kind, show, 'level', tmp_path / 'a.gif')
        return
    _, film = animate(kind, show, 'level', tmp_path / 'a.gif')
    assert int(film.read_text()) == 2 * 480 * 360 * 3
