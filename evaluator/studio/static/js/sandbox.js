// The Sandbox: sliders for the robot and every effect; the motion is drawn again while they are dragged.

import { get, latest, post } from "./api.js";
import { color, fill, fixed, h, num, surface } from "./dom.js";
import { boundsOf, dot, grid, path, view as view_of } from "./plate.js";
import { say } from "./say.js";
import { undoing } from "./undo.js";

const OWN = [[33.3, 14.4], [14.4, 33.3], [-33.3, -14.4], [40, 40]];

export async function show(view, { id, signal }) {
  const home = id ? null : await get("/api/home", signal);
  let from = id ?? "";
  const place = h("div");
  const undo = id && undoing("sandbox", id, signal, () => load());
  const pick = home && h("select", { "aria-label": "Robot", onchange: (event) => { from = event.target.value; load().catch(say); } },
    home.robots.map((name) => h("option", { value: `robot:${name}` }, `shipped robot: ${name}`)), home.experiments.filter((one) => !one.fault).map((one) => h("option", { value: one.id }, `robot of: ${one.name}`)));
  const source = () => {
    const experiment = from.startsWith("robot:") || !from ? null : from;
    return { experiment, robot: experiment ? null : from.replace("robot:", "") || "barrel" };
  };
  const load = latest(
    () => get(`/api/sandbox?${source().experiment ? `experiment=${source().experiment}` : `robot=${source().robot}`}`, signal),
    (found) => fill(place, screen(found, source(), signal, undo)),
  );
  fill(view, h("div", { class: "row end" }, h("div", {}, h("p", { class: "kind" }, "Sandbox"), h("h1", {}, "Effects on the turns")), pick), place);
  await load();
}

function screen(found, source, signal, undo) {
  const state = { nominal: {}, effects: {}, commands: (found.commands.length ? found.commands : OWN).slice(0, 12), chosen: 0, duration: 8 };
  let changed = [], base = [], base_s = null; // base_s: duration of the motions in base
  const plate = surface((context, width, height) => {
    const to = view_of(boundsOf([...base, ...changed]), width, height, 34);
    grid(context, to, width, height);
    base.forEach((one, k) => path(context, to, one, color("soft"), k === state.chosen ? 1.6 : 1));
    changed.forEach((one, k) => path(context, to, one, color(k === state.chosen ? "vermillion" : "orange"), k === state.chosen ? 3 : 1.3));
    dot(context, to.x(0), to.y(0), 4, color("ink"));
  }, signal, { class: "chart tallchart", role: "img", "aria-label": "Motion of the robot with and without the changes" });
  const table = h("tbody");
  const took = h("output", { class: "small soft" });

  // One request at a time, always for the latest state.
  let asking = false, dirty = false, failed = false;
  const ask = async () => {
    dirty = true;
    if (asking) return;
    asking = true;
    try {
      while (dirty) {
        dirty = false;
        const begun = performance.now(), { duration } = state;
        const answer = await post("/api/sandbox", { ...source, nominal: state.nominal, effects: state.effects, commands: state.commands, duration_s: duration, base: base_s !== duration }, signal);
        changed = answer.changed;
        if (answer.base) [base, base_s] = [answer.base, duration];
        if (failed) say(""); // but not a message about a change
        failed = false;
        took.textContent = `${changed.length} runs in ${Math.round(performance.now() - begun)} ms`;
        plate.redraw();
        rows();
      }
    } catch (error) { failed = true; say(error); } finally { asking = false; }
  };
  const rows = () => fill(table, changed.map((one, k) => h("tr", { tabindex: 0, "aria-selected": String(k === state.chosen), onclick: () => { state.chosen = k; plate.redraw(); rows(); }, onkeydown: (event) => { if (event.key === "Enter") event.currentTarget.click(); } },
    h("td", {}, `${num(one.left_rpm)} / ${num(one.right_rpm)}`), h("td", {}, base[k]?.radius_mm ? fixed(base[k].radius_mm, 2) : "straight"), h("td", {}, one.radius_mm ? fixed(one.radius_mm, 2) : "straight"),
    h("td", {}, base[k]?.radius_mm && one.radius_mm ? `${one.radius_mm > base[k].radius_mm ? "+" : ""}${fixed(100 * (one.radius_mm / base[k].radius_mm - 1), 1)} %` : "–"), h("td", {}, fixed(one.speed_mm_s, 3)))));

  const slider = (one, moved, of = "") => {
    const shown = h("output", {}, `${num(one.value)} ${one.unit}`);
    const input = h("input", { type: "range", min: one.low, max: one.high, step: one.step, value: one.value, "aria-label": of ? `${one.words}, ${of}` : one.words, oninput: () => { const value = Number(input.value); shown.textContent = `${num(value)} ${one.unit}`; moved(value); ask(); } });
    return { row: h("label", { class: "slide" }, h("span", {}, one.words), input, shown), reset: () => { input.value = one.value; shown.textContent = `${num(one.value)} ${one.unit}`; } };
  };
  const effect = (one) => {
    const given = found.in_robot.find((own) => own.id === one.id);
    const sliders = one.sliders.map((own) => slider(given && given[own.key] !== undefined ? { ...own, value: Number(given[own.key]) } : own, (value) => { state.effects[one.id] = { ...(state.effects[one.id] ?? given_values(one, given)), [own.key]: value }; box.classList.add("moved"); }, one.id));
    const box = h("details", { class: "effect" }, h("summary", {}, h("span", {}, one.name), h("span", { class: "small soft" }, given ? `${one.id} · in the robot` : one.id)), h("p", { class: "small soft" }, one.sentence), sliders.map((own) => own.row),
      h("button", { class: "plain small", onclick: () => { delete state.effects[one.id]; for (const own of sliders) own.reset(); box.classList.remove("moved"); ask(); } }, "Reset"));
    return box;
  };
  const given_values = (one, given) => Object.fromEntries(one.sliders.map((own) => [own.key, given && given[own.key] !== undefined ? given[own.key] : own.value]));
  const add = source.experiment && h("button", { title: "Write the changed effects to the robot file of the experiment", onclick: () => {
    if (!Object.keys(state.effects).length) { say("Move a slider of an effect first."); return; }
    undo.make(async () => {
      const { robot } = await post(`/api/experiments/${source.experiment}/robot`, { version: found.version, effects: state.effects });
      found.version = robot.version;
      say(`Written to ${robot.path}.`, true);
    }).catch(say);
  } }, "Add to the robot");
  ask();
  return h("div", { class: "side" },
    h("section", { class: "stack", "aria-label": "Sliders" },
      h("details", { class: "effect" }, h("summary", {}, h("span", {}, "Robot"), h("span", { class: "small soft" }, "nominal values")), found.robot.map((one) => slider(one, (value) => { state.nominal[one.key] = value; }).row)),
      found.effects.map(effect)),
    h("section", { class: "stack" }, plate.canvas,
      h("div", { class: "row end" }, h("p", { class: "legend small soft" }, h("i", { class: "soft" }), "as it is", h("i", { class: "vermillion" }), "with the changes"), took, h("div", { class: "row" }, add, undo && [undo.undo, undo.redo])),
      slider({ words: "duration", unit: "s", low: 2, high: 30, step: 1, value: 8 }, (value) => { state.duration = value; }).row,
      h("div", { class: "scroll" }, h("table", {}, h("thead", {}, h("tr", {}, ["left / right, rpm", "radius, mm", "with changes, mm", "change", "speed, mm/s"].map((text) => h("th", { scope: "col" }, text)))), table))));
}
