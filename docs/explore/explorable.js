// SPDX-License-Identifier: Apache-2.0
// A picture with handles. A recipe describes it:
//   title, saying       what is seen, and what a reader can say afterwards
//   state               {key: [start, low, high]}: all that can be changed
//   choices, sliders    [{key, label, options}], [{key, label, text, log}]: controls of single numbers
//   actions             [{label, act(state, computed) => changes}]: buttons
//   panels              [{title, x: [low, high], y, across, up, equal, draw(plot, state, computed), handles}]
//   handles of a panel  [{label, at(state, computed) => [x, y] | null, move([x, y], state, computed) => changes, text}]
//   compute(state)      what the panels and the sentence have in common
//   sentence(state, computed)
import { arrow, colour, covarianceEllipse, labelled, prepare, short, stroke } from '../../kalman_ros/live/page/pen.js';

const element = (tag, properties = {}, ...children) => {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
};

const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
const MARGIN = { left: 44, right: 14, top: 26, bottom: 30 };
const SMALL_STEP = 0.01, LARGE_STEP = 0.1;  // of the range of an axis, by an arrow key
const TICKS = 200;  // of a slider
const PAUSE = 600;  // milliseconds without a change until a screen reader has the sentence

// A plane with axes on a canvas, whose unit is that of the quantities.
class Plot {
  constructor(pen, width, height, { x, y, across, up, equal, log = '' }) {
    this.pen = pen;
    this.named = [];
    this.box = { left: MARGIN.left, right: width - MARGIN.right, top: MARGIN.top, bottom: height - MARGIN.bottom };
    const { left, right, top, bottom } = this.box;
    this.x = x; this.y = y;
    if (equal) {
      const needed = Math.max((x[1] - x[0]) / (right - left), (y[1] - y[0]) / (bottom - top));
      const widen = ([low, high], pixels) => { const more = (needed * pixels - (high - low)) / 2; return [low - more, high + more]; };
      this.x = widen(x, right - left); this.y = widen(y, bottom - top);
    }
    const [sx, sy] = ['x', 'y'].map((axis) => (log.includes(axis) ? Math.log10 : (value) => value));
    const [x0, x1] = this.x.map(sx), [y0, y1] = this.y.map(sy);
    this.X = (value) => left + (right - left) * (sx(value) - x0) / (x1 - x0);
    this.Y = (value) => bottom - (bottom - top) * (sy(value) - y0) / (y1 - y0);
    const back = (axis, value) => (log.includes(axis) ? 10 ** value : value);
    this.place = (px, py) => [back('x', x0 + (x1 - x0) * (px - left) / (right - left)), back('y', y0 + (y1 - y0) * (bottom - py) / (bottom - top))];
    this.axes(across, up, log, [x0, x1], [y0, y1]);
  }

  axes(across, up, log, [x0, x1], [y0, y1]) {
    const { pen, X, Y, box: { left, right, top, bottom } } = this;
    const marks = (low, high, axis, count) => (log.includes(axis)
      ? labelled(Math.ceil(low), Math.floor(high), Math.max(1, Math.min(count, Math.floor(high) - Math.ceil(low))), '').filter(([v]) => Number.isInteger(v)).map(([v]) => [10 ** v, short(10 ** v)])
      : labelled(low, high, count, ''));
    pen.fillStyle = colour('soft');
    stroke(pen, 'line', 1);
    pen.textBaseline = 'top';
    for (const [value, text] of marks(x0, x1, 'x', Math.max(3, (right - left) / 70))) {
      pen.textAlign = X(value) < left + 8 ? 'left' : 'center';  // clear of the other axis
      pen.beginPath(); pen.moveTo(X(value), top); pen.lineTo(X(value), bottom); pen.stroke();
      pen.fillText(text.replace('-', '−'), X(value), bottom + 3);
    }
    pen.textAlign = 'right'; pen.textBaseline = 'middle';
    for (const [value, text] of marks(y0, y1, 'y', Math.max(3, (bottom - top) / 45))) {
      pen.beginPath(); pen.moveTo(left, Y(value)); pen.lineTo(right, Y(value)); pen.stroke();
      pen.fillText(text.replace('-', '−'), left - 4, Y(value));
    }
    pen.textBaseline = 'bottom';
    pen.fillText(across, right, bottom + 29);
    pen.textAlign = 'left';
    pen.fillText(up, 2, 14);
  }

