# SPDX-License-Identifier: Apache-2.0
"""The live page in a headless Chromium, with clicks and keys."""

import importlib.util
import math
import os
from pathlib import Path

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('websockets')

from test_live import Page


def driver():
    path = Path(__file__).parents[2] / 'docs' / 'chromium.py'
    spec = importlib.util.spec_from_file_location('chromium', path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


chromium = driver()
pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(not chromium.program(), reason='there is no Chromium'),
]
SLIDER = 'div[data-key="{}"] input[type=range]'
NUMBER = 'div[data-key="{}"] input[type=number]'
#: Pixels of a canvas that are not empty.
DRAWN = (
    '(c => new Uint32Array(c.getContext("2d").getImageData(0, 0, c.width, c.height).data.buffer)'
    '.filter(Boolean).length)(document.querySelector("{}"))'
)


@pytest.fixture(scope='module')
def page():
    with Page('mass_spring_damper_2d') as loop, chromium.Chromium() as browser:
        browser.open(f'http://127.0.0.1:{loop.port}/')
        browser.until('Number.parseFloat(document.querySelector("#clock")?.textContent) > 3')
        browser.until('document.querySelectorAll("#pole-list .pole").length >= 4')
        browser.run('document.querySelectorAll("details").forEach(d => { d.open = true; })')
        yield browser, loop
        assert browser.errors == []


def text(selector):
    return f'document.querySelector("{selector}").textContent'


def handle_of(browser, selector):
    """Return the middle of something to drag on a canvas, as a place on the page."""
    left, top, _, _ = browser.place(selector)
    x, y = browser.until(f"""(c => {{
        const around = [[0, 0], [6, 0], [-6, 0], [0, 6], [0, -6]];
        for (let y = 0; y < c.clientHeight; y += 2) for (let x = 0; x < c.clientWidth; x += 2)
            if (c.handles?.some(h => around.every(([a, b]) => h.hit(x + a, y + b)))) return [x, y];
    }})(document.querySelector('{selector}'))""")
    return left + x, top + y


def test_everything_is_drawn(page):
    browser, _ = page
    for canvas in ('#system', '#poles', '#states canvas', '#bode', '#nyquist', '#cost canvas'):
        browser.place(canvas)
        browser.until(f'{DRAWN.format(canvas)} > 500')
    assert browser.run('document.documentElement.scrollWidth <= innerWidth')
    assert browser.run('document.querySelector("#notice").hidden')


def test_a_drag_of_a_slider_changes_the_gain_of_the_controller(page):
    browser, loop = page
    before = browser.run(text('#margins'))
    key = 'controller/state_cost/0'
    left, top, width, height = browser.place(SLIDER.format(key))
    middle = top + height / 2
    browser.drag(*((left + share * width, middle) for share in (0.5, 0.6, 0.7, 0.8)))
    browser.until(f'{text("#margins")} !== {before!r}')
    browser.until(f'{text("#latency")}.includes("ms")')
    loop.seen('values', lambda m: m['values'][key] > 200.0)


def test_a_number_and_the_keyboard_do_the_same(page):
    browser, loop = page
    key = 'plant/position.noise/0'
    browser.run(f'document.querySelector({NUMBER.format(key)!r}).focus()')
    browser.run(f'document.querySelector({NUMBER.format(key)!r}).select()')
    for character in '0.25':
        browser.key(character)
    browser.key('Tab')
    loop.seen('values', lambda m: m['values'][key] == 0.25)
    browser.until(f'document.querySelector({SLIDER.format(key)!r}).value > 260')
    browser.run(f'document.querySelector({SLIDER.format(key)!r}).focus()')
    browser.key('ArrowRight')
    loop.seen('values', lambda m: m['values'][key] > 0.25)


def test_a_pole_is_dragged(page):
    browser, loop = page
    left, top, _, _ = browser.place('#poles')
    x, y = browser.run('window.livePoles("regulator").at(0)')
    browser.drag((left + x, top + y), (left + x - 20, top + y - 10), (left + x - 60, top + y - 20))
    placed = loop.seen('values', lambda m: m['chosen']['law'] == 'placement', 60)
    assert placed
    browser.until('document.querySelector("#notice").hidden')


def test_the_poles_of_the_estimator_are_dragged_and_it_keeps_its_belief(page):
    browser, loop = page
    assert loop.do(do='choose', what='filter', value='luenberger')['error'] == ''
    placed = loop.seen('theory', lambda m: (m.get('estimator') or {}).get('placed'), 60)
    before = placed['estimator']['placed']
    browser.until(f'{text("#estimator-legend")}.includes("as sampled")')
    left, top, _, _ = browser.place('#poles')
    x, y = browser.run('window.livePoles("estimator").at(-1)')
    loop.until(lambda m: 'estimate' in m and m['estimate'][-1][-1] < 1.0)  # the trace of P
    loop.frames.clear()
    browser.drag((left + x, top + y), (left + x - 5, top + y), (left + x - 12, top + y))
    after = loop.seen('theory', lambda m: m['estimator']['placed'] != before, 60)
    assert set(after['estimator']['gains']) == {'position', 'velocity'}
    loop.seen('share', lambda m: 'observer_poles: [' in m['yaml'])
    rows = [row for frame in loop.frames for row in frame.get('estimate', ())]
    assert max(row[-1] for row in rows) < 1.0  # it was not configured again
    assert browser.run('document.querySelector("#notice").hidden')
    assert loop.do(do='choose', what='filter', value='kf')['error'] == ''


