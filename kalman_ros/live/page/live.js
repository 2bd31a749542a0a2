// SPDX-License-Identifier: Apache-2.0
// The page: what the server sends, what is drawn, and what a person does.

import { addressedCommands, rememberValues } from './address.js';
import { copyPicture, isRecording, noVideo, recordClip, saveAs, stopClip } from './clips.js';
import { Controls } from './controls.js';
import { add, clear, data } from './data.js';
import { buildDrawer, drawer, drawerWords, open, push, showDrawer } from './drawer.js';
import { ghostGone } from './ghost.js';
import { grabSystem } from './grab.js';
import { countPlans, forgetPlans } from './limits.js';
import { drawBode, drawNyquist, marginText, PoleMap } from './maps.js';
import { dragHandles } from './handles.js';
import { $, acted, element, page } from './page.js';
import { drawPaths } from './path.js';
import { forgetColours, short } from './pen.js';
import { plot } from './plots.js';
import { blamed, mainStates, RECENT, saying } from './saying.js';
import { answered, connect, forget, Newest, send } from './socket.js';
import { drawSystem } from './system.js';
import { traces } from './traces.js';
import { noticeStep } from './update.js';

const HELP = { reset: 'reset', pause: 'continue', mend: 'mend it' };  // what the button beside the sentence says
let plots = [], effects = [];

// --- what the server sends ---------------------------------------------------------------------
function receive(message) {
  page.dirty = true;
  if (message.kind !== 'frames') { RECEIVE[message.kind]?.(message); return; }
  for (const frame of message.frames) {
    if (frame.answer) show(frame.answer);
    else if (frame.latency) $('latency').textContent = `slider to input ${Math.round(frame.latency.ms)} ms`;
    else {
      if (frame.fresh) { forgetPlans(); acted(''); said = 0; }
      noticeStep(frame);
      add(frame);
    }
  }
}

function show(answer) {
  if (!answered(answer)) return;
  notice(answer.error || refusals.join('; '));
  if (!answer.error) return;
  showValues();
  map.show(page.theory, page.scene?.linear);
}

page.refused = notice;

function notice(text) {
  $('notice').textContent = text;
  $('notice').hidden = !text;
}

// what was done, for a few seconds
function told(text) {
  $('told').textContent = text;
  $('told').hidden = false;
  clearTimeout(told.timer);
  told.timer = setTimeout(() => { $('told').hidden = true; }, 5000);
}

// The changes in the address are made if the user wants it; until then the address stays as it is.
let offered = null, refusals = [];

function offer() {
  if (!page.scene || page.version === undefined || page.ghost.filter === undefined) return;
  if (offered === null) {
    offered = addressedCommands();
    $('offered').textContent = `The address changes ${offered.map(inWords).join(', ')}.`;
    $('offer').hidden = !offered.length;
  }
  if (!offered.length) rememberValues();
}

function inWords({ do: what, key, what: choice, of, name, side, sensor, value, filter }) {
  if (what === 'set') {
    const { group, title, role } = page.scene.controls.find((control) => control.key === key);
    return `${group}: ${title}${role ? ` (${role})` : ''} to ${value}`;
  }
  if (what === 'limit') return `the ${side} limit of ${name} to ${value ?? 'none'}`;
  if (what === 'place') return `the place of ${sensor}`;
  if (what === 'poles') return `the poles of the ${of}`;
  return what === 'ghost' ? `the ghost to ${filter}` : `the ${choice} to ${value}`;
}

function decide(accepted) {
  $('offer').hidden = true;
  const refused = (error) => { if (error) refusals.push(error); };
  if (accepted) for (const command of offered) send(command, refused);
  offered = [];
  if (!accepted) rememberValues();
}

function showValues() {
  controls.show(page.values);
  showDrawer();
  for (const select of $('choices').querySelectorAll('select')) select.value = page.chosen[select.name];
}

