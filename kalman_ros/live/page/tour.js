// SPDX-License-Identifier: Apache-2.0
// The guided tour: each claim of the course with a question, one handle, one effect, and an answer
// that is computed from what happened.

import { Controls } from './controls.js';
import { data } from './data.js';
import { element, page } from './page.js';
import { quantity, short } from './pen.js';
import { send } from './socket.js';
import { stepNumbers, stepSizes } from './update.js';

const NEEDED = 'cart_pole';  // the model in which all steps work
const SETTLE = 1, WINDOW = 4;  // seconds after a change before it is measured, and that are measured
const LEAST = 2;     // seconds that are measured before a change
const EQUAL = 1.25;  // two numbers within this factor are called the same
const LIMIT = 1.3;   // radians beyond which the pole has fallen
const GROWN = 1.5;   // an error that is larger by this factor is called larger

const stateIndex = (name) => page.scene.state.names.indexOf(name);
const between = (rows, from, to) => (rows ?? []).filter((row) => row[0] >= from && row[0] <= to);
const rootMeanSquare = (numbers) => Math.sqrt(numbers.reduce((sum, number) => sum + number * number, 0) / (numbers.length || 1));
const mean = (numbers) => numbers.reduce((sum, number) => sum + number, 0) / (numbers.length || 1);
const compare = (before, after, factor = EQUAL) => (after > factor * before ? 2 : after < before / factor ? 0 : 1);
const LESS_SAME_MORE = ['smaller', 'about the same', 'larger'];

const spread = (name, from, to) => rootMeanSquare(between(data.rows.truth, from, to).map((row) => row[1 + stateIndex(name)]));
const effort = (from, to) => rootMeanSquare(between(data.rows.input, from, to).map((row) => row[1]));
const believed = (name, from, to) => 2 * mean(between(data.rows.estimate, from, to).map((row) => row[1 + page.scene.state.names.length + stateIndex(name)]));

// the error of the estimate, against the truth of the same instant
function error(name, from, to) {
  const column = 1 + stateIndex(name), truths = new Map(between(data.rows.truth, from, to).map((row) => [row[0], row[column]]));
  return rootMeanSquare(between(data.rows.estimate, from, to).filter((row) => truths.has(row[0])).map((row) => row[column] - truths.get(row[0])));
}

// the error of a velocity by differences of the readings of its position
function errorOfDifferences(from, to) {
  const rows = between(data.rows['reading joint_states'], from, to), truths = new Map(between(data.rows.truth, from, to).map((row) => [row[0], row[1 + stateIndex('v')]]));
  const errors = [];
  for (let k = 1; k < rows.length; k++) {
    const dt = rows[k][0] - rows[k - 1][0];
    if (dt > 1e-6 && truths.has(rows[k][0])) errors.push((rows[k][1] - rows[k - 1][1]) / dt - truths.get(rows[k][0]));
  }
  return rootMeanSquare(errors);
}

// the rate in 1/s at which the lean grows, as the slope of its logarithm
function growth(from, to) {
  const points = [], column = 1 + stateIndex('theta');
  for (const row of between(data.rows.truth, from, to)) {
    const size = Math.abs(row[column]);
    if (size > 0.5 && points.length) break;
    if (size < 0.03) points.length = 0;
    else points.push([row[0], Math.log(size)]);
  }
  const t = mean(points.map(([time]) => time)), y = mean(points.map(([, value]) => value));
  return points.reduce((sum, [time, value]) => sum + (time - t) * (value - y), 0) / points.reduce((sum, [time]) => sum + (time - t) ** 2, 0);
}

// the time after which a state stays within a fifth of its largest value
function settled(name, from, to) {
  const rows = between(data.rows.truth, from, to), column = 1 + stateIndex(name), peak = Math.max(...rows.map((row) => Math.abs(row[column])));
  const late = rows.filter((row) => Math.abs(row[column]) > 0.2 * peak).at(-1);
  return (late?.[0] ?? from) - from;
}

// How much gain, or delay in seconds, the loop bears by the theory; null where that is not known.
function margin(name) {
  const loop = page.theory.loops?.[0];
  return (loop?.estimated ?? loop?.known)?.margins?.[name]?.[0] ?? null;
}

