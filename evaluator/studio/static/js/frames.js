// Frames of one recording: exact ones by number, the nearest key frame while dragging, and sequences for playing.

import { bytes, get, Refused } from "./api.js";

const KEPT_BYTES = 150e6; // of bitmaps in this tab
const BATCH = 24;

export class Frames {
  constructor(base, signal, drawn) {
    this.base = base;
    this.signal = signal;
    this.drawn = drawn; // called with (number, bitmap, exact) of the frame to show
    this.bitmaps = new Map();
    this.wanted = null;
    this.asking = false;
    this.fetching = new Set();
    this.shown = -1;
    signal.addEventListener("abort", () => { for (const one of this.bitmaps.values()) one.close(); this.bitmaps.clear(); });
  }

  async open() {
    const found = await get(`${this.base}/contents`, this.signal);
    this.times = found.time_s;
    this.keys = found.key_frames;
    [this.width, this.height] = found.size_px;
    this.px = Math.min(this.width, 1920); // the page shows no more
    const bytesEach = this.px * this.px * (this.height / this.width) * 4;
    this.most = Math.max(12, Math.floor(KEPT_BYTES / bytesEach));
    this.batch = Math.min(BATCH, Math.floor(this.most / 4));
  }

  get count() { return this.times.length; }

  indexAt(time) {
    let low = 0, high = this.times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.times[middle] <= time + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }

  // Show a frame; near: its key frame suffices for now. Only the last request counts.
  show(index, near = false) {
    const there = this.bitmaps.get(index);
    this.wanted = { index, near };
    if (there) {
      this.drawn(index, there, true);
      if (!near) this.#beside(index);
      return;
    }
    if (!this.asking) this.#ask();
  }

  async #ask() {
    this.asking = true;
    let exact = -1;
    try {
      while (this.wanted) {
        const { index, near } = this.wanted;
        if (this.bitmaps.has(index)) { this.drawn(index, this.bitmaps.get(index), true); this.wanted = null; break; }
        const response = await fetch(`${this.base}/frame?index=${index}&near=${near ? 1 : 0}&px=${this.px}`, { signal: this.signal });
        if (!response.ok) throw new Refused((await response.json()).error, response.status);
        const number = Number(response.headers.get("X-Frame"));
        const bitmap = await createImageBitmap(await response.blob());
        this.#keep(number, bitmap, index);
        const last = this.wanted && this.wanted.index === index && this.wanted.near === near;
        this.drawn(number, bitmap, number === index);
        if (last) this.wanted = null;
        exact = last && number === index ? index : -1;
      }
    } catch (error) {
      this.wanted = null;
      if (error.name !== "AbortError") this.failed?.(error);
    } finally {
      this.asking = false;
    }
    if (exact >= 0) this.#beside(exact);
  }

  // Fetch the frames beside one, so that a step is shown at once; first the one in the direction of the last step.
  async #beside(index) {
    const way = index < this.shown ? -1 : 1;
    this.shown = index;
    for (const next of [index + way, index - way]) {
      if (this.fetching.size || this.asking || this.shown !== index) return;
      if (next < 0 || next >= this.count || this.bitmaps.has(next)) continue;
      this.fetching.add(next);
      try { await this.#unpack(await bytes(`${this.base}/frames?first=${next}&count=1&px=${this.px}`, this.signal), index); } catch { return; } // fetched again when it is needed
      finally { this.fetching.delete(next); }
    }
  }

  // Fetch the frames from a number on for playing.
  async ahead(index) {
    const first = index - (index % this.batch);
    for (const start of [first, first + this.batch]) {
      if (start >= this.count || this.fetching.has(start) || this.bitmaps.has(Math.min(start + this.batch, this.count) - 1)) continue;
      this.fetching.add(start);
      bytes(`${this.base}/frames?first=${start}&count=${this.batch}&px=${this.px}`, this.signal)
        .then((buffer) => this.#unpack(buffer, index))
        .catch((error) => { if (error.name !== "AbortError") this.failed?.(error); })
        .finally(() => this.fetching.delete(start));
    }
  }

  async #unpack(buffer, near) {
    const view = new DataView(buffer), decoded = [];
    for (let at = 0; at + 8 <= buffer.byteLength;) {
      const index = view.getUint32(at), length = view.getUint32(at + 4);
      if (!this.bitmaps.has(index)) decoded.push(createImageBitmap(new Blob([new Uint8Array(buffer, at + 8, length)], { type: "image/jpeg" })).then((bitmap) => this.#keep(index, bitmap, near)));
      at += 8 + length;
    }
    await Promise.all(decoded); // in parallel: browsers decode on several threads
  }

  #keep(index, bitmap, near) {
    if (this.signal.aborted) { bitmap.close(); return; }
    this.bitmaps.get(index)?.close();
    this.bitmaps.set(index, bitmap);
    if (this.bitmaps.size <= this.most) return;
    let farthest = index;
    for (const other of this.bitmaps.keys()) if (Math.abs(other - near) > Math.abs(farthest - near)) farthest = other;
    if (farthest === index) return;
    this.bitmaps.get(farthest).close();
    this.bitmaps.delete(farthest);
  }
}
