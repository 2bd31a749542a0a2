// SPDX-License-Identifier: Apache-2.0
import { add, characteristic, complex, dot, apply, eigenvalues, lqe, lqr, multiply, polynomialAt, scale } from './numbers.js';
import { number } from './poles.js';

// Doyle (1978), Guaranteed margins for LQG regulators: q = sigma = 60
const A = [[1, 1], [0, 1]], B = [[0], [1]], C = [[1, 0]], ONES = [[60, 60], [60, 60]];
const DEGREES = 180 / Math.PI, RECOVERY = 300;  // of the noise that the filter expects at the input

const { K } = lqr(A, B, ONES, [[1]]);
const filter = (extra) => lqe(A, C, add(ONES, [[0, 0], [0, extra ** 2]]), [[1]]).L;
const ratio = (M, b, c) => { const { coefficients, adjugate } = characteristic(M); return { above: adjugate.map((N) => dot(c, apply(N, b))), below: coefficients }; };

function compensated(L) {
  const M = add(add(A, multiply(B, K), -1), multiply(L, C), -1), b = L.map(([l]) => l);
  return { parts: [ratio(M, b, K[0]), ratio(A, [0, 1], C[0])], compensator: { M, b }, unstable: [...eigenvalues(M), ...eigenvalues(A)].filter(([re]) => re > 0).length };
}

export const LOOPS = [
  { name: 'LQR', parts: [ratio(A, [0, 1], K[0])], unstable: 2 },
  { name: 'LQG', ...compensated(filter(0)) },
  { name: 'Recovered', ...compensated(filter(RECOVERY)) },
];

const FREQUENCIES = Array.from({ length: 700 }, (_, k) => 0.01 * (1e5) ** (k / 699));

// the loop at j omega, without the gain and the delay of the hand
export const loopAt = ({ parts }, omega) => parts.reduce((product, { above, below }) => complex.times(product, complex.over(polynomialAt(above, [0, omega]), polynomialAt(below, [0, omega]))), [1, 0]);

for (const loop of LOOPS) loop.curve = FREQUENCIES.map((omega) => loopAt(loop, omega));

// where a quantity of the curve changes its sign, by bisection in the logarithm of the frequency
function crossings(loop, value) {
  const found = [];
  for (let k = 1; k < FREQUENCIES.length; k++) {
    if (!(value(loop.curve[k - 1]) * value(loop.curve[k]) < 0)) continue;
    let [low, high] = [FREQUENCIES[k - 1], FREQUENCIES[k]];
    for (let turn = 0; turn < 60; turn++) {
      const middle = Math.sqrt(low * high);
      if (value(loopAt(loop, low)) * value(loopAt(loop, middle)) <= 0) high = middle; else low = middle;
    }
    found.push({ omega: high, value: loopAt(loop, high) });
  }
  return found;
}

