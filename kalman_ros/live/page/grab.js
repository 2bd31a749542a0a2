// SPDX-License-Identifier: Apache-2.0
// Pulling at the system with the mouse or a finger, a disturbance for as long as it is held; or
// carrying it away, which the estimator does not know.

import { data, last } from './data.js';
import { acted, page } from './page.js';
import { Newest, send } from './socket.js';

const PERIOD = 80;   // milliseconds between two commands: each push lasts for 200
const LONG = 100;    // pixels of a pull as strong as a typical input
const MOST = 3;      // the strongest pull, in typical inputs

// From a pull in pixels, right and up, to the shares of the inputs.
const PULL = {
  spring: (right) => [right],
  springs: (right, up) => [right, up],
  cart_pole: (right) => [right],
  motor: (right, up, truth) => [up * Math.cos(truth.theta) - right * Math.sin(truth.theta)],
  submersible: (right, up, truth) => {
    const c = Math.cos(truth.pitch), s = Math.sin(truth.pitch);
    return [c * right - s * up, up / 2, up / 2];
  },
  plane: (right, up, truth) => {
    const { heading } = page.scene.drawing, { length } = page.scene.input.names;
    if (!heading) return length === 2 ? [right, up] : null;
    const c = Math.cos(truth[heading]), s = Math.sin(truth[heading]);
    const along = c * right + s * up, across = c * up - s * right;
    return length === 2 ? [along, across] : length === 3 ? [along, across, 0] : null;
  },
};

export const CARRIED = 'carried';
export const grab = { carries: false };

// why the system cannot be pulled, or carried away; '' where it can
export function noGrab() {
  if (grab.carries) {
    if (page.scene.drawing.kind === 'bars') return 'the picture has no place';
    return page.status.lockstep ? 'it is carried away in real time alone' : '';
  }
  if (!page.scene.input.names.length) return 'the model has no input';
  return page.scene.drawing.kind in PULL ? '' : 'the picture has no body: push an input';
}

export function grabSystem(canvas) {
  const newest = new Newest(send);
  let timer = 0;
  const pull = () => {
    const [x, y] = canvas.body, [px, py] = canvas.pull, { names } = page.scene.state, row = last('truth');
    const truth = Object.fromEntries(names.map((name, k) => [name, row[1 + k]]));
    const shares = PULL[page.scene.drawing.kind]((px - x) / LONG, (y - py) / LONG, truth);
    if (shares) acted('The system is pulled', 'pulled', data.now);
    if (shares) newest.put({ do: 'push', shares: shares.map((share) => Number(Math.max(-MOST, Math.min(MOST, share)).toFixed(3))) });
  };
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    canvas.pull = [event.clientX - box.left, event.clientY - box.top];
    page.dirty = true;
  };
  const free = () => { clearInterval(timer); canvas.pull = null; page.dirty = true; };
  canvas.addEventListener('pointerdown', (event) => {
    if (page.task !== 'push' || noGrab() || !canvas.body || event.button) return;
    canvas.setPointerCapture(event.pointerId);
    canvas.carries = grab.carries;
    at(event);
    if (grab.carries) return;
    pull();
    timer = setInterval(pull, PERIOD);
  });
  canvas.addEventListener('pointermove', (event) => { if (canvas.pull) at(event); });
  canvas.addEventListener('pointerup', () => {
    if (canvas.pull && canvas.carries && canvas.place) {
      const [names, values] = canvas.place(...canvas.pull);
      send({ do: 'carry', names, values });
      acted('The system was carried away', CARRIED, data.now);
    }
    free();
  });
  canvas.addEventListener('pointercancel', free);
  canvas.addEventListener('touchstart', (event) => {
    if (page.task === 'push' && page.scene && !noGrab()) event.preventDefault();
  }, { passive: false });
}
