// SPDX-License-Identifier: Apache-2.0
// The plots over time that a scene has, by name.

import { data, last } from './data.js';
import { limitLines } from './limits.js';
import { page } from './page.js';
import { short } from './pen.js';

const STEPS = 150;  // that a plot of single steps shows
const CHI = [3.84, 5.99, 7.81, 9.49, 11.07, 12.59];  // 95 % of a chi-square of 1 to 6

// Return [name, section, function that returns the plot] of each plot of a scene.
export function traces(scene) {
  const { state, input, sensors, rate } = scene, n = state.names.length, found = [];
  const add = (name, section, make) => found.push({ name, section, make });
  state.names.forEach((name, k) => add(`state ${name}`, 'states', () => ({
    title: `${name} [${state.units[k]}]`,
    bands: [{ rows: data.rows.estimate, low: (r) => r[1 + k] - 2 * r[1 + n + k], high: (r) => r[1 + k] + 2 * r[1 + n + k], look: 'band' }],
    marks: Object.entries(sensors).filter(([, s]) => s.names.includes(name)).map(([s, sensor]) => ({
      rows: data.rows[`reading ${s}`], value: (r) => r[1 + sensor.names.indexOf(name)], look: 'reading',
    })),
    curves: [
      { rows: data.rows.truth, value: (r) => r[1 + k], look: 'ink', width: 2, turns: state.angles.includes(name) },
      { rows: data.rows.ghost, value: (r) => r[1 + k], look: 'ghost', dash: 'dotted', width: 2, turns: state.angles.includes(name) },
      { rows: data.rows.estimate, value: (r) => r[1 + k], look: 'estimate', dash: 'dashed', turns: state.angles.includes(name) },
    ],
    lines: limitLines('state', name),
  })));
  input.names.forEach((name, k) => add(`input ${name}`, 'states', () => ({
    title: `input ${name} [${input.units[k]}]`, curves: [{ rows: data.rows.input, value: (r) => r[1 + k], look: 'input' }],
    lines: limitLines('input', name),
  })));
  for (const [s, sensor] of Object.entries(sensors)) {
    const m = sensor.names.length;
    sensor.names.forEach((name, k) => add(`innovation ${s} ${name}`, 'innovations', () => ({
      title: `innovation of ${s}: ${name} [${sensor.units[k]}], with ±2σ`,
      bands: [{ rows: data.rows[`innovation ${s}`], low: (r) => -2 * r[1 + m + k], high: (r) => 2 * r[1 + m + k], look: 'band' }],
      marks: [{ rows: data.rows[`innovation ${s}`], value: (r) => r[1 + k], look: 'ink', dot: true }],
    })));
    add(`NIS ${s}`, 'innovations', () => ({
      title: `NIS of ${s}: innovation² / S, mean ${m}, 95 % below dashes`,
      marks: [{ rows: data.rows[`innovation ${s}`], value: (r) => r[1 + 2 * m], look: 'ink', dot: true }],
      lines: [{ value: m, look: 'estimate' }, { value: CHI[m - 1] ?? m + 2.5 * Math.sqrt(2 * m), look: 'estimate', dash: 'dashed' }],
    }));
    add(`gain ${s}`, 'filter', () => ({
      title: `gain K of ${s}, each row in units of its largest`,
      rows: state.names.map((name, k) => ({ name: `${name} [${state.units[k]}]`, values: last(`gain ${s}`)?.slice(1 + k * m, 1 + (k + 1) * m) ?? [] })),
      columns: sensor.names.map((name, k) => `${name} [${sensor.units[k]}]`),
    }));
  }
  add('trace', 'filter', () => ({
    title: 'trace of P', log: true, share: Math.min(1, STEPS / (rate * data.span)),
    curves: [{ rows: data.rows.estimate, value: (r) => r[1 + 2 * n], look: 'estimate' }],
    marks: rate * data.span < 800 ? [{ rows: data.rows.estimate, value: (r) => r[1 + 2 * n], look: 'estimate', dot: true }] : [],
  }));
  if (input.names.length) add('cost', 'cost', () => ({
    title: `cost a second: recent ${short(last('cost')?.[2])}, mean ${short(last('cost')?.[1])}, least possible ${short(page.theory.optimum)} (dots)`,
    log: true,
    curves: [{ rows: data.rows.cost, value: (r) => r[2], look: 'input' }, { rows: data.rows.cost, value: (r) => r[1], look: 'ink', dash: 'dashed' }],
    lines: page.theory.optimum > 0 ? [{ value: page.theory.optimum, look: 'estimate' }] : [],
  }));
  return found;
}