  // what is drawn within the axes
  clipped(draw) {
    const { left, right, top, bottom } = this.box;
    this.pen.save();
    this.pen.beginPath(); this.pen.rect(left, top, right - left, bottom - top); this.pen.clip();
    draw();
    this.pen.restore();
  }

  curve(points, look, { width = 2, dash = 'solid', closed = false } = {}) {
    stroke(this.pen, look, width, dash);
    this.pen.beginPath();
    for (const [x, y] of points) this.pen.lineTo(clamp(this.X(x), -1e5, 1e5), clamp(this.Y(y), -1e5, 1e5));
    if (closed) this.pen.closePath();
    this.pen.stroke();
  }

  // a curve that stays at each value until the next
  stairs(points, look, options) {
    this.curve(points.flatMap(([x, y], k) => (k ? [[x, points[k - 1][1]], [x, y]] : [[x, y]])), look, options);
  }

  area(points, base, look) {
    this.pen.fillStyle = colour(look);
    this.pen.beginPath();
    for (const [x, y] of [[points[0][0], base], ...points, [points.at(-1)[0], base]]) this.pen.lineTo(this.X(x), clamp(this.Y(y), -1e5, 1e5));
    this.pen.fill();
  }

  // the area between two curves
  between(above, below, look) {
    this.pen.fillStyle = colour(look);
    this.pen.beginPath();
    for (const [x, y] of [...above, ...[...below].reverse()]) this.pen.lineTo(this.X(x), clamp(this.Y(y), -1e5, 1e5));
    this.pen.fill();
  }

  across(y, look, dash = 'dashed') { this.curve([[this.x[0], y], [this.x[1], y]], look, { width: 1.4, dash }); }
  upright(x, look, dash = 'dashed') { this.curve([[x, this.y[0]], [x, this.y[1]]], look, { width: 1.4, dash }); }

  point(x, y, look, size = 4) {
    this.pen.fillStyle = colour(look);
    this.pen.beginPath(); this.pen.arc(this.X(x), this.Y(y), size, 0, 7); this.pen.fill();
  }

  cross(x, y, look, size = 6, width = 2.5) {
    const [px, py] = [this.X(x), this.Y(y)];
    stroke(this.pen, look, width);
    this.pen.beginPath();
    for (const s of [1, -1]) { this.pen.moveTo(px - size, py - s * size); this.pen.lineTo(px + size, py + s * size); }
    this.pen.stroke();
  }

  arrow([x0, y0], [x1, y1], look) { arrow(this.pen, this.X(x0), this.Y(y0), this.X(x1) - this.X(x0), this.Y(y1) - this.Y(y0), look); }

  ellipse({ x, P }, look, { sigmas = 2, ...options } = {}) {
    covarianceEllipse(this.pen, this.X, this.Y, x, [P[0][0], P[0][1], P[1][1]], sigmas, { look, ...options });
  }

  text(x, y, words, look = 'ink', align = 'left') {
    this.pen.fillStyle = colour(look);
    this.pen.textAlign = align; this.pen.textBaseline = 'bottom';
    this.pen.fillText(words, this.X(x) + { left: 7, right: -7, center: 0 }[align], this.Y(y) - 5);
  }

  // what is drawn in which colour, for the line above the picture: [[words, look]]
  legend(entries) { this.named = entries; }
}

// What was moved, in the address of the page: it can be shared.
function addressed(name, state) {
  const parts = (new URLSearchParams(location.hash.slice(1)).get(name) ?? '').split(',');
  const values = parts.map((part) => (part.trim() ? Number(part) : NaN));
  return values.length === Object.keys(state).length && values.every(Number.isFinite) ? values : null;
}

// beside what is remembered of the other pictures of the page
function remember(name, values) {
  const parts = [...new URLSearchParams(location.hash.slice(1))].filter(([other, text]) => text && other !== name);
  history.replaceState(null, '', `#${[...parts, [name, values]].map((pair) => pair.join('=')).join('&')}`);
}

// powers of ten about positive numbers
export function decades(values, low = Infinity, high = 0) {
  const known = values.filter((value) => value > 0 && Number.isFinite(value));
  const ends = [Math.min(low, ...known), Math.max(high, ...known)].map((end) => Math.log10(end));
  return [10 ** Math.floor(ends[0] + 1e-9), 10 ** Math.ceil(ends[1] - 1e-9)];
}

