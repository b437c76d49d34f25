// The Results screen: radius against difference of speed, trajectories, and the numbers of every run.

import { get, latest, post } from "./api.js";
import { color, counted, fill, fixed, h, labels, length, num, pen, surface } from "./dom.js";
import { jobOf, onJobs } from "./jobs.js";
import { boundsOf, dot, grid, path as draw_path, view as view_of } from "./plate.js";
import { say } from "./say.js";

export async function show(view, { id, rest, signal }) {
  const load = latest(
    () => get(`/api/experiments/${id}/results`, signal),
    (found) => fill(view, found.runs.length ? screen(found, id, rest[0], signal) : nothing(found, id)),
  );
  onJobs((_, ended) => { if (ended.some((job) => job.experiment === id)) load().catch(say); }, signal);
  await load();
}

const turns = (run) => run.radius_mm !== null && Math.abs(run.turned_deg) > 1;
const status_begins = (run, words) => String(run.radius_status).startsWith(words);
const turns_little = (run) => run.radius_mm !== null || status_begins(run, "turns too little");
const unproven = (run) => turns_little(run) || status_begins(run, "straight or");
const without_radius = (run) => (unproven(run) ? run.left_rpm === run.right_rpm : status_begins(run, "straight")) ? "straight" : turns_little(run) ? "turns < 1°" : "–";
const start = (id) => () => post(`/api/experiments/${id}/jobs`, { kind: "analyse" }).catch(say);

function nothing(found, id) {
  return h("div", { class: "stack" }, h("div", {}, h("p", { class: "kind" }, "Results"), h("h1", {}, found.name)),
    h("div", { class: "empty" }, h("h2", {}, "Nothing is measured yet"), h("p", {}, "The analysis tracks the marks in every recording, measures each turn, and simulates each run."),
      h("p", {}, h("button", { class: "main", disabled: Boolean(jobOf(id)), onclick: start(id) }, "Analyse all runs"))));
}

function screen(found, id, wanted, signal) {
  const runs = found.runs;
  let chosen = Math.max(runs.findIndex((run) => run.id === wanted), 0);
  const turning = runs.filter((run) => turns(run) && run.left_rpm !== null);
  const redraws = [];
  const rows = [];
  const choose = (index) => {
    chosen = index;
    for (const redraw of redraws) redraw();
    rows.forEach((row, k) => row.setAttribute("aria-selected", String(k === index)));
    fill(detail, facts(runs[index], id));
  };
  const detail = h("div", { class: "card" });
  const points = radius_chart(turning, () => runs[chosen], (run) => choose(runs.indexOf(run)), signal);
  const plate = trajectory(() => runs[chosen], (run, time) => { location.hash = frames_of(id, run, time); }, signal);
  redraws.push(points.redraw, plate.redraw);
  const table = h("table", {}, h("thead", {}, h("tr", {}, ["run", "left / right, rpm", "radius, mm", "95 %", "simulated, mm", "speed, mm/s", "path gap, mm"].map((text) => h("th", { scope: "col" }, text)))),
    h("tbody", {}, runs.map((run, index) => {
      const row = h("tr", { tabindex: 0, onclick: () => choose(index), onkeydown: (event) => { if (event.key === "Enter") choose(index); if (event.key === "ArrowDown") row.nextSibling?.focus(); if (event.key === "ArrowUp") row.previousSibling?.focus(); } },
        h("td", {}, run.id), h("td", {}, `${num(run.left_rpm)} / ${num(run.right_rpm)}`),
        h("td", { title: turns(run) ? null : run.radius_status }, turns(run) ? fixed(run.radius_mm, 3) : without_radius(run)), h("td", {}, turns(run) ? `${fixed(run.radius_low_mm, 3)} to ${fixed(run.radius_high_mm, 3)}` : ""),
        h("td", {}, run.simulated_radius_mm === null ? "–" : fixed(run.simulated_radius_mm, 3)), h("td", {}, fixed(run.speed_mm_s, 3)), h("td", {}, fixed(run.gap_rms_mm, 3)));
      rows.push(row);
      return row;
    })));
  const notice = h("div");
  // Whether it is up to date is shown later, because every recording has to be read.
  get(`/api/experiments/${id}/state`, signal).then((state) => {
    const stale = Object.values(state.outdated).filter((steps) => steps.length).length;
    fill(notice, stale > 0 && h("p", { class: "notice row end" }, `The experiment, its robot or its recordings changed after this analysis of ${counted(stale, "run")}.`,
      h("button", { disabled: Boolean(jobOf(id)), onclick: start(id) }, "Analyse again")));
  }).catch(say);
  const box = h("div", { class: "stack" },
    h("div", { class: "row end" }, h("div", {}, h("p", { class: "kind" }, "Results"), h("h1", {}, found.name)),
      h("dl", { class: "figures" }, figure("runs measured", runs.length), figure("gap of model and robot", found.gap_mm === null ? "–" : length(found.gap_mm), "gap", found.gap_mm))),
    notice,
    h("div", { class: "two" },
      h("section", { class: "card" }, h("h2", {}, "Radius against difference of speed"), points.canvas, h("p", { class: "legend small soft" }, h("i", { class: "blue" }), "measured, 95 % interval", h("i", { class: "vermillion dashed" }), "simulated (square)"), h("p", { class: "small soft" }, "Where a square lies outside the interval, model and robot disagree, or the marks are not where robot.toml says. Click a point to see its run.")),
      h("section", { class: "card" }, h("h2", {}, "Trajectory"), plate.canvas, h("p", { class: "legend small soft" }, h("i", { class: "ink" }), "measured centre", h("i", { class: "vermillion dashed" }), "simulated", h("i", { class: "blue" }), "circle of minimum radius"), h("p", { class: "small soft" }, "Click a point of the path to see its frame."))),
    detail,
    h("section", { class: "scroll wide tall" }, table));
  choose(chosen);
  return box;
}

