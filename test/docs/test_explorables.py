# SPDX-License-Identifier: Apache-2.0
"""The numbers of the pictures with handles are those of kr, and their handles move."""

import importlib.util
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_lyapunov
from thorough import mostly_thorough

import kalman_ros as kr

pytestmark = pytest.mark.slow  # by node, and in Chromium

ROOT = Path(__file__).parents[2]
DOCS = ROOT / 'docs'
PAGE = ROOT / 'kalman_ros' / 'live' / 'page'


def module(name):
    spec = importlib.util.spec_from_file_location(name, DOCS / f'{name}.py')
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


chromium = module('chromium')
CHAPTERS = sorted((DOCS / 'course').glob('[0-9]*.md'))
SHOWN = [
    (chapter.name, name)
    for chapter in CHAPTERS
    for name in re.findall(r'^```\{explorable\} (\w+)$', chapter.read_text(), re.MULTILINE)
]
NAMES = [name for _, name in SHOWN]
#: What is shown in place of a number that is none.
NOTHING = '\u2013'


def script(*modules):
    return module('bundle').bundle(*(DOCS / 'explore' / f'{name}.js' for name in modules))


def run(code, data=None, modules=('numbers',)):
    """Return what an expression of JavaScript gives, in which `d` is the data."""
    node = shutil.which('node') or shutil.which('nodejs')
    if not node:
        pytest.skip('there is no node to run JavaScript')
    names = ''.join(f'const {name} = module_{name};' for name in modules)
    text = f'{script(*modules)};{names}const d = {json.dumps(data)};'
    text += f'console.log(JSON.stringify({code}));'
    done = subprocess.run([node, '-'], input=text, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def systems():
    """Yield systems of one to four states with their noises and weights."""
    rng = np.random.default_rng(1)
    for n in (1, 2, 3, 4) * 5:
        A, B, C = rng.normal(size=(n, n)), rng.normal(size=(n, 1)), rng.normal(size=(1, n))
        half = rng.normal(size=(n, n))
        yield {
            'A': A,
            'B': B,
            'C': C,
            'W': half @ half.T + 0.1 * np.eye(n),
            'V': rng.uniform(0.1, 2),
        }


SYSTEMS = list(systems())
PLAIN = [{k: np.asarray(v).tolist() for k, v in system.items()} for system in SYSTEMS]


def close(ours, theirs, tolerance=1e-9):
    theirs = np.asarray(theirs)
    assert np.shape(ours) == theirs.shape
    np.testing.assert_allclose(ours, theirs, rtol=tolerance, atol=tolerance * np.abs(theirs).max())


def sorted_roots(poles):
    roots = [complex(*pole) if np.iterable(pole) else complex(pole) for pole in poles]
    return sorted(roots, key=lambda pole: (round(pole.real, 6), pole.imag))


def test_matrices_are_those_of_numpy_and_scipy():
    found = run(
        'd.map(({ A, W, B }) => ({ E: numbers.expm(A), inverse: numbers.inverse(A),'
        ' roots: numbers.eigenvalues(A), L: numbers.cholesky(W),'
        ' P: numbers.lyapunov(A, W), step: numbers.sample(A, B, 0.3),'
        ' Q: numbers.sampledNoise(A, W, 0.3) }))',
        PLAIN,
    )
    for system, ours in zip(SYSTEMS, found, strict=True):
        A, W = system['A'], system['W']
        close(ours['E'], expm(A))
        close(ours['inverse'], np.linalg.inv(A))
        close(sorted_roots(ours['roots']), sorted_roots(np.linalg.eigvals(A)))
        close(ours['L'], np.linalg.cholesky(W))
        close(ours['P'], solve_continuous_lyapunov(A, -W))
        sampled = kr.discretize(A, system['B'], 0.3, W)
        close(ours['step'][0], sampled.F)
        close(ours['step'][1], sampled.G)
        close(ours['Q'], sampled.Q)


def test_a_double_root_is_real_and_a_stiff_matrix_has_an_exponential():
    assert run('numbers.roots([1, -2, 1])') == [[1, 0], [1, 0]]
    assert run('numbers.roots([1, 0, 0])') == [[0, 0], [0, 0]]
    near = sorted(root for root, _ in run('numbers.roots([1, 1e8, 1])'))
    np.testing.assert_allclose(near, [-1e8, -1e-8], rtol=1e-12)
    assert run('numbers.solve([[1, 2], [2, 4]], [[1], [1]])') is None
    stiff = [[0, 1], [-400, -40]]
    close(run('numbers.expm(d)', stiff), expm(np.array(stiff)))


def test_gains_are_those_of_kr():
    found = run(
        'd.map(({ A, B, C, W, V }) => ({ ...numbers.lqr(A, B, W, [[V]]),'
        ' ...numbers.lqe(A, C, W, [[V]]),'
        ' placed: numbers.place(A, B.map(([b]) => b), A.map((_, k) => [-1 - k, 0])) }))',
        PLAIN,
    )
    for system, ours in zip(SYSTEMS, found, strict=True):
        A, B, C, W, V = (system[key] for key in 'ABCWV')
        gain, filtered = kr.lqr(A, B, W, [[V]]), kr.lqe(A, C, W, [[V]])
        close(ours['K'], gain.K)
        close(ours['X'], gain.S)
        close(ours['L'], filtered.L)
        close(ours['P'], filtered.P)
        poles = -1.0 - np.arange(len(A))
        close([ours['placed']], kr.place(A, B, poles).K)


def test_a_reading_and_a_prediction_are_those_of_the_filter():
    belief = {'x': [0.3, -0.2], 'P': [[1.5, 0.6], [0.6, 0.7]]}
    F, Q = [[1, 0.5], [0, 1]], [[0.02, 0.05], [0.05, 0.2]]
    ours = run(
        'numbers.update(numbers.predict(d.belief, d.F, d.Q), [1, 0.2], 0.9, 0.4)',
        {'belief': belief, 'F': F, 'Q': Q},
    )
    F, Q, H = np.array(F), np.array(Q), np.array([[1, 0.2]])
    x, P = F @ belief['x'], F @ belief['P'] @ F.T + Q
    S = H @ P @ H.T + 0.4
    K = P @ H.T / S
    close(ours['x'], x + (K * (0.9 - H @ x)).ravel())
    close(ours['P'], P - K @ H @ P)


def test_a_frequency_response_is_that_of_the_matrices():
    found = run(
        'd.map(({ A, B, C }) => numbers.transfer(A, B.map(([b]) => b), C[0], [0, 1.7]))', PLAIN
    )
    for system, value in zip(SYSTEMS, found, strict=True):
        A, B, C = (system[key] for key in 'ABC')
        close(complex(*value), (C @ np.linalg.solve(1.7j * np.eye(len(A)) - A, B))[0, 0])


def test_draws_are_normal():
    values = np.array(
        run('(() => { const f = numbers.normals(5); return Array.from({ length: 20000 }, f); })()')
    )
    assert abs(values.mean()) < 4 / math.sqrt(len(values))
    assert abs(values.var() - 1) < 4 * math.sqrt(2 / len(values))
    assert abs((np.abs(values) < 1).mean() - 0.6827) < 0.015


#: Doyle (1978), "Guaranteed margins for LQG regulators", with q and sigma of 60.
A, B, C = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[0.0], [1.0]]), np.array([[1.0, 0.0]])
NOISE = 60 * np.ones((2, 2))
K = kr.lqr(A, B, NOISE, [[1.0]]).K
EXTRA = {'LQG': 0.0, 'Recovered': 300.0}


