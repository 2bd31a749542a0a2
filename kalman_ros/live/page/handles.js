// SPDX-License-Identifier: Apache-2.0
// What is dragged on a canvas, beside limits: `canvas.handles` are renewed whenever it is drawn,
// each with `hit(x, y)`, `move(x, y, start)` and, where something follows, `end()`.

export function dragHandles(canvas) {
  let held = null, start = null;
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const under = (event) => (canvas.handles ?? []).find((handle) => handle.hit(...at(event)));
  canvas.addEventListener('pointerdown', (event) => {
    held = event.button ? null : under(event);
    if (!held) return;
    start = at(event);
    held.begin?.();
    event.stopImmediatePropagation();
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (held) held.move(...at(event), start);
    else canvas.classList.toggle('handle', Boolean(under(event)));
  });
  for (const name of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(name, () => { held?.end?.(); held = null; });
  }
  // a finger on a handle does not scroll
  canvas.addEventListener('touchstart', (event) => { if (under(event.touches[0])) event.preventDefault(); }, { passive: false });
}
