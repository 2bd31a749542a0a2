# SPDX-License-Identifier: Apache-2.0
"""The tour, the ghost and the address of the live page, in a headless Chromium."""

import io
import json
import math
import re
from urllib.parse import parse_qs, quote

import numpy as np
import pytest
from PIL import Image, ImageSequence

pytest.importorskip('rclpy')
pytest.importorskip('websockets')

from test_live import Page
from test_live_browser import NUMBER, chromium, text

pytestmark = [
    pytest.mark.real_time,
    pytest.mark.skipif(not chromium.program(), reason='there is no Chromium'),
]
SAID = text('#tour-said')
BELIEVED = 'estimator/joint_states.noise/0'


def opened(browser, loop, address=''):
    browser.open('about:blank')  # another part behind # alone would load nothing
    browser.open(f'http://127.0.0.1:{loop.port}/{address}')
    browser.until('Number.parseFloat(document.querySelector("#clock")?.textContent) > 1')
    browser.until('document.querySelector("#effects canvas") !== null')


@pytest.fixture(scope='module')
def cart():
    with Page('cart_pole') as loop, chromium.Chromium(1280, 800) as browser:
        opened(browser, loop)
        browser.until('document.querySelectorAll("#pole-list .pole").length >= 2')
        yield browser, loop
        assert browser.errors == []


def step(browser, loop, number):
    """Guess the first option of a step, do what it says, and return what it says was seen."""
    opened(browser, loop, f'#tour={number}')
    browser.until(f'{text("#words")}.startsWith("Chapter {number}. ")')
    assert browser.run('document.querySelector(".marked").hidden')
    browser.click('#guesses button')
    browser.until('!document.querySelector(".marked").hidden')
    browser.click('.marked > button')
    browser.until(f'!/[Mm]easured|Now move|First/.test({SAID})', 30)
    return browser.run(SAID)


def leave(browser):
    browser.run(
        "[...handles.querySelectorAll('button')].find(b => b.textContent === 'next').click()"
    )


def test_a_step_asks_measures_and_sets_back_what_it_changed(cart):
    browser, loop = cart
    said = step(browser, loop, 6)
    assert 'The error was' in said and 'You expected: smaller.' in said
    assert loop.seen('values', lambda m: m['values'][BELIEVED] == 0.05)
    leave(browser)
    loop.seen('values', lambda m: m['values'][BELIEVED] == 0.005)
    browser.until(f'{text("#words")}.startsWith("Chapter 7. ")')
    assert 'tour=7' in browser.run('location.hash')


def test_a_lean_without_the_motor_grows_as_the_pole_says(cart):
    browser, loop = cart
    said = step(browser, loop, 1)
    rate, pole = (float(said.split(word)[1].split()[0].rstrip('.;')) for word in (' of ', ' is '))
    assert rate == pytest.approx(pole, rel=0.25)
    leave(browser)
    loop.seen('values', lambda m: m['values']['plant/actuator_gain/0'] == 1.0)
    loop.until(lambda m: 'truth' in m and abs(m['truth'][-1][3]) < 0.2)


def test_a_prediction_is_larger_and_the_step_is_told_in_numbers(cart):
    browser, loop = cart
    opened(browser, loop, '#tour=7')
    browser.click('#guesses button:nth-of-type(3)')
    browser.until('!document.querySelector(".marked").hidden')
    browser.click('.marked > button')
    loop.seen('status', lambda m: m['lockstep'] and m['paused'] and not m['message'])
    browser.until('livePast().estimate > 0')
    for part in ('prior', 'estimate'):
        browser.click('.marked > button')
        loop.until(lambda m: part in m)  # noqa: B023
    browser.until(f'{SAID}.startsWith("x: predicted")')
    assert browser.run(SAID).endswith('As you expected.')
    leave(browser)
    loop.seen('status', lambda m: not m['lockstep'] and not m['message'])