const RECEIVE = {
  scene(message) {
    page.scene = message;
    data.unit = message.time;
    data.each = message.time.replace(/(?<=.)s$/, '');
    clear();
    forget();
    $('name').textContent = document.title = message.name;
    $('input-legend').hidden = !message.input.names.length;
    $('about').textContent = $('about').title = aboutScene(message);
    controls.build(message.controls);
    buildChoices();
    buildPlots();
    buildDrawer();
    showValues();
    offer();
  },
  values(message) {
    const isFirst = page.version === undefined;
    page.values = message.values;
    page.chosen = message.chosen;
    page.limits = message.limits;
    page.placed = message.placed;
    page.places = message.places;
    page.version = message.version;
    markStale();
    if (page.scene && isFirst) buildDrawer();  // with the handles that matter for these values
    else showValues();
    offer();
  },
  theory(message) {
    page.theory = message;
    markStale();
    $('notes').replaceChildren(...message.notes.map((text) => element('li', { textContent: text })));
    const loops = message.loops ?? [];
    $('loops').hidden = !loops.length;
    const select = $('loop-input'), names = loops.map((loop) => loop.input);
    if ([...select.options].map((option) => option.value).join() !== names.join()) {
      select.replaceChildren(...names.map((name) => new Option(name, name)));
    }
    $('regulator-legend').hidden = !message.regulator;
    $('pole-map').hidden = !message.open && !message.regulator && !message.estimator;
    map.show(message, page.scene?.linear);
    $('estimator-legend').textContent = `○ estimator${page.scene?.linear ? ': drag' : ''}${message.estimator?.placed ? ', | as sampled' : ''}`;
    listPoles();
    markUnstable();
  },
  share(message) { page.share = message; },
  path(message) { page.path = message; },
  ghost(message) {
    const isFirst = page.ghost.filter === undefined;
    page.ghost = message;
    if (isFirst) offer();
    $('ghost-legend').hidden = !message.filter;
    if (!message.filter) ghostGone();
    if (offered?.length === 0) rememberValues();
  },
  status(message) {
    if (page.status.paused && !message.paused) page.resumed = performance.now();
    page.status = message;
    countPlans(message);
    const how = message.lockstep ? `lockstep${message.speed === 1 ? '' : `, ${short(message.speed)} times as fast`}` : 'real time', late = lately(message.missed);
    $('state').textContent = message.message || `${how}${message.paused ? ', paused' : ''}${late > 0 ? `, ${late} steps late` : ''}`;
    $('step').textContent = message.lockstep ? 'step' : 'stop, step';
    $('step').title = `${message.lockstep ? '' : 'the nodes start again in lockstep, from here; then '}s: predict, then update`;
    if (message.failed) notice(`${message.message}. Press reset to start again.`);
    $('pause').textContent = message.paused ? 'continue' : 'pause';
    $('lockstep').checked = message.lockstep;
    $('speed').disabled = !message.lockstep;
    $('speed-label').title = message.lockstep ? '' : 'real time has one speed: choose lockstep';
    if (document.activeElement !== $('speed')) $('speed').value = Math.log10(message.speed);
    $('speed-value').textContent = message.lockstep ? `× ${short(message.speed)}` : 'in lockstep alone';
    data.span = message.lockstep ? Math.max(message.paused ? 0.5 : 0, 10 * message.speed) : 10;
    $('facts').replaceChildren(...Object.entries(message.nodes).flatMap(([name, { level, message: text }]) => [
      element('dt', { textContent: name }), element('dd', { textContent: text, className: ['', 'warn', 'error'][level] ?? '' }),
    ]));
  },
};

const missed = [];  // times, and steps that were late until then

// the steps that were late in the last ten seconds
function lately(count) {
  if (!(count >= (missed.at(-1)?.[1] ?? 0))) missed.length = 0;
  if (!(count >= 0)) return 0;
  missed.push([performance.now(), count]);
  while (missed[0][0] < performance.now() - 1e4) missed.shift();
  return count - missed[0][1];
}

// theory of values that have changed since is dimmed until the new one is there
function markStale() {
  const stale = page.theory.version !== undefined && page.theory.version < page.version;
  $('theory').classList.toggle('stale', stale);
  $('stale').hidden = !stale;
}

function markUnstable() {
  const loop = page.theory.loops?.[0], margins = (loop?.estimated ?? loop?.known)?.margins, delay = margins?.delay[0];
  for (const each of [controls, drawer.controls]) {
    each?.mark('plant/actuator_gain/0', margins ? [margins.lower_gain[0], margins.upper_gain[0]].filter(Boolean) : []);
    each?.mark('plant/actuator_delay', delay ? [delay + (page.values['plant/actuator_delay'] ?? 0)] : []);
  }
}

// what the system is, what is measured, and what the regulator is for
function aboutScene({ about, sensors, state, input, equilibrium, path }) {
  const measured = Object.entries(sensors).map(([name, sensor]) => `${name} (${sensor.names.join(', ')})`).join(', ');
  const parts = [about.replace(/[.:;]?$/, '.')], held = mainStates().map((name) => `${name} = ${short(equilibrium[state.names.indexOf(name)])}`);
  if (input.names.length) parts.push(`The regulator brings it to ${held.join(', ')}${path.reason ? '' : ', or along a path'}.`);
  return [parts[0], `Sensors: ${measured}.`, ...parts.slice(1)].filter((part) => part.length > 1).join(' ');
}

// --- what depends on the scene -----------------------------------------------------------------
const controls = new Controls($('controls'), send);
const placing = new Newest(send);
const map = new PoleMap($('poles'), (of, poles) => placing.put({ do: 'poles', of, poles: poles.map((pole) => [...pole]) }));