def test_the_curve_of_the_gain_is_dragged(page):
    browser, loop = page
    browser.until('document.querySelector("#stale").hidden')  # the curves stand still
    x, y = handle_of(browser, '#bode')
    browser.drag((x, y), *((x, y - 3 * k) for k in range(1, 6)))
    loop.seen('values', lambda m: 1.2 < m['values']['plant/actuator_gain/0'] < 10.0)
    loop.do(do='set', key='plant/actuator_gain/0', value=1.0)


def test_buttons_and_keys_pause_push_and_reset(page):
    browser, loop = page
    browser.click('#pause')
    browser.until(f'{text("#state")}.includes("paused")')
    browser.run('document.activeElement.blur()')
    browser.key(' ')
    browser.until(f'!{text("#state")}.includes("paused")')
    browser.click('[data-task=push]')
    noise = 'plant/position.noise/0'
    initial = loop.sections['scene']['initial']['values'][noise]
    loop.do(do='set', key=noise, value=initial)  # else the sentence is about the sensor
    pushed = f'{text("#sentence")}.startsWith("The input f_x was pushed (+), unknown to")'
    for button, said in (('#pushes button', pushed), ('#reset', f'!{pushed}')):
        browser.click(button)
        assert loop.until(lambda m: 'answer' in m)['answer']['error'] == ''
        browser.until(said, 3.0)
    assert browser.run('document.querySelector("#notice").hidden')


def test_a_refusal_is_shown_and_the_slider_goes_back(page):
    browser, _ = page
    browser.run(
        '(s => { s.value = "ekf"; s.add(new Option("wrong", "wrong")); s.value = "wrong";'
        ' s.dispatchEvent(new Event("change")); })(document.querySelector("#choices select"))'
    )
    browser.until(f'{text("#notice")}.includes("unknown filter")')
    assert browser.until('document.querySelector("#choices select").value === "kf"')


def test_the_shared_file_is_shown(page):
    browser, _ = page
    browser.click('#share')
    browser.until('document.querySelector("#shared").open')
    assert 'mass_spring_damper_2d_live.yaml' in browser.run(text('#command'))
    assert '/**:' in browser.run('document.querySelector("#yaml").value')
    browser.click('#close')


def test_a_phone_shows_one_column(page):
    browser, _ = page
    browser.resize(390, 844, mobile=True)
    browser.until('document.documentElement.scrollWidth <= 390')
    browser.until(f'{DRAWN.format("#system")} > 500')
    browser.click('#theme')
    assert browser.run('document.documentElement.classList.contains("dark")')
    browser.resize(1400, 1000)


def test_a_second_tab_sees_the_same(page):
    browser, loop = page
    loop.do(do='set', key='plant/actuator_gain/0', value=1.25)
    number = NUMBER.format('plant/actuator_gain/0')
    browser.until(f'document.querySelector({number!r}).value === "1.25"')


def test_from_slider_to_input_is_quick(page):
    """The 95th percentile is below 150 ms, on a machine of which nobody else takes the time."""
    load, processors = os.getloadavg()[0], os.cpu_count()
    if load > 1.5 * processors:
        pytest.skip(f'the load of this machine is {load:.0f}, with {processors} processors')
    _, loop = page
    found = []
    for k in range(40):
        loop.frames.clear()
        loop.do(do='set', key='controller/input_cost/0', value=1.0 + 0.1 * k)
        found.append(loop.framed(lambda m: 'latency' in m)['latency']['ms'])
    found.sort()
    assert found[math.ceil(0.95 * len(found)) - 1] < 150.0, found


def test_a_sensor_is_moved_on_the_map():
    with Page('two_bearings') as loop, chromium.Chromium(1280, 800) as browser:
        browser.open(f'http://127.0.0.1:{loop.port}/')
        browser.until('Number.parseFloat(document.querySelector("#clock")?.textContent) > 2')
        x, y = handle_of(browser, '#system')
        start = x, y
        browser.drag(start, *((start[0] + 4 * k, start[1] - 3 * k) for k in range(1, 15)))
        initial = loop.seen('scene', lambda m: True)['initial']['places']
        loop.seen('values', lambda m: m['places'] != initial)
        browser.until(f'{text("#sentence")}.startsWith("The sensor")')
        browser.click('#help')
        loop.seen('values', lambda m: m['places'] == initial)
        assert browser.errors == []
