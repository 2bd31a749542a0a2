// SPDX-License-Identifier: Apache-2.0
// The recent past of the loop: rows of numbers, each with a time first.

const MOST = 4000;

export const data = {
  now: 0,         // the time of the newest truth
  began: 0,       // the time of the last reset
  span: 10,       // the time that plots show
  unit: 's',      // of time, unless a second stands for another
  each: 's',      // the same in the singular
  rows: {},       // streams by name
  P: null,        // the newest covariance, flat
  ghostP: null,   // that of the ghost
  prior: null,    // the prediction of the next step
  arrived: {},    // wall time of the newest reading of each sensor, in ms
};

export function clear(began = 0) {
  data.now = data.began = began;
  data.rows = {};
  data.P = data.ghostP = data.prior = null;
  data.arrived = {};
}

function append(name, rows) {
  const stream = data.rows[name] ??= [];
  for (const row of rows) {
    if (row[0] === null) row[0] = data.now;
    stream.push(row);
  }
  const old = data.now - 4 * data.span;
  let drop = 0;
  while (drop < stream.length && (stream[drop][0] < old || stream.length - drop > MOST)) drop++;
  if (drop > 200 || stream.length > MOST + 500) stream.splice(0, drop);
}

export function add(frame) {
  if (frame.fresh) clear(data.now);
  if (frame.truth) {
    data.now = frame.truth.at(-1)[0];
    append('truth', frame.truth);
  }
  if (frame.estimate) {
    append('estimate', frame.estimate);
    data.P = frame.P;
    data.prior = null;
  }
  if (frame.ghost) {
    append('ghost', frame.ghost);
    data.ghostP = frame.ghost_P;
  }
  if (frame.input) append('input', frame.input);
  for (const [name, rows] of Object.entries(frame.readings ?? {})) {
    append(`reading ${name}`, rows);
    data.arrived[name] = performance.now();
  }
  for (const [name, rows] of Object.entries(frame.innovations ?? {})) append(`innovation ${name}`, rows);
  for (const [name, row] of Object.entries(frame.gain ?? {})) append(`gain ${name}`, [[data.now, ...row]]);
  if (frame.cost) append('cost', [[data.now, ...frame.cost]]);
  if (frame.prior) data.prior = frame.prior;
}

export const last = (name) => data.rows[name]?.at(-1);
