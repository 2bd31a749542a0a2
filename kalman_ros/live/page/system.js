// SPDX-License-Identifier: Apache-2.0
// The system itself: truth solid, estimate dashed with an ellipse of two standard deviations.

import { data, last } from './data.js';
import { beliefs, crosses, deviation, ellipse, FRESH, magnified, now, reach, rule, spring, TWO_SIGMA, upright } from './drawing.js';
import { limitOf, walls } from './limits.js';
import { page } from './page.js';
import { drawing, drawPath, room } from './path.js';
import { arrow, colour, labelled, prepare, short, stroke } from './pen.js';
import { send } from './socket.js';

const FAR = 6;       // metres at most between truth and estimate that a picture of a cart shows
const BESIDE = 0.3;  // metres that it shows beside a cart

// metres from the middle to the edge: a little more than the recent motion, changing slowly; and to
// the frame of springs, which stays
const zoomed = { run: -1, reach: 0, frame: 0 };

function zoom(scene, names) {
  const at = names.map((name) => 1 + scene.state.names.indexOf(name));
  if (drawing.points) return zoomed.reach;
  const rows = (data.rows.truth ?? []).slice(-400);
  const drawn = page.task === 'path' ? 1 : 0.3, points = (page.path.points ?? []).flat().map(Math.abs);
  const largest = (all) => Math.max(0, ...all.map((row) => Math.max(...at.map((k) => Math.abs(row[k])))));
  const believed = Math.min(largest((data.rows.estimate ?? []).slice(-100)), largest(rows) + FAR);
  const goal = Math.max(drawn, 1.1 * Math.max(0, ...points), 1.35 * Math.max(largest(rows), believed));
  const isNew = zoomed.run !== scene.run && rows.length > 0;
  zoomed.reach += (isNew || !zoomed.frame ? 1 : 0.06) * (goal - zoomed.reach);
  if (isNew) Object.assign(zoomed, { run: scene.run, frame: 0.88 * goal });
  // what is thrown far at once stays in the picture, too
  const row = rows.at(-1);
  if (row) {
    const far = largest([row]);
    zoomed.reach = Math.max(zoomed.reach, 1.15 * far);
    zoomed.frame = Math.max(zoomed.frame, 1.05 * far);
  }
  return zoomed.reach;
}

// how the places of a drawing are found again: for what is drawn on it, or dragged
function viewed(canvas, X, Y) {
  const along = (place) => { const zero = place(0), one = place(1) - zero; return (pixel) => (pixel - zero) / one; };
  const [x, y] = [along(X), along(Y)];
  canvas.view = { X, Y, world: (px, py) => [x(px), y(py)] };
  canvas.place = (px, py) => [page.scene.path.names, canvas.view.world(px, py)];
}

const camera = { run: -1, x: 0, scale: 0 };

// The middle and the scale of a cart's picture: it follows truth and estimate so that both stay in
// it, and the walls with them while they are near.
function follow(scene, seen, w, most, margin, isHeld) {
  if (isHeld && camera.scale) return camera;  // it does not change under the hand
  const limits = ['low', 'high'].map((side) => limitOf('state', 'x', side)).filter((value) => value !== null);
  const places = [seen.truth.x, seen.estimate?.x.x ?? seen.truth.x, ...limits], near = (x) => Math.min(Math.max(x, places[0] - FAR), places[0] + FAR);
  const low = Math.min(...places.map(near)) - margin, high = Math.max(...places.map(near)) + margin;
  const scale = Math.min(most, w / (high - low));
  const half = w / 2 / scale;  // as little as it takes
  if (camera.run !== scene.run) Object.assign(camera, { run: scene.run, x: 0 });
  camera.x += 0.1 * ((Math.max(Math.abs(low), Math.abs(high)) <= half ? 0 : (low + high) / 2) - camera.x);
  camera.x = Math.min(Math.max(camera.x, high - half), low + half);
  camera.scale = scale;
  return camera;
}

