// SPDX-License-Identifier: Apache-2.0
// What the page knows: the sections that the server sends, and the task that is open.

export const $ = (id) => document.getElementById(id);

export const page = {
  scene: null,
  values: {},    // of the controls, by key
  chosen: {},    // filter and law
  places: {},    // of sensors on the map
  placed: {},    // poles of the regulator and the estimator, where they are placed
  limits: { input: {}, alike: [], state: {}, reason: '' },
  theory: {},
  status: {},
  path: { points: [], state: '' },
  share: {},
  ghost: {},
  acted: { what: '', at: -1e9 },  // the last push, pull or carrying of this tab, at a time in ms
  acts: [],      // the recent ones, each with its time in the plots and a short name
  resumed: -1e9, // when a pause ended, in ms
  task: '',      // the open one of the drawer
  dirty: true,   // whether something has changed since it was drawn
};

// Remember what a person has just done to the plant, which no filter knows; '' forgets all.
export function acted(what, short = '', time = 0) {
  const at = performance.now(), goesOn = page.acted.what === what && at - page.acted.at < 500;
  page.acted = { what, at };
  if (!what) page.acts = [];
  else if (!goesOn) page.acts = [...page.acts.slice(-9), { short, time }];
}

// an element with properties and children
export function element(tag, properties = {}, ...children) {
  const made = Object.assign(document.createElement(tag), properties);
  made.append(...children);
  return made;
}
