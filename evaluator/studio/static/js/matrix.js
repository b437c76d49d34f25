// Where model and robot disagree: a row for each run, a cell for each second; a click leads to the frames.

import { color, h, labels, num, pen, surface } from "./dom.js";

const QUANTITIES = { along_mm_s: ["speed along", "mm/s"], across_mm_s: ["sideways speed", "mm/s"], yaw_deg_s: ["turn rate", "°/s"] };
const rem = () => parseFloat(labels(1));

// A name shortened in its middle to a width, because both ends distinguish runs.
export function shortened(context, name, width) {
  for (let kept = name.length, shown = name; ; kept--) {
    if (kept < 2 || context.measureText(shown).width <= width) return shown;
    shown = `${name.slice(0, Math.ceil((kept - 1) / 2))}…${name.slice(name.length - Math.floor((kept - 1) / 2))}`;
  }
}

export function matrix(pieces, id, signal) {
  const runs = [...new Set(pieces.run)];
  let quantity = "across_mm_s", after = false, over = null;
  const last = Math.max(...pieces.time_s) * 1.04;
  const widths = new Map(runs.map((run) => { const times = pieces.time_s.filter((_, k) => pieces.run[k] === run); return [run, times.length > 1 ? times[1] - times[0] : 1]; }));
  const ROW = Math.round(1.15 * rem()), LEFT = Math.round(7.4 * rem());
  const said = h("output", { class: "small soft" });
  const made = surface((context, width, height) => {
    const values = pieces[quantity].map(Math.abs).sort((a, b) => a - b);
    const most = values[Math.floor(0.97 * (values.length - 1))] || 1;
    const column = pieces[after ? `after_${quantity}` : quantity];
    const x = (time) => LEFT + (time / last) * (width - LEFT - 6);
    context.font = labels();
    context.fillStyle = color("soft");
    runs.forEach((run, row) => context.fillText(shortened(context, run, LEFT - 8), 0, row * ROW + 0.72 * ROW));
    const inks = [color("vermillion"), color("blue")];
    pieces.run.forEach((run, k) => {
      const span = widths.get(run), row = runs.indexOf(run);
      context.globalAlpha = Math.min(1, Math.abs(column[k]) / most) * 0.95 + 0.05;
      context.fillStyle = inks[column[k] > 0 ? 1 : 0];
      context.fillRect(x(pieces.time_s[k] - span / 2), row * ROW + 1, Math.max(x(span) - x(0) - 1, 2), ROW - 2);
      context.globalAlpha = 1;
      if (k === over) { context.strokeStyle = color("ink"); context.lineWidth = pen(1.5); context.strokeRect(x(pieces.time_s[k] - span / 2), row * ROW + 1, x(span) - x(0) - 1, ROW - 2); }
    });
    context.fillStyle = color("soft");
    for (let second = 0; second <= last; second += last > 12 ? 2 : 1) context.fillText(`${second} s`, x(second) - 6, height - 4);
  }, signal, { class: "matrix", tabindex: 0, role: "application", "aria-label": "Disagreement of every run over time; arrows choose a cell, Enter shows its frame" });
  made.canvas.style.height = `${runs.length * ROW + 1.4 * rem()}px`;
  const tell = () => {
    const [words, unit] = QUANTITIES[quantity];
    said.textContent = over === null ? "Choose a cell to see what differs there, click it to see the frame." : `${pieces.run[over]} at ${num(pieces.time_s[over])} s: measured ${words} is ${num(pieces[after ? `after_${quantity}` : quantity][over], 2)} ${unit} off`;
    made.redraw();
  };
  const cell = (event) => {
    const row = Math.floor(event.offsetY / ROW), time = ((event.offsetX - LEFT) / (made.canvas.clientWidth - LEFT - 6)) * last;
    let best = null;
    pieces.run.forEach((run, k) => { if (run === runs[row] && Math.abs(pieces.time_s[k] - time) <= widths.get(run) / 2) best = k; });
    return best;
  };
  const open = (k) => { location.hash = `#/x/${id}/runs/${encodeURIComponent(pieces.run[k])}/${pieces.time_s[k]}`; };
  made.canvas.addEventListener("pointermove", (event) => { over = cell(event); made.canvas.style.cursor = over === null ? "" : "pointer"; tell(); });
  made.canvas.addEventListener("click", (event) => { const k = cell(event); if (k !== null) open(k); });
  made.canvas.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && over !== null) { open(over); return; }
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], rows = { ArrowUp: -1, ArrowDown: 1 }[event.key];
    if (!step && !rows) return;
    event.preventDefault();
    event.stopPropagation();
    const at = over ?? 0;
    if (step) over = Math.max(0, Math.min(pieces.run.length - 1, at + step));
    else { const first = pieces.run.indexOf(runs[Math.max(0, Math.min(runs.length - 1, runs.indexOf(pieces.run[at]) + rows))]); over = Math.max(first, 0); }
    tell();
  });
  const choice = (key) => h("button", { "aria-pressed": String(key === quantity), onclick: (event) => { quantity = key; for (const one of event.target.parentElement.querySelectorAll("button")) one.setAttribute("aria-pressed", String(one === event.target)); tell(); } }, QUANTITIES[key][0]);
  const sides = h("button", { "aria-pressed": "false", onclick: () => { after = !after; sides.setAttribute("aria-pressed", String(after)); tell(); } }, "After the finding");
  tell();
  return h("div", { class: "stack", style: { gap: ".6rem" } }, h("div", { class: "row" }, h("span", { class: "row", role: "group", "aria-label": "Quantity" }, Object.keys(QUANTITIES).filter((key) => pieces[key]).map(choice)), pieces[`after_${quantity}`] ? sides : null, said),
    made.canvas, h("p", { class: "small soft" }, "Blue: measured more than simulated; vermillion: less. Full colour: among the largest before the effects are included."));
}