const DRAW = {
  spring(pen, w, h, scene, seen, canvas) {
    const scale = w / 2 / zoom(scene, ['x']), X = (x) => w / 2 + x * scale, y = h * 0.55, size = 44;
    walls(pen, canvas, 'x', X, (px) => (px - w / 2) / scale, w, y - 60, y + size / 2);
    const wall = X(-zoomed.frame);
    stroke(pen, 'soft', 2);
    pen.beginPath(); pen.moveTo(wall, y - 50); pen.lineTo(wall, y + size / 2); pen.lineTo(w, y + size / 2); pen.stroke();
    const { truth } = seen;
    if (!truth) return;
    canvas.body = [X(truth.x), y];
    canvas.place = (px) => [['x'], [(px - w / 2) / scale]];
    spring(pen, wall, y, X(truth.x) - size / 2, y);
    stroke(pen, 'ink', 3);
    pen.strokeRect(X(truth.x) - size / 2, y - size / 2, size, size);
    beliefs(pen, seen, (belief, look, dash) => {
      const x = X(belief.x.x), d = TWO_SIGMA * deviation(belief, 'x') * scale, v = look === 'prior' ? 16 : 0;
      pen.fillStyle = colour('band');
      if (!v) pen.fillRect(x - d, y - size / 2 - 8, 2 * d, size + 16);
      stroke(pen, look, 2, dash);
      pen.strokeRect(x - size / 2, y - size / 2, size, size);
      stroke(pen, look, 2);
      pen.beginPath(); pen.moveTo(x - d, y + size + v); pen.lineTo(x + d, y + size + v);
      for (const e of [-d, 0, d]) { pen.moveTo(x + e, y + size + v - 5); pen.lineTo(x + e, y + size + v + 5); }
      pen.stroke();
    });
    const reading = last('reading position');
    canvas.lines = true;
    if (reading && performance.now() - data.arrived.position < FRESH) {
      stroke(pen, 'reading', 2);
      pen.beginPath(); pen.moveTo(X(reading[1]), y - size); pen.lineTo(X(reading[1]), y + size); pen.stroke();
    }
    arrow(pen, X(truth.x), y - size, reach(scene, seen.input[0]), 0);
    rule(pen, X, w, h, scale);
  },

  springs(pen, w, h, scene, seen, canvas) {
    const scale = Math.min(w, h) / 2 / zoom(scene, ['x', 'y']), X = (x) => w / 2 + x * scale, Y = (y) => h / 2 - y * scale;
    viewed(canvas, X, Y);
    drawPath(pen, X, Y);
    const { truth } = seen;
    if (!truth) return;
    const [x, y] = canvas.body = [X(truth.x), Y(truth.y)], { frame: far } = zoomed;
    stroke(pen, 'soft', 2);
    pen.strokeRect(X(-far), Y(far), X(far) - X(-far), Y(-far) - Y(far));
    for (const [a, b] of [[-far, 0], [far, 0], [0, far], [0, -far]]) spring(pen, X(a), Y(b), x, y);
    beliefs(pen, seen, (belief, look, dash) => ellipse(pen, X, Y, belief, 'x', 'y', look, dash));
    stroke(pen, 'ink', 3);
    pen.beginPath(); pen.arc(x, y, 9, 0, 7); pen.stroke();
    crosses(pen, scene, X, Y, 'x', 'y');
    arrow(pen, x, y, reach(scene, seen.input[0]), -reach(scene, seen.input[1]));
    magnified(pen, w, h, seen, scale, 'x', 'y', canvas);
    rule(pen, X, w, h, scale);
    upright(pen, Y, canvas.view.world, h);
  },

  cart_pole(pen, w, h, scene, seen, canvas) {
    const { truth } = seen;
    if (!truth) return;
    const { x: centre, scale } = follow(scene, seen, w, Math.min(w / 3, h / 1.9), BESIDE, canvas.held);
    const ground = h * 0.72, long = 2 * scene.length * scale, X = (x) => w / 2 + (x - centre) * scale;
    stroke(pen, 'soft', 2);
    pen.beginPath(); pen.moveTo(0, ground + 24); pen.lineTo(w, ground + 24); pen.stroke();
    walls(pen, canvas, 'x', X, (px) => centre + (px - w / 2) / scale, w, ground - 40, ground + 24);
    const pole = (x, theta, look, width, dash) => {
      stroke(pen, look, width, dash);
      pen.strokeRect(X(x) - 32, ground - 8, 64, 26);
      pen.beginPath(); pen.moveTo(X(x), ground - 8); pen.lineTo(X(x) - long * Math.sin(theta), ground - 8 - long * Math.cos(theta)); pen.stroke();
    };
    canvas.body = [X(truth.x), ground + 5];
    canvas.place = (px) => [['x'], [centre + (px - w / 2) / scale]];
    pole(truth.x, truth.theta, 'ink', 4);
    beliefs(pen, seen, (belief, look, dash) => {
      const d = Math.min(Math.PI, TWO_SIGMA * deviation(belief, 'theta')), x = X(belief.x.x), a = -Math.PI / 2 - belief.x.theta;
      pen.fillStyle = colour('band');
      pen.beginPath(); pen.moveTo(x, ground - 8); pen.arc(x, ground - 8, long * 1.06, a - d, a + d); pen.fill();
      pole(belief.x.x, belief.x.theta, look, 2, dash);
      const s = TWO_SIGMA * deviation(belief, 'x') * scale;
      stroke(pen, look, 2);
      pen.beginPath(); pen.moveTo(x - s, ground + 32); pen.lineTo(x + s, ground + 32); pen.stroke();
    });
    arrow(pen, X(truth.x), ground + 5, reach(scene, seen.input[0]), 0);
    rule(pen, X, w, h, scale, centre);
  },

  motor(pen, w, h, scene, seen, canvas) {
    const { truth } = seen, x = w / 2, y = h / 2, r = Math.min(w, h) * 0.36;
    stroke(pen, 'soft', 2);
    pen.beginPath(); pen.arc(x, y, r, 0, 7); pen.stroke();
    if (!truth) return;
    const hand = (angle, look, width, dash) => {
      stroke(pen, look, width, dash);
      pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + r * Math.cos(angle), y - r * Math.sin(angle)); pen.stroke();
    };
    beliefs(pen, seen, (belief, look, dash) => {
      const d = Math.min(Math.PI, TWO_SIGMA * deviation(belief, 'theta')), a = -belief.x.theta;
      pen.fillStyle = colour('band');
      pen.beginPath(); pen.moveTo(x, y); pen.arc(x, y, r * 1.08, a - d, a + d); pen.fill();
      hand(belief.x.theta, look, 2, dash);
    });
    canvas.body = [x + r * Math.cos(truth.theta), y - r * Math.sin(truth.theta)];
    canvas.place = (px, py) => [['theta'], [Math.atan2(y - py, px - x)]];
    hand(truth.theta, 'ink', 4);
    arrow(pen, 24, h - 16, 0, -Math.abs(reach(scene, seen.input[0])));
    pen.fillStyle = colour('soft');
    pen.fillText(`${short(seen.input[0])} ${scene.input.units[0]}`, 36, h - 16);
  },

  submersible(pen, w, h, scene, seen, canvas) {
    const { truth } = seen;
    if (!truth) return;
    if (!drawing.points) middle.x = truth.x;
    const centre = middle.x, scale = w / 9, X = (x) => w / 2 + (x - centre) * scale;
    const deep = Math.max(0, h * 0.12 - truth.z * scale * 0.9 - (h - 60)), Y = (z) => h * 0.12 - deep - z * scale * 0.9;
    viewed(canvas, X, Y);
    drawPath(pen, X, Y);
    stroke(pen, 'soft', 2);
    pen.beginPath(); pen.moveTo(0, Y(0)); pen.lineTo(w, Y(0)); pen.stroke();
    pen.fillStyle = colour('soft');
    pen.textAlign = 'right';
    pen.fillText('water', w - 6, Y(0) + 12);
    pen.textAlign = 'left';
    upright(pen, Y, canvas.view.world, h);
    const body = (x, z, pitch, look, width, dash) => {
      stroke(pen, look, width, dash);
      pen.save(); pen.translate(X(x), Y(z)); pen.rotate(pitch);
      pen.beginPath(); pen.ellipse(0, 0, 36, 12, 0, 0, 7); pen.moveTo(36, 0); pen.lineTo(46, 0); pen.moveTo(-36, -8); pen.lineTo(-36, 8); pen.stroke();
      pen.restore();
    };
    beliefs(pen, seen, (belief, look, dash) => {
      ellipse(pen, X, (z) => Y(z), belief, 'x', 'z', look, dash);
      body(belief.x.x, belief.x.z, belief.x.pitch, look, 2, dash);
    });
    canvas.body = [X(truth.x), Y(truth.z)];
    body(truth.x, truth.z, truth.pitch, 'ink', 3);
    const along = Math.cos(truth.pitch), down = Math.sin(truth.pitch), [surge, fore, aft] = seen.input;
    const at = (s) => [X(truth.x) + s * along, Y(truth.z) + s * down];
    const push = (s, dx, dy, value) => { const [x, y] = at(s), size = reach(scene, value); arrow(pen, x, y, size * dx, size * dy); };
    push(-38, along, down, surge);
    push(26, down, -along, fore);
    push(-26, down, -along, aft);
    magnified(pen, w, h, seen, scale, 'x', 'z', canvas);
    rule(pen, X, w, h, scale, centre);
  },

  plane(pen, w, h, scene, seen, canvas) {
    const { truth } = seen;
    if (!truth) return;
    const view = frame(scene, seen, w, h);
    const X = (x) => w / 2 + (x - view.x) * view.scale, Y = (y) => h / 2 - (y - view.y) * view.scale;
    viewed(canvas, X, Y);
    stroke(pen, 'line', 1);
    pen.fillStyle = colour('soft');
    for (const [x, text] of labelled(view.x - w / 2 / view.scale, view.x + w / 2 / view.scale, 6, 'm')) {
      pen.beginPath(); pen.moveTo(X(x), 0); pen.lineTo(X(x), h); pen.stroke(); pen.fillText(text, X(x) + 3, h - 5);
    }
    for (const [y, text] of labelled(view.y - h / 2 / view.scale, view.y + h / 2 / view.scale, 5, 'm')) {
      pen.beginPath(); pen.moveTo(0, Y(y)); pen.lineTo(w, Y(y)); pen.stroke(); pen.fillText(text, 3, Y(y) - 3);
    }
    drawPath(pen, X, Y);
    const i = 1 + scene.state.names.indexOf('x'), j = 1 + scene.state.names.indexOf('y');
    for (const [rows, look, dash] of [['estimate', 'estimate', 'dashed'], ['truth', 'ink', 'solid']]) {
      stroke(pen, look, 1.4, dash);
      pen.beginPath();
      (data.rows[rows] ?? []).forEach((row, k) => (k ? pen.lineTo(X(row[i]), Y(row[j])) : pen.moveTo(X(row[i]), Y(row[j]))));
      pen.stroke();
    }
    places(pen, scene, X, Y, w + h, canvas);
    beliefs(pen, seen, (belief, look, dash) => ellipse(pen, X, Y, belief, 'x', 'y', look, dash));
    crosses(pen, scene, X, Y, 'x', 'y');
    const heading = scene.drawing.heading;
    const a = heading ? truth[heading] : Math.atan2(truth.v_y ?? 0, truth.v_x ?? 1);
    canvas.body = [X(truth.x), Y(truth.y)];
    pen.save(); pen.translate(...canvas.body); pen.rotate(-a);
    stroke(pen, 'ink', 2.5);
    pen.beginPath(); pen.moveTo(12, 0); pen.lineTo(-8, 7); pen.lineTo(-4, 0); pen.lineTo(-8, -7); pen.closePath(); pen.stroke();
    pen.restore();
    magnified(pen, w, h, seen, view.scale, 'x', 'y', canvas);
  },

  bars(pen, w, h, scene, seen) {
    const names = scene.state.names, row = h / names.length;
    names.forEach((name, k) => {
      const y = row * (k + 0.55), all = [...(data.rows.truth ?? []), ...(data.rows.estimate ?? [])].map((r) => r[1 + k]);
      const low = Math.min(...all.slice(-2000)), high = Math.max(...all.slice(-2000)), pad = 0.3 * (high - low) || 1;
      const X = (v) => 70 + (w - 90) * (v - low + pad) / (high - low + 2 * pad);
      pen.fillStyle = colour('ink');
      pen.fillText(`${name} [${scene.state.units[k]}]`, 8, y - row * 0.3);
      stroke(pen, 'line', 1);
      pen.beginPath(); pen.moveTo(70, y); pen.lineTo(w - 20, y); pen.stroke();
      pen.fillStyle = colour('soft');
      for (const [v, text] of labelled(low - pad, high + pad, 4, '')) pen.fillText(text, X(v) - 8, y + row * 0.3);
      beliefs(pen, seen, (belief, look, dash) => {
        const d = TWO_SIGMA * deviation(belief, name), x = belief.x[name];
        pen.fillStyle = colour('band');
        pen.fillRect(X(x - d), y - 12, X(x + d) - X(x - d), 24);
        stroke(pen, look, 2, dash);
        pen.strokeRect(X(x - d), y - 12, X(x + d) - X(x - d), 24);
        pen.beginPath(); pen.moveTo(X(x), y - 12); pen.lineTo(X(x), y + 12); pen.stroke();
      });
      if (seen.truth) {
        stroke(pen, 'ink', 4);
        pen.beginPath(); pen.moveTo(X(seen.truth[name]), y - 16); pen.lineTo(X(seen.truth[name]), y + 16); pen.stroke();
      }
    });
  },
};

