// SPDX-License-Identifier: Apache-2.0
// The poles in the complex plane, and the loop at an input: Bode and Nyquist with its margins.

import { data } from './data.js';
import { page } from './page.js';
import { colour, prepare, short, stroke, ticks } from './pen.js';
import { Newest, send } from './socket.js';

const GRAB = 16;   // pixels
const WIDE = 200;  // poles further apart than this factor are drawn on logarithmic axes

// Draws poles and lets a person drag those of the regulator and of a linear estimator; `moved`
// gets which of the two, and all poles of it.
export class PoleMap {
  constructor(canvas, moved) {
    this.canvas = canvas;
    this.moved = moved;
    this.theory = {};
    this.poles = { regulator: [], estimator: [] };
    this.draggable = [];
    this.held = null;
    canvas.addEventListener('pointerdown', (event) => this.grab(event));
    canvas.addEventListener('pointermove', (event) => this.drag(event));
    canvas.addEventListener('pointerup', () => this.release());
    canvas.addEventListener('pointercancel', () => { this.held = null; });
  }

  show(theory, linear) {
    this.theory = theory;
    this.draggable = linear ? ['regulator', 'estimator'] : ['regulator'];
    if (!this.held) {
      const copy = (poles) => (poles ?? []).map((pole) => [...pole]);
      this.poles = { regulator: copy(theory.regulator?.poles), estimator: copy(theory.estimator?.placed ?? theory.estimator?.poles) };
    }
    this.draw();
  }

  frame() {
    if (this.held) return;
    const all = [this.theory.open, this.poles.regulator, this.poles.estimator, this.theory.estimator?.poles].flatMap((poles) => poles ?? []);
    const sizes = all.map(([re, im]) => Math.hypot(re, im)).filter((size) => size > 1e-9);
    const reach = Math.max(1e-3, ...sizes), least = Math.min(...sizes, reach);
    this.inner = reach > WIDE * least ? 10 ** Math.floor(Math.log10(least)) : 0;
    const far = this.bend(reach);
    this.box = {
      left: -1.25 * far, right: Math.max(0.35 * far, 1.4 * Math.max(0, ...all.map(([re]) => this.bend(re)))), high: 1.2 * far,
    };
  }

  bend(value) {
    return this.inner ? Math.asinh(value / this.inner) : value;
  }

  straight(value) {
    return this.inner ? Math.sinh(value) * this.inner : value;
  }

  X(re) { return this.width * (this.bend(re) - this.box.left) / (this.box.right - this.box.left); }
  Y(im) { return this.height * (this.box.high - this.bend(im)) / (2 * this.box.high); }

  draw() {
    const area = prepare(this.canvas);
    if (!area) return;
    const { pen } = area;
    [this.width, this.height] = [area.width, area.height];
    this.frame();
    pen.fillStyle = colour('growth');
    pen.fillRect(this.X(0), 0, this.width, this.height);
    stroke(pen, 'line', 1);
    pen.fillStyle = colour('soft');
    const { left, right, high } = this.box;
    for (const v of ticks(left, right, 6)) {
      const x = this.width * (v - left) / (right - left);
      pen.beginPath(); pen.moveTo(x, 0); pen.lineTo(x, this.height); pen.stroke();
      pen.fillText(short(this.straight(v)), x + 2, this.height - 4);
    }
    for (const v of ticks(-high, high, 6)) {
      const y = this.height * (high - v) / (2 * high);
      pen.beginPath(); pen.moveTo(0, y); pen.lineTo(this.width, y); pen.stroke();
      if (Math.abs(v) > 1e-12) pen.fillText(short(this.straight(v)), 2, y - 2);
    }
    stroke(pen, 'soft', 1.4);
    pen.beginPath(); pen.moveTo(this.X(0), 0); pen.lineTo(this.X(0), this.height); pen.stroke();
    pen.textAlign = 'right';
    pen.fillText('grows', this.width - 4, 12);
    pen.textAlign = 'left';
    pen.fillText(`1/${data.each}, rad/${data.each}`, 4, 12);
    this.marks(pen, this.theory.open ?? [], 'ink', (x, y) => { pen.moveTo(x - 5, y - 5); pen.lineTo(x + 5, y + 5); pen.moveTo(x - 5, y + 5); pen.lineTo(x + 5, y - 5); });
    if (this.theory.estimator?.placed) this.marks(pen, this.theory.estimator.poles, 'estimate', (x, y) => { pen.moveTo(x, y - 8); pen.lineTo(x, y + 8); });
    this.marks(pen, this.poles.estimator, 'estimate', (x, y) => { pen.moveTo(x + 6, y); pen.arc(x, y, 6, 0, 7); });
    this.marks(pen, this.poles.regulator, 'input', (x, y) => pen.rect(x - 5, y - 5, 10, 10));
  }

