// SPDX-License-Identifier: Apache-2.0
import { number } from './poles.js';

const END = 6;  // seconds

export const eigenvalue = {
  title: 'One number decides whether it dies out',
  saying: 'the sign of a says whether x decays, stays or grows, and 1/|a| is the time in which it changes by a factor of e.',
  state: { a: [-0.7, -3, 0.8], start: [1, -2, 2] },
  panels: [
    {
      title: 'x(t) = exp(a t) x(0)', x: [-0.4, END], y: [-2.2, 2.2], across: 't in s', up: 'x',
      handles: [
        { label: 'where it starts', at: (state) => [0, state.start], move: ([, x]) => ({ start: x }) },
        {
          label: 'its value after one second', at: ({ a, start }) => [1, start * Math.exp(a)],
          move: ([, x], { start }) => (x / start > 0 ? { a: Math.log(x / start) } : {}),
        },
      ],
      draw(plot, { a, start }) {
        const times = Array.from({ length: 201 }, (_, k) => END * k / 200), constant = a ? 1 / Math.abs(a) : Infinity;
        plot.across(0, 'soft', 'solid');
        plot.curve([[0, start], [constant, start * (a < 0 ? 0 : a ? 2 : 1)]], 'prior', { width: 1.4, dash: 'dotted' });
        plot.curve(times.map((t) => [t, start * Math.exp(a * t)]), 'estimate', { width: 2.5 });
        if (constant < END) {
          plot.upright(constant, 'soft', 'dotted');
          plot.point(constant, start * Math.exp(a * constant), 'input', 5);
        }
        plot.legend([['the motion', 'estimate'], ['its first slope, a x(0)', 'prior'], ['after 1/|a|', 'input']]);
      },
    },
    {
      title: 'the same, on a logarithmic axis', x: [0, END], y: [0.01, 100], log: 'y', across: 't in s', up: '|x / x(0)|',
      draw(plot, { a }) {
        plot.curve([[0, 1], [END, Math.exp(a * END)]], 'estimate', { width: 2.5 });
        plot.across(Math.exp(-1), 'soft', 'dotted');
        plot.legend([['a straight line with slope a', 'estimate'], ['37 % are left', 'soft']]);
      },
    },
  ],
  sentence({ a, start }) {
    const rate = number(a);
    if (Math.abs(start) < 0.005) return 'It starts at 0, and stays there: drag the start.';
    if (Math.abs(a) < 0.005) return 'a = 0: nothing changes, what was there stays.';
    if (a < 0) return `a = ${rate} per second: after ${number(-1 / a)} s 37 % are left, after ${number(Math.log(100) / -a)} s 1 %.`;
    return `a = ${rate} per second: it grows, and doubles every ${number(Math.LN2 / a)} s. Without an input nothing ends that.`;
  },
};