def opened_loop(name):
    if name == 'LQR':
        return A, B, K
    L = kr.lqe(A, C, NOISE + np.diag([0, EXTRA[name] ** 2]), [[1.0]]).L
    whole = np.block([[A, np.zeros((2, 2))], [L @ C, A - B @ K - L @ C]])
    return whole, np.vstack([B, np.zeros((2, 1))]), np.hstack([np.zeros((1, 2)), K])


def test_margins_are_those_of_kr_and_of_doyle():
    code = 'margins.LOOPS.map(({ name, margins }) => ({ name, ...margins }))'
    close(K, [[10, 10]])  # 2 + sqrt(4 + q)
    for loop in run(code, modules=('margins',)):
        theirs = kr.margins(*opened_loop(loop['name']))
        assert loop['low'] == pytest.approx(theirs.lower_gain.value, rel=1e-9, abs=1e-9)
        assert (loop['high'] or math.inf) == pytest.approx(theirs.upper_gain.value, rel=1e-9)
        assert loop['lag'] == pytest.approx(math.degrees(theirs.lag.value), rel=1e-9)
        assert loop['lead'] == pytest.approx(math.degrees(theirs.lead.value), rel=1e-9)
        assert loop['delay'] == pytest.approx(theirs.delay.value, rel=1e-9)