let moved = null;  // the sensor that is dragged, with its place

// bearings as lines from their sensors, which can be moved
function places(pen, scene, X, Y, far, canvas) {
  for (const [name, sensor] of Object.entries(scene.sensors)) {
    if (!sensor.place) continue;
    canvas.lines = true;
    const is = moved?.name === name ? moved.place : page.places[name] ?? sensor.place, row = last(`reading ${name}`);
    const [x, y] = [X(is[0]), Y(is[1])], believed = scene.initial.places[name];
    const triangle = (px, py) => { pen.beginPath(); pen.moveTo(px - 6, py + 5); pen.lineTo(px + 6, py + 5); pen.lineTo(px, py - 7); pen.closePath(); pen.stroke(); };
    if (believed && String(believed) !== String(is)) {  // where the filter believes it is
      stroke(pen, 'estimate', 2, 'dashed');
      triangle(X(believed[0]), Y(believed[1]));
    }
    stroke(pen, 'soft', 2);
    triangle(x, y);
    if (name in page.places) canvas.handles.push({
      hit: (px, py) => Math.hypot(px - x, py - y) < 14,
      move: (px, py) => { moved = { name, place: canvas.view.world(px, py).map((value) => Number(value.toPrecision(4))) }; page.dirty = true; },
      end: () => {
        if (moved) send({ do: 'place', sensor: name, x: moved.place[0], y: moved.place[1] }, (error) => {
          if (!error) page.places[name] = moved.place;
          moved = null;
          page.dirty = true;
        });
      },
    });
    pen.fillStyle = colour('soft');
    pen.fillText(scene.relative ? 'observer' : name, x + 9, y + 4);
    canvas.taken.push([x + 20, y]);
    if (!row) continue;
    const a = row[1 + sensor.names.indexOf('bearing')];
    stroke(pen, 'reading', 1.5, performance.now() - data.arrived[name] < FRESH ? 'solid' : 'dotted');
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x + far * Math.cos(a), y - far * Math.sin(a)); pen.stroke();
  }
}

