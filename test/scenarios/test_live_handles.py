# SPDX-License-Identifier: Apache-2.0
"""Paths and limits on the live page, by mouse, in a headless Chromium."""

import math
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('websockets')

from test_live import Page
from test_live_browser import chromium, text

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(not chromium.program(), reason='there is no Chromium'),
]
EXAMPLES = Path(__file__).parents[2] / 'docs' / 'examples'
FIELD = 'document.querySelectorAll(".limits input")[{}].value'
#: Handles and effects of the open task, and parts of the system, that the window does not show.
OUT_OF_VIEW = """[...document.querySelectorAll(
    '#system, #tasks button, #handles input, #handles button, #effects canvas, #pause, #lockstep'
)].filter(e => { const b = e.getBoundingClientRect();
    return b.left < 0 || b.top < 0 || b.right > innerWidth || b.bottom > innerHeight; })
    .map(e => e.id || e.textContent || e.ariaLabel || e.tagName)"""


def served(example):
    with Page(str(EXAMPLES / f'{example}.yaml')) as loop, chromium.Chromium(1280, 800) as browser:
        browser.open(f'http://127.0.0.1:{loop.port}/')
        browser.until('Number.parseFloat(document.querySelector("#clock")?.textContent) > 1')
        browser.until('document.querySelector("#effects canvas") !== null')
        yield browser, loop
        assert browser.errors == []


def all_tasks_are_in_view(browser):
    for width, height, mobile in ((390, 844, True), (1280, 800, False)):
        browser.resize(width, height, mobile=mobile)
        for task in ('path', 'limits', 'regulator', 'filter', 'faults', 'push'):
            browser.run(f'document.querySelector("[data-task={task}]").click()')
            browser.run('window.scrollTo(0, 0)')
            assert browser.run(OUT_OF_VIEW) == [], (task, width)
        assert browser.run('document.documentElement.scrollWidth <= innerWidth')


@pytest.fixture(scope='module')
def robot():
    yield from served('robot_on_a_path')


@pytest.fixture(scope='module')
def cart():
    yield from served('cart_on_a_track')


def stroke(browser, *shares):
    left, top, width, height = browser.place('#system')
    browser.drag(*((left + x * width, top + y * height) for x, y in shares))


def test_a_path_is_drawn_and_followed(robot):
    browser, loop = robot
    assert browser.run('document.querySelector("#system").dataset.open') == 'path'
    arc = [k / 20 * math.pi / 2 for k in range(21)]
    stroke(browser, *((0.5 + 0.2 * math.sin(a), 0.5 - 0.2 * (1 - math.cos(a))) for a in arc))
    path = loop.seen('path', lambda m: m['state'] == 'following')
    assert 10 < len(path['points']) <= 200
    browser.until(f'/On the path: .* of .* s, .* m remain/.test({text("#sentence")})')
    end = path['points'][-1]
    loop.seen('path', lambda m: m['state'] == 'ended', 60)
    last = next(frame for frame in reversed(loop.frames) if 'truth' in frame)['truth'][-1]
    assert math.hypot(last[1] - end[0], last[2] - end[1]) < 0.3
    browser.until(f'{text("#sentence")}.includes("from the end of the path")')


def test_a_path_is_drawn_with_a_finger(robot):
    browser, loop = robot
    browser.resize(390, 844, mobile=True)
    before = loop.sections.get('path', {}).get('points')  # none, unless a test before drew one
    left, top, width, height = browser.place('#system')
    scrolled = browser.run('scrollY')
    for kind, share in (
        ('Start', 0.5),
        ('Move', 0.6),
        ('Move', 0.7),
        ('Move', 0.8),
        ('End', None),
    ):
        place = {'x': left + (share or 0.0) * width, 'y': top + (1.1 - (share or 0.0)) * height}
        touches = [] if share is None else [place]
        browser.call('Input.dispatchTouchEvent', type=f'touch{kind}', touchPoints=touches)
    loop.seen('path', lambda m: m['points'] and m['points'] != before)
    assert browser.run('scrollY') == scrolled
    browser.resize(1280, 800)


