// SPDX-License-Identifier: Apache-2.0
// Sliders and switches: at most one command of each is under way.

import { short } from './plots.js';

const STEPS = 400;
const OPEN = /^(Sensor|Cost|Plant input)/;

export class Controls {
  constructor(place, send) {
    this.place = place;
    this.send = send;
    this.items = new Map();
  }

  build(scene) {
    this.place.replaceChildren();
    this.items.clear();
    const groups = new Map();
    for (const control of scene.controls) {
      if (!groups.has(control.group)) {
        const group = document.createElement('details');
        group.open = OPEN.test(control.group) && innerWidth > 700;
        group.append(Object.assign(document.createElement('summary'), { textContent: control.group }));
        groups.set(control.group, group);
        this.place.append(group);
      }
      groups.get(control.group).append(control.low === null ? this.toggle(control) : this.slider(control));
    }
  }

  row(control) {
    const row = Object.assign(document.createElement('div'), { className: `control ${control.role}`, title: control.about });
    const unit = control.unit ? ` [${control.unit}]` : '';
    const title = Object.assign(document.createElement('span'), { textContent: `${control.title}${unit}` });
    row.append(title, Object.assign(document.createElement('span'), { className: 'role', textContent: control.role }));
    row.dataset.key = control.key;
    return row;
  }

  toggle(control) {
    const row = this.row(control);
    const box = Object.assign(document.createElement('input'), { type: 'checkbox' });
    box.setAttribute('aria-label', `${control.group}: ${control.title}`);
    box.addEventListener('change', () => this.send({ do: 'set', key: control.key, value: box.checked }));
    row.append(box);
    this.items.set(control.key, { control, show: (value) => { box.checked = value; } });
    return row;
  }

  slider(control) {
    const { low, high, scale } = control, log = scale === 'log';
    const range = Object.assign(document.createElement('input'), { type: 'range', min: 0, max: STEPS, step: 1 });
    const number = Object.assign(document.createElement('input'), { type: 'number', step: 'any' });
    const name = `${control.group}: ${control.title} ${control.role}`.trim();
    range.setAttribute('aria-label', name);
    number.setAttribute('aria-label', `${name}, number`);
    const place = (value) => STEPS * (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    const value = () => {
      const share = range.value / STEPS;
      return Number((log ? low * (high / low) ** share : low + (high - low) * share).toPrecision(3));
    };
    const item = { control, place, busy: false, next: null, held: false };
    const change = (wanted) => {
      if (item.busy) { item.next = wanted; return; }
      item.busy = true;
      this.send({ do: 'set', key: control.key, value: wanted }, () => {
        item.busy = false;
        if (item.next !== null) { const next = item.next; item.next = null; change(next); }
      });
    };
    range.addEventListener('input', () => {
      item.held = true;
      number.value = value();
      range.setAttribute('aria-valuetext', `${value()} ${control.unit}`);
      change(value());
    });
    range.addEventListener('change', () => { item.held = false; });
    number.addEventListener('change', () => { if (number.value !== '') change(Number(number.value)); });
    item.show = (current) => {
      if (item.held || item.busy || document.activeElement === number) return;
      range.value = place(current);
      number.value = Number(current.toPrecision(4));
      range.setAttribute('aria-valuetext', `${short(current)} ${control.unit}`);
    };
    item.ticks = Object.assign(document.createElement('span'), { className: 'track' });
    item.ticks.append(range);
    this.items.set(control.key, item);
    const row = this.row(control);
    row.append(item.ticks, number);
    return row;
  }

  show(values) {
    for (const [key, value] of Object.entries(values)) this.items.get(key)?.show(value);
  }

  // where the theory says that the loop becomes unstable
  mark(key, values) {
    const item = this.items.get(key);
    if (!item) return;
    item.ticks.querySelectorAll('.tick').forEach((tick) => tick.remove());
    for (const value of values) {
      const share = item.place(value) / STEPS;
      if (!(share > 0 && share < 1)) continue;
      const tick = Object.assign(document.createElement('i'), { className: 'tick', title: `unstable beyond ${short(value)}` });
      tick.style.left = `calc(${100 * share}% + ${8 - 16 * share}px)`;
      item.ticks.append(tick);
    }
  }
}
