// SPDX-License-Identifier: Apache-2.0
import { add, column, dot, expm, lyapunov, multiply, path, place, scale, transpose } from './numbers.js';
import { complexPlane, mark, number, poleHandles, polesOf, words } from './poles.js';

export const CART = { A: [[0, 1], [0, 0]], B: [[0], [1]] };  // of 1 kg, without friction
const START = [1, 0], STEP = 0.02, END = 6;

// what a feedback does to the cart: its motion from 1 m off, its forces, and the integrals of their squares
export function closed(K, A = CART.A) {
  const loop = add(A, multiply(CART.B, [K]), -1);
  const states = path(expm(scale(loop, STEP)), START, END / STEP);
  const integral = (weight) => { const X = lyapunov(transpose(loop), weight); return X ? dot(START, X.map((row) => dot(row, START))) : NaN; };
  return {
    loop, motion: states.map(([x], k) => [k * STEP, x]), forces: states.map((x, k) => [k * STEP, -dot(K, x)]),
    error: integral([[1, 0], [0, 0]]), effort: integral(multiply(column(K), [K])),
  };
}

export const feedback = {
  title: 'Feedback puts the poles where you want them, and the motor pays',
  saying: 'u = −K x replaces A by A − B K, so the poles can be placed; twice as fast costs four times the force and eight times the effort.',
  state: { re: [-1.5, -4, 0.5], im: [1.5, 0, 4], second: [-2, -4, 0.5], limit: [6, 0.5, 20] },
  compute(state) {
    const K = place(CART.A, [0, 1], polesOf(state));
    const found = closed(K);
    return { K, ...found, most: Math.max(...found.forces.map(([, u]) => Math.abs(u))) };
  },
  panels: [
    {
      title: 'poles of A − B K: drag', x: [-4.2, 1], y: [-4.2, 4.2], across: 'real part in 1/s', up: 'imaginary part',
      handles: poleHandles('pole'),
      draw(plot, state) {
        complexPlane(plot);
        plot.cross(0, 0, 'soft');
        mark(plot, polesOf(state), 'estimate');
        plot.legend([['without feedback', 'soft'], ['with it', 'estimate']]);
      },
    },
    {
      title: 'the cart, released 1 m off', x: [0, END], y: [-1.1, 1.1], across: 't in s', up: 'position in m',
      draw(plot, state, { motion }) { plot.across(0, 'soft', 'solid'); plot.curve(motion, 'estimate', { width: 2.5 }); },
    },
    {
      title: 'the force', x: [0, END], y: (state, { most }) => [-1.15 * Math.max(most, 10), 1.15 * Math.max(most, 10)], across: 't in s', up: 'force in N',
      handles: [{ label: 'what the motor can do', at: ({ limit }) => [END - 0.4, limit], move: ([, y]) => ({ limit: y }), text: ({ limit }) => `${number(limit)} N` }],
      draw(plot, { limit }, { forces }) {
        plot.across(0, 'soft', 'solid');
        plot.between([[0, 99], [END, 99]], [[0, limit], [END, limit]], 'growth');
        plot.between([[0, -limit], [END, -limit]], [[0, -99], [END, -99]], 'growth');
        plot.curve(forces, 'input', { width: 2.5 });
        plot.legend([['the force', 'input'], ['shaded: too much', 'soft']]);
      },
    },
  ],
  sentence(state, { K, effort, most }) {
    const stable = polesOf(state).every(([re]) => re < 0);
    if (!stable) return `${words(polesOf(state))}: a pole is not in the left half, so the cart never comes back to 0.`;
    return `K = [${K.map((k) => number(k)).join(', ')}] places ${words(polesOf(state))}: at most ${number(most)} N${most > state.limit ? ', which the motor does not have' : ''}, and an effort ∫u² dt of ${number(effort)} N²s.`;
  },
};
