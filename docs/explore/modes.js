// SPDX-License-Identifier: Apache-2.0
import { apply, expm, path, scale } from './numbers.js';
import { complexPlane, mark, number, poleHandles, polesOf, words } from './poles.js';

const SQUARE = [[0.5, -0.5], [1.5, -0.5], [1.5, 0.5], [0.5, 0.5]];
const STARTS = Array.from({ length: 16 }, (_, k) => [1.9 * Math.cos(k * Math.PI / 8), 2.6 * Math.sin(k * Math.PI / 8)]);
const STEP = 0.04, END = 8;

export const modes = {
  title: 'Two eigenvalues draw every path',
  saying: 'exp(A t) moves every point of the plane; real eigenvalues pull along two lines, a complex pair turns, and the real part decides whether it shrinks.',
  state: { re: [-0.4, -3, 0.8], im: [2, 0, 4], second: [-1.5, -3, 0.8], time: [0.6, 0, 4] },
  sliders: [{ key: 'time', label: 'time', text: (t) => `${number(t, 2)} s` }],
  compute(state) {
    const [[a, b], [c, d]] = polesOf(state), product = a * c - b * d;
    const A = [[0, 1], [-product, a + c]];
    return { A, flow: expm(scale(A, state.time)), step: expm(scale(A, STEP)) };
  },
  panels: [
    {
      title: 'eigenvalues: drag', x: [-3.2, 1], y: [-4.2, 4.2], across: 'real part in 1/s', up: 'imaginary part in rad/s',
      handles: poleHandles('eigenvalue'),
      draw(plot, state) { complexPlane(plot); mark(plot, polesOf(state), 'estimate'); },
    },
    {
      title: 'all paths, and what exp(A t) makes of a square', x: [-2, 2], y: [-3, 3], across: 'position', up: 'velocity',
      draw(plot, state, { A, flow, step }) {
        for (const start of STARTS) {
          const grows = A[1][1] > 0 || A[1][0] > 0;
          plot.curve(path(step, grows ? start.map((entry) => entry / 6) : start, END / STEP), 'reading', { width: 1 });
        }
        if (!state.im) for (const [p] of polesOf(state)) plot.curve([[-9, -9 * p], [9, 9 * p]], 'prior', { width: 1.5, dash: 'dashed' });
        plot.curve(SQUARE, 'soft', { dash: 'dotted', closed: true });
        plot.curve(SQUARE.map((corner) => apply(flow, corner)), 'input', { width: 2.5, closed: true });
        plot.point(0, 0, 'ink', 3);
        plot.legend([...(state.im ? [] : [['eigenvectors', 'prior']]), [`the square after ${number(state.time, 2)} s`, 'input']]);
      },
    },
    {
      title: 'released at 1', x: [0, END], y: [-1.3, 1.3], across: 't in s', up: 'position',
      draw(plot, state, { flow, step }) {
        plot.across(0, 'soft', 'solid');
        plot.curve(path(step, [1, 0], END / STEP).map(([x], k) => [k * STEP, x]), 'estimate', { width: 2.5 });
        plot.point(state.time, flow[0][0], 'input', 5);
      },
    },
  ],
  sentence(state, { flow }) {
    const [[re, im], [second]] = polesOf(state);
    const shown = `exp(A t) = [${flow.map((row) => row.map((entry) => number(entry, 2)).join('  ')).join(';  ')}]`;
    if (im) return `${words(polesOf(state))}: a turn takes ${number(2 * Math.PI / im)} s, and each second ${re < 0 ? 'leaves' : 'makes'} ${number(100 * Math.exp(re), 2)} % of the size. ${shown}.`;
    if (Math.abs(re - second) < 0.01) return `${number(re)} twice: there is one direction, and a part t exp(${number(re)} t) that ${re < 0 ? 'first grows' : 'grows'}. ${shown}.`;
    const slow = Math.max(re, second);
    return `${words(polesOf(state))}: two parts, each with its own time; ${slow < 0 ? `the slow one, ${number(-1 / slow)} s, is left in the end` : 'the larger eigenvalue decides'}. ${shown}.`;
  },
};