def test_the_values_of_before_stay_as_a_ghost_on_the_same_readings(cart):
    browser, loop = cart
    loop.do(do='reset')
    opened(browser, loop, '#task=filter')
    browser.run('ghost.value = "now"; ghost.dispatchEvent(new Event("change"))')
    loop.seen('ghost', lambda m: m['filter'] == 'ekf')
    for _ in range(3):
        frame = loop.until(lambda m: 'ghost' in m and 'estimate' in m)
    theirs = {row[0]: row for row in frame['ghost']}
    same = [(row, theirs[row[0]]) for row in frame['estimate'] if row[0] in theirs]
    assert same and all(math.isclose(a, b, rel_tol=1e-4, abs_tol=1e-7) for a, b in zip(*same[-1]))
    browser.until(f'{text("#ghost-errors")}.startsWith("Errors: ekf")')
    loop.do(do='set', key=BELIEVED, value=0.1)
    wide = loop.until(
        lambda m: 'ghost' in m and 'estimate' in m and m['estimate'][-1][5] > 4 * m['ghost'][-1][5]
    )
    assert wide['ghost'][-1][5] < 0.003
    browser.run('ghost.value = "none"; ghost.dispatchEvent(new Event("change"))')
    loop.seen('ghost', lambda m: m['filter'] == '')
    loop.until_no_more('ghost', period=1.0)
    loop.do(do='set', key=BELIEVED, value=0.005)


def test_a_ghost_that_no_tab_shows_ends(cart):
    _, loop = cart
    assert loop.do(do='ghost', filter='ukf')['error'] == ''
    loop.seen('ghost', lambda m: m['filter'] == 'ukf')
    cart[0].open('about:blank')
    loop.seen('ghost', lambda m: m['filter'] == '', 20)
    assert "unknown filter 'none'" in loop.do(do='ghost', filter='none')['error']


def test_the_address_holds_what_was_changed_and_offers_it(cart):
    browser, loop = cart
    opened(browser, loop, '#task=faults')
    loop.do(do='set', key=BELIEVED, value=0.02)
    browser.until('location.hash.includes("0.02")')
    parts = parse_qs(browser.run('location.hash').removeprefix('#'))
    assert parts['task'] == ['faults'] and json.loads(parts['set'][0]) == {BELIEVED: 0.02}
    address = browser.run('location.hash')
    loop.do(do='set', key=BELIEVED, value=0.005)
    loop.seen('values', lambda m: m['values'][BELIEVED] == 0.005)
    browser.until('!location.hash.includes("set")')
    opened(browser, loop, address)
    browser.until('!document.querySelector("#offer").hidden')
    assert loop.sections['values']['values'][BELIEVED] == 0.005  # not without a click
    browser.click('#accept')
    loop.seen('values', lambda m: m['values'][BELIEVED] == 0.02)
    number = NUMBER.format(BELIEVED)
    browser.until(f'document.querySelector({number!r}).value === "0.02"')
    loop.do(do='set', key=BELIEVED, value=0.005)


def test_limits_poles_and_a_ghost_are_in_the_address(cart):
    browser, loop = cart
    opened(browser, loop, '#task=limits')
    values, scene = (loop.seen(section, lambda m: True) for section in ('values', 'scene'))
    begun, force = values['chosen']['law'], scene['input']['names'][0]
    most = values['limits']['input'][force][1]
    free = {} if most is None else {'value': most}
    assert loop.do(do='limit', of='input', name=force, side='high', value=7.5)['error'] == ''
    assert loop.do(do='ghost', filter='ukf')['error'] == ''
    poles = [[-4.0, 0.0], [-5.0, 0.0], [-3.0, 1.0], [-3.0, -1.0]]
    assert loop.do(do='poles', of='regulator', poles=poles)['error'] == ''
    for part in ('inputs', 'ghost', 'poles'):
        browser.until(f'location.hash.includes("{part}=")')
    address = browser.run('location.hash')
    parts = {name: value[0] for name, value in parse_qs(address.removeprefix('#')).items()}
    assert json.loads(parts['inputs']) == {force: [-7.5, 7.5]} and parts['ghost'] == 'ukf'
    assert json.loads(parts['poles']) == {'regulator': poles}
    assert loop.do(do='choose', what='law', value='mpc')['error'] == ''
    loop.do(do='limit', of='state', name='x', side='high', value=1.5)
    browser.until('location.hash.includes("states=")')
    loop.do(do='limit', of='state', name='x', side='high')
    loop.do(do='ghost', shown=False)
    assert loop.do(do='choose', what='law', value=begun)['error'] == ''
    loop.do(do='limit', of='input', name=force, side='high', **free)
    browser.until('!location.hash.includes("inputs=") && !location.hash.includes("poles=")')
    browser.open('about:blank')
    opened(browser, loop, address)
    browser.until('!document.querySelector("#offer").hidden')
    offer = browser.run(text('#offered'))
    assert f'the high limit of {force} to 7.5' in offer and 'the poles of the regulator' in offer
    browser.click('#accept')
    loop.seen(
        'values',
        lambda m: m['limits']['input'] == {force: [-7.5, 7.5]} and m['placed'].get('regulator'),
    )
    loop.seen('ghost', lambda m: m['filter'] == 'ukf')
    loop.do(do='ghost', shown=False)
    assert loop.do(do='choose', what='law', value=begun)['error'] == ''
    loop.do(do='limit', of='input', name=force, side='high', **free)


