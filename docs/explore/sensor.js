// SPDX-License-Identifier: Apache-2.0
import { add, apply, diagonal, dot, expm, inverse, multiply, path, scale, transpose } from './numbers.js';
import { number } from './poles.js';

// two modes, along directions that are not at right angles
const MODES = [[1, 0.25], [-0.5, 1]], RATES = [-0.25, -1.5];
const T = transpose(MODES), A = multiply(T, diagonal(...RATES), inverse(T));
const DT = 0.1, COUNT = 40, SIGMA = 0.05, KNOWN_BEFORE = 3;
const F = expm(scale(A, DT));
const TRUE = [1, 0.6];

export const sensor = {
  title: 'One sensor, one direction: what does it show of two states?',
  saying: 'a reading shows the state along one direction, time turns the state, and so both parts are seen, except along a direction in which a mode never shows.',
  state: { angle: [0.3, -Math.PI, Math.PI], x: [-0.4, -2, 2], y: [-1, -2, 2] },
  compute({ angle }) {
    const c = [Math.cos(angle), Math.sin(angle)];
    let row = c, information = diagonal(KNOWN_BEFORE ** -2, KNOWN_BEFORE ** -2);
    for (let k = 0; k < COUNT; k++) {
      information = add(information, row.map((a) => row.map((b) => a * b / SIGMA ** 2)));
      row = apply(transpose(F), row);
    }
    const shares = MODES.map((mode) => Math.abs(dot(c, mode)) / Math.hypot(...mode));
    return { c, P: inverse(information), readings: (start) => path(F, start, COUNT).map((x, k) => [k * DT, dot(c, x)]), shares };
  },
  panels: [
    {
      title: 'the plane of the two states', x: [-2.2, 2.2], y: [-2.2, 2.2], equal: true, across: 'x₁', up: 'x₂',
      handles: [
        { label: 'direction of the sensor', at: (state, { c }) => c.map((entry) => 1.7 * entry), move: ([x, y]) => ({ angle: Math.atan2(y, x) }), text: ({ angle }) => `${number(angle * 180 / Math.PI)} degrees` },
        { label: 'another start', at: ({ x, y }) => [x, y], move: ([x, y]) => ({ x, y }) },
      ],
      draw(plot, { x, y }, { c, P }) {
        for (const mode of MODES) plot.curve([mode.map((entry) => -5 * entry), mode.map((entry) => 5 * entry)], 'prior', { width: 1.5, dash: 'dashed' });
        // all states with the same reading as the true one now
        const across = [-c[1], c[0]], along = dot(c, TRUE);
        plot.curve([-5, 5].map((s) => c.map((entry, k) => along * entry + s * across[k])), 'reading', { width: 1.2, dash: 'dotted' });
        plot.ellipse({ x: TRUE, P }, 'estimate', { filled: true });
        plot.arrow([0, 0], c.map((entry) => 1.7 * entry), 'ink');
        plot.curve(path(F, TRUE, COUNT), 'ink', { width: 1.2 });
        plot.curve(path(F, [x, y], COUNT), 'input', { width: 1.2 });
        plot.point(...TRUE, 'ink', 5);
        plot.point(x, y, 'input', 5);
        plot.legend([['the two modes', 'prior'], ['same reading at the start', 'reading'], ['known after 4 s, 2σ', 'estimate']]);
      },
    },
    {
      title: 'what the sensor reads from both starts', x: [0, COUNT * DT], y: [-2.2, 2.2], across: 't in s', up: 'y',
      draw(plot, { x, y }, { readings }) {
        plot.curve(readings(TRUE), 'ink', { width: 2.5 });
        plot.curve(readings([x, y]), 'input', { width: 2.5, dash: 'dashed' });
        plot.legend([['the true start', 'ink'], ['the other start', 'input']]);
      },
    },
  ],
  sentence({ x, y }, { readings, P, shares }) {
    const [one, other] = [readings(TRUE), readings([x, y])];
    const apart = Math.max(...one.map(([, reading], k) => Math.abs(reading - other[k][1])));
    const worst = Math.sqrt((P[0][0] + P[1][1]) / 2 + Math.hypot((P[0][0] - P[1][1]) / 2, P[0][1]));
    const blind = shares.findIndex((share) => share < 0.02);
    if (blind >= 0) return `The sensor is blind for the mode ${number(RATES[blind])}: it stands at right angles to it, and what lies along that dashed line stays unknown (σ = ${number(worst, 2)}).`;
    return `The readings of the two starts differ by ${number(apart, 2)} at most (noise ${SIGMA}). The least known direction has σ = ${number(worst, 2)} after ${COUNT} readings.`;
  },
};
