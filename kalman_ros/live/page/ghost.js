// SPDX-License-Identifier: Apache-2.0
// The ghost: a second filter, or the values from before a change, on the same readings.

import { data } from './data.js';
import { element, page } from './page.js';
import { quantity } from './pen.js';
import { errors } from './saying.js';
import { send } from './socket.js';

const RENEWED = 4000;  // milliseconds after which the server is told that the ghost is still shown
const NONE = 'none', NOW = 'now';
let pinned = false;    // whether this tab asked for the values of now

// Tell the server that the ghost is shown, while it can be seen; it ends soon after.
setInterval(() => {
  if (page.ghost.filter && !document.hidden) send({ do: 'ghost', shown: true });
}, RENEWED);

// a choice of what to compare with, in a `row`, and the errors of both
export function buildGhost(place, row) {
  const choice = element('select', { id: 'ghost' }, new Option('nothing', NONE), new Option('the values of now', NOW), ...page.scene.choices.filter.map((name) => new Option(name, name)));
  const told = element('p', { id: 'ghost-errors' });
  choice.addEventListener('change', () => {
    const { value } = choice;
    pinned = value === NOW;
    send(value === NONE ? { do: 'ghost', shown: false } : { do: 'ghost', filter: value === NOW ? '' : value }, (error) => { if (error) choice.value = NONE; page.refused(error); });
    delete data.rows.ghost;
  });
  choice.value = page.ghost.filter ? (pinned ? NOW : page.ghost.filter) : NONE;
  row.append(element('label', { className: 'speed', title: 'on the same readings; it stays as it is when a value changes' }, 'compare with ', choice));
  place.append(told);
  return () => {
    const text = ghostWords();
    if (told.textContent !== text) told.textContent = text;
  };
}

export function ghostGone() {
  delete data.rows.ghost;
  data.ghostP = null;
  pinned = false;
  const choice = document.getElementById('ghost');
  if (choice && document.activeElement !== choice) choice.value = NONE;
}

const half = (name, { wrong, believed, unit }) => `${name} ${quantity(wrong, unit)} (2σ ${quantity(believed, unit)})`;

function ghostWords() {
  const ours = errors(), ghost = page.ghost.filter && errors('ghost');
  if (!ours || !ghost) return page.ghost.filter ? 'The ghost starts.' : '';
  return `Errors: ${half(page.chosen.filter, ours)}; ${half(`ghost ${page.ghost.filter}`, ghost)}`;
}
