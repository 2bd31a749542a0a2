// SPDX-License-Identifier: Apache-2.0
// A path that a person draws on the map, and what became of it.

import { last } from './data.js';
import { page } from './page.js';
import { colour, stroke } from './pen.js';
import { send } from './socket.js';

const POINTS = 80;       // of a path that is sent
const LEAST = 24;        // pixels of the shortest path
export const drawing = { points: null };  // in pixels, while one is drawn

// Let a person draw on the canvas of the system while the task is open; the view stands still.
export function drawPaths(canvas) {
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener('pointerdown', (event) => {
    if (page.task !== 'path' || page.scene.path.reason || !canvas.view || event.button) return;
    canvas.setPointerCapture(event.pointerId);
    drawing.points = [at(event)];
  });
  canvas.addEventListener('pointermove', (event) => {
    if (!drawing.points) return;
    const [x, y] = at(event), [a, b] = drawing.points.at(-1);
    if (Math.hypot(x - a, y - b) < 3) return;
    drawing.points.push([x, y]);
    page.dirty = true;
  });
  canvas.addEventListener('pointerup', () => {
    const points = drawing.points;
    drawing.points = null;
    page.dirty = true;
    if (points && lengthOf(points) >= LEAST) sendPath(even(points).map(([x, y]) => canvas.view.world(x, y)));
  });
  canvas.addEventListener('pointercancel', () => { drawing.points = null; page.dirty = true; });
  // a finger draws, and does not scroll
  canvas.addEventListener('touchstart', (event) => {
    if (page.task === 'path' && !page.scene?.path.reason) event.preventDefault();
  }, { passive: false });
}

export function sendPath(points) {
  page.path = { ...page.path, points, state: 'planning', reason: '', remaining: '' };
  page.dirty = true;
  send({ do: 'path', points: points.map((point) => point.map((value) => Number(value.toFixed(3)))) });
}

const lengthOf = (points) => points.slice(1).reduce((sum, [x, y], k) => sum + Math.hypot(x - points[k][0], y - points[k][1]), 0);

// points at equal distances, from which the tremor of the hand is averaged
function even(points) {
  const total = lengthOf(points), step = total / (POINTS - 1), found = [points[0]];
  let done = 0;
  for (let k = 1; k < points.length; k++) {
    const [a, b] = points[k - 1], [c, d] = points[k], size = Math.hypot(c - a, d - b);
    while (found.length < POINTS - 1 && found.length * step <= done + size) {
      const share = (found.length * step - done) / size;
      found.push([a + share * (c - a), b + share * (d - b)]);
    }
    done += size;
  }
  found.push(points.at(-1));
  for (let round = 0; round < 3; round++) {
    const before = found.map((point) => [...point]);
    for (let k = 1; k < found.length - 1; k++) {
      for (const axis of [0, 1]) found[k][axis] = (before[k - 1][axis] + 2 * before[k][axis] + before[k + 1][axis]) / 4;
    }
  }
  return found;
}

// Paths that need no mouse, from where the estimate is.
export const SHAPES = {
  corner: () => [[0, 0], [1, 0], [1, 1]],
  circle: () => round((a) => [Math.sin(a), 1 - Math.cos(a)]),
  eight: () => round((a) => [Math.sin(a), Math.sin(2 * a) / 2]),
};
const round = (place) => Array.from({ length: 61 }, (_, k) => place(2 * Math.PI * k / 60));

export function sendShape(name) {
  const { scene, values } = page, estimate = last('estimate');
  if (!estimate) return;
  const of = (state) => estimate[1 + scene.state.names.indexOf(state)];
  const [x, y] = scene.path.names.map(of), size = 3 * (values['controller/path_speed'] ?? 0.5);
  const angle = scene.drawing.heading ? of(scene.drawing.heading) : 0, c = Math.cos(angle), s = Math.sin(angle);
  sendPath(SHAPES[name]().map(([a, b]) => [x + size * (c * a - s * b), y + size * (s * a + c * b)]));
}

// how large the map has to be for a path, in metres
export function room() {
  return page.scene.path.reason ? 0 : 8 * (page.values['controller/path_speed'] ?? 0.5);
}

// the path that was sent, and the one that is being drawn
export function drawPath(pen, X, Y) {
  const line = (points) => {
    pen.beginPath();
    points.forEach(([x, y], k) => (k ? pen.lineTo(x, y) : pen.moveTo(x, y)));
    pen.stroke();
  };
  const sent = (page.path.points ?? []).map(([x, y]) => [X(x), Y(y)]);
  if (sent.length && !drawing.points) {
    stroke(pen, 'path', 5);
    pen.globalAlpha = page.path.state === 'refused' ? 0.35 : 0.6;
    line(sent);
    pen.globalAlpha = 1;
    const [x, y] = sent.at(-1);
    pen.fillStyle = colour('path');
    pen.beginPath(); pen.arc(x, y, 6, 0, 7); pen.fill();
  }
  if (drawing.points) { stroke(pen, 'path', 5); line(drawing.points); }
}

// progress and refusal in words
export function pathWords() {
  const { state, reason, progress, remaining } = page.path, left = remaining ? `, ${Number(remaining).toFixed(2)} m remain` : '';
  if (state === 'planning') return 'The controller plans the motion …';
  if (state === 'refused') return `The path is refused: ${reason.replace(/^reference\/path: /, '')}.`;
  if (state === 'following') return `On the path: ${progress}${left}.`;
  return state === 'ended' ? `The motion has ended${away()}.` : '';
}

// what a person can do
export function pathHint() {
  const { reason } = page.scene.path;
  if (reason) return `No path can be drawn: ${reason}.`;
  const goes = page.path.state === 'following' ? ' another' : ' a';
  return `Draw${goes} path on the map, with the mouse or a finger${goes === ' a' ? '' : ': the robot goes on from where it is'}.`;
}

function away() {
  const end = page.path.points.at(-1), truth = last('truth');
  if (!end || !truth) return '';
  const [x, y] = page.scene.path.names.map((name) => truth[1 + page.scene.state.names.indexOf(name)]);
  return `, ${Math.hypot(x - end[0], y - end[1]).toFixed(2)} m from the end of the path`;
}
