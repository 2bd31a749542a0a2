// SPDX-License-Identifier: Apache-2.0
// What the page shows, and what was changed, in its address: a bookmark brings it back.

import { areAlike } from './limits.js';
import { page } from './page.js';

const known = () => new URLSearchParams(location.hash.slice(1));
const START = known();  // as the page was opened

// a part of the address with which the page was opened
export const addressed = (name) => START.get(name) ?? '';

function remember(changes) {
  const parts = known();
  for (const [name, value] of Object.entries(changes)) {
    if (value === '') parts.delete(name);
    else parts.set(name, value);
  }
  // it replaces the entry of the history, so that "back" leaves the page
  history.replaceState(null, '', `#${parts}`);
}

// the task that is open, and the step of the tour
export function rememberTask(task, step) {
  remember({ task, tour: task === 'tour' ? step : '' });
}

// what of an object is not so in another one, as text; '' where nothing is
function changes(now, before) {
  const all = Object.entries(now).filter(([key, value]) => JSON.stringify(value) !== JSON.stringify(before[key]));
  return all.length ? JSON.stringify(Object.fromEntries(all)) : '';
}

// what differs from that with which the loop started
export function rememberValues() {
  if (!page.scene) return;
  const { values, chosen, limits, placed, places } = page.scene.initial;
  remember({
    set: changes(page.values, values),
    choose: changes(page.chosen, chosen),
    poles: changes(page.placed, placed),
    places: changes(page.places, places),
    inputs: changes(bounded('input', page.limits), bounded('input', limits)),
    states: changes(bounded('state', page.limits), bounded('state', limits)),
    ghost: page.ghost.filter ?? '',
  });
}

const bounded = (of, limits) => Object.fromEntries(page.scene[of].names.map((name) => [name, limits[of][name] ?? [null, null]]));

// the object in a part of the address with which the page was opened; empty where it is not one
function object(name) {
  try {
    const value = JSON.parse(addressed(name) || '{}');
    return value && typeof value === 'object' && !Array.isArray(value) ? value : {};
  } catch {
    return {};
  }
}

const limit = (value) => value === null || Number.isFinite(value);
const bound = (value) => (value === null ? {} : { value });

// The commands that bring back what the address of this page says, where it is not so already.
// They are offered, not sent: an address may come from anywhere.
export function addressedCommands() {
  const commands = [];
  for (const [what, value] of Object.entries(object('choose'))) {
    if (page.scene.choices[what]?.includes(value) && page.chosen[what] !== value) commands.push({ do: 'choose', what, value });
  }
  for (const [key, value] of Object.entries(object('set'))) {
    if (key in page.values && page.values[key] !== value && ['number', 'boolean'].includes(typeof value)) commands.push({ do: 'set', key, value });
  }
  for (const [of, poles] of Object.entries(object('poles'))) {
    const pairs = Array.isArray(poles) && poles.every((pole) => Array.isArray(pole) && pole.length === 2 && pole.every(Number.isFinite));
    if (['regulator', 'estimator'].includes(of) && pairs && JSON.stringify(page.placed[of]) !== JSON.stringify(poles)) commands.push({ do: 'poles', of, poles });
  }
  for (const [sensor, place] of Object.entries(object('places'))) {
    if (sensor in page.places && Array.isArray(place) && place.length === 2 && place.every(Number.isFinite) && String(page.places[sensor]) !== String(place)) commands.push({ do: 'place', sensor, x: place[0], y: place[1] });
  }
  const pairs = ['input', 'state'].flatMap((of) => Object.entries(object(`${of}s`)).map(([name, pair]) => [of, name, pair]));
  for (const [of, name, pair] of pairs) {
    if (!page.scene[of].names.includes(name) || !Array.isArray(pair) || pair.length !== 2 || !pair.every(limit)) continue;
    const now = page.limits[of][name] ?? [null, null];
    // the low one is never above the high one, neither on the way
    const sides = pair[0] !== null && now[1] !== null && pair[0] >= now[1] ? ['high', 'low'] : ['low', 'high'];
    if (areAlike(of, name) && pair[0] !== null && pair[0] !== -pair[1]) continue;
    for (const side of areAlike(of, name) ? ['high'] : sides) {
      const k = side === 'low' ? 0 : 1;
      if (now[k] !== pair[k]) commands.push({ do: 'limit', of, name, side, ...bound(pair[k]) });
    }
  }
  const ghost = addressed('ghost');
  if (page.scene.choices.filter.includes(ghost) && page.ghost.filter !== ghost) commands.push({ do: 'ghost', filter: ghost });
  return commands;
}