export function mount(host, name, recipe) {
  const keys = Object.keys(recipe.state), start = Object.fromEntries(keys.map((key) => [key, recipe.state[key][0]]));
  const state = { ...start };
  let waiting = false, computed = null;

  const limits = (key) => recipe.state[key].slice(1);
  const change = (changes, remembered = true) => {
    for (const [key, value] of Object.entries(changes)) if (Number.isFinite(value)) state[key] = clamp(value, ...limits(key));
    recipe.repair?.(state);
    if (remembered) remember(name, keys.map((key) => Number(state[key].toPrecision(4))).join(','));
    if (!waiting) requestAnimationFrame(() => draw());
    waiting = true;
  };

  const controls = [];
  const bar = element('div', { className: 'explorable-controls' });
  for (const { key, label, options } of recipe.choices ?? []) {
    const group = element('span', { className: 'explorable-choice' });
    group.setAttribute('role', 'group');
    group.setAttribute('aria-label', label);
    options.forEach((option, k) => {
      const button = element('button', { type: 'button', textContent: option, onclick: () => change({ [key]: k }) });
      controls.push(() => button.setAttribute('aria-pressed', String(Math.round(state[key]) === k)));
      group.append(button);
    });
    bar.append(group);
  }
  for (const { key, label, text = short, log } of recipe.sliders ?? []) {
    const [to, from] = log ? [Math.log10, (value) => 10 ** value] : [(value) => value, (value) => value];
    const [low, high] = limits(key).map(to);
    const slider = element('input', { type: 'range', min: 0, max: TICKS, oninput: () => change({ [key]: from(low + (high - low) * slider.value / TICKS) }) });
    const shown = element('output');
    controls.push(() => {
      slider.value = Math.round(TICKS * (to(state[key]) - low) / (high - low));
      shown.textContent = text(state[key]);
      slider.setAttribute('aria-valuetext', text(state[key]));
    });
    bar.append(element('label', {}, `${label} `, slider, shown));
  }
  for (const { label, act } of recipe.actions ?? []) {
    const button = element('button', { type: 'button', textContent: label });
    // what would leave the limits is not done in part
    const fits = (changes) => Object.entries(changes).every(([key, value]) => value >= limits(key)[0] && value <= limits(key)[1]);
    button.onclick = () => { const changes = act(state, computed); if (fits(changes)) change(changes); };
    controls.push(() => { button.disabled = !fits(act(state, computed)); });
    bar.append(button);
  }
  bar.append(element('button', { type: 'button', textContent: 'reset', className: 'explorable-reset', onclick: () => change(start) }));

  const sentence = element('p', { className: 'explorable-sentence' }), spoken = element('p', { className: 'explorable-spoken' });
  spoken.setAttribute('role', 'status');
  let silence = 0;
  const stage = element('div', { className: 'explorable-panels' });
  const panels = recipe.panels.map((panel) => {
    const canvas = element('canvas'), frame = element('div', { className: 'explorable-frame' }, canvas);
    canvas.setAttribute('role', 'img');
    canvas.setAttribute('aria-label', `${panel.title}: ${panel.up} over ${panel.across}`);
    const legend = element('p', { className: 'explorable-legend' });
    const shown = { panel, canvas, legend, plot: null, handles: (panel.handles ?? []).map((handle) => grip(handle, () => shown, () => [state, computed], change)) };
    frame.append(...shown.handles.map((handle) => handle.element));
    stage.append(element('div', { className: 'explorable-panel' }, element('p', { textContent: panel.title }), legend, frame));
    frame.classList.toggle('equal', Boolean(panel.equal));
    return shown;
  });
  host.setAttribute('role', 'group');
  host.setAttribute('aria-label', recipe.title);
  host.replaceChildren(element('p', { className: 'explorable-title', textContent: recipe.title }), sentence, stage, bar,
    element('p', { className: 'explorable-saying', textContent: `You can say afterwards: ${recipe.saying}` }), spoken);

  function draw(always = false) {
    waiting = false;
    computed = recipe.compute?.(state);
    for (const shown of panels) {
      const area = prepare(shown.canvas, always), { panel } = shown;
      if (!area) continue;
      const range = (axis) => (typeof axis === 'function' ? axis(state, computed) : axis);
      shown.plot = new Plot(area.pen, area.width, area.height, { ...panel, x: range(panel.x), y: range(panel.y) });
      shown.plot.clipped(() => panel.draw(shown.plot, state, computed));
      explain(shown.legend, shown.plot.named);
      for (const handle of shown.handles) handle.show(shown.plot);
    }
    for (const control of controls) control();
    sentence.textContent = recipe.sentence(state, computed);
    clearTimeout(silence);
    silence = setTimeout(() => { spoken.textContent = sentence.textContent; }, PAUSE);
  }

  const fromAddress = () => {
    const values = addressed(name, recipe.state);
    if (!values) return;
    change(Object.fromEntries(keys.map((key, k) => [key, values[k]])), false);
    host.scrollIntoView({ block: 'center' });
  };
  addEventListener('hashchange', fromAddress);
  addEventListener('beforeprint', () => draw(true));
  fromAddress();
  draw(true);  // all of it, so that no legend moves the page later
  const again = () => change({}, false);
  new ResizeObserver(again).observe(stage);
  const seen = new IntersectionObserver(again);  // what is out of sight is not drawn
  panels.forEach(({ canvas }) => seen.observe(canvas));
  return again;
}

