// SPDX-License-Identifier: Apache-2.0
// Curves over time on a canvas.

import { data } from './data.js';
import { page } from './page.js';
import { colour, digitsOf, labelled, prepare, short, stroke, ticks } from './pen.js';

const FAR = 3;  // a line with a grip is within the plot if it is at most this many ranges away

const LEAST_SPAN = 0.1;  // of the span, after a reset
const FIRST = 0.5, ENOUGH = 15;

// without the start of a run, which is far off, if enough of it is left
function settled(rows) {
  const later = rows.filter((row) => row[0] > data.began + FIRST);
  return later.length > ENOUGH ? later : rows;
}

// Draw one plot, of the last `share` of the span. `curves` have rows, a value (row) => number, and a look; a `band` has low and high.
// A line with a `grip` is dragged, a limit on one `side`, whose value is null where there is none:
// the grip returns its handle for where it is hit and the value of a place.
// With `columns`, it is a heat map of the numbers of `rows`.
export function plot(canvas, { title, rows, columns, curves = [], bands = [], marks = [], lines = [], log = false, share = 1 }) {
  if (columns) { heatMap(canvas, title, rows, columns); return; }
  const area = prepare(canvas);
  if (!area) return;
  const { pen, width, height } = area;
  const left = 52, right = width - 6, top = 15, bottom = height - 14;
  const end = data.now, start = Math.max(0, end - share * data.span, Math.min(data.began, end - LEAST_SPAN * data.span));
  const scale = log ? (v) => (v > 0 ? Math.log10(v) : NaN) : (v) => v;
  const recent = (rows) => (rows ?? []).filter((row) => row[0] >= start);
  let low = Infinity, high = -Infinity;
  const extend = (value) => {
    if (value === null || !Number.isFinite(value)) return;
    low = Math.min(low, value);
    high = Math.max(high, value);
  };
  const shown = curves.map((curve) => ({ ...curve, points: recent(curve.rows).map((row) => [row[0], scale(curve.value(row))]) }));
  const filled = bands.map((band) => ({ ...band, points: recent(band.rows).map((row) => [row[0], scale(band.low(row)), scale(band.high(row))]) }));
  for (const { points } of shown) for (const [, y] of points) extend(y);
  for (const { points } of filled) {
    // a band that is much wider than the curves, as at the start, is cut
    const widths = points.map(([, a, b]) => b - a).sort((a, b) => a - b);
    const usual = widths[Math.floor(widths.length / 2)] ?? 0;
    for (const [, a, b] of points) if (b - a <= 4 * usual) { extend(a); extend(b); }
  }
  for (const { rows, value, dot } of marks) if (dot) for (const row of settled(recent(rows))) extend(scale(value(row)));
  for (const line of lines) if (!line.grip) extend(scale(line.value));
  const spread = high > low ? high - low : Infinity;
  const near = lines.filter(({ grip, value }) => grip && value !== null && Math.abs(value - (low + high) / 2) <= FAR * spread);
  for (const line of near) extend(line.value);
  if (!(high > low)) { const middle = Number.isFinite(low) ? low : 0; low = middle - 0.5; high = middle + 0.5; }
  const pad = 0.06 * (high - low);
  low -= pad; high += pad;
  if (canvas.held) [low, high] = canvas.range;  // it does not change under the hand
  canvas.range = [low, high];
  const X = (t) => left + (right - left) * (t - start) / (end - start || 1);
  const Y = (v) => bottom - (bottom - top) * (v - low) / (high - low);
  pen.fillStyle = colour('soft');
  pen.textBaseline = 'middle';
  pen.textAlign = 'right';
  stroke(pen, 'line', 1);
  const marked = ticks(low, high, 4);
  const digits = digitsOf(marked, log);
  for (const v of marked) {
    pen.beginPath(); pen.moveTo(left, Y(v)); pen.lineTo(right, Y(v)); pen.stroke();
    pen.fillText(short(log ? 10 ** v : v, digits), left - 4, Y(v));
  }
  pen.textAlign = 'center';
  pen.textBaseline = 'top';
  for (const [t, text] of labelled(start, end, Math.max(2, width / 110), data.unit)) if (X(t) > left + 8 && X(t) < right - 14) pen.fillText(text, X(t), bottom + 3);
  pen.save();
  pen.beginPath(); pen.rect(left, top - 2, right - left, bottom - top + 4); pen.clip();
  for (const { points, look } of filled) {
    pen.fillStyle = colour(look);
    pen.beginPath();
    points.forEach(([t, a], k) => (k ? pen.lineTo(X(t), Y(a)) : pen.moveTo(X(t), Y(a))));
    [...points].reverse().forEach(([t, , b]) => pen.lineTo(X(t), Y(b)));
    pen.fill();
  }
  for (const { rows, value, look, dot } of marks) {
    stroke(pen, look, 1.2);
    pen.beginPath();
    const seen = recent(rows), size = Math.max(0.8, Math.min(dot ? 1.8 : 2.5, 900 / (seen.length + 1)));
    for (const row of seen) {
      const x = X(row[0]), y = Y(scale(value(row)));
      if (!Number.isFinite(y)) continue;
      if (dot) { pen.moveTo(x + size, y); pen.arc(x, y, size, 0, 7); }
      else { pen.moveTo(x - size, y); pen.lineTo(x + size, y); pen.moveTo(x, y - size); pen.lineTo(x, y + size); }
    }
    pen.stroke();
  }
  for (const { value, look, dash, grip } of lines) {
    if (grip) continue;
    stroke(pen, look, 1.2, dash ?? 'dotted');
    pen.beginPath(); pen.moveTo(left, Y(scale(value))); pen.lineTo(right, Y(scale(value))); pen.stroke();
  }
  for (const { points, look, dash, width: wide, turns } of shown) {
    stroke(pen, look, wide ?? 1.5, dash);
    pen.beginPath();
    let before = null;
    for (const [t, y] of points) {
      if (y === null || !Number.isFinite(y)) { before = null; continue; }
      // no stroke across the wrap of an angle
      if (before === null || (turns && Math.abs(y - before) > Math.PI)) pen.moveTo(X(t), Y(y));
      else pen.lineTo(X(t), Y(y));
      before = y;
    }
    pen.stroke();
  }
  for (const { short: name, time } of page.acts) if (time > start) {
    stroke(pen, 'path', 1.2, 'dotted');
    pen.beginPath(); pen.moveTo(X(time), top); pen.lineTo(X(time), bottom); pen.stroke();
    pen.fillStyle = colour('path');
    const isLate = X(time) > right - 60;
    pen.textAlign = isLate ? 'right' : 'left';
    pen.textBaseline = 'top';
    pen.fillText(name, X(time) + (isLate ? -3 : 3), top);
  }
  pen.restore();
  canvas.handles = lines.filter((line) => line.grip).map((line) => {
    const y = gripOf(pen, line, left, right, top, bottom, Y);
    const hit = (px, py) => Math.abs(py - y) < (px > right - 70 ? 14 : 6) && px > left;
    return line.grip(hit, (_, py) => low + (high - low) * (bottom - py) / (bottom - top));
  });
  pen.setLineDash([]);
  pen.fillStyle = colour('ink');
  pen.textAlign = 'left';
  pen.textBaseline = 'top';
  pen.fillText(title, left, 1);
}