def test_a_refused_path_is_told_with_the_reason(robot):
    browser, loop = robot
    number = 'div[data-key="controller/path_speed"] input[type=number]'
    assert loop.do(do='limit', of='input', name='v', value=0.3)['error'] == ''
    browser.until(f'document.querySelector({number!r}).value === "0.8"')
    browser.click('#handles button:nth-of-type(3)')  # an eight
    why = 'beyond the input_limit of 0.3'  # the path of before may have been refused, too
    loop.seen('path', lambda m: m['state'] == 'refused' and why in m['reason'])
    browser.until(f'{text("#sentence")}.startsWith("The path is refused: it needs v of")')
    loop.do(do='limit', of='input', name='v', value=1.5)


def test_all_handles_of_a_robot_are_in_view_with_their_effects(robot):
    all_tasks_are_in_view(robot[0])


def test_the_walls_of_the_track_are_dragged(cart):
    browser, loop = cart
    assert browser.run('document.querySelector("#system").dataset.open') == 'limits'
    left, top, width, height = browser.place('#system')
    scale, ground = min(width / 3, height / 1.9), top + 0.72 * height

    def at(x):
        return left + width / 2 + scale * x, ground

    browser.drag(at(1.0), at(0.9), at(0.7))
    seen = loop.seen('values', lambda m: m['limits']['state']['x'][1] < 0.8)
    assert seen['limits']['state']['x'] == [-1.0, pytest.approx(0.7, abs=0.02)]
    browser.until(f'Math.abs({FIELD.format(1)} - 0.7) < 0.02')


def test_the_limit_of_the_input_is_dragged_and_the_page_says_what_acts(cart):
    browser, loop = cart
    canvas = '#effects canvas:nth-child(2)'
    left, top, width, height = browser.place(canvas)
    browser.until(f'document.querySelector({canvas!r}).handles.length === 2')
    low, high = browser.run(f'document.querySelector({canvas!r}).range')

    def at(force):
        share = (force - low) / (high - low)
        return left + width - 20, top + height - 14 - share * (height - 14 - 15)

    browser.drag(at(10.0), at(6.0), at(2.0))
    seen = loop.seen('values', lambda m: m['limits']['input']['f'][1] < 3.0)
    assert seen['limits']['input']['f'] == pytest.approx([-2.0, 2.0], abs=0.3)
    held = '/held by the limit of the input: [0-9]+ % of the last 5 s/'
    browser.until(f'{held}.test({text("#sentence")})')
    loop.do(do='limit', of='input', name='f', value=10.0)


def test_a_typed_limit_is_removed(cart):
    browser, loop = cart
    for typed, wanted in (('0.3', 0.3), ('', None)):
        browser.run(
            f'(f => {{ f.value = "{typed}"; f.dispatchEvent(new Event("change")); }})'
            '(document.querySelectorAll(".limits input")[3])'
        )
        loop.seen('values', lambda m: m['limits']['state']['theta'][1] == wanted)  # noqa: B023


@pytest.fixture
def pusher(tmp_path):
    text = (EXAMPLES / 'cart_on_a_track.yaml').read_text()
    (tmp_path / 'pusher.yaml').write_text(text + '    input_lower_limit: [-4.0]\n')
    yield from served(tmp_path / 'pusher')


def test_an_input_with_two_limits_has_a_field_for_each(pusher):
    browser, loop = pusher
    browser.click('[data-task=limits]')
    browser.until('document.querySelectorAll("[aria-label=\'lowest f\']").length === 1')
    steps = ('lowest', -3, [-3.0, 10.0]), ('highest', 3, [-3.0, 3.0]), ('lowest', -1, [-1.0, 3.0])
    for side, typed, wanted in steps:
        browser.run(
            f'(f => {{ f.value = "{typed}"; f.dispatchEvent(new Event("change")); }})'
            f'(document.querySelector("[aria-label=\'{side} f\']"))'
        )
        loop.seen('values', lambda m: m['limits']['input']['f'] == wanted)  # noqa: B023


