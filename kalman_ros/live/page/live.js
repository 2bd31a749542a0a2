// SPDX-License-Identifier: Apache-2.0
// The page: one socket, what it brings, and what a person does.

import { Controls } from './controls.js';
import { add, clear, data, last } from './data.js';
import { drawBode, drawNyquist, marginText, PoleMap } from './maps.js';
import { forgetColours, plot, short } from './plots.js';
import { drawSystem } from './system.js';

const $ = (id) => document.getElementById(id);
const page = { scene: null, values: {}, chosen: {}, theory: {}, status: {}, share: {}, plots: [] };
const waiting = new Map();
const STEPS = 150;  // that a plot of single steps shows
let socket = null, count = 0, dirty = true;

// --- the socket --------------------------------------------------------------------------------
function connect() {
  socket = new WebSocket(`ws://${location.host}/socket`);
  socket.onmessage = (event) => receive(JSON.parse(event.data));
  socket.onclose = () => {
    $('state').textContent = 'not connected';
    waiting.forEach((done) => done());
    waiting.clear();
    setTimeout(connect, 1000);
  };
}

function send(command, done = () => {}) {
  if (socket?.readyState !== WebSocket.OPEN) { done(); return; }
  const n = ++count;
  waiting.set(n, done);
  socket.send(JSON.stringify({ ...command, n: page.id * 1e6 + n }));
}

page.id = Math.floor(Math.random() * 1e6);

function receive(message) {
  dirty = true;
  if (message.kind === 'frames') {
    for (const frame of message.frames) {
      if (frame.answer) answered(frame.answer);
      else if (frame.latency) $('latency').textContent = `slider to input ${Math.round(frame.latency.ms)} ms`;
      else add(frame);
    }
    return;
  }
  RECEIVE[message.kind]?.(message);
}

function answered({ n, error }) {
  if (n === null || Math.floor(n / 1e6) !== page.id) return;
  notice(error);
  const done = waiting.get(n % 1e6);
  waiting.delete(n % 1e6);
  done?.();
  if (error) {
    controls.show(page.values);
    map.show(page.theory, page.scene?.linear);
  }
}

function notice(text) {
  $('notice').textContent = text;
  $('notice').hidden = !text;
}

const RECEIVE = {
  scene(message) {
    page.scene = message;
    data.unit = message.time;
    data.each = message.time.replace(/(?<=.)s$/, '');
    clear();
    waiting.clear();
    $('name').textContent = document.title = message.name;
    controls.build(message);
    buildPushes();
    buildChoices();
    buildPlots();
    controls.show(page.values);
  },
  values(message) {
    page.values = message.values;
    page.chosen = message.chosen;
    controls.show(page.values);
    for (const select of $('choices').querySelectorAll('select')) select.value = page.chosen[select.name];
  },
  theory(message) {
    page.theory = message;
    $('notes').replaceChildren(...message.notes.map((text) => Object.assign(document.createElement('li'), { textContent: text })));
    const loops = message.loops ?? [];
    $('loops').hidden = !loops.length;
    const select = $('loop-input'), names = loops.map((loop) => loop.input);
    if ([...select.options].map((option) => option.value).join() !== names.join()) {
      select.replaceChildren(...names.map((name) => new Option(name, name)));
    }
    $('regulator-legend').hidden = !message.regulator;
    $('pole-map').hidden = !message.open && !message.regulator && !message.estimator;
    map.show(message, page.scene?.linear);
    $('estimator-legend').textContent = `○ estimator${page.scene?.linear ? ': drag' : ''}${message.estimator?.placed ? ', | as sampled' : ''}`;
    listPoles();
    const margins = (loops[0]?.estimated ?? loops[0]?.known)?.margins;
    controls.mark('plant/actuator_gain/0', margins ? [margins.lower_gain[0], margins.upper_gain[0]].filter(Boolean) : []);
    const delay = margins?.delay[0];
    controls.mark('plant/actuator_delay', delay ? [delay + (page.values['plant/actuator_delay'] ?? 0)] : []);
  },
  share(message) { page.share = message; },
  status(message) {
    page.status = message;
    const how = message.lockstep ? 'lockstep' : 'real time';
    $('state').textContent = message.message || `${how}${message.paused ? ', paused' : ''}${message.missed > 0 ? `, ${message.missed} steps late` : ''}`;
    if (message.failed) notice(`${message.message}. Press reset to start again.`);
    $('pause').textContent = message.paused ? 'continue' : 'pause';
    $('lockstep').checked = message.lockstep;
    $('speed-label').hidden = !message.lockstep;
    if (document.activeElement !== $('speed')) $('speed').value = Math.log10(message.speed);
    $('speed-value').textContent = `× ${short(message.speed)}`;
    data.span = message.lockstep ? Math.max(message.paused ? 0.5 : 0, 10 * message.speed) : 10;
    const facts = [];
    for (const [name, { level, message: text }] of Object.entries(message.nodes)) {
      facts.push(Object.assign(document.createElement('dt'), { textContent: name }));
      facts.push(Object.assign(document.createElement('dd'), { textContent: text, className: ['', 'warn', 'error'][level] ?? '' }));
    }
    $('facts').replaceChildren(...facts);
  },
};