@pytest.mark.parametrize(
    'factor',
    mostly_thorough(
        [0.25, 0.5, 0.92, 0.94, 1.0, 1.009, 1.011, 2.0, 3.0], 0.92, 0.94, 1.009, 1.011
    ),
)
def test_a_loop_is_stable_where_its_poles_are(factor):
    code = 'margins.LOOPS.map((loop) => [loop.name, margins.changed(loop, d, 0).stable])'
    for name, stable in run(code, factor, ('margins',)):
        M, b, c = opened_loop(name)
        assert stable == bool(np.linalg.eigvals(M - factor * b @ c).real.max() < 0)


def test_the_whole_loop_has_the_poles_of_both_halves():
    M = run(
        'separation.wholeLoop([[-1, 2], [-1, -2]], [[-3, 0], [-4, 0]])', modules=('separation',)
    )
    close(sorted_roots(np.linalg.eigvals(M)), sorted_roots([-4, -3, -1 - 2j, -1 + 2j]))


def test_the_energy_of_a_feedback_is_that_of_its_motion():
    found = run('feedback.closed([2, 2])', modules=('feedback',))
    forces = np.array(found['forces'])
    assert found['effort'] == pytest.approx(
        np.trapezoid(forces[:, 1] ** 2, forces[:, 0]), rel=1e-3
    )
    fast = run('feedback.closed([8, 4])', modules=('feedback',))
    assert fast['effort'] == pytest.approx(8 * found['effort'])


@pytest.mark.thorough
def test_no_feedback_is_below_the_curve_of_lqr():
    rng = np.random.default_rng(2)
    for pole in zip(rng.uniform(-5, -0.1, 20), rng.uniform(0.2, 5, 20), strict=True):
        mine = run(
            'weights.weights.compute({ weight: 1, re: d[0], im: d[1], second: -1 })',
            pole,
            ('weights',),
        )
        assert mine['mine']['error'] > 0.999 * mine['same']['error']
        assert mine['mine']['effort'] == pytest.approx(mine['same']['effort'], rel=0.02)


def test_the_gain_of_a_level_settles_where_the_equation_has_it():
    found = run('gain.recursion({ Q: 0.1, R: 1, P0: 10 })', modules=('gain',))
    assert found['steady'] == pytest.approx(kr.dlqe([[1.0]], [[1.0]], [[0.1]], [[1.0]]).L[0, 0])
    assert found['rows'][-1]['L'] == pytest.approx(found['steady'], rel=1e-6)
    assert found['rows'][0]['L'] == pytest.approx(10 / 11)


def test_the_moments_of_the_bent_cloud_are_those_of_many_draws():
    found = run('banana.transforms(0.1, 0.5)', modules=('banana',))
    rng = np.random.default_rng(4)
    r, angle = 1 + 0.1 * rng.normal(size=10**6), math.pi / 2 + 0.5 * rng.normal(size=10**6)
    cloud = np.array([r * np.cos(angle), r * np.sin(angle)])
    np.testing.assert_allclose(found['exact']['x'], cloud.mean(axis=1), atol=3e-3)
    np.testing.assert_allclose(found['exact']['P'], np.cov(cloud), atol=3e-3)
    assert abs(found['unscented']['x'][1] - found['exact']['x'][1]) < 0.1 * abs(
        found['tangent']['x'][1] - found['exact']['x'][1]
    )


