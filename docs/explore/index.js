// SPDX-License-Identifier: Apache-2.0
// Puts each picture with handles into its place on the page.
import { banana } from './banana.js';
import { bearings } from './bearings.js';
import { eigenvalue } from './eigenvalue.js';
import { mount } from './explorable.js';
import { feedback } from './feedback.js';
import { gain } from './gain.js';
import { margins } from './margins.js';
import { modes } from './modes.js';
import { observer } from './observer.js';
import { forgetColours } from '../../kalman_ros/live/page/pen.js';
import { sampling } from './sampling.js';
import { sensor } from './sensor.js';
import { separation } from './separation.js';
import { update } from './update.js';
import { weights } from './weights.js';

const RECIPES = { banana, bearings, eigenvalue, feedback, gain, margins, modes, observer, sampling, sensor, separation, update, weights };

const drawings = Object.entries(RECIPES).flatMap(([name, recipe]) => {
  const host = document.getElementById(`explore-${name}`);
  return host ? [mount(host, name, recipe)] : [];
});

// a page that turns dark or light is drawn in the other colours
const redraw = () => { forgetColours(); drawings.forEach((draw) => draw()); };
new MutationObserver(redraw).observe(document.body, { attributes: true, attributeFilter: ['data-theme'] });
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
