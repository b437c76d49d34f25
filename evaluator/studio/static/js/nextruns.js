// The next experiment: drawn on the plate, and written as an experiment to be recorded.

import { post } from "./api.js";
import { color, h, num, surface } from "./dom.js";
import { boundsOf, grid, path, robot, view } from "./plate.js";
import { say } from "./say.js";

export function next_runs(content, id, signal) {
  const runs = content.next_experiment?.runs ?? [];
  if (!runs.length) return h("section", { class: "card" }, h("h2", {}, "Next experiment"), h("p", { class: "soft" }, content.verdict === "insufficient" ? "No runs of this kind would decide." : content.verdict === "unknown" ? "None is proposed for a free-form term: make it an effect of your own, below, and diagnose again." : "No further runs are needed: nothing remains to be distinguished."));
  let paths = null, body = null; // of the robot file, from the same answer
  const plate = surface((context, width, height) => {
    const placed = runs.map((run, k) => (paths ? moved(paths[k], run) : { x_mm: [run.x_mm], y_mm: [run.y_mm] }));
    const bounds = boundsOf(placed);
    const room = body ? Math.hypot(body.length_mm, body.width_mm) : 0; // for the outline at any heading
    const to = view({ x0: bounds.x0 - room, x1: bounds.x1 + room, y0: bounds.y0 - room, y1: bounds.y1 + room }, width, height);
    grid(context, to, width, height);
    runs.forEach((run, k) => {
      const ink = color(["blue", "vermillion", "green", "purple", "orange", "sky"][k % 6]);
      if (paths) path(context, to, placed[k], ink, 2);
      if (body) robot(context, to, run.x_mm, run.y_mm, run.heading_deg, ink, body);
    });
  }, signal, { class: "chart", role: "img", "aria-label": "The next runs on the plate" });
  post("/api/sandbox", { experiment: id, commands: runs.map((run) => [run.left_rpm, run.right_rpm]), duration_s: Math.max(...runs.map((run) => run.duration_s)) }, signal)
    .then((found) => { paths = found.changed; body = found.body; plate.redraw(); }).catch(say);
  const write = () => post(`/api/experiments/${id}/next`).then((made) => { say(`Written to ${made.path}.`, true); location.hash = `#/x/${made.id}/runs`; }).catch(say);
  return h("section", { class: "card stack" }, h("div", { class: "row end" }, h("h2", {}, "Next experiment"), h("button", { onclick: write }, "Write it out")),
    h("div", { class: "two" }, plate.canvas, h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ["left / right, rpm", "from x, y, mm", "heading", "for", "times"].map((text) => h("th", { scope: "col" }, text)))),
      h("tbody", {}, runs.map((run) => h("tr", {}, h("td", {}, `${num(run.left_rpm)} / ${num(run.right_rpm)}`), h("td", {}, `${num(run.x_mm)}, ${num(run.y_mm)}`), h("td", {}, `${num(run.heading_deg)}°`), h("td", {}, `${num(run.duration_s)} s`), h("td", {}, String(run.times)))))))));
}

function moved(path_of, run) {
  const cos = Math.cos((run.heading_deg * Math.PI) / 180), sin = Math.sin((run.heading_deg * Math.PI) / 180);
  return { x_mm: path_of.x_mm.map((x, k) => run.x_mm + x * cos - path_of.y_mm[k] * sin), y_mm: path_of.x_mm.map((x, k) => run.y_mm + x * sin + path_of.y_mm[k] * cos) };
}
