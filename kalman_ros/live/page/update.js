// SPDX-License-Identifier: Apache-2.0
// One step of the filter, magnified: the ellipse grows by the prediction, the reading comes with
// its own ellipse, and both multiply.

import { data, last } from './data.js';
import { ellipse, TWO_SIGMA } from './drawing.js';
import { page } from './page.js';
import { colour, prepare, short, stroke } from './pen.js';

const LASTS = 400;    // milliseconds of an animation
const ROOM = 1.4;     // of the largest ellipse
const FAR = 4;        // a reading is seen if it is at most this many ellipses away
const step = { phase: '', since: 0, before: null, prior: null, after: null, time: null };

// two coordinates of the state: those of a map, else those that are measured, else the first
function axes() {
  const { scene } = page, { names } = scene.state;
  const measured = names.filter((name) => Object.values(scene.sensors).some((sensor) => sensor.names.includes(name)));
  return [...new Set([...scene.path.names, ...measured, ...names])].slice(0, 2);
}

// the mean and covariance of two coordinates
function belief(x, P) {
  const { names } = page.scene.state, n = names.length, [a, b] = axes().map((name) => names.indexOf(name));
  if (b === undefined) return { mean: [x[a], 0], P: [P[a * n + a], 0, 0] };
  return { mean: [x[a], x[b]], P: [P[a * n + a], P[a * n + b], P[b * n + b]] };
}

// the sensor that measures one of the coordinates, most rarely; '' where none does
export function shownSensor() {
  const names = axes(), rate = (s) => page.values[`plant/${s}.rate`] ?? 0;
  const found = Object.entries(page.scene.sensors).filter(([, sensor]) => sensor.names.some((name) => names.includes(name)));
  return found.map(([s]) => s).sort((a, b) => rate(a) - rate(b))[0] ?? '';
}

const current = () => (last('estimate') && data.P ? belief(last('estimate').slice(1), data.P) : null);

// Notice the prediction of a step, and its update; called before a frame is added.
export function noticeStep(frame) {
  if (frame.prior?.x) Object.assign(step, { phase: 'predicted', since: performance.now(), before: current(), prior: belief(frame.prior.x, frame.prior.P), after: null });
  if (frame.estimate && step.phase === 'predicted') {
    const row = frame.estimate.at(-1);
    Object.assign(step, { phase: 'updated', since: performance.now(), after: belief(row.slice(1), frame.P), time: row[0] });
  } else if (frame.estimate && step.phase === 'updated') {
    // the step may take several frames
    if (!page.status.paused) step.phase = '';
    else Object.assign(step, { after: belief(frame.estimate.at(-1).slice(1), frame.P), time: frame.estimate.at(-1)[0] });
  }
}

export const isPredicted = () => step.phase === 'predicted';

// the readings of this step, as beliefs; a coordinate that is not measured has no variance
function readings() {
  const names = axes(), found = [];
  for (const [s, sensor] of Object.entries(page.scene.sensors)) {
    const row = last(`reading ${s}`), at = names.map((name) => sensor.names.indexOf(name));
    if (!row || Math.max(...at) < 0 || (step.phase === 'updated' && Math.abs(row[0] - step.time) > 1e-3)) continue;
    const std = (k) => page.values[`estimator/${s}.noise/${k}`] ?? page.values[`estimator/${s}.noise/0`] ?? null;
    found.push({ sensor: s, mean: at.map((k) => (k < 0 ? null : row[1 + k])), std: at.map((k) => (k < 0 ? null : std(k))), columns: at });
  }
  return found;
}

const mix = (a, b, share) => a.map((value, k) => value + share * (b[k] - value));

// Draw the step; return whether it still moves.
export function drawStep(canvas) {
  const area = prepare(canvas), names = axes();
  const now = step.phase ? (step.phase === 'predicted' ? step.prior : step.after) : current();
  if (!area || !now) return false;
  const { pen, width: w, height: h } = area, from = step.phase === 'predicted' ? step.before ?? now : step.phase ? step.prior : now;
  const share = step.phase ? Math.min(1, (performance.now() - step.since) / LASTS) : 1;
  const seen = step.phase === 'predicted' ? [] : readings();
  const view = fit([from, now], seen, w / h);
  const X = (x) => w / 2 + (x - view.centre[0]) / view.reach[0] * w / 2, Y = (y) => h / 2 - (y - view.centre[1]) / view.reach[1] * h / 2;
  cross(pen, w, h, names, view);
  const outline = ({ mean, P }, look, dash) => flat(pen, X, Y, mean, P, look, dash);
  if (step.phase === 'predicted' && step.before) outline(step.before, 'soft', 'dotted');
  if (step.phase === 'updated') outline(step.prior, 'prior', 'dotted');
  pen.globalAlpha = share;
  for (const reading of seen) band(pen, X, Y, w, h, reading);
  pen.globalAlpha = 1;
  const look = step.phase === 'predicted' ? 'prior' : 'estimate';
  outline({ mean: mix(from.mean, now.mean, share), P: mix(from.P, now.P, share) }, look, look === 'prior' ? 'dotted' : 'dashed');
  const row = last('truth'), truth = row && names.map((name) => row[1 + page.scene.state.names.indexOf(name)]);
  if (truth && step.phase !== 'predicted') { pen.fillStyle = colour('ink'); pen.beginPath(); pen.arc(X(truth[0]), Y(truth[1] ?? 0), 4, 0, 7); pen.fill(); }
  return share < 1;
}