// --- what depends on the scene -----------------------------------------------------------------
const controls = new Controls($('controls'), send);
const map = new PoleMap($('poles'), placePoles);
let placing = false, nextPoles = null;

function placePoles(of, poles) {
  if (placing) { nextPoles = [of, poles.map((pole) => [...pole])]; return; }
  placing = true;
  send({ do: 'poles', of, poles }, () => {
    placing = false;
    if (nextPoles) { const next = nextPoles; nextPoles = null; placePoles(...next); }
  });
}

function listPoles() {
  if ($('pole-list').contains(document.activeElement)) return;
  const rows = [];
  for (const [of, poles] of Object.entries(map.poles)) {
    poles.forEach(([re, im], index) => {
      if (im < 0) return;
      const row = Object.assign(document.createElement('div'), { className: 'pole' });
      const numbers = [re, ...(im ? [im] : [])].map((value, part) => {
        const input = Object.assign(document.createElement('input'), { type: 'number', step: 'any', value: Number(value.toPrecision(4)) });
        input.disabled = !map.draggable.includes(of);
        input.setAttribute('aria-label', `${of} pole ${index + 1}, ${part ? 'imaginary' : 'real'} part`);
        input.addEventListener('change', () => {
          const wanted = poles.map((pole) => [...pole]), old = wanted[index][1];
          const partner = old ? wanted.findIndex(([a, b], k) => k !== index && a === re && b === -old) : -1;
          wanted[index][part] = Number(input.value);
          if (partner >= 0) wanted[partner] = [wanted[index][0], -wanted[index][1]];
          send({ do: 'poles', of, poles: wanted });
          input.blur();
        });
        return input;
      });
      row.append(of === 'regulator' ? '□ regulator' : '○ estimator', numbers[0], ...(numbers[1] ? ['± j', numbers[1]] : []), `1/${data.each}`);
      rows.push(row);
    });
  }
  $('pole-list').replaceChildren(...rows);
}

function buildPushes() {
  const names = page.scene.input.names;
  $('pushes').replaceChildren(...names.flatMap((name, input) => [1, -1].map((share) => {
    const button = Object.assign(document.createElement('button'), { type: 'button', textContent: `push ${name} ${share > 0 ? '+' : '−'}` });
    if (!input && share > 0) button.title = 'p';
    button.addEventListener('click', () => push(input, share));
    return button;
  })));
  $('strength-label').hidden = $('input-legend').hidden = !names.length;
}

