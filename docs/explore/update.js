// SPDX-License-Identifier: Apache-2.0
import { predict, sample, sampledNoise, update as correct } from './numbers.js';
import { number } from './poles.js';

const A = [[0, 1], [0, 0]], [F] = sample(A, [[0], [1]], 1), Q = sampledNoise(A, [[0, 0], [0, 0.1]], 1);
const density = (mean, variance) => (x) => Math.exp(-((x - mean) ** 2) / variance / 2) / Math.sqrt(2 * Math.PI * variance);
const before = ({ x, v, pxx, pxv, pvv }) => ({ x: [x, v], P: [[pxx, pxv], [pxv, pvv]] });
const belief = ({ x: [x, v], P }) => ({ x, v, pxx: P[0][0], pxv: P[0][1], pvv: P[1][1] });
const AXES = [[1, 0], [0, 1]];

export const update = {
  title: 'Predict: the ellipse grows. Update: it shrinks along what was read.',
  saying: 'a prediction shears and widens what is known, a reading multiplies it with a second Gaussian, and the product is narrower than both.',
  state: {
    x: [0, -9, 12], v: [0.8, -4, 4], pxx: [1.5, 1e-4, 100], pxv: [0.6, -30, 30], pvv: [0.6, 1e-4, 10],
    sensor: [0, 0, 1], y: [1.6, -9, 9], sigma: [0.6, 0.05, 4],
  },
  // an address may have any numbers
  repair(state) {
    const most = 0.999 * Math.sqrt(state.pxx * state.pvv);
    state.pxv = Math.max(-most, Math.min(most, state.pxv));
  },
  choices: [{ key: 'sensor', label: 'what is read', options: ['read the position', 'read the velocity'] }],
  actions: [
    { label: 'predict 1 s', act: (state) => belief(predict(before(state), F, Q)) },
    { label: 'take a reading like this', act: (state, { after }) => belief(after) },
  ],
  compute(state) {
    const h = AXES[Math.round(state.sensor)], prior = before(state);
    return { prior, after: correct(prior, h, state.y, state.sigma ** 2), k: Math.round(state.sensor) };
  },
  panels: [
    {
      title: 'what is known, 2σ', x: [-6, 10], y: [-4, 5], across: 'position in m', up: 'velocity in m/s',
      handles: [
        { label: 'the reading', at: ({ y, sensor }) => (Math.round(sensor) ? [-5, y] : [y, -3.2]), move: (place, { sensor }) => ({ y: place[Math.round(sensor)] }) },
        { label: 'the expected state', at: ({ x, v }) => [x, v], move: ([x, v]) => ({ x, v }) },
      ],
      draw(plot, { y, sigma }, { prior, after, k }) {
        const far = 50, edge = (side) => (k ? [[-far, y + side], [far, y + side]] : [[y + side, -far], [y + side, far]]);
        if (k) plot.between(edge(2 * sigma), edge(-2 * sigma), 'growth');
        else plot.between([[y - 2 * sigma, far], [y + 2 * sigma, far]], [[y - 2 * sigma, -far], [y + 2 * sigma, -far]], 'growth');
        plot.curve(edge(0), 'input', { width: 1.5, dash: 'dashed' });
        plot.ellipse(prior, 'prior', { dash: 'dotted' });
        plot.ellipse(after, 'estimate', { filled: true });
        plot.arrow(prior.x, after.x, 'soft');
        plot.legend([['before, P⁻', 'prior'], ['the reading, ±2σ', 'input'], ['after, P⁺', 'estimate']]);
      },
    },
    {
      title: 'the same along the axis that is read', x: (state) => (Math.round(state.sensor) ? [-4, 5] : [-6, 10]), y: (state, { after, k }) => [0, 1.15 * density(0, Math.min(after.P[k][k]))(0)],
      across: 'what is read', up: 'density',
      handles: [{
        label: 'noise of the reading', at: ({ y, sigma }) => [y + sigma, density(y, sigma ** 2)(y + sigma)], move: ([place], { y }) => ({ sigma: place - y }), text: ({ sigma }) => `σ ${number(sigma)}`,
      }],
      draw(plot, { y, sigma }, { prior, after, k }) {
        const places = Array.from({ length: 401 }, (_, i) => plot.x[0] + (plot.x[1] - plot.x[0]) * i / 400);
        const line = (mean, variance) => places.map((place) => [place, density(mean, variance)(place)]);
        const product = line(after.x[k], after.P[k][k]);
        plot.area(product, 0, 'band');
        plot.curve(line(prior.x[k], prior.P[k][k]), 'prior', { dash: 'dotted' });
        plot.curve(line(y, sigma ** 2), 'input', { dash: 'dashed' });
        plot.curve(product, 'estimate', { width: 2.5 });
        plot.legend([['predicted', 'prior'], ['read', 'input'], ['their product, scaled', 'estimate']]);
      },
    },
  ],
  sentence({ sigma }, { prior, after, k }) {
    const [before_, read, now] = [prior.P[k][k], sigma ** 2, after.P[k][k]].map((variance) => 1 / variance);
    const other = 1 - k, [was, is] = [prior, after].map(({ P }) => Math.sqrt(P[other][other]));
    return `L = ${number(after.L[k], 2)}. Information adds: ${number(before_, 4)} + ${number(read, 4)} = ${number(now, 4)}. The other state was not read, and its σ went from ${number(was)} to ${number(is)}${Math.abs(prior.P[0][1]) < 1e-9 ? ': nothing ties them together' : ''}.`;
  },
};