// A view in which the ellipses, and as far as possible the readings, are seen. Each axis has its
// scale, unless both have the same unit.
function fit(beliefs, seen, aspect) {
  const centre = beliefs.at(-1).mean, variance = ({ P }, axis) => P[axis ? 2 : 0], { state } = page.scene;
  const reach = [0, 1].map((axis) => {
    const sizes = beliefs.map((each) => Math.abs(each.mean[axis] - centre[axis]) + TWO_SIGMA * Math.sqrt(Math.max(variance(each, axis), 0)));
    const most = Math.max(...sizes), far = seen.filter((each) => each.mean[axis] !== null)
      .map((each) => Math.abs(each.mean[axis] - centre[axis]) + TWO_SIGMA * each.std[axis] / ROOM);
    return ROOM * Math.max(most, Math.min(FAR * most, Math.max(0, ...far))) || 1;
  });
  const [a, b] = axes().map((name) => state.units[state.names.indexOf(name)]);
  if (a !== b) return { centre, reach };
  const scale = Math.max(reach[0] / aspect, reach[1]);
  return { centre, reach: [scale * aspect, scale] };
}

function flat(pen, X, Y, mean, P, look, dash) {
  // both scales differ: the ellipse is that of the scaled covariance
  const a = X(1) - X(0), b = Y(0) - Y(1), scaled = [P[0] * a * a, P[1] * a * b, P[2] * b * b];
  const place = { x: { a: X(mean[0]), b: -Y(mean[1]) }, P: (i, j) => scaled[(i === 'b') + (j === 'b')] };
  ellipse(pen, (x) => x, (y) => -y, place, 'a', 'b', look, dash);
}

// a reading of both coordinates is an ellipse, one of a single coordinate a band
function band(pen, X, Y, w, h, { mean, std }) {
  if (mean[0] !== null && mean[1] !== null && mean.length > 1) {
    flat(pen, X, Y, mean, [std[0] ** 2, 0, std[1] ** 2], 'reading', 'solid');
    return;
  }
  const upright = mean[0] !== null, place = upright ? X : Y, k = upright ? 0 : 1;
  stroke(pen, 'reading', 2);
  pen.beginPath();
  for (const shift of [-TWO_SIGMA, TWO_SIGMA]) {
    const at = place(mean[k] + shift * std[k]);
    if (upright) { pen.moveTo(at, 0); pen.lineTo(at, h); } else { pen.moveTo(0, at); pen.lineTo(w, at); }
  }
  pen.stroke();
}

function cross(pen, w, h, names, view) {
  const { state } = page.scene, unit = (name) => state.units[state.names.indexOf(name)];
  stroke(pen, 'line', 1);
  pen.beginPath(); pen.moveTo(0, h / 2); pen.lineTo(w, h / 2); pen.moveTo(w / 2, 0); pen.lineTo(w / 2, h); pen.stroke();
  pen.fillStyle = colour('soft');
  pen.textAlign = 'right';
  pen.fillText(`${names[0]}: ±${short(view.reach[0], 2)} ${unit(names[0])}`, w - 4, h / 2 - 4);
  pen.textAlign = 'left';
  if (names[1]) pen.fillText(`${names[1]}: ±${short(view.reach[1], 2)} ${unit(names[1])}`, w / 2 + 4, 11);
}

// a mean with as many digits as its standard deviation
function within(mean, std) {
  const digits = std > 0 ? Math.min(Math.max(1 - Math.floor(Math.log10(std)), 0), 8) : 3;
  return `${mean.toFixed(digits)} ± ${std.toFixed(digits)}`;
}

// what the step did to each coordinate, in numbers
export function stepNumbers() {
  const { state, sensors } = page.scene, names = axes();
  if (!step.phase) return [];
  return names.map((name, axis) => {
    const parts = [], at = (one) => within(one.mean[axis], Math.sqrt(Math.max(one.P[axis ? 2 : 0], 0)));
    parts.push(`${name}: predicted ${at(step.prior)}`);
    if (step.phase === 'updated') {
      for (const { sensor, mean, std: noise, columns } of readings()) {
        if (mean[axis] === null) continue;
        const row = last(`gain ${sensor}`), m = sensors[sensor].names.length;
        const K = row?.[1 + state.names.indexOf(name) * m + columns[axis]];
        parts.push(`read ${within(mean[axis], noise[axis])}, gain ${short(K, 2)}`);
      }
      parts.push(`updated ${at(step.after)} ${state.units[state.names.indexOf(name)]}`);
    }
    return parts.join('; ');
  });
}

// the standard deviations of the first coordinate before the step and as predicted, once it is updated; else null
export function stepSizes() {
  if (step.phase !== 'updated' || !step.before) return null;
  return [step.before, step.prior].map(({ P }) => Math.sqrt(Math.max(P[0], 0)));
}
