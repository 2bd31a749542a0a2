// SPDX-License-Identifier: Apache-2.0
// Parts of the drawings: springs, arrows, ellipses, readings.

import { data, last } from './data.js';
import { colour, covarianceEllipse, labelled, quantity, short, stroke, ticks } from './pen.js';

export const TWO_SIGMA = 2;
const RECENT = 0.5;  // seconds that an estimate may be under way
export const FRESH = 600;  // milliseconds for which a reading is shown

// the truth of the time of a recent estimate, which is under way for a moment; else the newest
function truthOf(estimate) {
  const rows = data.rows.truth ?? [], newest = rows.at(-1);
  if (!estimate || newest === undefined || newest[0] - estimate[0] > RECENT) return newest;
  for (let k = rows.length - 1; k >= 0 && rows[k][0] >= estimate[0] - 1e-6; k--) if (rows[k][0] <= estimate[0] + 1e-6) return rows[k];
  return newest;
}

// truth, estimate and covariance by the names of the states
export function now(scene) {
  const names = scene.state.names, n = names.length;
  const ghost = last('ghost');
  const estimate = last('estimate'), truth = truthOf(estimate), input = last('input');
  const at = (row, first) => Object.fromEntries(names.map((name, k) => [name, row?.[first + k] ?? null]));
  const cell = (P, a, b) => (P ? P[names.indexOf(a) * n + names.indexOf(b)] : 0);
  const prior = data.prior && { x: at(data.prior.x, 0), P: (a, b) => cell(data.prior.P, a, b) };
  return {
    truth: truth && at(truth, 1),
    estimate: estimate && { x: at(estimate, 1), P: (a, b) => cell(data.P, a, b) },
    ghost: ghost && { x: at(ghost, 1), P: (a, b) => cell(data.ghostP, a, b) },
    prior,
    input: (input ?? []).slice(1),
  };
}

export const deviation = (belief, name) => Math.sqrt(Math.max(0, belief.P(name, name) ?? 0));

// the length in pixels of an input: large ones are shortened
export const reach = (scene, value) => 70 * Math.tanh((value ?? 0) / (scene.force || 1));

export function spring(pen, x0, y0, x1, y1) {
  const length = Math.hypot(x1 - x0, y1 - y0), turns = 9, a = Math.atan2(y1 - y0, x1 - x0);
  stroke(pen, 'soft', 1.4);
  pen.save();
  pen.translate(x0, y0); pen.rotate(a);
  pen.beginPath(); pen.moveTo(0, 0);
  for (let k = 0; k <= 2 * turns; k++) pen.lineTo(length * (0.08 + 0.84 * k / (2 * turns)), k % 2 ? 6 : -6);
  pen.lineTo(length, 0); pen.stroke();
  pen.restore();
}

// the ellipse of two states of a belief; y points up in the world
export function ellipse(pen, X, Y, belief, a, b, look, dash) {
  const mean = [belief.x[a], belief.x[b]];
  if (mean.includes(null)) return;
  covarianceEllipse(pen, X, Y, mean, [belief.P(a, a), belief.P(a, b), belief.P(b, b)], TWO_SIGMA, { look, dash, filled: look === 'estimate' });
}

let corner = null;  // of the magnifier: as shares of width and height

// The corner with the most room about it; it stays while there is enough.
function freest(w, h, r, taken) {
  const room = ([x, y]) => Math.min(...taken.map(([px, py]) => Math.hypot(px - across(x, w, r), py - down(y, h, r))));
  if (corner && room(corner) > r + 14) return corner;
  const all = [[1, 0], [0, 0], [1, 1], [0, 1]];
  return all.reduce((best, each) => (room(each) > room(best) + 1 ? each : best));
}

// away from the numbers at the left and below, with its own text
const across = (share, w, r) => (share ? w - r - 30 : r + 56), down = (share, h, r) => (share ? h - r - 52 : r + 14);