function buildChoices() {
  $('choices').replaceChildren(...Object.entries(page.scene.choices).map(([what, list]) => {
    const label = Object.assign(document.createElement('label'), { className: 'speed', textContent: `${what} ` });
    const select = Object.assign(document.createElement('select'), { name: what });
    select.append(...list.map((name) => new Option(name, name)));
    select.value = page.chosen[what];
    select.addEventListener('change', () => send({ do: 'choose', what, value: select.value }, () => { select.value = page.chosen[what]; }));
    label.append(select);
    return label;
  }));
}

function buildPlots() {
  const { state, input, sensors, rate } = page.scene, n = state.names.length;
  page.plots = [];
  const build = (place, make) => {
    const canvas = document.createElement('canvas');
    canvas.setAttribute('role', 'img');
    page.plots.push({ canvas, make });
    $(place).append(canvas);
  };
  for (const id of ['states', 'innovations', 'filter', 'cost']) $(id).replaceChildren();
  state.names.forEach((name, k) => build('states', () => ({
    title: `${name} [${state.units[k]}]`,
    bands: [{ rows: data.rows.estimate, low: (r) => r[1 + k] - 2 * r[1 + n + k], high: (r) => r[1 + k] + 2 * r[1 + n + k], look: 'band' }],
    marks: Object.entries(sensors).filter(([, s]) => s.names.includes(name)).map(([s, sensor]) => ({
      rows: data.rows[`reading ${s}`], value: (r) => r[1 + sensor.names.indexOf(name)], look: 'reading',
    })),
    curves: [
      { rows: data.rows.truth, value: (r) => r[1 + k], look: 'ink', width: 2, turns: state.angles.includes(name) },
      { rows: data.rows.estimate, value: (r) => r[1 + k], look: 'estimate', dash: 'dashed', turns: state.angles.includes(name) },
    ],
  })));
  input.names.forEach((name, k) => build('states', () => ({
    title: `${name} [${input.units[k]}]`, curves: [{ rows: data.rows.input, value: (r) => r[1 + k], look: 'input' }],
  })));
  for (const [s, sensor] of Object.entries(sensors)) {
    const m = sensor.names.length;
    sensor.names.forEach((name, k) => build('innovations', () => ({
      title: `${s}: ${name} [${sensor.units[k]}], with ±2σ`,
      bands: [{ rows: data.rows[`innovation ${s}`], low: (r) => -2 * r[1 + m + k], high: (r) => 2 * r[1 + m + k], look: 'band' }],
      marks: [{ rows: data.rows[`innovation ${s}`], value: (r) => r[1 + k], look: 'ink', dot: true }],
    })));
    build('innovations', () => ({
      title: `NIS of ${s}: ${m} on average, 95 % below the dashes`,
      marks: [{ rows: data.rows[`innovation ${s}`], value: (r) => r[1 + 2 * m], look: 'ink', dot: true }],
      lines: [{ value: m, look: 'estimate' }, { value: [3.84, 5.99, 7.81, 9.49, 11.07, 12.59][m - 1] ?? m + 2.5 * Math.sqrt(2 * m), look: 'estimate', dash: 'dashed' }],
    }));
    build('filter', () => ({
      title: `gain K of ${s}: ${state.names.join(', ')} by ${sensor.names.join(', ')}`,
      curves: Array.from({ length: n * m }, (_, k) => ({ rows: data.rows[`gain ${s}`], value: (r) => r[1 + k], look: k % 2 ? 'ink' : 'estimate', dash: ['solid', 'dashed', 'dotted'][k % 3] })),
    }));
  }
  build('filter', () => ({
    title: 'trace of P', log: true, share: Math.min(1, STEPS / (rate * data.span)),
    curves: [{ rows: data.rows.estimate, value: (r) => r[1 + 2 * n], look: 'estimate' }],
    marks: rate * data.span < 800 ? [{ rows: data.rows.estimate, value: (r) => r[1 + 2 * n], look: 'estimate', dot: true }] : [],
  }));
  $('cost-title').hidden = !input.names.length;
  if (input.names.length) build('cost', () => ({
    title: `cost a second: recent ${short(last('cost')?.[2])}, mean ${short(last('cost')?.[1])}, least possible ${short(page.theory.optimum)} (dots)`,
    log: true,
    curves: [{ rows: data.rows.cost, value: (r) => r[2], look: 'input' }, { rows: data.rows.cost, value: (r) => r[1], look: 'ink', dash: 'dashed' }],
    lines: page.theory.optimum > 0 ? [{ value: page.theory.optimum, look: 'estimate' }] : [],
  }));
}