function figure(words, value, name, raw) {
  return h("div", {}, h("dt", {}, words), h("dd", { "data-figure": name ?? null, "data-value": raw ?? null }, String(value)));
}

const frames_of = (id, run, time) => `#/x/${id}/runs/${encodeURIComponent(run.id)}/${time}`;

function facts(run, id) {
  const at = run.sustained_from_s ?? 0;
  return h("div", { class: "row end" },
    h("div", {}, h("h3", {}, run.id), h("p", { class: "soft" }, `${num(run.left_rpm)} / ${num(run.right_rpm)} rpm. ${!turns(run) ? `${run.radius_status}`.replaceAll(" -", " −") : `Radius ${fixed(run.radius_mm, 3)} mm, simulated ${fixed(run.simulated_radius_mm, 3)} mm. It turned by ${fixed(run.turned_deg, 0)}°.`}`)),
    run.has_video && h("a", { class: "button", href: frames_of(id, run, at) }, "See its frames"));
}

// Ticks of the logarithmic axis, mm. It extends to the next tick on either side, so that it shows at least two.
const TICKS = [-2, -1, 0, 1, 2, 3, 4].flatMap((power) => [1, 2, 5].map((digit) => Number(`${digit}e${power}`)));

function radius_chart(runs, chosen, choose, signal) {
  let places = [];
  const made = surface((context, width, height) => {
    if (!runs.length) { context.fillStyle = color("soft"); context.font = labels(1); context.fillText("No run turns.", 20, 30); return; }
    const rem = parseFloat(labels(1)), left = 3.6 * rem, right = rem, top = 0.7 * rem, bottom = 2.6 * rem;
    const difference = (run) => Math.abs(run.left_rpm - run.right_rpm);
    const values = runs.flatMap((run) => [run.radius_low_mm, run.radius_high_mm, run.radius_mm, run.simulated_radius_mm]).filter((v) => v > 0);
    const y0 = Math.log(TICKS.findLast((tick) => tick < Math.min(...values)) ?? TICKS[0]), y1 = Math.log(TICKS.find((tick) => tick > Math.max(...values)) ?? TICKS.at(-1)), x1 = Math.max(...runs.map(difference)) * 1.06;
    const x = (v) => left + (v / x1) * (width - left - right), y = (v) => height - bottom - ((Math.log(v) - y0) / (y1 - y0)) * (height - top - bottom);
    context.font = labels();
    context.strokeStyle = color("faint");
    context.fillStyle = color("soft");
    context.beginPath();
    for (const value of TICKS) {
      if (Math.log(value) < y0 - 1e-9 || Math.log(value) > y1 + 1e-9) continue;
      context.moveTo(left, y(value)); context.lineTo(width - right, y(value));
      context.fillText(String(value), 1.5 * rem, y(value) + 4);
    }
    const step = [1, 2, 5, 10, 20, 50].find((s) => x1 / s <= 8) ?? 100;
    for (let value = 0; value <= x1; value += step) { context.moveTo(x(value), top); context.lineTo(x(value), height - bottom); context.fillText(String(value), x(value) - 5, height - bottom + rem); }
    context.stroke();
    context.fillText("difference of rotational frequency, rpm", left + (width - left) / 2 - 8 * rem, height - 5);
    context.save(); context.translate(0.8 * rem, height / 2 + 4 * rem); context.rotate(-Math.PI / 2); context.fillText("minimum turning radius, mm", -20, 0); context.restore();
    places = runs.map((run) => ({ run, x: x(difference(run)), y: y(run.radius_mm) }));
    for (const { run, x: px, y: py } of places) {
      context.strokeStyle = color("blue");
      context.lineWidth = pen(1.4);
      context.beginPath();
      if (run.radius_high_mm > 0) { context.moveTo(px, y(run.radius_low_mm)); context.lineTo(px, y(run.radius_high_mm)); }
      context.stroke();
      if (run === chosen()) { context.strokeStyle = color("ink"); context.beginPath(); context.arc(px, py, pen(9), 0, 7); context.stroke(); }
      dot(context, px, py, 4, color("blue"));
      if (run.simulated_radius_mm > 0) { context.strokeStyle = color("vermillion"); context.strokeRect(px - rem / 3, y(run.simulated_radius_mm) - rem / 3, rem / 1.5, rem / 1.5); }
    }
  }, signal, { class: "chart", role: "img", "aria-label": "Minimum turning radius of every run against the difference of its wheel speeds; the table below holds the numbers" });
  made.canvas.addEventListener("click", (event) => {
    const near = places.map((one) => ({ ...one, d: Math.hypot(one.x - event.offsetX, one.y - event.offsetY) })).sort((a, b) => a.d - b.d)[0];
    if (near && near.d < 24) choose(near.run);
  });
  return made;
}