// where the ellipse is too small to see: the same, magnified, in a corner away from what is drawn
export function magnified(pen, w, h, seen, scale, a, b, canvas) {
  const belief = seen.estimate;
  if (!belief || belief.x[a] === null) { corner = null; return; }
  const off = Math.hypot(belief.x[a] - seen.truth[a], belief.x[b] - seen.truth[b]);
  const size = Math.max(off, TWO_SIGMA * Math.sqrt(Math.max(belief.P(a, a), belief.P(b, b), 1e-18)));
  const r = Math.min(58, 0.19 * h), zoom = 10 ** Math.floor(Math.log10(0.75 * r / size));
  if (size * scale > 16) { corner = null; return; }
  corner = freest(w, h, r, [canvas.body, ...canvas.taken]);
  const cx = across(corner[0], w, r), cy = down(corner[1], h, r);
  pen.save();
  pen.beginPath(); pen.arc(cx, cy, r, 0, 7); pen.fillStyle = colour('paper'); pen.fill();
  stroke(pen, 'soft', 1); pen.stroke();
  pen.clip();
  const fit = [5, 2, 1].map((factor) => factor * zoom).find((each) => each * size <= 0.75 * r) ?? zoom;
  const X = (x) => cx + (x - seen.truth[a]) * fit, Y = (y) => cy - (y - seen.truth[b]) * fit;
  ellipse(pen, X, Y, belief, a, b, 'estimate', 'dashed');
  if (seen.ghost) ellipse(pen, X, Y, seen.ghost, a, b, 'ghost', 'dotted');
  if (seen.prior) ellipse(pen, X, Y, seen.prior, a, b, 'prior', 'dotted');
  stroke(pen, 'ink', 3);
  pen.beginPath(); pen.arc(cx, cy, 2.5, 0, 7); pen.stroke();
  pen.restore();
  // with a scale below
  const [long] = ticks(0, r / fit, 1).slice(-1), half = long * fit / 2, below = cy + r + 8;
  stroke(pen, 'soft', 1.5);
  pen.beginPath(); pen.moveTo(cx - half, below); pen.lineTo(cx + half, below);
  for (const end of [-half, half]) { pen.moveTo(cx + end, below - 3); pen.lineTo(cx + end, below + 3); }
  pen.stroke();
  pen.fillStyle = colour('soft');
  pen.textAlign = 'center';
  pen.fillText(`${quantity(long, 'm')}, magnified × ${short(Number((fit / scale).toPrecision(2)))}`, cx, below + 14);
  pen.textAlign = 'left';
}

export function beliefs(pen, seen, draw) {
  if (seen.ghost) draw(seen.ghost, 'ghost', 'dotted');
  if (seen.prior) draw(seen.prior, 'prior', 'dotted');
  if (seen.estimate) draw(seen.estimate, 'estimate', 'dashed');
}

// readings of two states as crosses, which fade
export function crosses(pen, scene, X, Y, a, b) {
  for (const [name, sensor] of Object.entries(scene.sensors)) {
    const i = sensor.names.indexOf(a), j = sensor.names.indexOf(b), row = last(`reading ${name}`);
    if (i < 0 || j < 0) continue;
    if (!row || performance.now() - data.arrived[name] > FRESH) continue;
    const x = X(row[1 + i]), y = Y(row[1 + j]);
    stroke(pen, 'reading', 2);
    pen.beginPath(); pen.moveTo(x - 6, y); pen.lineTo(x + 6, y); pen.moveTo(x, y - 6); pen.lineTo(x, y + 6); pen.stroke();
  }
}

// a scale along the left edge
export function upright(pen, Y, world, h) {
  pen.fillStyle = colour('soft');
  stroke(pen, 'soft', 1);
  const [, high] = world(0, 0), [, low] = world(0, h - 30);
  for (const [y, text] of labelled(low, high, 6, 'm')) {
    pen.beginPath(); pen.moveTo(0, Y(y)); pen.lineTo(6, Y(y)); pen.stroke();
    pen.fillText(text, 9, Y(y) + 4);
  }
}

// a scale along the lower edge
export function rule(pen, X, w, h, scale, centre = 0) {
  pen.fillStyle = colour('soft');
  stroke(pen, 'soft', 1);
  for (const [x, text] of labelled(centre - w / 2 / scale, centre + w / 2 / scale, 6, 'm')) {
    pen.beginPath(); pen.moveTo(X(x), h - 14); pen.lineTo(X(x), h - 20); pen.stroke();
    const half = pen.measureText(text).width / 2;
    if (X(x) > half && X(x) < w - half) pen.fillText(text, X(x) - half, h - 3);  // else it would be cut
  }
}
