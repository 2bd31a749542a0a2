// SPDX-License-Identifier: Apache-2.0
import { complex, roots } from './numbers.js';
import { number } from './poles.js';

const END = 6;
const poles = (speed, late) => (late ? roots([1, -1, speed]) : [[1 - speed, 0]]);
const size = (speed, late) => Math.max(...poles(speed, late).map(complex.size));

export const sampling = {
  title: 'A sampled loop is at most as fast as one sample',
  saying: 'a pole z is what one sample leaves; p dt = 1 is gone in one sample and nothing is faster, p dt = 2 is unstable, and a delay of one sample halves what can be asked.',
  state: { speed: [0.6, 0.02, 2.4], dt: [0.5, 0.1, 1], late: [0, 0, 1] },
  choices: [{ key: 'late', label: 'when the input acts', options: ['acts at once', 'one sample late'] }],
  sliders: [{ key: 'dt', label: 'sample', text: (value) => `${number(value, 2)} s` }],
  compute({ speed, dt, late }) {
    const rows = [[0, 1]];
    let x = 1, before = 0;
    for (let k = 1; k * dt <= END; k++) {
      const u = -speed / dt * x;
      x += dt * (Math.round(late) ? before : u);
      before = u;
      rows.push([k * dt, x]);
    }
    // what is left in the long run
    let [now, last, settled] = [1, 0, 0];
    for (let k = 1; k <= 2000; k++) {
      [now, last] = [now - speed * (Math.round(late) ? last : now), now];
      if (Math.abs(now) >= 0.01) settled = k;
    }
    return { z: poles(speed, Math.round(late)), rows, settled: settled + 1 };
  },
  panels: [
    {
      title: 'poles of the sampled loop', x: [-1.6, 1.6], y: [-1.6, 1.6], equal: true, across: 'real part of z', up: 'imaginary part',
      draw(plot, state, { z }) {
        const circle = Array.from({ length: 91 }, (_, k) => complex.turn(k * Math.PI / 45));
        plot.curve(circle, 'soft', { width: 1.5 });
        plot.curve([[-2, 0], [2, 0]], 'line', { width: 1 });
        for (const [re, im] of z) plot.cross(re, im, complex.size([re, im]) < 1 ? 'estimate' : 'bad');
        plot.point(0, 0, 'soft', 3);
        plot.legend([['inside: it decays', 'soft']]);
      },
    },
    {
      title: 'what is left, released at 1', x: [0, END], y: [-1.6, 1.6], across: 't in s', up: 'x',
      draw(plot, { speed, dt }, { rows }) {
        plot.across(0, 'soft', 'solid');
        plot.curve(Array.from({ length: 121 }, (_, k) => [END * k / 120, Math.exp(-speed / dt * END * k / 120)]), 'prior', { dash: 'dotted' });
        plot.curve(rows, 'estimate', { width: 2 });
        for (const [t, x] of rows) plot.point(t, x, 'estimate', 3.5);
        plot.legend([['sampled', 'estimate'], ['continuous, exp(−p t)', 'prior']]);
      },
    },
    {
      title: 'what one sample leaves', x: [0, 2.4], y: [0, 2], across: 'p dt', up: '|z|',
      handles: [{ label: 'gain p dt', at: ({ speed, late }) => [speed, size(speed, Math.round(late))], move: ([speed]) => ({ speed }), text: ({ speed }) => `p dt ${number(speed)}` }],
      draw(plot, { speed, late }) {
        const speeds = Array.from({ length: 241 }, (_, k) => 0.01 * k);
        plot.curve(speeds.map((each) => [each, Math.exp(-each)]), 'prior', { dash: 'dotted' });
        for (const k of [0, 1]) plot.curve(speeds.map((each) => [each, size(each, k)]), k ? 'input' : 'estimate', { width: k === Math.round(late) ? 2.5 : 1.2 });
        plot.across(1, 'bad');
        plot.point(speed, size(speed, Math.round(late)), Math.round(late) ? 'input' : 'estimate', 6);
        plot.legend([['acts at once', 'estimate'], ['one sample late', 'input'], ['continuous', 'prior']]);
      },
    },
  ],
  sentence({ speed, dt, late }, { z, settled }) {
    const most = Math.max(...z.map(complex.size));
    const poles_ = z.map(([re, im]) => `${number(re)}${im ? ` ${im < 0 ? '−' : '+'} ${number(Math.abs(im))}j` : ''}`).join(' and ');
    const end = most >= 1 ? 'it never settles' : most < 1e-9 ? 'all is gone after one sample' : `less than 1 % is left after ${settled} sample${settled > 1 ? 's' : ''}, ${number(settled * dt)} s`;
    return `p dt = ${number(speed)}, ${Math.round(late) ? 'one sample late' : 'at once'}: z = ${poles_}, so ${end}. The continuous pole would be ${number(-speed / dt)} per second.`;
  },
};