def test_bearings_inform_as_a_batch_of_least_squares():
    state = {'kind': 1, 'tx': 6, 'ty': 5, 'sx': 3, 'sy': -1, 'turn': 0, 'sigma': 1}
    last = run('bearings.informed(d).at(-1)', state, ('bearings',))
    information = np.eye(2) / 36
    for k in range(30):
        dx, dy = np.subtract([6, 5], [3, -1] if k % 2 else [0, 0])
        h = np.array([-dy, dx]) / (dx**2 + dy**2)
        information += np.outer(h, h) / math.radians(1) ** 2
    close(last['P'], np.linalg.inv(information))


def test_a_turn_of_the_ship_shows_the_distance():
    def sigma(turn):
        state = {'kind': 2, 'tx': 6, 'ty': 5, 'sx': 3, 'sy': -1, 'turn': turn, 'sigma': 1}
        P = np.array(run('bearings.informed(d).at(-1).P', state, ('bearings',)))
        return math.sqrt(np.linalg.eigvalsh(P[:2, :2])[-1])

    assert sigma(0) > 4 * sigma(math.pi / 2)


def test_the_script_is_small_and_complete():
    assert len(script('index')) < 150e3
    index = (DOCS / 'explore' / 'index.js').read_text()
    listed = re.search(r'RECIPES = \{ (.*) \}', index)[1].split(', ')
    assert sorted(NAMES) == sorted(listed)
    assert {name for name, _ in SHOWN} == {chapter.name for chapter in CHAPTERS}
    # one module draws here and on the live page
    assert (
        "from '../../kalman_ros/live/page/pen.js'"
        in (DOCS / 'explore' / 'explorable.js').read_text()
    )
    assert "from './pen.js'" in (PAGE / 'plots.js').read_text()


@pytest.fixture(scope='module')
def places(tmp_path_factory):
    """Every picture on one page, opened as a file."""
    if not chromium.program():
        pytest.skip('there is no Chromium')
    pytest.importorskip('websockets')
    folder = tmp_path_factory.mktemp('explorables')
    (folder / 'explorables.js').write_text(script('index'))
    hosts = ''.join(f'<div class="explorable" id="explore-{name}">text</div>' for name in NAMES)
    style = module('bundle').palette() + (DOCS / '_static' / 'pages.css').read_text()
    page = folder / 'page.html'
    page.write_text(
        '<!doctype html><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f'<style>{style} body {{ font: 16px sans-serif }} [hidden] {{ display: none }}</style>'
        f'<body>{hosts}<script src="explorables.js" defer></script>'
    )
    with chromium.Chromium(1280, 900) as browser:
        yield browser, page.as_uri()
        assert browser.errors == []


def opened(places, part='', width=1280, *, mobile=False):
    browser, address = places
    browser.resize(width, 844 if mobile else 900, mobile=mobile)
    browser.open('about:blank')
    browser.open(address + part)
    browser.until(f'document.querySelectorAll(".explorable-sentence").length === {len(NAMES)}')
    return browser


#: Whether each picture has a pixel that is not empty.
DRAWN = (
    '[...document.querySelectorAll(".explorable-frame canvas")].every(c => new Uint32Array('
    'c.getContext("2d").getImageData(0, 0, c.width, c.height).data.buffer).some(Boolean))'
)


def sentence(browser, name):
    # what was moved is drawn in the next frame
    browser.call(
        'Runtime.evaluate', awaitPromise=True,
        expression='new Promise((f) => requestAnimationFrame(() => requestAnimationFrame(f)))',
    )  # fmt: skip
    return browser.run(
        f'document.querySelector("#explore-{name} .explorable-sentence").textContent'
    )


