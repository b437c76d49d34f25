// The plate from above, mm: x to the right, y upward, one scale for both.

import { color, labels, pen } from "./dom.js";

export function view(bounds, width, height, margin = 26) {
  const wide = Math.max(bounds.x1 - bounds.x0, 1), tall = Math.max(bounds.y1 - bounds.y0, 1);
  const scale = Math.min((width - 2 * margin) / wide, (height - 2 * margin) / tall);
  const left = width / 2 - ((bounds.x0 + bounds.x1) / 2) * scale, base = height / 2 + ((bounds.y0 + bounds.y1) / 2) * scale;
  return { scale, x: (mm) => left + mm * scale, y: (mm) => base - mm * scale, mmx: (px) => (px - left) / scale, mmy: (px) => (base - px) / scale };
}

export function boundsOf(paths) {
  const found = { x0: Infinity, x1: -Infinity, y0: Infinity, y1: -Infinity };
  for (const { x_mm: xs, y_mm: ys } of paths) {
    for (let k = 0; k < xs.length; k++) {
      if (xs[k] === null) continue;
      found.x0 = Math.min(found.x0, xs[k]); found.x1 = Math.max(found.x1, xs[k]);
      found.y0 = Math.min(found.y0, ys[k]); found.y1 = Math.max(found.y1, ys[k]);
    }
  }
  return Number.isFinite(found.x0) ? found : { x0: -10, x1: 10, y0: -10, y1: 10 };
}

export function grid(context, to, width, height) {
  const power = 10 ** Math.floor(Math.log10(44 / to.scale)); // lines at 1, 2 or 5 times a power of ten, 44 px apart
  const step = Math.max([1, 2, 5, 10].find((times) => times * power * to.scale >= 44) * power, 1);
  context.strokeStyle = color("faint");
  context.fillStyle = color("soft");
  context.lineWidth = pen(1);
  context.font = labels();
  context.beginPath();
  for (let x = Math.ceil(to.mmx(0) / step) * step; to.x(x) < width; x += step) {
    context.moveTo(Math.round(to.x(x)) + 0.5, 0);
    context.lineTo(Math.round(to.x(x)) + 0.5, height);
    if (to.x(x) < width - 56) context.fillText(String(x).replace("-", "−"), to.x(x) + 3, height - 4); // room for "mm"
  }
  for (let y = Math.ceil(to.mmy(height) / step) * step; to.y(y) > 0; y += step) {
    context.moveTo(0, Math.round(to.y(y)) + 0.5);
    context.lineTo(width, Math.round(to.y(y)) + 0.5);
    if (to.y(y) > 16 && to.y(y) < height - 16) context.fillText(String(y).replace("-", "−"), 3, to.y(y) - 3);
  }
  context.stroke();
  context.textAlign = "right";
  context.fillText("mm", width - 4, height - 4);
  context.textAlign = "start";
}

export function path(context, to, { x_mm: xs, y_mm: ys }, ink, width = 1.5, dash = []) {
  context.strokeStyle = ink;
  context.lineWidth = pen(width);
  context.lineJoin = "round";
  context.setLineDash(dash);
  context.beginPath();
  for (let k = 0; k < xs.length; k++) k ? context.lineTo(to.x(xs[k]), to.y(ys[k])) : context.moveTo(to.x(xs[k]), to.y(ys[k]));
  context.stroke();
  context.setLineDash([]);
}

export function dot(context, x, y, radius, ink) {
  context.fillStyle = ink;
  context.beginPath();
  context.arc(x, y, pen(radius), 0, 7);
  context.fill();
}

// The robot's outline at a pose. body: its length and width in mm.
export function robot(context, to, x, y, heading, ink, { length_mm: length, width_mm: width }) {
  context.save();
  context.translate(to.x(x), to.y(y));
  context.rotate((-heading * Math.PI) / 180);
  context.strokeStyle = ink;
  context.lineWidth = pen(1.2);
  context.strokeRect((-length / 2) * to.scale, (-width / 2) * to.scale, length * to.scale, width * to.scale);
  context.beginPath();
  context.moveTo(0, 0);
  context.lineTo(0.8 * length * to.scale, 0); // beyond the front, which shows the heading
  context.stroke();
  context.restore();
}
