// SPDX-License-Identifier: Apache-2.0
// The drawer beside the system: a few tasks, each with its handles and the two effects they have.

import { addressed, rememberTask } from './address.js';
import { Controls } from './controls.js';
import { data } from './data.js';
import { buildGhost } from './ghost.js';
import { grab, noGrab } from './grab.js';
import { areAlike, hasLimits, hasWalls, limitOf, setLimit } from './limits.js';
import { $, acted, element, page } from './page.js';
import { pathHint, sendShape, SHAPES } from './path.js';
import { short } from './pen.js';
import { mainStates } from './saying.js';
import { send } from './socket.js';
import { buildTour, followTour, goTo, tourEffect, tourReason, tourStep, tourWords } from './tour.js';
import { drawStep, isPredicted, shownSensor, stepNumbers } from './update.js';

const ROWS = 4;  // handles of a task, at most
export const drawer = { effects: [], controls: null, tell: () => {} };
let renewed = () => {};  // what shows values again

// A button; where there is a reason, it is disabled and says why.
export function button(text, act, reason = '', title = '') {
  const made = element('button', { type: 'button', textContent: text, disabled: Boolean(reason), title: reason || title });
  made.addEventListener('click', act);
  return made;
}

const keys = (pattern, count = ROWS) => page.scene.controls.filter(({ key }) => pattern.test(key)).slice(0, count);
let sensor = '';  // of which faults and noise are shown
const firstSensor = () => (sensor in page.scene.sensors ? sensor : Object.keys(page.scene.sensors)[0]);
// a coordinate that it measures, or that matters to it most
const sensedBy = (name) => page.scene.sensors[name].names.find((each) => page.scene.state.names.includes(each)) ?? page.scene.sensors[name].sees ?? mainStates()[0];

const hasPlaces = () => Object.keys(page.places).length > 0;

// of several sensors, one is chosen
function chooseSensor(place, task) {
  const names = Object.keys(page.scene.sensors);
  if (names.length < 2) return;
  const choice = element('select', { id: 'sensor' }, ...names.map((name) => new Option(name, name)));
  choice.value = firstSensor();
  choice.addEventListener('change', () => { sensor = choice.value; open(task); });
  place.append(element('label', { className: 'speed' }, 'sensor ', choice));
}

// the first noise of the model that acts, in the plant and as believed
function processNoise() {
  const all = keys(/^(estimator|plant|controller)\/model_parameters\..*noise/, 100), name = ({ key }) => key.split('/').slice(1).join('/');
  const first = all.find(({ key }) => page.values[key] > 0) ?? all[0];
  return first ? all.filter((control) => name(control) === name(first)).slice(0, 2) : [];
}

const noInput = () => (page.scene.input.names.length ? '' : 'the model has no input');

// the states with the largest weights, else those that are measured
function heavy(count) {
  const { names } = page.scene.state, weight = (k) => page.values[`controller/state_cost/${k}`] ?? 0;
  const order = names.map((name, k) => [weight(k), name]).filter(([w]) => w > 0).sort((a, b) => b[0] - a[0]).map(([, name]) => name);
  return [...new Set([...order, ...mainStates(), ...names])].slice(0, count);
}

const loopEffects = () => [`state ${heavy(1)[0]}`, ...(noInput() ? [`state ${heavy(2)[1] ?? heavy(1)[0]}`] : [`input ${page.scene.input.names[0]}`])];

