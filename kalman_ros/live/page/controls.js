// SPDX-License-Identifier: Apache-2.0
// Sliders and switches: at most one command of each is under way.

import { element } from './page.js';
import { short } from './pen.js';
import { Newest } from './socket.js';

const STEPS = 400;

export class Controls {
  constructor(place, send) {
    this.place = place;
    this.send = send;
    this.items = new Map();
    this.values = {};
  }

  // all controls, folded by their groups
  build(controls) {
    this.clear();
    const groups = new Map();
    for (const control of controls) {
      if (!groups.has(control.group)) {
        const group = element('details', {}, element('summary', { textContent: control.group }));
        groups.set(control.group, group);
        this.place.append(group);
      }
      groups.get(control.group).append(this.row(control));
    }
  }

  // a few controls, each with the name of its group
  list(controls) {
    this.clear();
    for (const control of controls) this.place.append(this.row(control, `${control.group}: `));
    this.show(this.values);
  }

  clear() {
    this.place.replaceChildren();
    this.items.clear();
  }

  row(control, before = '') {
    const row = element('div', { className: `control ${control.role}`, title: control.about });
    const unit = control.unit ? ` [${control.unit}]` : '';
    const title = element('span', {}, element('span', { className: 'group', textContent: before }), `${control.title}${unit}`);
    row.append(title, element('span', { className: 'role', textContent: control.role }));
    row.dataset.key = control.key;
    row.append(...(control.low === null ? this.toggle(control) : this.slider(control)));
    return row;
  }

  toggle(control) {
    const box = element('input', { type: 'checkbox' });
    box.setAttribute('aria-label', `${control.group}: ${control.title}`);
    box.addEventListener('change', () => this.send({ do: 'set', key: control.key, value: box.checked }));
    this.items.set(control.key, { control, show: (value) => { box.checked = value; } });
    return [box];
  }

  slider(control) {
    const { low, high, scale } = control, log = scale === 'log';
    const range = element('input', { type: 'range', min: 0, max: STEPS, step: 1 });
    const number = element('input', { type: 'number', step: 'any' });
    const name = `${control.group}: ${control.title} ${control.role}`.trim();
    range.setAttribute('aria-label', name);
    number.setAttribute('aria-label', `${name}, number`);
    const place = (value) => STEPS * (log ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
    const value = () => {
      const share = range.value / STEPS;
      return Number((log ? low * (high / low) ** share : low + (high - low) * share).toPrecision(3));
    };
    const newest = new Newest(this.send), item = { control, place, held: false };
    const change = (wanted) => newest.put({ do: 'set', key: control.key, value: wanted }, () => {
      if (control.key in this.values) item.show(this.values[control.key]);
    });
    range.addEventListener('input', () => {
      item.held = true;
      number.value = value();
      range.setAttribute('aria-valuetext', `${value()} ${control.unit}`);
      change(value());
    });
    range.addEventListener('change', () => { item.held = false; });
    number.addEventListener('change', () => { if (number.value !== '') change(Number(number.value)); });
    item.show = (current) => {
      if (item.held || newest.busy || document.activeElement === number) return;
      range.value = place(current);
      number.value = Number(current.toPrecision(4));
      range.setAttribute('aria-valuetext', `${short(current)} ${control.unit}`);
    };
    item.ticks = element('span', { className: 'track' }, range);
    this.items.set(control.key, item);
    return [item.ticks, number];
  }

  show(values) {
    this.values = values;
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
      const tick = element('i', { className: 'tick', title: `unstable beyond ${short(value)}` });
      tick.style.left = `calc(${100 * share}% + ${8 - 16 * share}px)`;
      item.ticks.append(tick);
    }
  }
}
