// Drawing of a frame on the Marks screen: mask of the colour, blobs, centres, region, exclusions, corrections.

import { pen } from "./dom.js";
import { drawFrame, inkOf } from "./overlay.js";

// A bitmap for the mask of each mark, tinted.
export async function maskImages(seen) {
  const found = new Map();
  for (const [name, one] of Object.entries(seen.marks)) {
    const data = Uint8Array.from(atob(one.mask), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([data], { type: "image/png" }));
    const canvas = new OffscreenCanvas(bitmap.width, bitmap.height), context = canvas.getContext("2d");
    context.drawImage(bitmap, 0, 0);
    bitmap.close();
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
    for (let k = 0; k < pixels.data.length; k += 4) pixels.data[k + 3] = pixels.data[k];
    context.putImageData(pixels, 0, 0);
    context.globalCompositeOperation = "source-in";
    context.fillStyle = "#ff3cc8";
    context.fillRect(0, 0, canvas.width, canvas.height);
    found.set(name, canvas);
  }
  return found;
}

export function drawMarks(context, width, height, state, frames) {
  const scale = drawFrame(context, width, height, state.bitmap, frames);
  if (!scale) return;
  const seen = state.seen.get(state.index);
  if (seen) {
    const chosen = seen.marks[state.mark];
    if (state.showMask && chosen && state.masks.frame === state.index && state.masks.of.has(state.mark)) {
      const mask = state.masks.of.get(state.mark);
      context.globalAlpha = 0.5;
      context.imageSmoothingEnabled = false;
      context.drawImage(mask, (chosen.origin_px[0] - chosen.cell_px[0] / 2) * scale, (chosen.origin_px[1] - chosen.cell_px[1] / 2) * scale, mask.width * chosen.cell_px[0] * scale, mask.height * chosen.cell_px[1] * scale);
      context.imageSmoothingEnabled = true;
      context.globalAlpha = 1;
    }
    for (const [name, one] of Object.entries(seen.marks)) {
      for (const blob of one.blobs) circle(context, blob.x_px * scale, blob.y_px * scale, blob.radius_px * scale, blob.chosen ? inkOf(name) : "rgb(255 255 255 / .45)", blob.chosen ? 2 : 1);
      if (one.x_px !== null) cross(context, one.x_px * scale, one.y_px * scale, inkOf(name), 7);
    }
  }
  for (const row of state.rows) if (row.frame === state.index && row.x !== null) cross(context, row.x * scale, row.y * scale, "#ff5aa0", 10);
  if (state.said.region_px) box(context, state.said.region_px, scale, "#8fd0f2", [8, 5]);
  for (const one of state.said.mask_px ?? []) box(context, one, scale, "#ff8a4c", [], "rgb(255 138 76 / .25)");
  if (state.draft) box(context, state.draft, scale, "#fff", [4, 3]);
  if (state.cursor) cross(context, state.cursor[0] * scale, state.cursor[1] * scale, "#fff", 14);
  context.restore();
}

function circle(context, x, y, radius, ink, width) {
  context.strokeStyle = ink;
  context.lineWidth = pen(width);
  context.beginPath();
  context.arc(x, y, radius, 0, 7);
  context.stroke();
}

function cross(context, x, y, ink, size) {
  const reach = pen(size);
  for (const [stroke, width] of [["rgb(0 0 0 / .7)", 3.5], [ink, 1.5]]) {
    context.strokeStyle = stroke;
    context.lineWidth = pen(width);
    context.beginPath();
    context.moveTo(x - reach, y); context.lineTo(x + reach, y);
    context.moveTo(x, y - reach); context.lineTo(x, y + reach);
    context.stroke();
  }
}

function box(context, [x0, y0, x1, y1], scale, ink, dash, inside) {
  context.setLineDash(dash);
  context.strokeStyle = ink;
  context.lineWidth = pen(2);
  if (inside) { context.fillStyle = inside; context.fillRect(x0 * scale, y0 * scale, (x1 - x0) * scale, (y1 - y0) * scale); }
  context.strokeRect(x0 * scale, y0 * scale, (x1 - x0) * scale, (y1 - y0) * scale);
  context.setLineDash([]);
}