BAD = [
    'set={', 'set=[1]', 'set={"plant/model":1}', 'choose={"law":3}', 'poles={"regulator":[[1]]}',
    'poles={"x":[[1,2]]}', 'inputs={"f":"a"}', 'states={"x":[1]}', 'states=[]', 'ghost=none',
]  # fmt: skip


@pytest.mark.parametrize('bad', BAD)
def test_an_address_that_makes_no_sense_offers_nothing(cart, bad):
    browser, loop = cart
    opened(browser, loop, f'#{quote(bad, safe="=")}&tour=99&task=nothing')
    browser.until('document.querySelector("#offer").hidden')


@pytest.mark.parametrize('kind', ['webm', 'gif'])
def test_a_clip_is_recorded(cart, kind):
    browser, loop = cart
    opened(browser, loop, '#task=regulator')
    browser.run("""(make => { window.kept = []; URL.createObjectURL = blob => {
        window.kept.push(blob); return make.call(URL, blob); }; })(URL.createObjectURL)""")
    browser.click('#share')
    assert browser.run(f'document.querySelector("#{kind}").disabled') is False
    browser.click(f'#{kind}')
    browser.until(f'{text("#share")}.includes("stop")')
    browser.until('document.querySelector("#system").solid')
    now = browser.run('Number.parseFloat(clock.textContent)')
    browser.until(f'Number.parseFloat(clock.textContent) > {now + 2.0}')
    browser.click('#share')
    browser.until(f'{text("#share")} === "share"')
    assert int(browser.run(text('#told')).split()[-2]) > 5  # kB
    browser.run("""kept[0].arrayBuffer().then(b => { window.clip = [...new Uint8Array(b)]
        .map(x => x.toString(16).padStart(2, '0')).join(''); })""")
    clip = bytes.fromhex(browser.until('window.clip'))
    if kind == 'webm':
        assert clip[:4] == bytes.fromhex('1a45dfa3')  # of an EBML file
        return
    with Image.open(io.BytesIO(clip)) as film:
        frames = [np.asarray(frame.convert('RGB')) for frame in ImageSequence.Iterator(film)]
        width, height = browser.run('[system.width, system.height]')
        assert film.size == (480, round(480 * height / width))
    assert 10 < len(frames) < 60
    assert (frames[0] != frames[-1]).any()
    # the paper of the picture is that of the page, to the 8 levels of a bin of colours
    paper = browser.run('getComputedStyle(system).backgroundColor')
    wanted = [int(part) for part in re.findall(r'\d+', paper)]
    values, counts = np.unique(frames[-1].reshape(-1, 3), axis=0, return_counts=True)
    assert np.abs(values[counts.argmax()].astype(int) - wanted).max() < 8


def test_a_picture_is_copied_or_saved(cart):
    browser, loop = cart
    opened(browser, loop, '#task=regulator')
    browser.click('#share')
    browser.click('#picture')
    browser.until(f'/^(copied|saved)/.test({text("#made")})')
    browser.click('#close')


def test_the_gains_are_a_heat_map_with_names(cart):
    browser, loop = cart
    opened(browser, loop)
    browser.run('document.querySelector("#all-plots").open = true')
    map_ = '[...document.querySelectorAll("#filter canvas")].find(c => c.style.height)'
    browser.run('document.querySelector("#filter canvas").scrollIntoView()')
    browser.until(f'{map_} !== undefined')
    label = browser.until(f'{map_}.ariaLabel')
    assert label.startswith('gain K of joint_states') and 'v [m/s]' in label
    numbers = label.split('; ')[1].removeprefix('v [m/s] ').split(', ')
    assert len(numbers) == 2 and all(math.isfinite(float(number)) for number in numbers)


def test_a_cart_that_is_carried_away_stays_in_the_picture(cart):
    browser, loop = cart
    opened(browser, loop)
    assert loop.do(do='carry', names=['x'], values=[4.0])['error'] == ''
    loop.until(lambda m: 'truth' in m and m['truth'][-1][1] > 3.5)
    for _ in range(5):
        browser.until('document.querySelector("#system").body')
        x, width = browser.run('(s => [s.body[0], s.getBoundingClientRect().width])(system)')
        assert 0.0 < x < width
    loop.do(do='reset')