const fallen = (from, to) => between(data.rows.truth, from, to).some((row) => Math.abs(row[1 + stateIndex('theta')]) > LIMIT);
const NIS = (from, to) => mean(between(data.rows['innovation joint_states'], from, to).map((row) => row.at(-1)).filter(Number.isFinite));
const scaled = (key, factor) => () => page.values[key] * factor;
const GAIN = 'plant/actuator_gain/0', DELAY = 'plant/actuator_delay', EFFORT = 'controller/input_cost/0';
const HOME = 'controller/state_cost/0', BELIEVED = 'estimator/joint_states.noise/0', RATE = 'plant/joint_states.rate';

let pushes = 0;

// A step has a question with options, one handle (the `key` of a control, or what `act` does and
// `value` shows), the name of one plot, what is measured between two times, and what that says:
// the number of the option that was right, and a sentence.
const STEPS = [
  {
    chapter: '1. One eigenvalue', claim: 'Negative decays, zero stays, positive grows.',
    ask: 'The motor gets a hundredth of its gain. What does the lean of the pole do?',
    options: ['it stays', 'it grows evenly', 'it doubles, again and again'],
    key: GAIN, to: () => 0.01, effect: 'state theta', settle: 0, window: 2.5, resets: true, measure: growth,
    seen(_, rate) {
      const pole = Math.max(...(page.theory.open ?? []).map(([re]) => re));
      return [rate > 1 ? 2 : 0, `It grew at a rate of ${short(rate, 2)} per second; the positive pole without feedback is ${short(pole, 2)}.`];
    },
  },
  {
    chapter: '2. Modes', claim: 'A linear system is a sum of motions, each along its direction.',
    ask: 'A push moves the cart, and the pole with it. Which is home first?',
    options: ['the pole', 'the cart', 'both at once'],
    act: () => { pushes++; send({ do: 'push', input: 0, share: 0.3 }); }, value: () => pushes, does: 'push the cart',
    effect: 'state theta', settle: 0, window: 3, measure: (from, to) => [settled('theta', from, to), settled('x', from, to)],
    seen: (_, [pole, cart]) => [[0, 2, 1][compare(pole, cart)], `The pole was within a fifth of its swing after ${short(pole, 2)} s, the cart after ${short(cart, 2)} s. Each has a share of the same modes; the slowest has its pole at ${short(Math.max(...(page.theory.regulator?.poles ?? []).map(([re]) => re)), 2)} per second.`],
  },
  {
    chapter: '3. Feedback', claim: 'What the input reaches can be placed, at a price.',
    ask: 'All poles of the regulator go to 1.3 times their distance. The force that holds the pole becomes…',
    options: LESS_SAME_MORE,
    act: () => send({ do: 'poles', of: 'regulator', poles: (page.theory.regulator?.poles ?? []).map(([re, im]) => [1.3 * re, 1.3 * im]) }),
    value: () => page.chosen.law, does: 'place the poles', undo: () => send({ do: 'choose', what: 'law', value: 'lqr' }),
    effect: 'input f', settle: 3, measure: effort,
    seen: (before, after) => [compare(before, after), `The force was ${short(before, 2)} N (rms), and is ${short(after, 2)} N: that is the price.`],
  },
  {
    chapter: '4. Cost', claim: 'Weights, not poles: LQR is on the boundary of the possible.',
    ask: 'Force becomes thirty times as dear. The deviation of the cart becomes…',
    options: LESS_SAME_MORE, key: EFFORT, to: scaled(EFFORT, 30), effect: 'state x', window: 6,
    measure: (from, to) => [spread('x', from, to), effort(from, to)],
    seen: (before, after) => [compare(before[0], after[0]), `The cart strayed ${quantity(before[0], 'm')} (rms) for ${short(before[1], 2)} N, now ${quantity(after[0], 'm')} for ${short(after[1], 2)} N.`],
  },
  {
    chapter: '5. Observers', claim: 'What a sensor shows can be estimated, without an inverse.',
    ask: 'No sensor reads the velocity. Its estimate, beside the differences of the readings, is…',
    options: ['better', 'about the same', 'worse'], key: RATE, to: () => 50, effect: 'state v',
    measure: (from, to) => [error('v', from, to), errorOfDifferences(from, to)],
    seen: (_, [ours, differences]) => [compare(differences, ours), `With half as many readings, the estimate is wrong by ${short(ours, 2)} m/s (rms), their differences by ${short(differences, 2)} m/s.`],
  },
  {
    chapter: '6. Noise', claim: "Between slow and noisy there is a best gain, Kalman's.",
    ask: 'The filter believes in ten times the noise of the sensor. The error of the cart\'s position becomes…',
    options: LESS_SAME_MORE, key: BELIEVED, to: scaled(BELIEVED, 10), effect: 'state x',
    measure: (from, to) => error('x', from, to),
    seen: (before, after) => [compare(before, after), `The error was ${quantity(before, 'm')} (rms), and is ${quantity(after, 'm')}: the gain is too small now.`],
  },
  {
    chapter: '7. Predict and update', claim: 'Uncertainty grows with time and shrinks with readings.',
    ask: 'One step of the filter, magnified: after the prediction, the ellipse is…',
    options: LESS_SAME_MORE, act: () => send({ do: 'step', reading: 'joint_states' }), does: 'predict, then update',
    undo: () => send({ do: 'mode', lockstep: false }), effect: 'update', stepwise: true,
    seen() {
      const [before, predicted] = stepSizes();
      return [compare(before, predicted, 1 + 1e-9), `${stepNumbers()[0]}.`];
    },
  },
  {
    chapter: '8. LQG', claim: 'Regulator and estimator can be designed apart.',
    ask: 'The regulator becomes stiffer: ten times the weight of the position. The error of the estimate becomes…',
    options: LESS_SAME_MORE, key: HOME, to: scaled(HOME, 10), effect: 'state x',
    measure: (from, to) => [error('x', from, to), believed('x', from, to)],
    seen: (before, after) => [compare(before[1], after[1]), `The filter's 2σ was ${quantity(before[1], 'm')}, and is ${quantity(after[1], 'm')}; its error ${quantity(before[0], 'm')} and ${quantity(after[0], 'm')} (rms). The gain of the estimator does not know of the regulator.`],
  },
  {
    chapter: '9. Margins', claim: 'LQR tolerates much, LQG perhaps nothing.',
    ask: 'The red mark is where the theory expects the end. The motor gets a gain just beyond it: the pole…',
    options: ['stays up', 'shakes more and more'], key: GAIN, to: () => 1.15 * (margin('upper_gain') ?? 5), effect: 'state theta', settle: 0, resets: true,
    measure: (from, to) => [spread('theta', from, to), fallen(from, to), margin('upper_gain')],
    seen: (before, [lean, down, most]) => [down || lean > GROWN * before[0] ? 1 : 0, `The lean was ${quantity(before[0], 'rad')} (rms), ${down ? 'and the pole has fallen' : `and is ${quantity(lean, 'rad')}`}. Computed margin: a factor of ${short(most ?? before[2], 2)}.`],
  },
  {
    chapter: '10. Sampling', claim: 'A sampled loop is at most as fast as one sample.',
    ask: 'Every force comes later, by nine tenths of what the theory allows. The pole…',
    options: ['stays as it is', 'stays up, and shakes', 'falls'], key: DELAY, to: () => 0.9 * (margin('delay') ?? 0.03), effect: 'state theta', resets: true,
    measure: (from, to) => [spread('theta', from, to), fallen(from, to)],
    seen: (before, [lean, down]) => [down ? 2 : lean > GROWN * before[0] ? 1 : 0, `The lean was ${quantity(before[0], 'rad')} (rms), ${down ? 'and the pole has fallen' : `and is ${quantity(lean, 'rad')}`}, with a delay of ${short(page.values[DELAY] * page.scene.rate, 2)} samples.`],
  },
  {
    chapter: '11. Nonlinear systems', claim: 'A tangent is wrong where it bends; sigma points follow.',
    ask: 'The filter sends sigma points (ukf) in place of a tangent (ekf). Near upright, the error of the lean becomes…',
    options: LESS_SAME_MORE, act: () => send({ do: 'choose', what: 'filter', value: page.chosen.filter === 'ukf' ? 'ekf' : 'ukf' }), value: () => page.chosen.filter,
    does: 'change the filter', undo: () => send({ do: 'choose', what: 'filter', value: 'ekf' }), effect: 'state theta', settle: 2,
    measure: (from, to) => error('theta', from, to),
    seen: (before, after) => [compare(before, after), `The error was ${quantity(before, 'rad')} (rms), and is ${quantity(after, 'rad')}: within a degree nothing bends. In lidar_radar it does.`],
  },
  {
    chapter: '12. Beyond one Gaussian', claim: 'Honesty about the unknown.',
    ask: 'The filter believes in a third of the noise. Its NIS is 2 on average when it is honest, and becomes…',
    options: LESS_SAME_MORE, key: BELIEVED, to: scaled(BELIEVED, 1 / 3), effect: 'NIS joint_states', measure: NIS,
    seen: (before, after) => [compare(before, after), `The NIS was ${short(before, 2)} on average, and is ${short(after, 2)}: a filter that is too sure contradicts its readings. In bearing_tracker, one is right about what it does not know.`],
  },
];