// open(run, time) is called for a click on a measured path with a recording.
function trajectory(chosen, open, signal) {
  let to = null;
  const made = surface((context, width, height) => {
    const run = chosen();
    const circle = run.center_x_mm !== null && run.radius_mm !== null && Math.abs(run.turned_deg) > 20;
    to = view_of(boundsOf([run.path, run.simulated ?? run.path]), width, height, 40);
    grid(context, to, width, height);
    if (circle) {
      context.strokeStyle = color("blue");
      context.lineWidth = pen(1);
      context.beginPath();
      context.arc(to.x(run.center_x_mm), to.y(run.center_y_mm), Math.abs(run.radius_mm) * to.scale, 0, 7);
      context.stroke();
    }
    draw_path(context, to, run.path, color("ink"), 2.4);
    if (run.simulated) draw_path(context, to, run.simulated, color("vermillion"), 1.6, [6, 4]);
    dot(context, to.x(run.path.x_mm[0]), to.y(run.path.y_mm[0]), 4.5, color("ink"));
  }, signal, { class: "chart", role: "img", "aria-label": "Trajectory of the chosen run, measured and simulated" });
  const near = ({ offsetX, offsetY }) => {
    const { path, has_video } = chosen();
    const distances = path.x_mm.map((x, k) => Math.hypot(to.x(x) - offsetX, to.y(path.y_mm[k]) - offsetY)), least = Math.min(...distances);
    return has_video && least < 24 ? path.time_s[distances.indexOf(least)] : null;
  };
  made.canvas.addEventListener("pointermove", (event) => { made.canvas.style.cursor = near(event) === null ? "" : "pointer"; });
  made.canvas.addEventListener("click", (event) => { const time = near(event); if (time !== null) open(chosen(), time); });
  return made;
}
