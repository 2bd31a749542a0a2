// SPDX-License-Identifier: Apache-2.0
// Clips and pictures of the system, made and kept in the browser.

import { Gif } from './gif.js';
import { element, page } from './page.js';
import { colour } from './pen.js';

const RATE = 30;                 // pictures a second of a video
const KINDS = ['video/webm;codecs=vp9', 'video/webm;codecs=vp8', 'video/webm'];
const PAUSE = 80, WIDE = 480;    // milliseconds between the pictures of a GIF, and their width in pixels
const LONGEST = { webm: 5 * 60 * 1000, gif: 20 * 1000 };  // milliseconds, since a clip is held in memory
let stop = null;                 // ends the clip that is recorded

export const isRecording = () => stop !== null;

// why this browser cannot record a video; '' where it can
export function noVideo(canvas) {
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
export function recordClip(kind, canvas, ended) {
  canvas.solid = true;  // a clip is not transparent
  const record = kind === 'gif' ? recordGif : recordVideo, timer = setTimeout(stopClip, LONGEST[kind]);
  const end = record(canvas, ended);
  stop = () => {
    clearTimeout(timer);
    stop = null;
    canvas.solid = false;
    end();
  };
  page.dirty = true;
}

export function stopClip() {
  stop?.();
}

function recordVideo(canvas, ended) {
  const mimeType = KINDS.find((kind) => MediaRecorder.isTypeSupported(kind)), parts = [];
  const recorder = new MediaRecorder(canvas.captureStream(RATE), { mimeType });
  recorder.ondataavailable = ({ data }) => { if (data.size) parts.push(data); };
  recorder.onstop = () => ended(new Blob(parts, { type: 'video/webm' }));
  recorder.start(1000);
  return () => recorder.stop();
}

function recordGif(canvas, ended) {
  const scale = Math.min(1, WIDE / canvas.width), [width, height] = [canvas.width, canvas.height].map((size) => Math.round(size * scale));
  const small = element('canvas', { width, height }).getContext('2d', { willReadFrequently: true }), gif = new Gif(width, height, PAUSE);
  const take = () => {
    small.drawImage(canvas, 0, 0, width, height);
    gif.add(new Uint32Array(small.getImageData(0, 0, width, height).data.buffer));
  };
  const timer = setInterval(take, PAUSE);
  return () => {
    clearInterval(timer);
    take();
    gif.blob().then(ended);
  };
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
