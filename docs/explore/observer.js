// SPDX-License-Identifier: Apache-2.0
import { decades } from './explorable.js';
import { add, apply, cholesky, column, expm, lqe, lyapunov, multiply, normals, place, sample, sampledNoise, scale, transpose } from './numbers.js';
import { number } from './poles.js';

const A = [[0, 1], [-1, -0.3]], C = [[1, 0]];  // a mass on a spring, and a sensor of its position
const DT = 0.02, END = 12, COUNT = END / DT;
const [SLOW, FAST] = [0.2, 30];

// draws that are the same at every place of the handles
const draws = (() => { const normal = normals(7); return Array.from({ length: COUNT + 1 }, () => [normal(), normal(), normal()]); })();

// gain with a pair of poles at a distance `speed` from 0
function gain(speed) {
  const pair = [[-Math.SQRT1_2 * speed, Math.SQRT1_2 * speed], [-Math.SQRT1_2 * speed, -Math.SQRT1_2 * speed]];
  return place(transpose(A), C[0], pair);
}

// deviations of the error in the position: by the noise of the sensor, by the pushes, by both
function deviations(L, push, noise) {
  const loop = add(A, multiply(column(L), C), -1), W = [[0, 0], [0, push ** 2]];
  const [read, pushed] = [scale(multiply(column(L), [L]), noise ** 2), W].map((density) => lyapunov(loop, density)[0][0]);
  return [read, pushed, read + pushed].map((variance) => Math.sqrt(variance));
}

function simulate(L, push, noise) {
  const F = expm(scale(A, DT)), N = cholesky(sampledNoise(A, [[0, 0], [0, push ** 2]], DT));
  const [Fe, Ge] = sample(add(A, multiply(column(L), C), -1), column(L), DT);
  let x = [1, 0], estimate = [0, 0];
  return draws.map(([a, b, c], k) => {
    const reading = x[0] + noise / Math.sqrt(DT) * c, row = { t: k * DT, x: x[0], reading, estimate: estimate[0] };
    estimate = apply(Fe, estimate).map((entry, i) => entry + Ge[i][0] * reading);
    x = apply(F, x).map((entry, i) => entry + N[i][0] * a + N[i][1] * b);
    return row;
  });
}

const GAINS = Array.from({ length: 120 }, (_, k) => SLOW * (FAST / SLOW) ** (k / 119)).map((speed) => [speed, gain(speed)]);
let known = {};  // what does not depend on the speed, of the last noise

export const observer = {
  title: 'Too slow misses the pushes, too fast follows the noise',
  saying: 'a fast observer forgets its first error soon and copies the noise; in between is the least error, and Kalman\'s gain is at least as good as the best of any speed.',
  state: { speed: [6, SLOW, FAST], noise: [0.05, 0.005, 0.5], push: [0.3, 0.02, 2] },
  sliders: [
    { key: 'noise', label: 'noise of the sensor', log: true, text: (value) => `${number(value / Math.sqrt(DT), 2)} m in each reading` },
    { key: 'push', label: 'pushes', log: true, text: (value) => `${number(value, 2)} m/s in a second` },
  ],
  compute({ speed, noise, push }) {
    if (known.noise !== noise || known.push !== push) {
      const { L, P } = lqe(A, C, [[0, 0], [0, push ** 2]], [[noise ** 2]]);
      known = { noise, push, curves: GAINS.map(([each, gains]) => [each, ...deviations(gains, push, noise)]), kalman: Math.sqrt(P[0][0]), L };
    }
    return { ...known, rows: simulate(gain(speed), push, noise), now: deviations(gain(speed), push, noise)[2] };
  },
  panels: [
    {
      title: 'the position, and its estimate from a wrong start', x: [0, END], y: (state, { rows }) => { const most = Math.max(2.2, ...rows.map(({ x }) => 1.2 * Math.abs(x))); return [-most, most]; }, across: 't in s', up: 'position in m',
      draw(plot, state, { rows }) {
        for (const { t, reading } of rows.filter((_, k) => k % 4 === 0)) plot.point(t, reading, 'reading', 1.3);
        plot.curve(rows.map(({ t, x }) => [t, x]), 'ink');
        plot.curve(rows.map(({ t, estimate }) => [t, estimate]), 'estimate', { dash: 'dashed' });
        plot.legend([['truth', 'ink'], ['readings', 'reading'], ['estimate', 'estimate']]);
      },
    },
    {
      title: 'its error in the long run, computed', x: [SLOW, FAST], y: (state, { curves, kalman, now }) => decades([kalman, now, ...curves.map((row) => row[3])], 0.1, 0.1), log: 'xy', across: 'speed of the observer in 1/s', up: 'σ in m',
      handles: [{ label: 'speed of the observer', at: ({ speed }, { now }) => [speed, now], move: ([speed]) => ({ speed }), text: ({ speed }) => `${number(speed)} per second` }],
      draw(plot, state, { curves, now, kalman }) {
        [['reading', 'dotted'], ['input', 'dotted'], ['estimate', 'solid']].forEach(([look, dash], k) => {
          plot.curve(curves.map((row) => [row[0], row[1 + k]]), look, { width: k === 2 ? 2.5 : 1.5, dash });
        });
        plot.across(kalman, 'prior');
        plot.point(state.speed, now, 'estimate', 6);
        plot.legend([['by the sensor\'s noise', 'reading'], ['by the pushes', 'input'], ['both', 'estimate'], ['Kalman\'s gain', 'prior']]);
      },
    },
  ],
  sentence({ speed }, { now, kalman, L, curves }) {
    const best = curves.reduce((least, row) => (row[3] < least[3] ? row : least));
    return `At ${number(speed, 2)} per second σ is ${number(1000 * now)} mm; the best speed, ${number(best[0], 2)}, has ${number(1000 * best[3])} mm; Kalman's gain [${L.map(([l]) => number(l, 2)).join(', ')}] has ${number(1000 * kalman)} mm.`;
  },
};
