# SPDX-License-Identifier: Apache-2.0
"""Bounds on the way of an input, from the controller to the plant: pauses, stamps, timeouts."""

import numpy as np
import pytest

pytest.importorskip('rclpy')

from kalman_ros.codecs.layout import Sample
from kalman_ros.control.limiter import Limiter, limits_of
from kalman_ros.core import Signal
from kalman_ros.nodes.controller import output
from kalman_ros.nodes.controller.node import ControllerNode
from kalman_ros.nodes.controller.output import OutputStage
from kalman_ros.nodes.plant.input import PlantInput

SECOND = 1_000_000_000


class Clock:
    """A clock that is moved by hand."""

    def __init__(self):
        self.seconds = 100.0

    def pass_time(self, seconds):
        self.seconds += seconds


class Publisher:
    """Keeps what is published."""

    def __init__(self):
        self.inputs = []

    def publish(self, message):
        self.inputs.append(message)


@pytest.fixture
def clock(monkeypatch):
    """The clock of the output stage; sleeping moves it."""
    moved = Clock()
    monkeypatch.setattr(output, 'monotonic', lambda: moved.seconds)
    monkeypatch.setattr(output, 'sleep', moved.pass_time)
    return moved


def stage(period, *, simulated=False):
    """Return an output stage for an input of at most 10 per second, and its publisher."""
    limiter = Limiter(limits_of(1, {'input_rate_limit': 10.0}), np.zeros(1))
    publisher = Publisher()
    built = OutputStage(publisher, lambda _, u: float(u[0]), limiter, period, simulated=simulated)
    built.open()
    return built, publisher


@pytest.mark.parametrize('simulated', [False, True])
@pytest.mark.parametrize(
    ('period', 'pause', 'counts'),
    [
        (0.01, 0.05, 0.05),
        (0.01, 0.1, 0.1),
        (0.01, 0.11, 0.1),
        (0.01, 5.0, 0.1),
        (0.25, 0.2, 0.2),
        (0.25, 0.26, 0.25),
    ],
)
def test_a_pause_counts_for_a_tenth_of_a_second_or_one_period(
    clock, simulated, period, pause, counts
):
    built, _ = stage(period, simulated=simulated)
    start = built.command(SECOND, np.full(1, 1e3))[0]
    clock.pass_time(pause)
    end = built.command(SECOND + round(pause * SECOND), np.full(1, 1e3))[0]
    assert end - start == pytest.approx(10.0 * counts)


def test_a_stamp_that_goes_back_counts_for_one_period():
    built, _ = stage(0.02, simulated=True)
    start = built.command(5 * SECOND, np.full(1, 1e3))[0]
    assert start == pytest.approx(0.2)
    assert built.command(SECOND, np.full(1, 1e3))[0] == pytest.approx(0.4)


@pytest.mark.parametrize(('start', 'ramp'), [(4.5, True), (20.0, False)])
def test_an_output_closes_within_its_rate_limit_or_in_half_a_second(clock, start, ramp):
    built, publisher = stage(0.01)
    while built.value[0] < start - 1e-9:
        clock.pass_time(0.1)
        built.command(0, np.full(1, start))
    del publisher.inputs[:]
    clock.pass_time(5.0)
    before = clock.seconds
    built.close(lambda: 0)
    steps = -np.diff([start, *publisher.inputs])
    assert publisher.inputs[-1] == 0.0
    assert clock.seconds - before <= 0.5 + 0.011
    assert steps[0] == pytest.approx(1.0)  # the pause counts for a tenth of a second
    assert steps[1:-1] == pytest.approx(np.full(len(steps) - 2, 0.1))
    assert (steps[-1] < 0.11) == ramp


@pytest.mark.parametrize(
    ('ahead', 'held'),
    [(-SECOND, False), (0, True), (1, True), (SECOND, True), (SECOND + 1, False)],
)
def test_an_input_on_the_way_to_idle_is_not_stamped_before_the_last(
    pair, monkeypatch, ahead, held
):
    """Up to the tolerance; a stamp further ahead of the clock is of a clock that was set back."""
    node = pair(ControllerNode, future_tolerance=1.0).node
    now = 100 * SECOND
    monkeypatch.setattr(node, '_now', lambda: now)
    node._output.open()
    node._output.command(now + ahead, np.ones(1))
    node.deactivate()
    assert node._output.at_idle
    assert node._output.stamp == (now + ahead if held else now)


def test_the_plant_drops_an_input_after_the_timeout_and_no_earlier():
    now = [SECOND]
    signal = Signal('force', 'std_msgs/Float64MultiArray', ('data[0]',))
    idle = np.array([3.0])
    plant = PlantInput(signal, idle, lambda: now[0])
    assert plant.drop_old(0.5) is None  # nothing has come

    def hold():
        now[0] = SECOND
        plant.hold(Sample(0, np.ones(1), None))

    hold()
    now[0] = SECOND + SECOND // 2
    assert plant.drop_old(0.5) is None
    assert (plant.is_set, plant.force[0]) == (True, 1.0)
    now[0] += 1
    assert plant.drop_old(0.5) == pytest.approx(0.5)
    assert (plant.is_set, plant.force[0]) == (False, 3.0)
    assert plant.drop_old(0.5) is None  # once
    hold()
    now[0] = 10**18
    assert plant.drop_old(0.0) is None  # never
    assert plant.force[0] == 1.0