const TASKS = {
  path: {
    says: true,  // why its handles are disabled
    reason: () => page.scene.path.reason,
    words: pathHint,
    build: (place) => {
      place.append(element('div', { className: 'transport' }, 'or send a ', ...Object.keys(SHAPES).map((name) => button(name, () => sendShape(name), page.scene.path.reason, `a path from here: ${name}`))));
      list(place, keys(/^controller\/path_/, 2));
    },
    effects: () => (page.scene.input.names.length > 1 ? page.scene.input.names.slice(0, 2).map((name) => `input ${name}`) : loopEffects()),
  },
  limits: {
    reason: noInput,
    words: () => page.limits.reason && `States have no limits: ${page.limits.reason}. Drag those of the input.`
      || `Drag the red lines${hasWalls() ? ' and walls' : ''}, or type a number; an empty field is no limit.`,
    build: buildLimits,
    effects: () => {
      const limited = page.scene.state.names.find((name) => limitOf('state', name, 'low') !== null || limitOf('state', name, 'high') !== null);
      return [`state ${limited ?? heavy(1)[0]}`, `input ${page.scene.input.names[0]}`];
    },
  },
  regulator: {
    reason: noInput,
    words: () => 'Weights of the cost: a heavy state is brought home faster, a heavy input is spared. Beyond red marks the loop is unstable.',
    build: (place) => list(place, [
      ...heavy(2).flatMap((name) => keys(new RegExp(`^controller/state_cost/${page.scene.state.names.indexOf(name)}$`))),
      ...keys(/^controller\/input_cost/, 1), ...keys(/^plant\/actuator_gain/, 1),
    ]),
    effects: loopEffects,
  },
  filter: {
    reason: () => '',
    words: () => 'What the sensor does (actual), and what the filter computes with (believed).',
    build: (place) => {
      const row = element('div', { className: 'selects' });
      place.append(row);
      chooseSensor(row, 'filter');
      list(place, [...keys(new RegExp(`/${firstSensor()}\\.noise/0$`), 2), ...processNoise()]);
      drawer.tell = buildGhost(place, row);
    },
    effects: () => [`state ${sensedBy(firstSensor())}`, `NIS ${firstSensor()}`],
  },
  update: {
    reason: () => '',
    words: () => (isPredicted() ? 'Predicted: the ellipse has moved by the model and grown by Q. Now update.'
      : 'One step: the ellipse grows (prediction), the reading comes with another, both multiply.'),
    build: buildStep,
    effects: () => [drawStep],
  },
  faults: {
    reason: () => '',
    words: () => `Faults of ${firstSensor()}: does the filter notice?`,
    build: (place) => {
      chooseSensor(place, 'faults');
      list(place, keys(new RegExp(`^plant/${firstSensor()}\\.(bias|outliers|dropout|enabled)`)));
    },
    effects: () => [`innovation ${firstSensor()} ${page.scene.sensors[firstSensor()].names[0]}`, `state ${sensedBy(firstSensor())}`],
  },
  push: {
    reason: () => (noInput() && page.scene.drawing.kind === 'bars' ? noInput() : ''),
    words: () => {
      if (noGrab()) return `With the mouse, nothing: ${noGrab()}.`;
      return grab.carries ? `Drag the system${hasPlaces() ? ' or a sensor' : ''} elsewhere: the estimator does not know.`
        : `Pull at the system with the mouse or a finger${hasPlaces() ? ', move a sensor' : ''}, or push an input for 0.2 s.`;
    },
    build: buildPushes,
    effects: () => (noInput() ? [`state ${mainStates()[0]}`, `NIS ${firstSensor()}`] : pushEffects()),
  },
  tour: {
    reason: tourReason,
    words: tourWords,
    build: (place) => {
      drawer.controls = buildTour(place, () => open('tour'));
      drawer.tell = followTour;
    },
    effects: () => [tourEffect() === 'update' ? drawStep : tourEffect()],
  },
};

function list(place, controls) {
  const rows = element('div');
  place.append(rows);
  drawer.controls = new Controls(rows, send);
  drawer.controls.values = page.values;
  drawer.controls.list(controls);
}

function buildLimits(place) {
  const { state, input } = page.scene, shown = [];
  const limited = state.names.filter((name) => [limitOf('state', name, 'low'), limitOf('state', name, 'high')].some((value) => value !== null));
  for (const name of [...new Set([...limited, ...heavy(2)])].slice(0, ROWS - 1)) shown.push(['state', name, state.units[state.names.indexOf(name)]]);
  for (const name of input.names.slice(0, ROWS - shown.length)) shown.push(['input', name, input.units[input.names.indexOf(name)]]);
  const fields = [];
  for (const [of, name, unit] of shown) {
    const reason = hasLimits(of, name) ? '' : page.limits.reason;
    const row = element('div', { className: 'limits', title: reason }, element('span', { textContent: `${of === 'input' ? 'input ' : ''}${name} [${unit}]` }));
    const alike = areAlike(of, name);
    for (const side of alike ? ['high'] : ['low', 'high']) {
      const field = element('input', { type: 'number', step: 'any', disabled: Boolean(reason), placeholder: 'no limit', title: reason || (of === 'input' && side === 'low' ? '' : 'empty: no limit') });
      field.setAttribute('aria-label', alike ? `largest magnitude of ${name}` : `${side === 'low' ? 'lowest' : 'highest'} ${name}`);
      field.addEventListener('change', () => setLimit({ of, name, side }, field.value === '' ? null : Number(field.value)));
      row.append(element('span', { className: 'role', textContent: alike ? '±' : side === 'low' ? 'lowest' : 'highest' }), field);
      fields.push({ field, show: () => { const value = limitOf(of, name, side); field.value = value === null ? '' : short(value); } });
    }
    place.append(row);
  }
  if (page.limits.reason && !noInput()) place.append(button('use law: mpc', () => send({ do: 'choose', what: 'law', value: 'mpc' })));
  renewed = () => { for (const { field, show } of fields) if (document.activeElement !== field) show(); };
  renewed();
}

