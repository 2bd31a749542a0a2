// SPDX-License-Identifier: Apache-2.0
// What the page shows, and what was changed, in its address: a bookmark brings it back.

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

// the values that differ from those with which the loop started
export function rememberValues() {
  if (!page.scene) return;
  const { values, chosen } = page.scene.initial, changed = {};
  for (const [key, value] of Object.entries(page.values)) if (value !== values[key]) changed[key] = value;
  const choices = Object.fromEntries(Object.entries(page.chosen).filter(([what, choice]) => choice !== chosen[what]));
  remember({
    set: Object.keys(changed).length ? JSON.stringify(changed) : '',
    choose: Object.keys(choices).length ? JSON.stringify(choices) : '',
  });
}

// the object in a part of the address with which the page was opened; empty where it is not one
function object(name) {
  try {
    const value = JSON.parse(addressed(name) || '{}');
    return value && typeof value === 'object' && !Array.isArray(value) ? value : {};
  } catch {
    return {};
  }
}

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
  return commands;
}