  marks(pen, poles, look, shape) {
    stroke(pen, look, 2);
    pen.beginPath();
    for (const [re, im] of poles) shape(this.X(re), this.Y(im));
    pen.stroke();
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  grab(event) {
    const [x, y] = this.at(event);
    let best = GRAB;
    for (const of of this.draggable) {
      this.poles[of].forEach(([re, im], index) => {
        const distance = Math.hypot(this.X(re) - x, this.Y(im) - y);
        if (distance < best) {
          best = distance;
          this.held = { of, index, partner: im ? this.poles[of].findIndex(([a, b], k) => k !== index && a === re && b === -im) : -1 };
        }
      });
    }
    if (this.held) this.canvas.setPointerCapture(event.pointerId);
  }

  drag(event) {
    if (!this.held) return;
    const [x, y] = this.at(event), { left, right, high } = this.box, { of, index, partner } = this.held, poles = this.poles[of];
    const re = Math.min(this.straight(left + (right - left) * x / this.width), -1e-3);
    const im = this.straight(high - 2 * high * y / this.height);
    poles[index] = [re, partner < 0 ? 0 : im];
    if (partner >= 0) poles[partner] = [re, -im];
    this.draw();
    this.moved(of, poles);
  }

  release() {
    if (!this.held) return;
    const { of } = this.held;
    this.held = null;
    this.moved(of, this.poles[of]);
  }
}

const GAIN = 'plant/actuator_gain/0', NEAR = 10;  // pixels
const gain = new Newest(send);

// The curve of the gain with that of the simulated actuator, which is dragged up and down.
function gainHandle(canvas, pen, w, sizes, X, part) {
  if (!(GAIN in page.values)) return;
  const now = page.values[GAIN], shifted = sizes.map((size) => size + 20 * Math.log10(now));
  if (now !== 1) {
    curve(pen, w, shifted, X, part, 'input', 'dotted');
    pen.fillStyle = colour('input');
    pen.fillText(`× ${short(now)}: drag`, X(w[0]) + 6, Math.min(Math.max(part.Y(shifted[0]) - 5, part.top + 10), part.bottom));
  }
  const decibels = (part.high - part.low) / (part.bottom - part.top), { low, high } = page.scene.controls.find(({ key }) => key === GAIN);
  let begun = now;
  canvas.handles = [{
    hit: (x, y) => y < part.bottom + NEAR && w.some((each, k) => Math.hypot(X(each) - x, part.Y(shifted[k]) - y) < NEAR),
    begin: () => { begun = page.values[GAIN]; },
    move: (_, y, [, from]) => {
      const value = Math.min(Math.max(begun * 10 ** (decibels * (from - y) / 20), low), high);
      page.values[GAIN] = Number(value.toPrecision(3));
      page.dirty = true;
      gain.put({ do: 'set', key: GAIN, value: page.values[GAIN] });
    },
  }];
}

const LOOPS = [['known', 'ink', 'solid', 'states known'], ['estimated', 'estimate', 'dashed', 'with the estimate']];

export function marginText(loop) {
  return LOOPS.filter(([key]) => loop[key]).map(([key, , , name]) => {
    const m = loop[key].margins;
    if (!m) return `${name}: unstable`;
    const phase = m.lag[0] === null ? '–' : `${short(180 * m.lag[0] / Math.PI)}°`;
    const most = m.upper_gain[0] === null ? '∞' : short(m.upper_gain[0]);
    const late = m.delay[0] === null ? '–' : `${short(m.delay[0])} s`;
    return `${name}: gain ${short(m.lower_gain[0])} to ${most}, phase ${phase}, delay ${late}, disk ${short(m.disk)}`;
  }).join('. ');
}

export function drawBode(canvas, loop) {
  const area = prepare(canvas);
  if (!area || !loop) return;
  const { pen, width, height } = area;
  const left = 40, low = Math.log10(loop.w[0]), high = Math.log10(loop.w.at(-1));
  const X = (w) => left + (width - left - 6) * (Math.log10(w) - low) / (high - low);
  const half = height / 2;
  const size = { top: 14, bottom: half - 8, low: -40, high: 40, unit: 'dB' };
  const phase = { top: half + 14, bottom: height - 16, low: -270, high: 90, unit: '°' };
  for (const part of [size, phase]) {
    part.Y = (v) => part.bottom - (part.bottom - part.top) * (v - part.low) / (part.high - part.low);
    pen.fillStyle = colour('soft');
    pen.textAlign = 'right';
    for (let v = part.low; v <= part.high; v += part === size ? 20 : 90) {
      stroke(pen, v === 0 && part === size || v === -180 ? 'soft' : 'line', 1);
      pen.beginPath(); pen.moveTo(left, part.Y(v)); pen.lineTo(width - 6, part.Y(v)); pen.stroke();
      pen.fillText(`${v} ${part.unit}`, left - 3, part.Y(v) + 3);
    }
  }
  pen.textAlign = 'center';
  const unit = width - 6 - pen.measureText('rad/s').width;
  for (let k = Math.ceil(low); k <= high; k++) {
    const text = short(10 ** k), reach = pen.measureText(text).width / 2 + 4;
    if (X(10 ** k) + reach < unit) pen.fillText(text, X(10 ** k), height - 3);
  }
  pen.textAlign = 'left';
  pen.fillText('rad/s', unit, height - 3);
  canvas.handles = [];
  for (const [key, look, dash] of LOOPS) {
    const found = loop[key];
    if (!found) continue;
    let before = null;
    const angles = found.re.map((re, k) => {
      const angle = 180 * Math.atan2(found.im[k], re) / Math.PI;
      const value = angle + 360 * Math.round(((before ?? angle) - angle) / 360);
      before = value;
      return value;
    });
    // whole turns, such that the phase at the crossover is the margin above half a turn
    const lag = found.margins?.lag;
    if (lag && lag[1] !== null) {
      const k = nearest(loop.w, lag[1]);
      const shift = 360 * Math.round((180 * lag[0] / Math.PI - 180 - angles[k]) / 360);
      angles.forEach((_, i) => { angles[i] += shift; });
    }
    const sizes = found.re.map((re, k) => 20 * Math.log10(Math.hypot(re, found.im[k]) || 1e-12));
    curve(pen, loop.w, sizes, X, size, look, dash);
    if (key === (loop.estimated ? 'estimated' : 'known')) gainHandle(canvas, pen, loop.w, sizes, X, size);
    curve(pen, loop.w, angles, X, phase, look, dash);
    const m = found.margins;
    if (!m) continue;
    pen.fillStyle = colour(look);
    for (const [value, w] of [m.lower_gain, m.upper_gain]) {
      if (value === null || w === null || w < loop.w[0] || w > loop.w.at(-1) || !value) continue;
      bar(pen, X(w), size.Y(0), size.Y(-20 * Math.log10(value)), look, `×${short(value)}`);
    }
    if (lag && lag[1] !== null) bar(pen, X(lag[1]), phase.Y(-180), phase.Y(180 * lag[0] / Math.PI - 180), look, `${short(180 * lag[0] / Math.PI)}°`);
  }
}

const nearest = (list, value) => list.reduce((best, each, k) => (Math.abs(Math.log(each / value)) < Math.abs(Math.log(list[best] / value)) ? k : best), 0);

function curve(pen, w, values, X, part, look, dash) {
  pen.save();
  pen.beginPath(); pen.rect(0, part.top, 1e4, part.bottom - part.top); pen.clip();
  stroke(pen, look, 1.6, dash);
  pen.beginPath();
  values.forEach((value, k) => (k ? pen.lineTo(X(w[k]), part.Y(value)) : pen.moveTo(X(w[k]), part.Y(value))));
  pen.stroke();
  pen.restore();
}

function bar(pen, x, from, to, look, text) {
  stroke(pen, look, 4);
  pen.globalAlpha = 0.6;
  pen.beginPath(); pen.moveTo(x, from); pen.lineTo(x, to); pen.stroke();
  pen.globalAlpha = 1;
  pen.textAlign = look === 'ink' ? 'left' : 'right';
  pen.fillText(text, look === 'ink' ? x + 5 : x - 5, (from + to) / 2);
  pen.textAlign = 'left';
}

export function drawNyquist(canvas, loop) {
  const area = prepare(canvas);
  if (!area || !loop) return;
  const { pen, width, height } = area;
  const scale = Math.min(width, height) / 4.5, X = (re) => width * 0.62 + re * scale, Y = (im) => height / 2 - im * scale;
  stroke(pen, 'line', 1);
  pen.beginPath(); pen.moveTo(0, Y(0)); pen.lineTo(width, Y(0)); pen.moveTo(X(0), 0); pen.lineTo(X(0), height); pen.stroke();
  stroke(pen, 'soft', 1, 'dotted');
  pen.beginPath(); pen.arc(X(0), Y(0), scale, 0, 7); pen.stroke();
  for (const [key, look, dash] of LOOPS) {
    const found = loop[key];
    if (!found) continue;
    const alpha = found.margins?.disk ?? 2;
    if (alpha < 2) {
      const near = -(2 - alpha) / (2 + alpha), far = -(2 + alpha) / (2 - alpha);
      pen.fillStyle = colour(look);
      pen.globalAlpha = 0.1;
      pen.beginPath(); pen.arc(X((near + far) / 2), Y(0), scale * (near - far) / 2, 0, 7); pen.fill();
      pen.globalAlpha = 1;
    }
    for (const sign of [1, -1]) {
      stroke(pen, look, 1.6, dash);
      pen.beginPath();
      found.re.forEach((re, k) => (k ? pen.lineTo(X(re), Y(sign * found.im[k])) : pen.moveTo(X(re), Y(sign * found.im[k]))));
      pen.stroke();
    }
  }
  stroke(pen, 'bad', 2.4);
  pen.beginPath();
  pen.moveTo(X(-1) - 6, Y(0)); pen.lineTo(X(-1) + 6, Y(0)); pen.moveTo(X(-1), Y(0) - 6); pen.lineTo(X(-1), Y(0) + 6);
  pen.stroke();
  pen.fillStyle = colour('soft');
  pen.fillText('−1', X(-1) - 5, Y(0) + 18);
  pen.fillText('Nyquist: the disks stay free', 4, 12);
}