// gains between which the loop is stable, phases in degrees, delay in seconds
export function marginsOf(loop) {
  // the curve begins on the real axis
  const onAxis = [loopAt(loop, 0)[0], ...crossings(loop, ([, im]) => im).map(({ value: [re] }) => re)];
  const gains = onAxis.filter((re) => re < -1e-9).map((re) => -1 / re);
  const phases = crossings(loop, (value) => complex.size(value) - 1).map(({ omega, value: [re, im] }) => {
    const lag = ((Math.atan2(im, re) + Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI);  // to -1
    return { omega, lag, lead: 2 * Math.PI - lag, delay: lag / omega };
  });
  return {
    low: Math.max(0, ...gains.filter((gain) => gain < 1)), high: Math.min(Infinity, ...gains.filter((gain) => gain > 1)),
    lead: Math.min(...phases.map(({ lead }) => lead)) * DEGREES, lag: Math.min(...phases.map(({ lag }) => lag)) * DEGREES, delay: Math.min(...phases.map(({ delay }) => delay)),
    crossover: phases.reduce((least, each) => (each.delay < least.delay ? each : least)).omega,
  };
}

for (const loop of LOOPS) loop.margins = marginsOf(loop);

// the curve with the gain and the delay, and whether it encircles -1 as it must (Nyquist, 1932)
export function changed(loop, factor, delay) {
  const curve = loop.curve.map((value, k) => scale([complex.times(value, complex.turn(-FREQUENCIES[k] * delay))], factor)[0]);
  let turned = 0, last = null;
  for (const [re, im] of curve) {
    const angle = Math.atan2(im, 1 + re);
    if (last !== null) turned += ((angle - last + 3 * Math.PI) % (2 * Math.PI) + 2 * Math.PI) % (2 * Math.PI) - Math.PI;
    last = angle;
  }
  // from 0 to infinity it is half of the turns; both ends are on the real axis
  return { curve, stable: Math.round(turned / Math.PI) === loop.unstable };
}

// the state over time, from a little off, the input late by the delay
const DT = 0.002, END = 6;
function simulate({ compensator }, factor, delay) {
  const late = Math.round(delay / DT), inputs = new Float64Array(END / DT + late + 2), rows = [], [k1, k2] = K[0];
  const [[m11, m12], [m21, m22]] = compensator?.M ?? [[0, 0], [0, 0]], [l1, l2] = compensator?.b ?? [0, 0];
  let x1 = 0.1, x2 = 0, e1 = 0.1, e2 = 0;  // state and estimate
  for (let k = 0; k * DT <= END && Math.abs(x1) < 50; k++) {
    if (k % 5 === 0) rows.push([k * DT, x1]);
    inputs[k + late] = -factor * (compensator ? k1 * e1 + k2 * e2 : k1 * x1 + k2 * x2);
    [e1, e2] = [e1 + DT * (m11 * e1 + m12 * e2 + l1 * x1), e2 + DT * (m21 * e1 + m22 * e2 + l2 * x1)];
    [x1, x2] = [x1 + DT * (x1 + x2), x2 + DT * (x2 + inputs[k])];
  }
  return rows;
}

export const margins = {
  title: 'LQR is far from −1, LQG comes close, and some of it can be had back',
  saying: 'the distance of the curve from −1 is what may be wrong; a regulator with the whole state keeps out of a circle, the same regulator with an estimate does not, and noise expected at the input brings margin back.',
  state: { kind: [0, 0, 2], factor: [1, 0.3, 4], delay: [0, 0, 0.4] },
  choices: [{ key: 'kind', label: 'loop', options: ['LQR', 'LQG', 'recovered'] }],
  sliders: [
    { key: 'factor', label: 'gain of the plant', log: true, text: (value) => `× ${number(value)}` },
    { key: 'delay', label: 'delay', text: (value) => `${number(1000 * value)} ms` },
  ],
  compute({ kind, factor, delay }) {
    const loop = LOOPS[Math.round(kind)];
    return { loop, ...changed(loop, factor, delay), motion: simulate(loop, factor, delay) };
  },
  panels: [
    {
      title: 'the loop in the complex plane', x: ({ kind }) => (Math.round(kind) ? [-2.6, 1.4] : [-6, 1.6]), y: ({ kind }) => (Math.round(kind) ? [-2, 2] : [-3.8, 3.8]), equal: true, across: 'real part', up: 'imaginary part',
      handles: [
        {
          label: 'gain', at: ({ factor }, { loop }) => [-factor / nearest(loop), 0],
          move: ([re], state, { loop }) => (re < 0 ? { factor: -re * nearest(loop) } : {}), text: ({ factor }) => `times ${number(factor)}`,
        },
        {
          label: 'delay', at: ({ factor, delay }, { loop }) => complex.times(scale([loopAt(loop, loop.margins.crossover)], factor)[0], complex.turn(-loop.margins.crossover * delay)),
          move: ([re, im], state, { loop }) => {
            const [x, y] = loopAt(loop, loop.margins.crossover), angle = Math.atan2(y, x) - Math.atan2(im, re);
            const before = state.delay * loop.margins.crossover, round = 2 * Math.PI;  // it may go round more than once
            return { delay: (angle + round * Math.round((before - angle) / round)) / loop.margins.crossover };
          },
          text: ({ delay }) => `${number(1000 * delay)} ms`,
        },
      ],
      draw(plot, state, { curve, stable }) {
        const circle = (x, radius) => Array.from({ length: 91 }, (_, k) => [x + radius * Math.cos(k * Math.PI / 45), radius * Math.sin(k * Math.PI / 45)]);
        plot.across(0, 'soft', 'solid');
        plot.curve(circle(0, 1), 'soft', { width: 1, dash: 'dotted' });
        plot.curve(circle(-1, 1), 'prior', { width: 1.2, dash: 'dashed' });
        plot.curve(curve.map(([re, im]) => [re, -im]), 'reading', { width: 1.2 });
        plot.curve(curve, stable ? 'estimate' : 'bad', { width: 2.5 });
        plot.cross(-1, 0, 'bad', 6);
        plot.legend([['the loop', stable ? 'estimate' : 'bad'], ['LQR keeps out of this circle', 'prior'], ['−1: oscillates for ever', 'bad']]);
      },
    },
    {
      title: 'the state, from 0.1 off', x: [0, END], y: [-1, 1], across: 't in s', up: 'x₁',
      draw(plot, state, { motion, stable }) { plot.across(0, 'soft', 'solid'); plot.curve(motion, stable ? 'estimate' : 'bad', { width: 2.5 }); },
    },
  ],
  sentence({ factor, delay }, { loop, stable }) {
    const { low, high, lead, lag, delay: most } = loop.margins;
    const range = `gains of ${number(low, 3)} to ${Number.isFinite(high) ? number(high, 3) : 'infinity'}, a phase of −${number(lead, 2)} (lead) to +${number(lag, 2)} degrees (lag), ${number(1000 * most, 3)} ms of delay`;
    return `${loop.name} tolerates, one at a time, ${range}. With × ${number(factor)} and ${number(1000 * delay)} ms it is ${stable ? 'stable' : 'unstable'}.`;
  },
};

// the gain at the boundary that is nearest to 1
const nearest = (loop) => {
  const { low, high } = loop.margins;
  return low && (!Number.isFinite(high) || -Math.log(low) < Math.log(high)) ? low : high;
};