// --- drawing: at most 20 times a second --------------------------------------------------------
let drawn = 0;

function draw(time) {
  requestAnimationFrame(draw);
  if (!dirty || !page.scene || time - drawn < 45) return;
  drawn = time;
  dirty = false;
  $('clock').textContent = `${data.now.toFixed(data.unit === 's' ? 2 : 0)} ${data.unit}`;
  $('prior-legend').hidden = !data.prior;
  drawSystem($('system'), page.scene);
  for (const { canvas, make } of page.plots) plot(canvas, make());
  if (!map.held) map.draw();
  const loop = (page.theory.loops ?? []).find((each) => each.input === $('loop-input').value);
  if (loop) {
    $('margins').textContent = marginText(loop);
    drawBode($('bode'), loop);
    drawNyquist($('nyquist'), loop);
  }
}

// --- what a person does ------------------------------------------------------------------------
const ACT = {
  pause: () => send({ do: page.status.paused ? 'resume' : 'pause' }),
  step: () => send({ do: 'step' }),
  reset: () => send({ do: page.status.failed ? 'restart' : 'reset' }),
  push: () => push(0, 1),
  theme: () => theme(!document.documentElement.classList.contains('dark')),
  share: () => {
    const file = `${page.share.name}_live.yaml`;
    $('yaml').value = page.share.yaml;
    $('command').textContent = `./dev live ${file}\n./dev demo ${file}`;
    $('shared').showModal();
  },
};

function push(input, sign) {
  send({ do: 'push', input, share: sign * 10 ** $('strength').value });
}

function theme(dark) {
  document.documentElement.classList.toggle('dark', dark);
  forgetColours();
  dirty = true;
}

for (const id of ['pause', 'step', 'reset', 'share', 'theme']) $(id).addEventListener('click', ACT[id]);
$('lockstep').addEventListener('change', () => send({ do: 'mode', lockstep: $('lockstep').checked }));
$('speed').addEventListener('input', () => send({ do: 'speed', value: Number((10 ** $('speed').value).toPrecision(2)) }));
$('close').addEventListener('click', () => $('shared').close());
$('copy').addEventListener('click', () => { $('yaml').select(); document.execCommand('copy'); });
$('save').addEventListener('click', () => {
  const link = Object.assign(document.createElement('a'), { download: `${page.share.name}_live.yaml` });
  link.href = URL.createObjectURL(new Blob([page.share.yaml], { type: 'application/yaml' }));
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
});
$('loop-input').addEventListener('change', () => { dirty = true; });
const KEYS = { ' ': 'pause', s: 'step', r: 'reset', p: 'push', t: 'theme' };
addEventListener('keydown', (event) => {
  const busy = event.target.closest('input, select, textarea, button, summary, dialog');
  if (busy || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  ACT[KEYS[event.key]]();
});
addEventListener('scroll', () => { dirty = true; }, { passive: true });
addEventListener('resize', () => { dirty = true; });
const darkness = matchMedia('(prefers-color-scheme: dark)');
darkness.addEventListener('change', () => theme(darkness.matches));
theme(darkness.matches);
// where the poles are on the map, in pixels: for tests
window.livePoles = (of) => map.poles[of].map(([re, im]) => [map.X(re), map.Y(im)]);
connect();
requestAnimationFrame(draw);