function listPoles() {
  if ($('pole-list').contains(document.activeElement)) return;
  const rows = [];
  for (const [of, poles] of Object.entries(map.poles)) {
    poles.forEach(([re, im], index) => {
      if (im < 0) return;
      const numbers = [re, ...(im ? [im] : [])].map((value, part) => {
        const input = element('input', { type: 'number', step: 'any', value: Number(value.toPrecision(4)), disabled: !map.draggable.includes(of) });
        if (input.disabled) input.title = 'the filter of a nonlinear model has no poles to place';
        input.setAttribute('aria-label', `${of} pole ${index + 1}, ${part ? 'imaginary' : 'real'} part`);
        input.addEventListener('change', () => {
          const wanted = poles.map((pole) => [...pole]), old = wanted[index][1];
          const partner = old ? wanted.findIndex(([a, b], k) => k !== index && a === re && b === -old) : -1;
          wanted[index][part] = Number(input.value);
          if (partner >= 0) wanted[partner] = [wanted[index][0], -wanted[index][1]];
          send({ do: 'poles', of, poles: wanted });
          input.blur();
        });
        return input;
      });
      rows.push(element('div', { className: 'pole' },
        of === 'regulator' ? '□ regulator' : '○ estimator', numbers[0], ...(numbers[1] ? ['± j', numbers[1]] : []), `1/${data.each}`));
    });
  }
  $('pole-list').replaceChildren(...rows);
}

function buildChoices() {
  $('choices').replaceChildren(...Object.entries(page.scene.choices).map(([what, list]) => {
    const select = element('select', { name: what }, ...list.map((name) => new Option(name, name)));
    select.value = page.chosen[what];
    select.addEventListener('change', () => send({ do: 'choose', what, value: select.value }, () => { select.value = page.chosen[what]; }));
    return element('label', { className: 'speed' }, `${what} `, select);
  }));
}

function canvasIn(place) {
  const canvas = element('canvas');
  canvas.setAttribute('role', 'img');
  dragHandles(canvas);
  place.append(canvas);
  return canvas;
}

function buildPlots() {
  for (const id of ['states', 'innovations', 'filter', 'cost']) $(id).replaceChildren();
  plots = traces(page.scene).map((trace) => ({ ...trace, canvas: canvasIn($(trace.section)) }));
  $('cost-title').hidden = !page.scene.input.names.length;
}

// the effects of the task that is open
page.renew = () => {
  $('effects').replaceChildren();
  // a plot by its name, or a function that draws and returns whether it still moves
  const made = drawer.effects.map((effect) => (effect instanceof Function ? { move: effect } : plots.find(({ name }) => name === effect)));
  effects = made.filter(Boolean).map((effect) => ({ ...effect, canvas: canvasIn($('effects')) }));
  for (const { move, canvas } of effects) canvas.classList.toggle('large', Boolean(move));
  markUnstable();
};

// --- drawing: at most 60 times a second --------------------------------------------------------
let drawn = 0, said = 0;

function draw(time) {
  requestAnimationFrame(draw);
  if (!page.dirty || !page.scene || time - drawn < 15) return;
  drawn = time;
  page.dirty = false;
  $('clock').textContent = `${data.now.toFixed(data.unit === 's' ? 2 : 0)} ${data.unit}`;
  $('prior-legend').hidden = !data.prior;
  $('path-legend').hidden = !page.path.points?.length;
  drawSystem($('system'), page.scene);
  $('limit-legend').hidden = !$('system').handles?.some(({ limit }) => limit);
  $('line-legend').hidden = !$('system').lines;
  for (const { canvas, make, move } of effects) {
    if (!move) plot(canvas, make());
    else if (move(canvas)) page.dirty = true;
  }
  if ($('all-plots').open) for (const { canvas, make } of plots) plot(canvas, make());
  if (time - said > 400) { said = time; say(); }
  if (!$('theory').open) return;
  if (!map.held) map.draw();
  const loop = (page.theory.loops ?? []).find((each) => each.input === $('loop-input').value);
  if (loop) {
    $('margins').textContent = marginText(loop);
    drawBode($('bode'), loop);
    drawNyquist($('nyquist'), loop);
  }
}

// a few times a second, so that it can be read
function say() {
  const { text, help } = saying();
  if ($('sentence').textContent !== text) $('sentence').textContent = text;
  $('help').hidden = !help;
  $('help').textContent = HELP[help] ?? '';
  $('help').dataset.act = help;
  drawerWords();
}

