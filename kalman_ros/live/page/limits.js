// SPDX-License-Identifier: Apache-2.0
// Limits of inputs and states: lines in the plots and walls in the picture, which are dragged.

import { data } from './data.js';
import { page } from './page.js';
import { colour, short, stroke } from './pen.js';
import { Newest, send } from './socket.js';

const newest = new Newest(send);
const WINDOW = 5;      // seconds of which the shares are told
const NEAR = 0.01;     // a state is at a limit within this share of it
let held = null;       // the limit that is dragged, with its value

// the limit of an input or a state; null where there is none
export function limitOf(of, name, side) {
  if (held && held.of === of && held.name === name) {
    if (areAlike(of, name)) return side === 'low' ? -Math.abs(held.value) : Math.abs(held.value);
    if (held.side === side) return held.value;
  }
  return page.limits[of][name]?.[side === 'low' ? 0 : 1] ?? null;
}

// whether the limits of an input move together, one minus the other
export const areAlike = (of, name) => of === 'input' && page.limits.alike.includes(name);

export const hasLimits = (of, name) => name in page.limits[of];

// lines of a plot, one for each side; where there is no limit, only while limits are the task
export function limitLines(of, name) {
  if (!hasLimits(of, name)) return [];
  return ['low', 'high'].map((side) => ({ value: limitOf(of, name, side), look: 'bad', dash: 'dashed', side, grip: (...places) => limitHandle({ of, name, side }, ...places) }))
    .filter(({ value }) => value !== null || page.task === 'limits');
}

export function setLimit(grip, value, done) {
  const number = value === null ? {} : { value: Number(value.toPrecision(3)) };
  newest.put({ do: 'limit', ...grip, ...number }, done);
}

// What is dragged to move a limit: `valueAt(x, y)` is where the pointer puts it.
function limitHandle(limit, hit, valueAt) {
  const hold = (x, y) => {
    const value = valueAt(x, y);
    held = { ...limit, value };
    page.dirty = true;
  };
  return {
    hit, limit, begin: hold,
    move: (x, y) => { hold(x, y); setLimit(limit, held.value); },
    end: () => setLimit(limit, held.value, () => { held = null; page.dirty = true; }),
  };
}

// whether the limits of a position are walls in the picture
export const hasWalls = () => ['spring', 'cart_pole'].includes(page.scene.drawing.kind) && hasLimits('state', 'x');

// walls at the limits of a position; where there is none, a grip at the edge
export function walls(pen, canvas, name, X, world, width, top, bottom) {
  if (!hasLimits('state', name)) return;
  for (const side of ['low', 'high']) {
    const value = limitOf('state', name, side), sign = side === 'low' ? -1 : 1;
    const edge = side === 'low' ? 10 : width - 10;
    const free = value === null, x = free ? edge : X(value);
    if (x < 0 || x > width || (free && page.task !== 'limits')) continue;  // not in the picture
    stroke(pen, 'bad', free ? 1.5 : 4, free ? 'dotted' : 'solid');
    pen.beginPath(); pen.moveTo(x, top); pen.lineTo(x, bottom); pen.stroke();
    if (!free) {
      stroke(pen, 'bad', 1);
      pen.beginPath();
      for (let y = top; y < bottom; y += 9) { pen.moveTo(x, y + 9); pen.lineTo(x + 9 * sign, y); }
      pen.stroke();
    }
    pen.fillStyle = colour('bad');
    // outside of the walls where there is room, so that near ones keep apart
    const text = free ? 'no limit: drag' : `${short(value)} m`, isRoomy = (sign < 0 ? x : width - x) > pen.measureText(text).width + 6;
    pen.textAlign = (side === 'low') === isRoomy ? 'right' : 'left';
    pen.fillText(text, isRoomy ? x - 4 * sign : Math.min(Math.max(x, 2), width - 2), top - 5);
    pen.textAlign = 'left';
    canvas.handles.push(limitHandle({ of: 'state', name, side }, (px, py) => Math.abs(px - x) < 16 && py > top - 20 && py < bottom + 20, world));
  }
}

const history = [];  // of what the controller counts: time, inputs planned within limits, answered

export const forgetPlans = () => { history.length = 0; };

export function countPlans(status) {
  const planned = Number.parseInt(status.planned_within_limits, 10), answered = Number.parseInt(status.answered, 10);
  if (!(answered >= 0) || !(planned >= 0)) { history.length = 0; return; }
  if (history.length && history.at(-1)[1] > answered) history.length = 0;
  history.push([performance.now(), answered, planned]);
  while (history.length > 2 && history[1][0] < performance.now() - 1e3 * WINDOW) history.shift();
}

// Shares of the last seconds in which a limit acts: of each input, of each state, and in the plan.
export function acting() {
  const found = [], { state, input } = page.scene, since = Math.max(data.now - WINDOW, data.began);
  const share = (rows, test) => {
    const recent = (rows ?? []).filter((row) => row[0] >= since);
    return recent.length ? recent.filter(test).length / recent.length : 0;
  };
  const add = (of, name, rows, column, near) => {
    const low = limitOf(of, name, 'low'), high = limitOf(of, name, 'high');
    if (low === null && high === null) return;
    const beyond = (value) => (low !== null && value <= low + near * Math.abs(low)) || (high !== null && value >= high - near * Math.abs(high));
    found.push({ of, name, share: share(rows, (row) => beyond(row[column])) });
  };
  input.names.forEach((name, k) => add('input', name, data.rows.input, 1 + k, 0.001));
  state.names.forEach((name, k) => add('state', name, data.rows.truth, 1 + k, NEAR));
  if (history.length > 1) {
    const [, a, b] = history[0], [, c, d] = history.at(-1);
    if (c > a) found.push({ of: 'plan', name: '', share: (d - b) / (c - a) });
  }
  return found;
}

const percent = (share) => `${Math.max(1, Math.round(100 * share))} % of the last ${WINDOW} s`;

// one sentence on which limit acts most; '' where none does
export function actingSentence() {
  const all = acting(), of = (kind) => all.filter((each) => each.of === kind && each.share > 0.005).sort((a, b) => b.share - a.share)[0];
  const input = of('input'), state = of('state'), plan = of('plan');
  if (input) {
    const which = page.scene.input.names.length > 1 ? `input ${input.name}` : 'input';
    return `The regulator is held by the limit of the ${which}: ${percent(input.share)}.`;
  }
  if (state) return `The limit of ${state.name} holds the state: ${percent(state.share)}.`;
  if (plan) return `A limit ahead shapes the input: ${percent(plan.share)}.`;
  return '';
}