def test_a_path_of_a_cart_says_why_it_cannot_be_drawn(cart):
    browser, _ = cart
    browser.click('[data-task=path]')
    browser.until(f'{text("#words")}.includes("the state has no position in a plane")')
    assert browser.run('[...handles.querySelectorAll("button")].every(b => b.disabled && b.title)')


def test_a_pull_by_the_mouse_moves_the_cart(cart):
    browser, loop = cart
    browser.click('[data-task=push]')
    browser.until('document.querySelector("#system").body')
    left, top, _, _ = browser.place('#system')
    x, y = browser.run('document.querySelector("#system").body')
    loop.frames.clear()
    start = left + x, top + y
    browser.drag(start, *((start[0] + 4 * k, start[1]) for k in range(1, 30)))
    loop.until(lambda m: 'truth' in m and m['truth'][-1][2] > 0.15)


def test_all_handles_of_a_cart_are_in_view_with_their_effects(cart):
    all_tasks_are_in_view(cart[0])


def test_a_fallen_pole_is_told_with_the_button_that_helps(cart):
    browser, loop = cart
    assert loop.do(do='carry', names=['theta'], values=[2.5])['error'] == ''
    browser.until(f'{text("#sentence")}.startsWith("The pole has fallen")')
    browser.until(f'!help.hidden && {text("#help")} === "reset"')
    browser.click('#help')
    browser.until(f'!{text("#sentence")}.startsWith("The pole has fallen")')
    loop.frames.clear()
    loop.until(lambda m: 'truth' in m and abs(m['truth'][-1][3]) < 0.5)


@pytest.mark.parametrize(
    ('key', 'value', 'words'),
    [
        ('bias/0', 0.05, 'reads x'),
        ('outliers', 0.1, 'has outliers'),
        ('enabled', False, 'has sent nothing for'),
    ],
)
def test_a_broken_sensor_is_named_and_mended(cart, key, value, words):
    browser, loop = cart
    loop.do(do='reset')
    assert loop.do(do='set', key=f'plant/joint_states.{key}', value=value)['error'] == ''
    browser.until(f'{text("#sentence")}.startsWith("The sensor joint_states {words}")')
    browser.until(f'!help.hidden && {text("#help")} === "mend it"')
    browser.click('#help')
    initial = loop.sections['scene']['initial']['values']
    loop.seen('values', lambda m: m['values'] == {**m['values'], **initial})
    browser.until(f'!{text("#sentence")}.startsWith("The sensor")')


def test_a_reset_forgets_what_was_before(cart):
    browser, _ = cart
    browser.until('livePast().truth > 100')
    browser.click('#reset')
    browser.until('livePast().truth < 60')
    assert browser.run('livePast().began') > 0.0


def test_another_address_is_opened_anew(cart):
    browser, _ = cart
    browser.run('window.before = true; setTimeout(() => { location.hash = "task=faults" })')
    browser.until('!window.before && document.querySelector("#effects canvas")')
    browser.until('document.querySelector("[data-task=faults]").ariaSelected === "true"')


def test_a_step_of_the_filter_is_predicted_and_updated_with_its_gain(cart):
    browser, loop = cart
    browser.resize(1280, 800)
    browser.click('[data-task=update]')
    button = text('#handles button')
    browser.until(f'{button}.startsWith("predict: stop")')
    browser.click('#handles button')
    loop.seen('status', lambda m: m['lockstep'] and m['paused'] and not m['message'])
    browser.until(f'{button} === "predict"')
    for _ in range(3):
        loop.frames.clear()
        browser.click('#handles button')
        browser.until(f'{button} === "update"')
        assert 'updated' not in browser.run(text('#numbers'))
        browser.click('#handles button')
        browser.until(f'{button} === "predict" && {text("#numbers")}.includes("updated")')
    shown = text('#numbers')
    numbers = '/x: predicted .*; read .*, gain 0.[0-9]+; updated .* m/'
    browser.until(f'{numbers}.test({shown})')
    assert browser.run(OUT_OF_VIEW) == []
    browser.run('document.querySelector("#lockstep").click()')
    loop.seen('status', lambda m: not m['lockstep'] and not m['message'])