const START = { guess: -1, base: null, value: null, changed: null, before: null, said: '' };
const progress = { index: 0, entered: 0, ...START };
let controls = null, redrawn = () => {};

export const tourStep = () => progress.index + 1;
export const tourReason = () => (page.scene.model === NEEDED ? '' : `the tour is in ./dev live ${NEEDED}`);
export const tourWords = () => `Chapter ${STEPS[progress.index].chapter}, of ${STEPS.length}: ${STEPS[progress.index].claim}`;
export const tourEffect = () => STEPS[progress.index].effect;
const valueOf = (step) => (step.value ? step.value() : page.values[step.key]);

// Go to a step, from 1; what the last one changed is set back.
export function goTo(number) {
  restore();
  const index = Math.min(Math.max(Math.round(number) || 1, 1), STEPS.length) - 1;
  Object.assign(progress, { ...START, index, entered: data.now });
}

function restore() {
  const step = STEPS[progress.index];
  if (progress.changed === null) return;
  progress.changed = null;
  if (step.key) send({ do: 'set', key: step.key, value: progress.base });
  else step.undo?.();
  if (step.resets) send({ do: 'reset' });
}

export function buildTour(place, reopen) {
  const step = STEPS[progress.index], go = (by) => { goTo(progress.index + 1 + by); reopen(); };
  const act = () => (step.act ? step.act() : send({ do: 'set', key: step.key, value: Number(step.to().toPrecision(3)) }));
  const press = (text, done) => {
    const made = element('button', { type: 'button', textContent: text });
    made.addEventListener('click', done);
    return made;
  };
  const guesses = step.options.map((text, k) => press(text, () => {
    if (progress.said) return;
    progress.guess = k;
    redrawn();
  }));
  const rows = element('div'), doing = press(step.does ?? 'do it', act), handle = element('div', { className: 'marked' }, rows, doing);
  controls = null;
  if (step.key) {
    controls = new Controls(rows, send);
    controls.values = page.values;
    controls.list(page.scene.controls.filter(({ key }) => key === step.key));
  }
  const said = element('p', { id: 'tour-said' });
  said.setAttribute('role', 'status');
  place.append(element('p', { id: 'tour-ask', textContent: step.ask }), element('div', { className: 'transport', id: 'guesses' }, ...guesses), handle, said,
    element('div', { className: 'transport' }, ...(progress.index ? [press('back', () => go(-1))] : []), ...(progress.index + 1 < STEPS.length ? [press('next', () => go(1))] : [])));
  redrawn = () => {
    guesses.forEach((each, k) => each.setAttribute('aria-pressed', k === progress.guess));
    handle.hidden = progress.before === null;
    const text = progress.said || (progress.guess < 0 ? 'First a guess.' : progress.before === null ? 'Being measured, before anything is moved …'
      : progress.changed === null ? 'Now move the handle.' : 'Being measured …');
    if (said.textContent !== text) said.textContent = text;
  };
  redrawn();
  return controls;
}

