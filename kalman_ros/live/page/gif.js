// SPDX-License-Identifier: Apache-2.0
// Animations as GIF: CompuServe, Graphics Interchange Format, version 89a (1990).

const COLOURS = 256, NONE = 0;      // of a palette; the index of a pixel that stays as it was
const CLEAR = COLOURS, END = CLEAR + 1, MOST = 4096;  // codes

// the 15 bits by which colours are counted, from those of a pixel: red is the lowest byte
const bin = (pixel) => (pixel >> 3 & 31) | (pixel >> 6 & 992) | (pixel >> 9 & 31744);

// Frames of one size, each a Uint32Array of pixels as in ImageData; `pause` is between them, in ms.
export class Gif {
  constructor(width, height, pause) {
    Object.assign(this, { width, height, pause, frames: [], counts: new Uint32Array(32768), colours: new Uint32Array(32768) });
  }

  add(pixels) {
    const bins = new Uint16Array(pixels.length);
    for (let k = 0; k < pixels.length; k++) {
      const at = bins[k] = bin(pixels[k]);
      if (!this.counts[at]++) this.colours[at] = pixels[k];
    }
    this.frames.push(bins);
  }

  // the most frequent colours, and for each bin the index of the nearest one
  palette() {
    const used = [...this.counts.keys()].filter((k) => this.counts[k]).sort((a, b) => this.counts[b] - this.counts[a]);
    const kept = used.slice(0, COLOURS - 1), index = new Uint8Array(32768), parts = (k) => [0, 8, 16].map((shift) => this.colours[k] >> shift & 255);
    const known = kept.map(parts);
    for (const k of used) {
      const mine = parts(k), far = known.map((other) => other.reduce((sum, value, c) => sum + (value - mine[c]) ** 2, 0));
      index[k] = 1 + far.indexOf(Math.min(...far));
    }
    return { bytes: Uint8Array.from({ length: 3 * COLOURS }, (_, k) => known[Math.floor(k / 3) - 1]?.[k % 3] ?? 0), index };
  }

  // the file; the page goes on between two frames
  async blob() {
    const { bytes, index } = this.palette(), { width, height } = this, two = (value) => [value & 255, value >> 8];
    const parts = [
      Uint8Array.of(...new TextEncoder().encode('GIF89a'), ...two(width), ...two(height), 0xf7, 0, 0), bytes,
      Uint8Array.of(0x21, 0xff, 11, ...new TextEncoder().encode('NETSCAPE2.0'), 3, 1, 0, 0, 0),  // again and again
    ];
    let before = null;
    for (const bins of this.frames) {
      const indices = bins.map((at, k) => (before?.[k] === at ? NONE : index[at]));
      parts.push(
        Uint8Array.of(0x21, 0xf9, 4, 5, ...two(Math.round(this.pause / 10)), NONE, 0),  // on what was there
        Uint8Array.of(0x2c, 0, 0, 0, 0, ...two(width), ...two(height), 0, 8), ...blocks(compress(indices)),
      );
      before = bins;
      await new Promise((done) => { setTimeout(done); });
    }
    return new Blob([...parts, Uint8Array.of(0x3b)], { type: 'image/gif' });
  }
}

// The codes of T. A. Welch (Computer 17 (6), 1984), with as many bits as the newest one needs.
function compress(indices) {
  const table = new Uint16Array(MOST * COLOURS), bytes = [];
  let next = END + 1, width = 9, held = 0, bits = 0;
  const write = (code) => {
    held |= code << bits;
    for (bits += width; bits >= 8; bits -= 8) { bytes.push(held & 255); held >>>= 8; }
  };
  write(CLEAR);
  let prefix = indices[0];
  for (let k = 1; k < indices.length; k++) {
    const at = prefix * COLOURS + indices[k];
    if (table[at]) { prefix = table[at]; continue; }
    write(prefix);
    prefix = indices[k];
    if (next < MOST) {
      table[at] = next;
      if (next++ === 1 << width) width++;
      continue;
    }
    write(CLEAR);
    table.fill(0);
    next = END + 1;
    width = 9;
  }
  write(prefix);
  write(END);
  if (bits) bytes.push(held);
  return bytes;
}

// bytes in blocks of at most 255, each with its length
function blocks(bytes) {
  const parts = [];
  for (let k = 0; k < bytes.length; k += 255) {
    const part = bytes.slice(k, k + 255);
    parts.push(Uint8Array.of(part.length, ...part));
  }
  return [...parts, Uint8Array.of(0)];
}