// The words of a legend in their colours, changed only where they are others.
function explain(legend, entries) {
  if (legend.dataset.shown === String(entries)) return;
  legend.dataset.shown = String(entries);
  legend.replaceChildren(...entries.map(([words, look]) => {
    const part = element('span', { textContent: words });
    part.style.color = `var(--${look})`;
    return part;
  }));
}

// A place that is dragged, by a pointer or with the arrow keys.
function grip({ label, at, move, text }, shown, current, change) {
  const handle = element('div', { className: 'explorable-handle', tabIndex: 0 });
  for (const [name, value] of Object.entries({ role: 'slider', 'aria-label': `${label}: arrow keys move it, with Shift in large steps`, 'aria-valuemin': 0, 'aria-valuemax': 100, 'data-name': label })) handle.setAttribute(name, value);
  let place = null, offset = null, pointer = null;  // where it is, and what drags it
  const pixels = () => [shown().plot.X(place[0]), shown().plot.Y(place[1])];
  handle.addEventListener('pointerdown', (event) => {
    if (event.button || !place) return;
    event.preventDefault();
    // of handles that overlap it is the nearest one
    const away = (each) => each.away(event.clientX, event.clientY);
    shown().handles.reduce((nearest, each) => (away(each) < away(nearest) ? each : nearest)).take(event);
  });
  handle.addEventListener('pointermove', (event) => {
    if (offset) change(move(shown().plot.place(event.clientX - offset[0], event.clientY - offset[1]), ...current(), false));
  });
  for (const end of ['pointerup', 'pointercancel']) handle.addEventListener(end, () => { offset = null; });
  handle.addEventListener('keydown', (event) => {
    const way = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!way || !place) return;
    event.preventDefault();
    const { plot } = shown(), { left, right, top, bottom } = plot.box, share = event.shiftKey ? LARGE_STEP : SMALL_STEP, [x, y] = pixels();
    change(move(plot.place(x + way[0] * share * (right - left), y + way[1] * share * (bottom - top)), ...current(), true));
  });
  return {
    element: handle,
    away(x, y) {
      const { left, right, top, bottom } = handle.getBoundingClientRect();
      return handle.hidden ? Infinity : Math.hypot(x - (left + right) / 2, y - (top + bottom) / 2);
    },
    take(event) {
      // from where it is, which may be beyond the picture
      const [x, y] = pixels();
      this.follow(event.pointerId, [event.clientX - x, event.clientY - y]);
    },
    follow(id, from) {
      handle.focus({ preventScroll: true });
      handle.setPointerCapture(id);
      [pointer, offset] = [id, from];
    },
    show(plot) {
      const focused = document.activeElement === handle;
      place = at(...current());
      handle.hidden = !place;
      if (!place) {
        const [first] = shown().handles;  // two poles have become a pair
        if (focused) first.element.focus({ preventScroll: true });
        if (offset) first.follow(pointer, offset);
        offset = null;
        return;
      }
      const { left, right, top, bottom } = plot.box, [x, y] = pixels();
      const [near, level] = [clamp(x, left, right), clamp(y, top, bottom)];
      Object.assign(handle.style, { left: `${near}px`, top: `${level}px` });
      handle.classList.toggle('beyond', near !== x || level !== y);
      handle.classList.toggle('late', near > right - 70);  // its name is to the left
      handle.setAttribute('aria-valuetext', text?.(...current()) ?? place.map((value) => short(value)).join(', '));
      handle.setAttribute('aria-valuenow', String(Math.round(100 * (near - left) / (right - left))));
    },
  };
}
