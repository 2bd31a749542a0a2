# SPDX-License-Identifier: Apache-2.0
"""The plant's side of lockstep, without a middleware: what it waits for."""

from types import SimpleNamespace

import pytest

pytest.importorskip('rclpy')

from kalman_ros.nodes.plant.pacing import FIRST_STAMP, Lockstep

PERIOD = 0.01


class Plant:
    """What `Lockstep` needs of a plant, with a clock that the test sets."""

    def __init__(self):
        self.period, self.run_until, self.steps = PERIOD, 1e9, 0
        self.said, self.now, self.reports = [], 0, 0
        self.steady = SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=self.now))
        self.diagnostics = SimpleNamespace(publish=lambda: None)

    elapsed = property(lambda self: self.steps * PERIOD)
    stamp = property(lambda self: FIRST_STAMP + round(self.steps * PERIOD * 1e9))

    def create_timer(self, period, watch, clock):
        self.watch = watch

    def create_subscription(self, *_):
        return object()

    def destroy_subscription(self, _):
        pass

    def get_logger(self):
        return SimpleNamespace(error=lambda _: None, info=lambda _: None)

    def endpoints_matched(self, *, every_sensor):
        return True

    def publish_step(self):
        self.said.append(self.steps)

    def step(self):
        self.steps += 1


def started(**options):
    plant = Plant()
    pacer = Lockstep(plant, ('estimate', None), 2.0, **options)
    plant.watch()
    return plant, pacer


def answer(pacer, times):
    for _ in range(times):
        pacer.answered()


def test_the_plant_never_gets_further_ahead_than_the_recorder_confirmed():
    plant, pacer = started(window=10)
    answer(pacer, 50)
    assert plant.said == list(range(11))
    pacer.confirm(FIRST_STAMP + round(4 * PERIOD * 1e9))
    answer(pacer, 50)
    assert plant.said == list(range(15))
    pacer.confirm(FIRST_STAMP + round(14 * PERIOD * 1e9))
    assert plant.said[-1] == 15


@pytest.mark.parametrize('forged', [0, 2**62])
def test_a_forged_confirmation_neither_holds_the_plant_back_nor_lets_it_run_ahead(forged):
    plant, pacer = started(window=10)
    answer(pacer, 5)
    pacer.confirm(FIRST_STAMP + round(4 * PERIOD * 1e9))
    pacer.confirm(forged)
    answer(pacer, 50)
    assert plant.said[-1] == (14 if forged == 0 else 15)


def test_without_a_recorder_nobody_waits_for_one():
    plant, pacer = started()
    answer(pacer, 5000)
    assert plant.said[-1] == 5000


def test_a_recorder_that_does_not_confirm_is_named():
    plant, pacer = started(window=1)
    answer(pacer, 5)
    for plant.now in range(0, 5_000_000_000, 50_000_000):
        plant.watch()
    assert plant.said == [0, 1]  # and nothing is asked for again
    assert 'the recorder has not confirmed for 4 s' in pacer.trouble()
    assert pacer.held
    pacer.confirm(plant.stamp)
    assert not pacer.held
    assert pacer.trouble() == ''


@pytest.mark.parametrize('stamped', [True, False])
def test_two_answers_to_one_step_are_no_two_steps(stamped):
    plant, pacer = started(stamped=stamped)
    plant.now = 1_100_000_000
    plant.watch()
    assert plant.said == [0, 0]  # asked again
    pacer.answered()
    if stamped:
        assert plant.steps == 1
        return
    pacer.answered()  # the answer to the first asking, which was only late
    assert plant.steps == 0
    plant.now += 1_100_000_000
    plant.watch()
    assert plant.said == [0, 0, 1]
    pacer.answered()
    assert plant.steps == 2
