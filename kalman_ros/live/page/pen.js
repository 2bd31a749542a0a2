// SPDX-License-Identifier: Apache-2.0
// What every drawing on a canvas needs: colours, lines, arrows, numbers, scales.

const cache = new Map();

// a colour of the style sheet
export function colour(name) {
  if (!cache.has(name)) {
    cache.set(name, getComputedStyle(document.body).getPropertyValue(`--${name}`).trim());
  }
  return cache.get(name);
}

export const forgetColours = () => cache.clear();

// a context whose unit is a CSS pixel; null where the canvas is not to be seen, if it need not be drawn
export function prepare(canvas, always = false) {
  const box = canvas.getBoundingClientRect();
  if (!box.width || (!always && (box.bottom < 0 || box.top > innerHeight))) return null;
  const ratio = Math.min(devicePixelRatio || 1, 2);
  const width = Math.round(box.width * ratio), height = Math.round(box.height * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  const pen = canvas.getContext('2d');
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, box.width, box.height);
  pen.font = '11px system-ui, sans-serif';
  pen.lineJoin = 'round';
  return { pen, width: box.width, height: box.height };
}

export function short(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  if (size !== 0 && (size >= 1e5 || size < 1e-3)) return value.toExponential(1).replace('e+', 'e');
  return String(Number(value.toPrecision(digits)));
}

const DEGREE = Math.PI / 180;

// a length or another quantity with a unit that suits its size
export function quantity(value, unit) {
  if (unit === 'm' && Math.abs(value) < 0.01) return `${short(1e3 * value, 2)} mm`;
  if (unit === 'm' && Math.abs(value) < 0.95) return `${short(100 * value, 2)} cm`;
  if (unit === 'rad') return `${short(value / DEGREE, 2)}°`;
  return `${short(value, 2)} ${unit}`.trim();
}

// round numbers within an interval
export function ticks(low, high, count) {
  const rough = (high - low) / count;
  if (!(rough > 0)) return [low];
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
  const found = [];
  for (let k = Math.ceil(low / step); k * step <= high && found.length < 20; k++) found.push(k * step);
  return found.length > 1 || count > 20 ? found : ticks(low, high, 2 * count);  // one number is no scale
}

// as many digits as it takes to tell two neighbours apart
export function digitsOf(marked, log = false) {
  const step = marked[1] - marked[0] || 1, change = log ? 2.3 * step : step / Math.max(...marked.map(Math.abs));
  return Math.min(7, Math.max(3, Math.ceil(-Math.log10(change) + 1e-9) + 1));
}

// round numbers within an interval, each with its text
export function labelled(low, high, count, unit) {
  const marked = ticks(low, high, count), digits = digitsOf(marked);
  return marked.map((value) => [value, `${short(value, digits)} ${unit}`.trim()]);
}

const DASHES = { solid: [], dashed: [6, 4], dotted: [2, 3] };

export function stroke(pen, name, width = 1.5, dash = 'solid') {
  pen.strokeStyle = colour(name);
  pen.lineWidth = width;
  pen.setLineDash(DASHES[dash]);
}

export function arrow(pen, x, y, dx, dy, look = 'input') {
  const size = Math.hypot(dx, dy);
  if (size < 2) return;
  stroke(pen, look, 3);
  pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + dx, y + dy); pen.stroke();
  const a = Math.atan2(dy, dx), h = Math.min(10, size);
  pen.fillStyle = colour(look);
  pen.beginPath();
  pen.moveTo(x + dx, y + dy);
  for (const s of [2.6, -2.6]) pen.lineTo(x + dx + h * Math.cos(a + s), y + dy + h * Math.sin(a + s));
  pen.fill();
}

// the ellipse of `sigmas` standard deviations about a mean, of the covariance [[p, q], [q, r]]
export function covarianceEllipse(pen, X, Y, [mx, my], [p, q, r], sigmas, { look, dash = 'solid', filled = false }) {
  const middle = (p + r) / 2, off = Math.hypot((p - r) / 2, q), turn = 0.5 * Math.atan2(2 * q, p - r);
  const long = sigmas * Math.sqrt(Math.max(0, middle + off)), wide = sigmas * Math.sqrt(Math.max(0, middle - off));
  const far = (pixels) => Math.max(-1e5, Math.min(1e5, pixels));
  pen.beginPath();
  for (let k = 0; k <= 72; k++) {
    const a = long * Math.cos(k * Math.PI / 36), b = wide * Math.sin(k * Math.PI / 36);
    pen.lineTo(far(X(mx + a * Math.cos(turn) - b * Math.sin(turn))), far(Y(my + a * Math.sin(turn) + b * Math.cos(turn))));
  }
  if (filled) { pen.fillStyle = colour('band'); pen.fill(); }
  stroke(pen, look, 2, dash);
  pen.stroke();
  pen.beginPath(); pen.arc(X(mx), Y(my), 2.5, 0, 7); pen.fillStyle = colour(look); pen.fill();
}