// Look at what happened since the guess; called a few times a second.
export function followTour() {
  const step = STEPS[progress.index], window = step.window ?? WINDOW;
  for (const mark of ['entered', 'changed']) if (progress[mark] > data.now) progress[mark] = data.now;  // the clock began anew
  if (progress.guess < 0 || progress.said) { redrawn(); return; }
  if (step.stepwise) {
    progress.before ??= 0;
    progress.changed ??= page.status.lockstep ? data.now : null;
    if (stepSizes()) tell(step.seen());
  } else if (progress.before === null) {
    // without what the step before has set back
    const from = Math.max(progress.entered + SETTLE, data.now - window);
    if (data.now >= progress.entered + SETTLE + LEAST) Object.assign(progress, { before: step.measure(from, data.now), base: valueOf(step), value: valueOf(step) });
  } else {
    const value = valueOf(step);
    if (value !== progress.value) Object.assign(progress, { value, changed: data.now });
    const from = progress.changed + (step.settle ?? SETTLE);
    if (progress.changed !== null && data.now >= from + window) tell(step.seen(progress.before, step.measure(from, data.now)));
  }
  redrawn();
}

function tell([index, text]) {
  const step = STEPS[progress.index], right = index === progress.guess;
  progress.said = `${text} ${right ? 'As you expected.' : `You expected: ${step.options[progress.guess]}.`}`;
}
