// SPDX-License-Identifier: Apache-2.0
// Two poles of one system, real or a conjugate pair, as places that are dragged in the complex plane.
import { short } from '../../kalman_ros/live/page/pen.js';

const ON_AXIS = 0.15;  // an imaginary part below is that of a real pole

// the two poles of the state; its keys end with `of`
export function polesOf(state, of = '') {
  const re = state[`re${of}`], im = state[`im${of}`];
  return im ? [[re, im], [re, -im]] : [[re, 0], [state[`second${of}`], 0]];
}

// whether a pole leaves the real axis, or is away from it: a key that moves it does so at once
const off = (y, im, byKey) => Math.abs(y) >= (byKey && !im ? 1e-6 : ON_AXIS);

export function poleHandles(label, of = '') {
  const [re, im, second] = [`re${of}`, `im${of}`, `second${of}`];
  const text = (state) => words(polesOf(state, of));
  // one that leaves the real axis takes the other with it; the first then moves the pair
  const move = (key) => ([x, y], state, computed, byKey) => {
    if (off(y, state[im], byKey)) return { [re]: x, [im]: Math.max(Math.abs(y), ON_AXIS) };
    return state[im] ? { [re]: x, [second]: x, [im]: 0 } : { [key]: x };
  };
  return [
    { label: `${label}, first pole`, text, at: (state) => [state[re], state[im]], move: move(re) },
    { label: `${label}, second pole`, text, at: (state) => (state[im] ? null : [state[second], 0]), move: move(second) },
  ];
}

export const number = (value, digits = 3) => short(Math.abs(value) < 1e-9 ? 0 : value, digits).replaceAll('-', '−');

export function words([[re, im], [second]]) {
  return im ? `${number(re)} ± ${number(Math.abs(im))}j` : `${number(re)} and ${number(second)}`;
}

// the complex plane: what decays is on the left
export function complexPlane(plot) {
  plot.between([[0, plot.y[1]], [plot.x[1], plot.y[1]]], [[0, plot.y[0]], [plot.x[1], plot.y[0]]], 'growth');
  plot.curve([[plot.x[0], 0], [plot.x[1], 0]], 'soft', { width: 1 });
  plot.curve([[0, plot.y[0]], [0, plot.y[1]]], 'soft', { width: 1 });
  plot.legend([['shaded: it grows', 'soft']]);
}

export const mark = (plot, poles, look) => poles.forEach(([re, im]) => plot.cross(re, im, look));
