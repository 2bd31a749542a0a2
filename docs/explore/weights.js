// SPDX-License-Identifier: Apache-2.0
import { decades } from './explorable.js';
import { closed, CART } from './feedback.js';
import { eigenvalues, lqr, place } from './numbers.js';
import { complexPlane, mark, number, poleHandles, polesOf, words } from './poles.js';

const [LOW, HIGH] = [1e-3, 1e3];  // weights of the input
const [LEAST, MOST] = [1e-5, 1e8];  // of the curve: any poles that can be dragged have their effort on it
const best = (weight) => { const { K } = lqr(CART.A, CART.B, [[1, 0], [0, 0]], [[weight]]); return { weight, K: K[0], ...closed(K[0]) }; };

let curve = null;  // from much effort to little
const tradeOff = () => (curve ??= Array.from({ length: 105 }, (_, k) => best(LEAST * (MOST / LEAST) ** (k / 104))));

// the weight whose regulator takes this effort, between those of the curve
function weightOf(effort) {
  const points = tradeOff(), k = Math.min(points.length - 1, Math.max(1, points.findIndex((point) => point.effort < effort)));
  const [more, less] = [points[k - 1], points[k]];
  const share = Math.log(more.effort / effort) / Math.log(more.effort / less.effort);
  return more.weight * (less.weight / more.weight) ** share;
}

export const weights = {
  title: 'LQR is on the boundary of the possible',
  saying: 'weights choose a point on a curve of error against effort, and no other feedback is below that curve.',
  state: { weight: [0.3, LOW, HIGH], re: [-0.8, -5, -0.05], im: [2, 0, 5], second: [-2, -5, -0.05] },
  sliders: [{ key: 'weight', label: 'weight of the input', log: true, text: (value) => number(value, 2) }],
  compute(state) {
    const K = place(CART.A, [0, 1], polesOf(state)), mine = { K, ...closed(K) };
    return { ours: best(state.weight), mine, same: best(weightOf(mine.effort)) };
  },
  panels: [
    {
      title: 'what each feedback costs', x: (state, { ours, mine }) => decades([ours.effort, mine.effort], 0.01, 1000), y: (state, { ours, mine }) => decades([ours.error, mine.error], 0.1, 10), log: 'xy', across: 'effort ∫u² dt', up: 'error ∫x² dt',
      handles: [{ label: 'regulator on the curve', at: (state, { ours }) => [ours.effort, ours.error], move: ([effort]) => ({ weight: weightOf(effort) }), text: ({ weight }) => `weight ${number(weight)}` }],
      draw(plot, state, { mine, ours }) {
        plot.curve(tradeOff().map(({ effort, error }) => [effort, error]), 'estimate', { width: 2.5 });
        plot.point(ours.effort, ours.error, 'estimate', 6);
        plot.cross(mine.effort, mine.error, 'input', 6);
        plot.legend([['LQR, every weight', 'estimate'], ['your poles', 'input']]);
      },
    },
    {
      title: 'poles: drag yours', x: [-5.2, 0.5], y: [-5.2, 5.2], across: 'real part in 1/s', up: 'imaginary part',
      handles: poleHandles('pole'),
      draw(plot, state, { ours }) {
        complexPlane(plot);
        plot.curve(tradeOff().map(({ loop }) => eigenvalues(loop)[0]), 'estimate', { width: 1, dash: 'dotted' });
        mark(plot, eigenvalues(ours.loop), 'estimate');
        mark(plot, polesOf(state), 'input');
      },
    },
    {
      title: 'the cart, released 1 m off', x: [0, 6], y: [-0.8, 1.1], across: 't in s', up: 'position in m',
      draw(plot, state, { ours, mine }) {
        plot.across(0, 'soft', 'solid');
        plot.curve(mine.motion, 'input', { dash: 'dashed' });
        plot.curve(ours.motion, 'estimate', { width: 2.5 });
      },
    },
  ],
  sentence(state, { ours, mine, same }) {
    const more = 100 * (mine.error / same.error - 1);
    return `Weight ${number(state.weight, 2)}: K = [${ours.K.map((k) => number(k)).join(', ')}]. Your poles ${words(polesOf(state))} have ${more < 0.05 ? 'the least error that their effort allows' : `${number(more, 2)} % more error than LQR with the same effort`}.`;
  },
};
