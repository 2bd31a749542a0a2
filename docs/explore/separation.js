// SPDX-License-Identifier: Apache-2.0
import { CART } from './feedback.js';
import { add, blocks, column, eigenvalues, expm, multiply, path, place, scale, transpose } from './numbers.js';
import { complexPlane, mark, number, poleHandles, polesOf, words } from './poles.js';

const C = [[1, 0]], STEP = 0.02, END = 6;

// the whole loop, in the state and its estimate: not in the error, in which the zero would be seen at once
export function wholeLoop(regulator, estimator) {
  const K = [place(CART.A, [0, 1], regulator)], L = column(place(transpose(CART.A), C[0], estimator));
  const BK = multiply(CART.B, K), LC = multiply(L, C);
  return blocks([[CART.A, scale(BK, -1)], [LC, add(add(CART.A, BK, -1), LC, -1)]]);
}

export const separation = {
  title: 'Four poles, two designs that do not meddle with each other',
  saying: 'the poles of the whole loop are those of the regulator and those of the estimator; moving one pair leaves the other, and the error of the estimate does not know the regulator.',
  state: {
    re: [-1, -5, -0.1], im: [1, 0, 5], second: [-1.5, -5, -0.1],
    re2: [-3, -5, -0.1], im2: [2, 0, 5], second2: [-4, -5, -0.1],
  },
  compute(state) {
    const M = wholeLoop(polesOf(state), polesOf(state, '2'));
    return { M, all: eigenvalues(M), states: path(expm(scale(M, STEP)), [1, 0, 0, 0], END / STEP) };
  },
  panels: [
    {
      title: 'drag two pairs', x: [-5.2, 0.5], y: [-5.2, 5.2], across: 'real part in 1/s', up: 'imaginary part',
      handles: [...poleHandles('regulator'), ...poleHandles('estimator', '2')],
      draw(plot, state, { all }) {
        complexPlane(plot);
        for (const [re, im] of all) plot.point(re, im, 'line', 9);
        mark(plot, polesOf(state), 'input');
        mark(plot, polesOf(state, '2'), 'estimate');
        plot.legend([['regulator, A − B K', 'input'], ['estimator, A − L C', 'estimate'], ['grey: the whole loop', 'soft']]);
      },
    },
    {
      title: 'the cart, 1 m from where it is thought to be', x: [0, END], y: (state, { states }) => { const most = Math.max(1.5, ...states.flatMap(([x, , estimate]) => [1.1 * Math.abs(x), 1.1 * Math.abs(estimate)])); return [-most, most]; }, across: 't in s', up: 'position in m',
      draw(plot, state, { states }) {
        plot.across(0, 'soft', 'solid');
        plot.curve(states.map(([x], k) => [k * STEP, x]), 'ink', { width: 2.5 });
        plot.curve(states.map(([, , estimate], k) => [k * STEP, estimate]), 'estimate', { dash: 'dashed' });
        plot.legend([['truth', 'ink'], ['estimate', 'estimate']]);
      },
    },
    {
      title: 'the error of the estimate', x: [0, END], y: [-1.1, 1.1], across: 't in s', up: 'error in m',
      draw(plot, state, { states }) {
        plot.across(0, 'soft', 'solid');
        plot.curve(states.map(([x, , estimate], k) => [k * STEP, x - estimate]), 'prior', { width: 2.5 });
        plot.legend([['x − x̂', 'prior']]);
      },
    },
  ],
  sentence(state, { states }) {
    const error = states[Math.round(1 / STEP)], most = Math.max(...states.map(([x]) => Math.abs(x)));
    return `Regulator ${words(polesOf(state))}, estimator ${words(polesOf(state, '2'))}. After 1 s the error is ${number(error[0] - error[2])} m, whatever the regulator does; the cart was at most ${number(most)} m off.`;
  },
};
