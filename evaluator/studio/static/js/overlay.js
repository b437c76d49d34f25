// Overlay of a frame: marks with rings, heading, and trails of the centre, measured and simulated.

import { color, labels, pen } from "./dom.js";

const INKS = { green: "#5aff78", yellow: "#ffeb3c" };
export const inkOf = (name) => INKS[name.split("_")[0]] ?? "#78c8ff";
export const markNames = (marks) => Object.keys(marks).filter((key) => key.endsWith("_x_px")).map((key) => key.slice(0, -5));

// Draws a frame in the middle of a canvas and leaves the context at its corner, in a saved state that the caller restores.
// Returns canvas px per px of the frame; without a frame 0, and nothing is saved.
export function drawFrame(context, width, height, bitmap, frames) {
  if (!bitmap) {
    context.fillStyle = color("soft");
    context.font = labels(0.9);
    context.textAlign = "center";
    context.fillText("reading the frame …", width / 2, height / 2);
    context.textAlign = "start";
    return 0;
  }
  const scale = Math.min(width / frames.width, height / frames.height);
  context.save();
  context.translate((width - frames.width * scale) / 2, (height - frames.height * scale) / 2);
  context.drawImage(bitmap, 0, 0, frames.width * scale, frames.height * scale);
  return scale;
}

// trails: the paths of the run (`trailsOf`).
export function drawOverlay(context, curves, row, scale, trails) {
  const { marks, poses } = curves;
  trails(context, row + 1, scale);
  if (poses.center_x_px && Number.isFinite(poses.center_x_px[row])) {
    const [x, y, nx, ny] = [poses.center_x_px[row], poses.center_y_px[row], poses.nose_x_px[row], poses.nose_y_px[row]].map((v) => v * scale);
    context.strokeStyle = context.fillStyle = "#ff5aa0";
    context.lineWidth = pen(2);
    context.beginPath();
    context.moveTo(x, y);
    context.lineTo(nx, ny);
    context.stroke();
    context.beginPath();
    context.arc(x, y, pen(3.5), 0, 7);
    context.fill();
  }
  for (const name of markNames(marks)) ring(context, marks[`${name}_x_px`][row], marks[`${name}_y_px`][row], scale, inkOf(name));
}

function ring(context, x, y, scale, ink) {
  if (x === null || x === undefined) return;
  const radius = pen(9), arm = pen(4);
  context.lineWidth = pen(3.5);
  for (const stroke of ["rgb(0 0 0 / .55)", ink]) {
    context.strokeStyle = stroke;
    context.beginPath();
    context.arc(x * scale, y * scale, radius, 0, 7);
    context.moveTo(x * scale - arm, y * scale);
    context.lineTo(x * scale + arm, y * scale);
    context.moveTo(x * scale, y * scale - arm);
    context.lineTo(x * scale, y * scale + arm);
    context.stroke();
    context.lineWidth = pen(1.6);
  }
}

// The trails of a run, cached as an image: the simulated one is drawn once, the measured one is extended frame by frame.
export function trailsOf({ poses, simulated }, [width, height]) {
  const kept = new OffscreenCanvas(1, 1), context = kept.getContext("2d");
  let drawn = 0, zoom = 0;
  return (onto, count, scale) => {
    const wanted = scale * onto.getTransform().a;
    if (wanted !== zoom || count < drawn) {
      zoom = wanted;
      kept.width = Math.ceil(width * zoom); // which clears it
      kept.height = Math.ceil(height * zoom);
      context.scale(zoom / scale, zoom / scale);
      trail(context, simulated, 0, simulated.time_s?.length ?? 0, scale, "#ff8a4c", [6, 4]);
      drawn = 0;
    }
    trail(context, poses, Math.max(drawn - 1, 0), count, scale, "#ffffff", []);
    drawn = count;
    onto.drawImage(kept, 0, 0, width * scale, height * scale);
  };
}

function trail(context, columns, first, count, scale, ink, dash) {
  const xs = columns.center_x_px, ys = columns.center_y_px;
  if (!xs || count - first < 2) return;
  context.setLineDash(dash);
  context.lineJoin = "round";
  for (const [stroke, width] of [["rgb(0 0 0 / .45)", 3.2], [ink, 1.6]]) {
    context.strokeStyle = stroke;
    context.lineWidth = pen(width);
    context.beginPath();
    let drawing = false;
    for (let k = first; k < Math.min(count, xs.length); k++) {
      if (xs[k] === null) { drawing = false; continue; }
      drawing ? context.lineTo(xs[k] * scale, ys[k] * scale) : context.moveTo(xs[k] * scale, ys[k] * scale);
      drawing = true;
    }
    context.stroke();
  }
  context.setLineDash([]);
}

// The time axis: motors on between start and stop, frames without a mark, the frame shown.
export function drawAxis(context, width, height, state) {
  const { first, last, time, start, stop, gaps } = state;
  const at = (seconds) => 10 + ((seconds - first) / Math.max(last - first, 1e-9)) * (width - 20);
  const middle = height / 2;
  context.fillStyle = color("faint");
  context.fillRect(10, middle - 4, width - 20, 8);
  context.fillStyle = color("blue");
  context.globalAlpha = 0.45;
  const [a, b] = [at(Math.max(start, first)), at(stop ?? last)];
  context.fillRect(a, middle - 4, Math.max(b - a, 0), 8);
  context.globalAlpha = 1;
  context.fillStyle = color("vermillion");
  for (const seconds of gaps) context.fillRect(at(seconds), middle + 6, 1.5, 4);
  context.fillStyle = context.strokeStyle = color("blue");
  edge(context, a, middle, "start");
  if (stop !== null && stop !== undefined) edge(context, b, middle, "stop");
  context.fillStyle = color("ink");
  context.fillRect(at(time) - 1, 2, 2, height - 4);
  context.beginPath();
  context.arc(at(time), middle, 6.5, 0, 7);
  context.fill();
  return { at, seconds: (x) => first + ((x - 10) / (width - 20)) * (last - first) };
}

function edge(context, x, middle, kind) {
  const side = kind === "start" ? 1 : -1;
  context.lineWidth = pen(2);
  context.beginPath();
  context.moveTo(x, middle - 13);
  context.lineTo(x, middle + 13);
  context.stroke();
  context.beginPath();
  context.moveTo(x, middle - 13);
  context.lineTo(x + side * 9, middle - 9);
  context.lineTo(x, middle - 5);
  context.fill();
}
