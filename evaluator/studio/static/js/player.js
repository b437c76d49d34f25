// One recording, frame by frame, with the measurement drawn on it, and curves over time.

import { get } from "./api.js";
import { curvePlot } from "./curves.js";
import { fill, fixed, h, surface } from "./dom.js";
import { Frames } from "./frames.js";
import { drawAxis, drawFrame, drawOverlay, markNames, trailsOf } from "./overlay.js";
import { say } from "./say.js";

const GRAB_PX = 9;

// run: {id, start_s, stop_s, video}; changed(key, seconds): called when start or stop was dragged.
export async function player(place, experiment, run, { signal, changed, at }) {
  const base = `/api/experiments/${experiment}/runs/${encodeURIComponent(run.id)}`;
  const state = { index: 0, bitmap: null, exact: true, playing: false, start: run.start_s ?? 0, stop: run.stop_s ?? null, overlay: true };
  const frames = new Frames(base, signal, (index, bitmap, exact) => {
    if (exact && index !== state.index) return;
    Object.assign(state, { bitmap, exact });
    screen.redraw();
  });
  frames.failed = say;
  fill(place, h("p", { class: "soft" }, "Reading the times of the frames …"));
  const [, curves] = await Promise.all([frames.open(), get(`${base}/curves`, signal)]);
  if (signal.aborted) return null;
  const first = frames.times[0], last = frames.times[frames.count - 1];
  const rows = new Map((curves.marks.frame ?? []).map((frame, row) => [frame, row]));
  const gaps = (curves.marks.time_s ?? []).filter((_, row) => markNames(curves.marks).some((name) => curves.marks[`${name}_x_px`][row] === null));

  const trails = trailsOf(curves, [frames.width, frames.height]);
  const screen = surface((context, width, height) => {
    const scale = drawFrame(context, width, height, state.bitmap, frames);
    if (!scale) return;
    if (state.overlay && state.exact && rows.has(state.index)) drawOverlay(context, curves, rows.get(state.index), scale, trails);
    context.restore();
  }, signal, { class: "film", role: "img", "aria-label": `Frame of ${run.id}`, tabindex: 0 });
  screen.canvas.style.aspectRatio = `${frames.width} / ${frames.height}`;

  let map = null;
  const axis = surface((context, width, height) => {
    map = drawAxis(context, width, height, { first, last, time: frames.times[state.index], start: state.start, stop: state.stop, gaps });
  }, signal, { class: "axis", tabindex: 0, role: "slider", "aria-label": "Time", "aria-valuemin": 0, "aria-valuemax": frames.count - 1 });

  const clock = h("output", { class: "clock" });
  const plots = h("div", { class: "plots" });
  const heads = [];
  if (curves.poses.time_s) {
    for (const [title, column] of [["heading, °", "heading_deg"], ["speed, mm/s", "speed_mm_s"], ["turn rate, °/s", "yaw_rate_deg_s"]]) {
      const lines = [{ label: "measured", values: curves.poses[column], ink: "blue" }];
      if (curves.simulated.time_s?.length === curves.poses.time_s.length) lines.push({ label: "simulated", values: curves.simulated[column], ink: "vermillion", dash: [6, 4] });
      const plot = curvePlot(title, curves.poses.time_s, lines, { signal, seek: (time) => go(frames.indexAt(time)), timed: column === "yaw_rate_deg_s" });
      plots.append(plot.box);
      heads.push(plot);
    }
  }

  const go = (index, near = false) => {
    state.index = Math.max(0, Math.min(frames.count - 1, index));
    frames.show(state.index, near);
    const time = frames.times[state.index];
    clock.textContent = `${fixed(time, 3)} s · frame ${state.index} of ${frames.count - 1}`;
    axis.canvas.setAttribute("aria-valuenow", state.index);
    axis.canvas.setAttribute("aria-valuetext", clock.textContent);
    axis.redraw();
    for (const head of heads) head.at(time);
  };

  const play = h("button", { "aria-label": "Play", title: "Play (space)", onclick: () => (state.playing ? pause() : start()) }, "▶");
  const pause = () => { state.playing = false; play.textContent = "▶"; play.setAttribute("aria-label", "Play"); };
  const start = () => {
    if (state.index >= frames.count - 1) go(0);
    state.playing = true;
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "Pause");
    let begun = performance.now(), from = frames.times[state.index];
    const tick = (now) => {
      if (!state.playing || signal.aborted) return;
      const due = frames.indexAt(from + (now - begun) / 1000);
      frames.ahead(due);
      if (frames.bitmaps.has(due)) { if (due !== state.index) go(due); }
      else { begun = now; from = frames.times[state.index]; frames.ahead(state.index + 1); } // wait for frames rather than skip them
      if (due >= frames.count - 1 && state.index >= frames.count - 1) { pause(); return; }
      requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  };

  const setEdge = (key, seconds) => {
    state[key === "start_s" ? "start" : "stop"] = seconds;
    axis.redraw();
    changed(key, seconds);
  };
  const here = (key) => () => setEdge(key, Math.round(frames.times[state.index] * 1000) / 1000);
  dragging(axis.canvas, state, () => map, { go: (time, near) => { pause(); go(frames.indexAt(time), near); }, moved: () => axis.redraw(), dropped: setEdge }, { first, last });

  const keys = (event) => {
    if (event.target.closest?.("input, select, textarea, dialog, button") && event.key === " ") return;
    if (event.target.closest?.("input, select, textarea, dialog") || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = event.shiftKey ? 10 : 1;
    const act = { ArrowLeft: () => go(state.index - step), ArrowRight: () => go(state.index + step), Home: () => go(0), End: () => go(frames.count - 1),
      " ": () => (state.playing ? pause() : start()), s: here("start_s"), e: here("stop_s"), o: () => overlay.click() }[event.key];
    if (!act) return;
    event.preventDefault();
    if (event.key.startsWith("Arrow")) pause();
    act();
  };
  document.addEventListener("keydown", keys, { signal });

  const overlay = h("button", { class: "small", "aria-pressed": "true", title: "Show what was measured (o)", onclick: () => {
    state.overlay = !state.overlay;
    overlay.setAttribute("aria-pressed", String(state.overlay));
    screen.redraw();
  } }, "Overlay");
  const step = (by, label, text) => h("button", { "aria-label": label, title: label, onclick: () => { pause(); go(state.index + by); } }, text);
  fill(place, screen.canvas, axis.canvas,
    h("div", { class: "row" }, step(-1, "One frame back (←)", "‹"), play, step(1, "One frame on (→)", "›"), clock,
      h("span", { class: "push row" }, overlay,
        h("button", { class: "small", onclick: here("start_s"), title: "The motors start in this frame (s)" }, "Start here"),
        h("button", { class: "small", onclick: here("stop_s"), title: "The motors stop in this frame (e)" }, "Stop here"))),
    curves.poses.time_s ? [h("p", { class: "legend small soft" }, h("i", { class: "blue" }), "measured", h("i", { class: "vermillion dashed" }), "simulated"), plots]
      : h("p", { class: "soft" }, "Not analysed yet: the curves and the overlay appear after “Analyse”."));
  go(at !== undefined ? frames.indexAt(at) : 0);
  return { time: () => frames.times[state.index], edges: (start, stop) => { state.start = start ?? 0; state.stop = stop ?? null; axis.redraw(); } };
}

// Dragging on the time axis: start or stop of the command if one is grabbed, else the frame that is shown.
function dragging(canvas, state, mapOf, act, bounds) {
  let held = null;
  const near = (x) => {
    const map = mapOf();
    const edges = [["start_s", state.start], ["stop_s", state.stop]].filter(([, at]) => at !== null);
    return edges.find(([, at]) => Math.abs(map.at(Math.max(at, bounds.first)) - x) < GRAB_PX)?.[0];
  };
  const seconds = (event) => Math.max(bounds.first, Math.min(bounds.last, mapOf().seconds(event.offsetX)));
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    held = (event.offsetY < canvas.clientHeight / 2 + 4 && near(event.offsetX)) || "time";
    if (held === "time") act.go(seconds(event), true);
  });
  canvas.addEventListener("pointermove", (event) => {
    canvas.style.cursor = held === null ? (near(event.offsetX) ? "ew-resize" : "pointer") : "ew-resize";
    if (held === null) return;
    if (held !== "time") { state[held === "start_s" ? "start" : "stop"] = seconds(event); act.moved(); }
    act.go(seconds(event), true);
  });
  canvas.addEventListener("pointercancel", () => { held = null; });
  canvas.addEventListener("pointerup", (event) => {
    if (held === null) return;
    const at = seconds(event);
    act.go(at, false);
    if (held !== "time") act.dropped(held, Math.round(at * 1000) / 1000);
    held = null;
  });
}