@pytest.mark.parametrize('name', mostly_thorough(NAMES, 'margins', 'modes', 'update'))
def test_each_handle_moves_by_mouse_and_by_key(places, name):
    browser = opened(places)
    picture = f'document.querySelector("#explore-{name}")'
    count = browser.run(f'{picture}.querySelectorAll(".explorable-handle").length')
    assert count
    for kind in range(max(1, browser.run(f'{picture}.querySelectorAll("[aria-pressed]").length'))):
        browser.run(f'{picture}.querySelectorAll("[aria-pressed]")[{kind}]?.click()')
        for k in range(count):
            # what is out of sight is not drawn, and has no place yet
            browser.run(f'{picture}.scrollIntoView({{ block: "center" }})')
            sentence(browser, name)
            handle = f'{picture}.querySelectorAll(".explorable-handle")[{k}]'
            browser.run(f'{handle}.id = "handle-{name}-{k}"')
            if browser.run(f'{handle}.hidden'):
                continue
            left, top, width, height = browser.place(f'#handle-{name}-{k}')
            x, y = left + width / 2, top + height / 2
            before = browser.run(f'{handle}.getAttribute("aria-valuetext")')
            browser.drag((x, y), (x + 12, y + 9), (x - 15, y + 21))
            after = sentence(browser, name)
            assert 'NaN' not in after and 'undefined' not in after
            assert browser.run(f'{handle}.getAttribute("aria-valuetext")') != before
            assert browser.run('location.hash').startswith(f'#{name}=')
            pressed = []
            for key in ('ArrowRight', 'ArrowLeft', 'ArrowUp', 'ArrowDown'):
                browser.run(f'{handle}.focus()')
                press(browser, key)
                sentence(browser, name)
                pressed.append(browser.run('location.hash'))
            assert len(set(pressed)) > 1
    browser.run(f'{picture}.querySelector(".explorable-reset").click()')
    assert 'NaN' not in sentence(browser, name)


def press(browser, key):
    browser.run(
        'document.activeElement.dispatchEvent('
        f'new KeyboardEvent("keydown", {{ key: "{key}", bubbles: true }}))'
    )


def test_an_address_brings_a_place_back(places):
    browser = opened(places, '#gain=0.5,2,1')
    assert 'Q/R = 0.25' in sentence(browser, 'gain')
    # an address may come from anywhere
    for part in ('#gain=1e999,2,1', '#gain=,,', '#gain=<b>', '#gain=1', '#modes=9,9,9,9', '#%zz'):
        browser = opened(places, part)
        assert 'Q/R = 0.1' in sentence(browser, 'gain')
        assert 'NaN' not in sentence(browser, 'modes')


def values(browser, name):
    return browser.run(f'location.hash.match(/{name}=([^&]*)/)[1].split(",").map(Number)')


def focus(browser, name, k=0):
    browser.run(f'document.querySelector("#explore-{name}").scrollIntoView({{ block: "center" }})')
    sentence(browser, name)
    browser.run(f'document.querySelectorAll("#explore-{name} .explorable-handle")[{k}].focus()')


@pytest.mark.thorough
def test_a_belief_stays_one_however_often_it_is_predicted(places):
    browser = opened(places)
    for label, count in (('predict 1 s', 30), ('take a reading like this', 30)):
        button = '[...document.querySelectorAll("#explore-update button")]'
        button += f'.find(e => e.textContent === "{label}")'
        for _ in range(count):
            browser.run(f'{button}.click()')
            assert NOTHING not in sentence(browser, 'update')
            _, _, pxx, pxv, pvv, *_ = values(browser, 'update')
            assert pxx * pvv > pxv**2
    # an address is no belief
    browser = opened(places, '#update=0,0,1e-4,30,1e-4,0,0,0.05')
    assert NOTHING not in sentence(browser, 'update')


def place_of(browser, name, k):
    """Return the centre of a handle on the screen."""
    focus(browser, name, k)
    handle = f'document.querySelectorAll("#explore-{name} .explorable-handle")[{k}]'
    browser.run(f'{handle}.id = "handle-{name}-{k}"')
    left, top, width, height = browser.place(f'#handle-{name}-{k}')
    return left + width / 2, top + height / 2


@pytest.mark.thorough
def test_either_of_two_real_poles_is_dragged_into_a_pair(places):
    for k in (0, 1):
        for way in (-1, 1):
            browser = opened(places, '#modes=-1,0,-2,0.6')
            x, y = place_of(browser, 'modes', k)
            browser.drag((x, y), (x, y + 20 * way), (x - 5, y + 60 * way))
            sentence(browser, 'modes')
            re, im, *_ = values(browser, 'modes')
            assert im > 1.0 and re == pytest.approx(-1.2 - k, abs=0.3)