function buildStep(place) {
  const act = button('', () => send({ do: 'step', reading: shownSensor() }), '', 'to the next reading'), numbers = element('div', { id: 'numbers' });
  const legend = Object.entries({ before: 'before', prior: 'predicted', line: 'reading, 2σ', estimate: 'updated' });
  place.append(element('div', { className: 'transport' }, act), numbers, element('p', { className: 'legend' }, ...legend.map(([look, text]) => element('span', {}, element('i', { className: look }), text))));
  drawer.tell = () => {
    act.textContent = isPredicted() ? 'update' : page.status.lockstep ? 'predict' : 'predict: stop, and go step by step';
    const lines = stepNumbers();
    if (numbers.textContent !== lines.join('')) numbers.replaceChildren(...lines.map((textContent) => element('p', { textContent })));
  };
}

function buildPushes(place) {
  const row = element('div', { className: 'transport', id: 'pushes' }), names = page.scene.input.names;
  const choice = element('select', { id: 'grab' }, new Option('pulls (a force)', 'pull'), new Option('carries away', 'carry'));
  if (noInput()) Object.assign(choice.options[0], { disabled: true, title: noInput() });
  grab.carries = grab.carries || Boolean(noInput());
  choice.value = grab.carries ? 'carry' : 'pull';
  choice.addEventListener('change', () => { grab.carries = choice.value === 'carry'; page.dirty = true; });
  place.append(element('label', { className: 'speed' }, 'the mouse ', choice));
  for (const [input, name] of names.entries()) {
    for (const sign of [1, -1]) row.append(button(`push ${name} ${sign > 0 ? '+' : '−'}`, () => push(input, sign), '', !input && sign > 0 ? 'p' : ''));
  }
  const strength = element('input', { type: 'range', id: 'strength', min: -1.5, max: 0.5, step: 0.05, value: push.strength });
  strength.addEventListener('input', () => { push.strength = Number(strength.value); });
  if (names.length) place.append(row, element('label', { className: 'speed' }, 'strength of a push ', strength));
}

export function push(input, sign) {
  const name = page.scene.input.names[input], way = sign > 0 ? '+' : '−';
  acted(`The input ${name} was pushed (${way})`, `${name} ${way}`, data.now);
  if (push.input !== input) {  // its effects
    push.input = input;
    if (page.task === 'push') { drawer.effects = TASKS.push.effects(); page.renew(); }
  }
  send({ do: 'push', input, share: sign * 10 ** push.strength });
}
push.strength = -0.7;
push.input = 0;

// the state along which the input that was pushed acts first, and the input
const pushEffects = () => [`state ${page.scene.path.names[push.input] ?? mainStates()[0]}`, `input ${page.scene.input.names[push.input] ?? page.scene.input.names[0]}`];

// the tasks of a scene, and the one that matters first
export function buildDrawer() {
  const tabs = Object.entries(TASKS).map(([name, task]) => {
    const reason = task.reason(), tab = button(name, () => open(name), '', reason);
    tab.setAttribute('role', 'tab');
    tab.classList.toggle('off', Boolean(reason));  // it opens all the same, and says why
    tab.dataset.task = name;
    return tab;
  });
  $('tasks').replaceChildren(...tabs);
  $('tasks').onkeydown = (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const next = tabs.at((tabs.indexOf(document.activeElement) + step) % tabs.length);
    next.focus();
    next.click();
  };
  if (!TASKS[page.task] && addressed('tour')) goTo(Number(addressed('tour')));
  const task = page.task || (addressed('tour') ? 'tour' : addressed('task'));
  open(TASKS[task] ? task : first());
}

function first() {
  if (!page.scene.path.reason && page.scene.drawing.heading) return 'path';  // a robot
  if (page.chosen.law === 'mpc') return 'limits';
  return noInput() ? 'filter' : 'regulator';
}

export function open(name) {
  page.task = name;
  for (const tab of $('tasks').children) {
    tab.setAttribute('aria-selected', tab.dataset.task === name);
    tab.tabIndex = tab.dataset.task === name ? 0 : -1;
  }
  drawer.controls = null;
  drawer.tell = () => {};
  renewed = () => {};
  $('handles').replaceChildren();
  const task = TASKS[name], reason = task.reason();
  if (!reason || task.says) task.build($('handles'));
  drawer.effects = reason ? [`state ${mainStates()[0]}`] : task.effects();
  $('system').dataset.open = name;
  rememberTask(name, tourStep());
  page.renew();
  page.dirty = true;
}

let law = '';

// what the server says about values
export function showDrawer() {
  if (!TASKS[page.task]) return;
  drawer.controls?.show(page.values);
  if (page.task === 'limits' && law !== page.chosen.law) open('limits');
  law = page.chosen.law;
  renewed();
}

export function drawerWords() {
  const task = TASKS[page.task];
  if (!task) return;
  const words = task.reason() && !task.says ? `There is nothing to move: ${task.reason()}.` : task.words();
  if ($('words').textContent !== words) $('words').textContent = words;
  drawer.tell();
}