const HEAT_ROW = 20;  // pixels

// Draw a matrix with its names: a cell is as dark as its size beside the largest of its row, since
// rows have other units; its number and its sign are written.
function heatMap(canvas, title, rows, columns) {
  canvas.style.height = `${HEAT_ROW * (rows.length + 1) + 18}px`;
  const area = prepare(canvas);
  if (!area) return;
  const { pen, width } = area, left = 110, top = 18 + HEAT_ROW, wide = (width - left) / columns.length;
  canvas.setAttribute('aria-label', `${title}: ${rows.map(({ name, values }) => `${name} ${values.map((value) => short(value)).join(', ')}`).join('; ')}`);
  pen.textBaseline = 'middle';
  pen.fillStyle = colour('ink');
  pen.textAlign = 'left';
  pen.fillText(title, 0, 8);
  pen.fillStyle = colour('soft');
  pen.textAlign = 'center';
  columns.forEach((name, j) => pen.fillText(name, left + (j + 0.5) * wide, top - HEAT_ROW / 2, wide - 4));
  rows.forEach(({ name, values }, i) => {
    const most = Math.max(...values.map((value) => Math.abs(value ?? 0)), 1e-300), y = top + i * HEAT_ROW;
    pen.textAlign = 'right';
    pen.fillStyle = colour('soft');
    pen.fillText(name, left - 6, y + HEAT_ROW / 2, left - 8);
    pen.textAlign = 'center';
    values.forEach((value, j) => {
      pen.globalAlpha = 0.45 * Math.abs(value ?? 0) / most;
      pen.fillStyle = colour(value < 0 ? 'input' : 'estimate');
      pen.fillRect(left + j * wide + 1, y + 1, wide - 2, HEAT_ROW - 2);
      pen.globalAlpha = 1;
      pen.fillStyle = colour('ink');
      pen.fillText(short(value, 2).replace('-', '−'), left + (j + 0.5) * wide, y + HEAT_ROW / 2, wide - 4);
    });
  });
}

// Draw a line with its grip, at the edge of the plot where it is beyond; return its height.
function gripOf(pen, { value, look, dash, side }, left, right, top, bottom, Y) {
  const free = value === null, up = side === 'high';
  const y = free ? (up ? top : bottom) : Math.min(Math.max(Y(value), top), bottom), beyond = !free && Math.abs(Y(value) - y) > 1;
  stroke(pen, look, 1.6, free || beyond ? 'dotted' : dash);
  pen.globalAlpha = free ? 0.35 : 1;
  pen.beginPath(); pen.moveTo(left, y); pen.lineTo(right, y); pen.stroke();
  pen.globalAlpha = 1;
  const text = free ? 'no limit' : `${beyond ? (up ? '↑ ' : '↓ ') : ''}${short(value)}`, width = pen.measureText(text).width + 10;
  pen.setLineDash([]);
  pen.fillStyle = colour(free ? 'panel' : look);
  pen.fillRect(right - width, y - 7, width, 14);
  stroke(pen, look, 1);
  pen.strokeRect(right - width, y - 7, width, 14);
  pen.fillStyle = colour(free ? 'soft' : 'paper');
  pen.textAlign = 'center';
  pen.textBaseline = 'middle';
  pen.fillText(text, right - width / 2, y);
  return y;
}