def test_of_handles_that_overlap_the_nearest_is_dragged(places):
    """With little noise of the bearing its handle lies within that of the range."""
    browser = opened(places, '#banana=0.05,0.07')
    x, y = place_of(browser, 'banana', 0)
    browser.drag((x, y), (x + 15, y), (x + 30, y))
    sentence(browser, 'banana')
    distance, bearing = values(browser, 'banana')
    assert distance == 0.05 and bearing > 0.1


def test_noise_that_is_dragged_beyond_nothing_stays_the_least(places):
    browser = opened(places, '#banana=0.05,0.2')
    x, y = place_of(browser, 'banana', 0)
    browser.drag((x, y), (x - 20, y), (x - 150, y))
    sentence(browser, 'banana')
    assert values(browser, 'banana')[1] == pytest.approx(np.pi / 180, rel=1e-3)


def test_arrow_keys_make_a_pair_and_take_it_apart(places):
    browser = opened(places, '#modes=-1,0,-2,0.6')
    focus(browser, 'modes', 1)
    press(browser, 'ArrowUp')
    sentence(browser, 'modes')
    re, im, *_ = values(browser, 'modes')
    assert (re, im) == (-2, 0.15)
    # the handle of the other pole is gone, and the first has the keys
    assert browser.run('document.activeElement.dataset.name') == 'eigenvalue, first pole'
    press(browser, 'ArrowDown')
    sentence(browser, 'modes')
    assert values(browser, 'modes')[:3] == [-2, 0, -2]


def test_a_handle_beyond_the_picture_does_not_jump(places):
    browser = opened(places, '#eigenvalue=0.8,2')
    focus(browser, 'eigenvalue', 1)
    browser.run('document.activeElement.id = "beyond"')
    left, top, width, height = browser.place('#beyond')
    x, y = left + width / 2, top + height / 2
    browser.drag((x, y), (x + 1, y + 1))
    sentence(browser, 'eigenvalue')
    assert values(browser, 'eigenvalue')[0] > 0.75


def test_an_address_has_what_was_moved_in_all_pictures(places):
    browser = opened(places)
    for name in ('gain', 'modes'):
        focus(browser, name)
        press(browser, 'ArrowDown')
        sentence(browser, name)
    assert values(browser, 'gain') and values(browser, 'modes')


def test_a_page_that_is_printed_has_all_pictures(places):
    browser = opened(places)
    browser.run('dispatchEvent(new Event("beforeprint"))')
    assert browser.run(DRAWN)


def test_what_is_left_is_counted_in_samples(places):
    browser = opened(places, '#sampling=0.25,0.5,1')
    x = [1.0, 1.0 - 0.25 * 0]  # the input acts one sample late: nothing happens in the first
    while len(x) < 40:
        x.append(x[-1] - 0.25 * x[-2])
    settled = max(k for k, value in enumerate(x) if abs(value) >= 0.01) + 1
    assert f'after {settled} samples' in sentence(browser, 'sampling')


def test_a_phone_shows_a_handle_and_its_effects_together(places):
    browser = opened(places, width=390, mobile=True)
    assert browser.run('document.documentElement.scrollWidth') <= 390
    heights = browser.run(
        '[...document.querySelectorAll(".explorable-panels")]'
        '.map(e => e.getBoundingClientRect().height)'
    )
    assert max(heights) < 844
    assert browser.run(
        '[...document.querySelectorAll(".explorable-handle")]'
        '.every(e => getComputedStyle(e).touchAction === "none")'
    )
    browser.run('document.querySelector("#explore-modes").scrollIntoView()')
    sentence(browser, 'modes')
    left, top, width, height = browser.place('#explore-modes .explorable-handle')
    x, y, before = left + width / 2, top + height / 2, sentence(browser, 'modes')
    for kind, points in (
        ('touchStart', [{'x': x, 'y': y}]),
        ('touchMove', [{'x': x - 30, 'y': y + 10}]),
        ('touchEnd', []),
    ):
        browser.call('Input.dispatchTouchEvent', type=kind, touchPoints=points)
    assert sentence(browser, 'modes') != before


@pytest.mark.thorough
def test_what_is_scrolled_to_is_drawn(places):
    browser = opened(places)
    for name in NAMES:
        browser.run(f'document.querySelector("#explore-{name}").scrollIntoView()')
        sentence(browser, name)
    assert browser.run(DRAWN)
