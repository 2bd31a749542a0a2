// SPDX-License-Identifier: Apache-2.0
import { moments, multiply, normals, sigmaPoints, transpose } from './numbers.js';
import { number } from './poles.js';

const UP = Math.PI / 2, DEGREE = Math.PI / 180, COUNT = 400;
const draws = (() => { const normal = normals(11); return Array.from({ length: COUNT }, () => [normal(), normal()]); })();
const toPlane = ([r, angle]) => [r * Math.cos(angle), r * Math.sin(angle)];

// the place of a target at a range of 1 m straight ahead: the exact mean and covariance, and what two filters think
export function transforms(range, bearing) {
  const [r2, t2] = [range ** 2, bearing ** 2], once = Math.exp(-t2 / 2), twice = Math.exp(-2 * t2);
  const exact = { x: [0, once], P: [[(1 + r2) * (1 - twice) / 2, 0], [0, (1 + r2) * (1 + twice) / 2 - once ** 2]] };
  const polar = { x: [1, UP], P: [[r2, 0], [0, t2]] };
  const J = [[Math.cos(UP), -Math.sin(UP)], [Math.sin(UP), Math.cos(UP)]];
  const tangent = { x: toPlane(polar.x), P: multiply(J, polar.P, transpose(J)) };
  const { points, weights } = sigmaPoints(polar, 1), sent = points.map(toPlane);
  return { exact, tangent, points, sent, unscented: moments(sent, weights) };
}

const little = (value) => (value < 0.001 ? 'under 0.001' : number(value, 2));

export const banana = {
  title: 'A tangent misses the bend, sigma points follow it',
  saying: 'an extended filter takes the function\'s tangent at one point, the unscented filter sends a few points through the function; where the function bends within the uncertainty, only the second has the mean right.',
  state: { range: [0.05, 0.01, 0.3], bearing: [25 * DEGREE, 1 * DEGREE, 45 * DEGREE] },
  compute: ({ range, bearing }) => ({ ...transforms(range, bearing), cloud: draws.map(([a, b]) => [1 + range * a, UP + bearing * b]) }),
  panels: [
    {
      title: 'what the sensor reads: range and bearing', x: [-30, 210], y: [0, 2], across: 'bearing in degrees', up: 'range in m',
      handles: [
        { label: 'noise of the bearing, 2σ', at: ({ bearing }) => [90 + 2 * bearing / DEGREE, 1], move: ([angle]) => ({ bearing: (angle - 90) * DEGREE / 2 }), text: ({ bearing }) => `σ ${number(bearing / DEGREE)} degrees` },
        { label: 'noise of the range, 2σ', at: ({ range }) => [90, 1 + 2 * range], move: ([, r]) => ({ range: (r - 1) / 2 }), text: ({ range }) => `σ ${number(range)} m` },
      ],
      draw(plot, { range, bearing }, { cloud, points }) {
        for (const [r, angle] of cloud) plot.point(angle / DEGREE, r, 'reading', 1.3);
        plot.ellipse({ x: [90, 1], P: [[(bearing / DEGREE) ** 2, 0], [0, range ** 2]] }, 'ink', { dash: 'dashed' });
        for (const [r, angle] of points) plot.point(angle / DEGREE, r, 'estimate', 4.5);
        plot.legend([['2σ', 'ink'], ['sigma points', 'estimate']]);
      },
    },
    {
      title: 'where the target is', x: [-1.3, 1.3], y: [-0.3, 1.7], equal: true, across: 'x in m', up: 'y in m',
      draw(plot, state, { cloud, sent, exact, tangent, unscented }) {
        for (const each of cloud) plot.point(...toPlane(each), 'reading', 1.3);
        plot.ellipse(exact, 'ink', { dash: 'dashed' });
        plot.ellipse(tangent, 'input');
        plot.ellipse(unscented, 'estimate');
        for (const each of sent) plot.point(...each, 'estimate', 4.5);
        plot.legend([['exact', 'ink'], ['tangent (EKF)', 'input'], ['sigma points (UKF)', 'estimate']]);
      },
    },
  ],
  sentence({ bearing }, { exact, tangent, unscented }) {
    const off = ({ x }) => Math.abs(x[1] - exact.x[1]), deviation = Math.sqrt(exact.P[1][1]);
    const claims = ({ P }) => Math.sqrt(P[1][1]) / deviation;
    return `Bearings of σ = ${number(bearing / DEGREE)}°: the tangent's mean is ${little(off(tangent) / deviation)} σ off and it claims ${number(claims(tangent), 2)} of the true σ across the bend; the sigma points ${little(off(unscented) / deviation)} σ and ${number(claims(unscented), 2)}.`;
  },
};
