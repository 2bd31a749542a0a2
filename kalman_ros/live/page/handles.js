// SPDX-License-Identifier: Apache-2.0
// What is dragged on a canvas: `canvas.handles` are renewed whenever it is drawn, each with
// `hit(x, y)`, `move(x, y, start)`, and, where something is to be done, `begin(x, y)` and `end()`.
// `canvas.held` is the one that is dragged.

export function dragHandles(canvas) {
  let start = null, box = null;
  const at = (event) => {
    // while it is dragged, the page may move under the hand
    if (!canvas.held) box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const under = (event) => (canvas.handles ?? []).find((handle) => handle.hit(...at(event)));
  canvas.addEventListener('pointerdown', (event) => {
    const handle = under(event);
    if (!handle || event.button) return;
    event.stopImmediatePropagation();
    canvas.setPointerCapture(event.pointerId);
    start = at(event);
    canvas.held = handle;
    handle.begin?.(...start);
  });
  canvas.addEventListener('pointermove', (event) => {
    if (canvas.held) canvas.held.move(...at(event), start);
    else canvas.classList.toggle('handle', Boolean(under(event)));
  });
  for (const name of ['pointerup', 'pointercancel']) {
    canvas.addEventListener(name, () => {
      const handle = canvas.held;
      canvas.held = null;
      handle?.end?.();
    });
  }
  // a finger on a handle does not scroll
  canvas.addEventListener('touchstart', (event) => { if (under(event.touches[0])) event.preventDefault(); }, { passive: false });
}
