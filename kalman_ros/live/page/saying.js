// SPDX-License-Identifier: Apache-2.0
// One sentence that says what is going on, from the numbers, and the button that helps.

import { data, last } from './data.js';
import { CARRIED } from './grab.js';
import { actingSentence } from './limits.js';
import { page } from './page.js';
import { pathWords } from './path.js';
import { quantity, short } from './pen.js';

export const RECENT = 2;  // seconds over which an error is averaged
const FALLEN = 1.3;    // radians at which no force brings the pole up again
const TOO_SURE = 2;    // the error beyond this many times the 2σ is too large to be chance
const SHOWN = 6000;    // milliseconds for which the end of a motion is told
const FAST = 20, QUIET = 300;  // readings a second of a fast sensor, and the milliseconds after which it is quiet
const RESUMED = 2000;  // milliseconds for which the end of a pause is told
const FELT = 4000;     // milliseconds for which a push is told
const ended = { state: '', at: 0 };
// the coordinates that the sentence is about: the place on a map, else the first that is measured
export function mainStates() {
  const { scene } = page, { names } = scene.state;
  if (scene.path.names.length) return scene.path.names;
  const measured = names.find((name) => Object.values(scene.sensors).some((sensor) => sensor.names.includes(name)));
  return [measured ?? names[0]];
}

const turned = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));

// the begin of the recent past; after a reset that of its latter half, without the start
const since = () => Math.max(data.now - RECENT, (data.now + data.began) / 2);

// how wrong the estimate is, and how wrong it believes to be (2σ), in the recent past
export function errors(rows = 'estimate') {
  const { state } = page.scene, n = state.names.length, names = mainStates();
  const truths = new Map((data.rows.truth ?? []).map((row) => [row[0], row]));
  let squares = 0, variances = 0, count = 0;
  for (const row of (data.rows[rows] ?? []).filter((each) => each[0] >= since())) {
    const truth = truths.get(row[0]);
    if (!truth) continue;
    count++;
    for (const name of names) {
      const k = state.names.indexOf(name), off = row[1 + k] - truth[1 + k];
      squares += (state.angles.includes(name) ? turned(off) : off) ** 2;
      variances += row[1 + n + k] ** 2;
    }
  }
  if (!count) return null;
  return { wrong: Math.sqrt(squares / count), believed: 2 * Math.sqrt(variances / count), unit: state.units[state.names.indexOf(names[0])] };
}

function fallen() {
  if (page.scene.drawing.kind !== 'cart_pole') return false;
  const at = 1 + page.scene.state.names.indexOf('theta');  // it may swing through the top
  return (data.rows.truth ?? []).some((row) => row[0] >= since() && Math.abs(turned(row[at])) > FALLEN);
}

// the sensor that is not as the filter believes; '' where all are
const troubled = () => Object.keys(page.status.sensors ?? {})[0] ?? '';

// a fast sensor of which nothing has arrived lately, before its silence is sure; '' where there is none
function quiet() {
  const since = ([name, at]) => page.values[`plant/${name}.rate`] > FAST && performance.now() - at > QUIET;
  return Object.entries(data.arrived).find(since)?.[0] ?? '';
}

// the sensor that the sentence blames
export const blamed = () => troubled() || quiet();

const SAID = {
  silent: ({ seconds }) => `has sent nothing for ${short(seconds, 2)} ${data.unit}${page.values[`plant/${troubled()}.enabled`] === false ? ', switched off' : ''}`,
  lost: ({ share }) => `loses ${percent(share)} of its readings`,
  frozen: () => 'is frozen at one value',
  outliers: ({ share }) => `has outliers, ${percent(share)} of its readings`,
  bias: ({ off }) => `reads ${off.map(({ name, unit, size }) => `${name} ${quantity(Math.abs(size), unit)} too ${size > 0 ? 'high' : 'low'}`).join(' and ')}`,
  noise: ({ off: [{ name, factor }] }) => `scatters in ${name} ${short(factor > 1 ? factor : 1 / factor, 2)} times ${factor > 1 ? 'as much as' : 'less than'} the filter believes`,
  late: ({ seconds }) => `is ${short(seconds, 2)} ${data.unit} late`,
};

const percent = (share) => `${Math.max(1, Math.round(100 * share))} %`;

// why an error of what the sentence is about stays; '' where the readings depend on it
function unseen() {
  const names = mainStates().filter((name) => page.theory.unseen?.includes(name));
  if (!names.length) return '';
  const carried = page.acts.findLast(({ short }) => short === CARRIED);
  return `, and stays so${carried ? ` after it was carried at ${carried.time.toFixed(1)} ${data.unit}` : ''}, since no reading depends on ${names.join(', ')}`;
}

function sensorWords() {
  const name = troubled();
  return name && `The sensor ${name} ${SAID[page.status.sensors[name].kind](page.status.sensors[name])}`;
}

// The sentence, and the name of an action that helps, or ''.
export function saying() {
  const { status, scene, path } = page, { controller, plant } = status.nodes ?? {}, sensor = sensorWords();
  if (!last('truth')) return { text: status.message || (data.began ? 'It begins anew.' : 'The nodes start.'), help: '' };
  if (status.paused) return { text: 'The plant is paused.', help: 'pause' };
  if (performance.now() - page.resumed < RESUMED) return { text: 'The plant goes on, and the filter from its last belief.', help: '' };
  if (plant?.level === 2) return { text: `The plant: ${plant.message}.`, help: 'reset' };
  if (sensor && fallen()) return { text: `${sensor}; the pole has fallen.`, help: 'mend' };
  if (sensor && controller?.level === 2) return { text: `${sensor}. The controller: ${controller.message}.`, help: 'mend' };
  if (controller?.level === 2) return quiet() ? { text: `The sensor ${quiet()} sends nothing. The controller: ${controller.message}.`, help: 'mend' } : { text: `The controller: ${controller.message}.`, help: 'reset' };
  if (fallen() && quiet()) return { text: `The sensor ${quiet()} sends nothing; the pole has fallen.`, help: 'mend' };
  if (fallen()) return { text: 'The pole has fallen: no force that the regulator knows brings it up.', help: 'reset' };
  const error = errors();
  const much = error?.wrong > error?.believed ? ', more than that' : '';
  const wrong = error && `${mainStates().join(', ')} within ${quantity(error.believed, error.unit)}; over ${RECENT} s it is wrong by ${quantity(error.wrong, error.unit)}`;
  if (sensor) return { text: error ? `${sensor}: the filter believes ${wrong}.` : `${sensor}.`, help: 'mend' };
  if (error && page.acted.what && performance.now() - page.acted.at < FELT) return { text: `${page.acted.what}, unknown to the filter: it believes ${wrong}.`, help: '' };
  if (error && error.wrong > TOO_SURE * error.believed) return { text: `The filter is too sure: it believes ${wrong}${unseen()}.`, help: 'reset' };
  const recent = path.state === 'ended' && performance.now() - ended.at < SHOWN;
  if (path.state !== ended.state) Object.assign(ended, { state: path.state, at: performance.now() });
  if (!scene.path.reason && (recent || ['planning', 'refused', 'following'].includes(path.state))) return { text: pathWords(), help: '' };
  const held = scene.input.names.length ? actingSentence() : '';
  if (held) return { text: held, help: '' };
  if (error) return { text: `The filter believes ${wrong}${much}.`, help: '' };
  return { text: 'No estimate has been compared with the truth yet.', help: '' };
}