// --- what a person does ------------------------------------------------------------------------
const ACT = {
  pause: () => send({ do: page.status.paused ? 'resume' : 'pause' }),
  step: () => send({ do: 'step' }),
  reset: () => send({ do: page.status.failed ? 'restart' : 'reset' }),
  push: () => (page.scene.input.names.length ? push(0, 1) : open('push')),
  mend: () => {
    const ends = ['plant', 'estimator'].map((node) => `${node}/${blamed()}.`), { values } = page.scene.initial;
    const changed = Object.keys(values).filter((key) => ends.some((end) => key.startsWith(end)) && page.values[key] !== values[key]);
    for (const key of changed) send({ do: 'set', key, value: values[key] });
    const [now, place] = [page.places, page.scene.initial.places].map((places) => places[blamed()]);
    if (String(now) !== String(place)) send({ do: 'place', sensor: blamed(), x: place[0], y: place[1] });
    else if (!changed.length) open('faults');
  },
  theme: () => useTheme(!document.documentElement.classList.contains('dark')),
  help: () => ACT[$('help').dataset.act]?.(),
  share: () => {
    if (isRecording()) { stopClip(); return; }
    $('made').textContent = $('webm').title = noVideo($('system'));
    $('webm').disabled = Boolean($('webm').title);
    const file = `${page.share.name}_live.yaml`;
    $('yaml').value = page.share.yaml;
    $('command').textContent = `./dev live ${file}\n./dev demo ${file}`;
    $('shared').showModal();
    $('yaml').setSelectionRange(0, 0);
    $('yaml').scrollTop = 0;
  },
};

function useTheme(dark) {
  document.documentElement.classList.toggle('dark', dark);
  forgetColours();
  page.dirty = true;
}

for (const id of ['pause', 'step', 'reset', 'share', 'theme', 'help']) $(id).addEventListener('click', ACT[id]);
$('lockstep').addEventListener('change', () => send({ do: 'mode', lockstep: $('lockstep').checked }));
$('speed').addEventListener('input', () => send({ do: 'speed', value: Number((10 ** $('speed').value).toPrecision(2)) }));
$('accept').addEventListener('click', () => decide(true));
$('decline').addEventListener('click', () => decide(false));
$('close').addEventListener('click', () => $('shared').close());
$('copy').addEventListener('click', () => {
  $('yaml').select();
  $('made').textContent = document.execCommand('copy') ? 'the file is copied' : 'this browser does not copy: it is selected';
});
$('save').addEventListener('click', () => saveAs(new Blob([page.share.yaml], { type: 'application/yaml' }), `${page.share.name}_live.yaml`));
$('picture').addEventListener('click', async () => { $('made').textContent = await copyPicture($('system'), page.share.name); });
for (const kind of ['webm', 'gif']) $(kind).addEventListener('click', () => {
  $('shared').close();
  recordClip(kind, $('system'), (clip) => {
    $('share').textContent = 'share';
    saveAs(clip, `${page.share.name}.${kind}`);
    told(`${page.share.name}.${kind} is saved, ${Math.ceil(clip.size / 1000)} kB`);
  });
  $('share').textContent = '● stop';
});
$('link').addEventListener('click', () => {
  const field = element('input', { value: location.href });
  $('shared').append(field);
  field.select();
  $('made').textContent = document.execCommand('copy') ? 'the address is copied' : 'this browser does not copy';
  field.remove();
});
// another address in this tab is as if it were opened anew
addEventListener('hashchange', () => location.reload());
for (const kind of ['pointerdown', 'keydown']) addEventListener(kind, () => { refusals = []; }, true);
$('loop-input').addEventListener('change', () => { page.dirty = true; });
const KEYS = { ' ': 'pause', s: 'step', r: 'reset', p: 'push', t: 'theme' };
addEventListener('keydown', (event) => {
  const busy = event.target.closest('input, select, textarea, button, summary, dialog');
  if (busy || event.ctrlKey || event.metaKey || event.altKey || !KEYS[event.key]) return;
  event.preventDefault();
  ACT[KEYS[event.key]]();
});
const redraw = () => { page.dirty = true; };
addEventListener('scroll', redraw, { passive: true, capture: true });
addEventListener('resize', redraw);
document.addEventListener('toggle', redraw, true);
const darkness = matchMedia('(prefers-color-scheme: dark)');
darkness.addEventListener('change', () => useTheme(darkness.matches));
useTheme(darkness.matches);
$('saying').title = `over the last ${RECENT} s: root mean squares, of 2σ and of the error, of all coordinates together`;
dragHandles($('system'));
dragHandles($('bode'));
drawPaths($('system'));
grabSystem($('system'));
// for tests: where poles are, in pixels, and how much of the past is kept
const rows = (name) => data.rows[name]?.length ?? 0;
window.livePast = () => ({ truth: rows('truth'), estimate: rows('estimate'), began: data.began });
window.livePoles = (of) => map.poles[of].map(([re, im]) => [map.X(re), map.Y(im)]);
connect(receive, () => { $('state').textContent = 'not connected'; });
requestAnimationFrame(draw);
