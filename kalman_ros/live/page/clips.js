// SPDX-License-Identifier: Apache-2.0
// Clips and pictures of the system, made and kept in the browser.

import { element, page } from './page.js';
import { colour } from './plots.js';

const RATE = 30;                 // pictures a second
const KINDS = ['video/webm;codecs=vp9', 'video/webm;codecs=vp8', 'video/webm'];
const LONGEST = 5 * 60 * 1000;   // milliseconds, since a clip is held in memory
let recorder = null;

export const isRecording = () => recorder !== null;

// why this browser cannot record; '' where it can
export function noClip(canvas) {
  if (!window.MediaRecorder || !canvas.captureStream) return 'this browser records no canvas';
  return KINDS.some((kind) => MediaRecorder.isTypeSupported(kind)) ? '' : 'this browser writes no WebM';
}

export function saveAs(blob, name) {
  const link = element('a', { download: name });
  link.href = URL.createObjectURL(blob);
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

// Record a canvas until `stopClip`; `ended` is called with the clip when that is done.
export function recordClip(canvas, ended) {
  const mimeType = KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)), parts = [];
  canvas.solid = true;  // a clip is not transparent
  recorder = new MediaRecorder(canvas.captureStream(RATE), { mimeType });
  recorder.ondataavailable = ({ data }) => { if (data.size) parts.push(data); };
  recorder.onstop = () => {
    canvas.solid = false;
    recorder = null;
    ended(new Blob(parts, { type: 'video/webm' }));
  };
  recorder.start(1000);
  setTimeout(stopClip, LONGEST);
  page.dirty = true;
}

export function stopClip() {
  if (recorder?.state === 'recording') recorder.stop();
}

// a canvas on its background, as a PNG
function picture(canvas) {
  const flat = element('canvas', { width: canvas.width, height: canvas.height }), pen = flat.getContext('2d');
  pen.fillStyle = colour('panel');
  pen.fillRect(0, 0, flat.width, flat.height);
  pen.drawImage(canvas, 0, 0);
  return new Promise((done) => { flat.toBlob(done, 'image/png'); });
}

// Copy the picture, or save it where the browser does not let a page copy; return what was done.
export async function copyPicture(canvas, name) {
  const blob = await picture(canvas);
  try {
    await navigator.clipboard.write([new ClipboardItem({ 'image/png': blob })]);
    return 'copied';
  } catch {
    saveAs(blob, `${name}.png`);
    return 'saved, since this browser copies no pictures';
  }
}
