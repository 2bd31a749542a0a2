// SPDX-License-Identifier: Apache-2.0
import { decades } from './explorable.js';
import { normals } from './numbers.js';
import { number } from './poles.js';

const COUNT = 30;
const draws = (() => { const normal = normals(3); return Array.from({ length: COUNT }, () => [normal(), normal()]); })();

// variance before and after each reading of a number that walks, its gain, and one run
export function recursion({ Q, R, P0 }) {
  const rows = [];
  let P = P0, x = 0, estimate = Math.sqrt(P0);
  draws.forEach(([walk, noise], k) => {
    if (k) { P += Q; x += Math.sqrt(Q) * walk; }
    const L = P / (P + R), reading = x + Math.sqrt(R) * noise;
    estimate += L * (reading - estimate);
    rows.push({ k, before: P, after: (1 - L) * P, L, x, reading, estimate });
    P *= 1 - L;
  });
  const steady = (Q + Math.sqrt(Q * Q + 4 * Q * R)) / 2;  // of the variance before a reading
  return { rows, steady: steady / (steady + R) };
}

export const gain = {
  title: 'The gain goes from "believe the reading" to what the noises deserve',
  saying: 'the gain does not depend on the readings; it starts near one where little is known, and settles where what a step adds and what a reading takes are equal.',
  state: { Q: [0.1, 0.001, 10], R: [1, 0.01, 10], P0: [10, 0.01, 100] },
  sliders: [
    { key: 'Q', label: 'Q, added by a step', log: true, text: (value) => number(value, 2) },
    { key: 'R', label: 'R, of a reading', log: true, text: (value) => number(value, 2) },
  ],
  compute: recursion,
  panels: [
    {
      title: 'the sawtooth of P', x: [-1, COUNT], y: ({ R }, { rows }) => decades([R, ...rows.flatMap(({ before, after }) => [before, after])], 0.1, 10), log: 'y', across: 'reading', up: 'variance',
      handles: [{ label: 'variance at the start', at: ({ P0 }) => [0, P0], move: ([, P0]) => ({ P0 }) }],
      draw(plot, { R }, { rows }) {
        plot.across(R, 'input', 'dotted');
        plot.curve(rows.flatMap(({ k, before, after }) => [[k, before], [k, after]]), 'estimate', { width: 2 });
        plot.legend([['P', 'estimate'], ['R', 'input']]);
      },
    },
    {
      title: 'the gain', x: [-1, COUNT], y: [0, 1.05], across: 'reading', up: 'L',
      draw(plot, state, { rows, steady }) {
        plot.across(steady, 'prior');
        plot.stairs(rows.map(({ k, L }) => [k, L]), 'estimate', { width: 2.5 });
        plot.legend([['L', 'estimate'], ['in the long run', 'prior']]);
      },
    },
    {
      title: 'one run', x: [-1, COUNT], y: (state, { rows }) => { const all = rows.flatMap(({ x, reading, estimate }) => [x, reading, estimate]), low = Math.min(...all), high = Math.max(...all); return [low - 0.1 * (high - low), high + 0.2 * (high - low)]; },
      across: 'reading', up: 'x',
      draw(plot, state, { rows }) {
        for (const { k, reading } of rows) plot.cross(k, reading, 'reading', 3, 1.5);
        plot.curve(rows.map(({ k, x }) => [k, x]), 'ink');
        plot.curve(rows.map(({ k, estimate }) => [k, estimate]), 'estimate', { dash: 'dashed' });
        plot.legend([['truth', 'ink'], ['readings', 'reading'], ['estimate', 'estimate']]);
      },
    },
  ],
  sentence({ Q, R }, { rows, steady }) {
    const settled = rows.findIndex(({ L }) => Math.abs(L - steady) < 0.02 * steady);
    return `The first gain is ${number(rows[0].L)}; it settles at ${number(steady)}${settled < 0 ? ', later than what is shown' : `, within 2 % after ${settled + 1} reading${settled ? 's' : ''}`}. Q/R = ${number(Q / R, 2)} alone decides where.`;
  },
};
