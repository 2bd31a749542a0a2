// SPDX-License-Identifier: Apache-2.0
import { decades } from './explorable.js';
import { add, diagonal, identity, inverse } from './numbers.js';
import { number } from './poles.js';

const COUNT = 30, DT = 1, END = (COUNT - 1) * DT, SPEED = 0.35, DEGREE = Math.PI / 180;
const BEFORE = [6, 0.3];  // deviations of place and velocity before the first bearing, in km and km per minute
const MOVES = [0.05, -0.06];  // of the target of the ship

// where each bearing is taken from; the last kind turns half way
function places({ kind, sx, sy, turn }) {
  return Array.from({ length: COUNT }, (_, k) => {
    if (kind === 0) return [0, 0];
    if (kind === 1) return k % 2 ? [sx, sy] : [0, 0];
    const first = Math.min(k, COUNT / 2) * SPEED * DT, second = Math.max(0, k - COUNT / 2) * SPEED * DT;
    return [first + second * Math.cos(turn), second * Math.sin(turn)];
  });
}

// covariance of the target at the end before the first bearing; of one that moves, the velocity joins in
function before(moving) {
  const [place, velocity] = BEFORE.map((s) => s ** 2);
  return moving ? moved(diagonal(place, place, velocity, velocity), END) : diagonal(place, place);
}

// information about (x, y, vx, vy) at the end, from bearings h x with noise of `sigma`
export function informed({ tx, ty, sigma, kind, ...rest }) {
  const moving = kind === 2;
  let information = inverse(before(moving));
  return places({ kind, ...rest }).map(([x, y], k) => {
    const back = moving ? END - k * DT : 0, target = moving ? [tx - MOVES[0] * back, ty - MOVES[1] * back] : [tx, ty];
    const [dx, dy] = [target[0] - x, target[1] - y], r2 = dx * dx + dy * dy || 1e-9;
    const slope = [-dy / r2, dx / r2], h = moving ? [...slope, -back * slope[0], -back * slope[1]] : slope;
    information = add(information, h.map((a) => h.map((b) => a * b / (sigma * DEGREE) ** 2)));
    return { place: [x, y], target, P: inverse(information) };
  });
}

function moved(P, t) {
  const F = identity(4).map((row, i) => row.map((entry, j) => (j === i + 2 ? t : entry)));
  return F.map((a) => F.map((b) => a.reduce((sum, entry, k) => sum + entry * b.reduce((inner, other, l) => inner + other * P[k][l], 0), 0)));
}

const longest = ([[p, q], [, r]]) => Math.sqrt((p + r) / 2 + Math.hypot((p - r) / 2, q));

export const bearings = {
  title: 'One bearing is a line',
  saying: 'a bearing shows a direction and no distance; a second place to look from, or a turn of one\'s own path, makes the lines cross, and the wider they cross the better the distance is known.',
  state: { kind: [0, 0, 2], tx: [6, -2, 11], ty: [5, -2, 9], sx: [3, -2, 11], sy: [-1, -2, 9], turn: [0, -Math.PI, Math.PI], sigma: [1, 0.2, 5] },
  choices: [{ key: 'kind', label: 'who looks', options: ['one microphone', 'two microphones', 'a ship'] }],
  sliders: [{ key: 'sigma', label: 'noise of a bearing', log: true, text: (value) => `${number(value, 2)}°` }],
  compute(state) { return { rows: informed({ ...state, kind: Math.round(state.kind) }), kind: Math.round(state.kind), before: longest(before(Math.round(state.kind) === 2)) }; },
  panels: [
    {
      title: 'the map: drag', x: [-2, 12], y: [-3, 9], equal: true, across: 'east in km', up: 'north in km',
      handles: [
        { label: 'target', at: ({ tx, ty }) => [tx, ty], move: ([tx, ty]) => ({ tx, ty }) },
        { label: 'second microphone', at: ({ sx, sy }, { kind }) => (kind === 1 ? [sx, sy] : null), move: ([sx, sy]) => ({ sx, sy }) },
        {
          label: 'the turn of the ship', at: (state, { rows, kind }) => (kind === 2 ? rows.at(-1).place : null),
          move: ([x, y]) => ({ turn: Math.atan2(y, x - COUNT / 2 * SPEED * DT) }), text: ({ turn }) => `${number(turn / DEGREE)} degrees`,
        },
      ],
      draw(plot, { tx, ty, sigma }, { rows, kind }) {
        const shown = kind === 2 ? [0, 7, 14, 22, 29] : kind === 1 ? [0, 1] : [0];
        for (const k of shown) {
          const { place, target } = rows[k], angle = Math.atan2(target[1] - place[1], target[0] - place[0]), far = 40;
          const ray = (turn) => [place[0] + far * Math.cos(angle + turn), place[1] + far * Math.sin(angle + turn)];
          plot.between([place, ray(2 * sigma * DEGREE)], [place, ray(-2 * sigma * DEGREE)], 'growth');
          plot.curve([place, ray(0)], 'reading', { width: 1, dash: 'dotted' });
        }
        if (kind === 2) {
          plot.curve(rows.map(({ place }) => place), 'ink', { width: 2 });
          plot.curve(rows.map(({ target }) => target), 'soft', { width: 1.5 });
        }
        plot.ellipse({ x: [tx, ty], P: rows.at(-1).P }, 'estimate', { filled: true });
        if (kind !== 2) for (const k of shown) plot.point(...rows[k].place, 'ink', 5);
        plot.legend([['known after 30 bearings, 2σ', 'estimate'], [kind === 2 ? 'the ship' : 'microphones', 'ink'], ['a bearing, ±2σ', 'input']]);
      },
    },
    {
      title: 'the least known direction', x: [0, COUNT], y: (state, { rows, before }) => decades([before, ...rows.map(({ P }) => longest(P))], 0.1, 10), log: 'y', across: 'bearings', up: 'σ in km',
      draw(plot, state, { rows, kind, before }) {
        plot.across(before, 'soft', 'dotted');
        if (kind === 2) plot.upright(COUNT / 2, 'soft', 'dotted');
        plot.curve(rows.map(({ P }, k) => [k + 1, longest(P)]), 'estimate', { width: 2.5 });
        plot.legend([['σ of the place', 'estimate'], ['before the first bearing', 'soft']]);
      },
    },
  ],
  sentence({ turn }, { rows, kind }) {
    const sigma = longest(rows.at(-1).P);
    if (kind === 0) return `30 bearings from one place: σ along the line is still ${number(sigma, 2)} km. More of the same never helps.`;
    if (kind === 1 && sigma > 0.5) return `Both look along nearly the same line: σ is ${number(sigma, 2)} km, and the distance is lost.`;
    if (kind === 1) return `Two places to look from: σ is ${number(1000 * sigma, 2)} m. Drag the second microphone onto the line to the target, and the distance is lost.`;
    const straight = Math.abs(turn) < 2 * DEGREE;
    return straight ? `On a straight course σ stays ${number(sigma, 2)} km: a target twice as far and, seen from the ship, twice as fast has the same bearings. Drag the ship's end to turn.`
      : `A turn of ${number(turn / DEGREE, 2)}°: σ is ${number(sigma, 2)} km, ${number(longest(rows[COUNT / 2].P) / sigma, 2)} times better than before the turn.`;
  },
};