// what of the plane is shown: the recent tracks, the sensors, and an ellipse that is not larger
const shown = { x: 0, y: 0, scale: 0, run: -1 };
const middle = { x: 0 };

function frame(scene, seen, w, h) {
  if (drawing.points || moved) return shown;
  const i = 1 + scene.state.names.indexOf('x'), j = 1 + scene.state.names.indexOf('y');
  const points = [...(data.rows.truth ?? []), ...(data.rows.estimate ?? [])].map((row) => [row[i], row[j]]);
  for (const sensor of Object.values(scene.sensors)) if (sensor.place) points.push(sensor.place);
  points.push(...(page.path.points ?? []));
  const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
  const box = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
  if (seen.estimate) {
    const { x, P } = seen.estimate, size = Math.max(box[1] - box[0], box[3] - box[2], 1);
    const [dx, dy] = [P('x', 'x'), P('y', 'y')].map((v) => Math.min(TWO_SIGMA * Math.sqrt(Math.max(0, v)), size));
    box[0] = Math.min(box[0], x.x - dx); box[1] = Math.max(box[1], x.x + dx);
    box[2] = Math.min(box[2], x.y - dy); box[3] = Math.max(box[3], x.y + dy);
  }
  const least = Math.max(room(), 1e-3);
  const scale = 0.85 * Math.min(w / Math.max(box[1] - box[0], least), h / Math.max(box[3] - box[2], least / 2));
  const goal = { x: (box[0] + box[1]) / 2, y: (box[2] + box[3]) / 2, scale };
  const follow = shown.run === scene.run && shown.scale ? 0.08 : 1;
  for (const key of ['x', 'y', 'scale']) shown[key] += follow * (goal[key] - shown[key]);
  shown.run = scene.run;
  // what moves faster than the picture follows stays in it, too
  for (const at of [seen.estimate?.x, seen.truth]) if (at) for (const [key, size] of [['x', w], ['y', h]]) {
    const half = 0.46 * size / shown.scale;
    shown[key] = Math.min(Math.max(shown[key], at[key] - half), at[key] + half);
  }
  return shown;
}

export function drawSystem(canvas, scene) {
  const area = prepare(canvas);
  if (!area) return;
  if (canvas.solid) {
    area.pen.fillStyle = colour('panel');
    area.pen.fillRect(0, 0, area.width, area.height);
  }
  area.pen.textAlign = 'left';
  area.pen.textBaseline = 'alphabetic';
  canvas.handles = [];
  canvas.place = null;
  canvas.lines = false;
  canvas.taken = [];  // places with a name beside them
  DRAW[scene.drawing.kind](area.pen, area.width, area.height, scene, now(scene), canvas);
  if (canvas.pull && canvas.body) {
    const [x, y] = canvas.body, [px, py] = canvas.pull;
    arrow(area.pen, x, y, px - x, py - y, canvas.carries ? 'bad' : 'path');
    area.pen.fillText(canvas.carries ? 'carried to here' : 'a pull', px + 8, py - 8);
  }
}
