// The Marks screen: candidates of the tracker, colours set by a click, region and exclusions drawn, frames corrected by hand.

import { get, post } from "./api.js";
import { fill, fixed, h, num, pen, surface } from "./dom.js";
import { Frames } from "./frames.js";
import { drawMarks, maskImages } from "./markdrawing.js";
import { inkOf } from "./overlay.js";
import { pointing } from "./pointing.js";
import { say } from "./say.js";
import { undoing } from "./undo.js";

const HALF_HUE = 25; // degrees to either side of a clicked colour: half the distance of neighbouring named hues
const SHEET = 8;
const TOOLS = [["color", "Set the colour"], ["region", "Draw the region"], ["mask", "Draw an exclusion"], ["place", "Place by hand"]];
const HINTS = {
  color: (mark) => `Click the ${mark} mark to have its colour searched for in all frames.`,
  region: () => "Drag over the part of the image in which marks are searched for.",
  mask: () => "Drag over what is not to be searched, for example a reflection.",
  place: (mark) => `Click the centre of the ${mark} mark; this holds for this frame only.`,
};

export async function show(view, { id, rest, signal }) {
  const [table, file] = await Promise.all([get(`/api/experiments/${id}`, signal), get(`/api/experiments/${id}/tracking`, signal)]);
  const runs = table.rows.filter((row) => row.video && row.id);
  const head = h("div", {}, h("p", { class: "kind" }, "Marks"), h("h1", {}, "Candidates for marks"));
  if (!runs.length) { fill(view, head, h("div", { class: "empty" }, h("h2", {}, "No recording yet"), h("p", {}, "Add runs with a video on the screen “Runs”."))); return; }
  const run = runs.find((row) => row.id === rest[0]) ?? runs[0];
  const pick = h("select", { "aria-label": "Run", onchange: (event) => { location.hash = `#/x/${id}/marks/${encodeURIComponent(event.target.value)}`; } }, runs.map((row) => h("option", { value: row.id, selected: row === run }, row.id)));
  const place = h("div");
  fill(view, h("div", { class: "row end" }, head, pick), place);
  await workbench(place, id, run, file, signal);
}

async function workbench(place, id, run, file, signal) {
  const base = `/api/experiments/${id}/runs/${encodeURIComponent(run.id)}`;
  const state = { index: 0, bitmap: null, said: settings(file), version: file.version, mark: "green", tool: "color", seen: new Map(), masks: { of: new Map(), frame: -1 }, draft: null, cursor: null, showMask: true, rows: [], correctionsVersion: "" };
  if (!state.said.mark[state.mark]) [state.mark] = Object.keys(state.said.mark);
  const frames = new Frames(base, signal, (index, bitmap) => { state.bitmap = bitmap; if (index === state.index) screen.redraw(); });
  frames.failed = say;
  await frames.open();
  const corrections = await get(`${base}/corrections`, signal);
  state.rows = corrections.rows;
  state.correctionsVersion = corrections.version;

  const screen = surface((context, width, height) => drawMarks(context, width, height, state, frames), signal, { class: "film pick", tabindex: 0, role: "application", "aria-label": "Frame with the candidates for marks; arrows move a cross, with Shift ten pixels, Enter acts like a click" });
  screen.canvas.style.aspectRatio = `${frames.width} / ${frames.height}`;
  const readout = h("div", { class: "stack" });
  const sheet = h("div", { class: "contact" });
  const scrub = h("input", { type: "range", min: 0, max: frames.count - 1, value: 0, "aria-label": "Frame", oninput: () => go(Number(scrub.value), true), onchange: () => go(Number(scrub.value)) });
  const clock = h("output", { class: "clock" });

  const go = (index, dragging = false) => {
    state.index = Math.max(0, Math.min(frames.count - 1, index));
    scrub.value = state.index;
    clock.textContent = `${fixed(frames.times[state.index], 3)} s · frame ${state.index} of ${frames.count - 1}`;
    frames.show(state.index, dragging);
    if (!dragging) look();
    screen.redraw();
  };

  // Only the latest frame is searched: a search takes a tenth of a second, dragging is faster.
  let asking = false, again = false;
  const look = async () => {
    again = true;
    if (asking) return;
    asking = true;
    try {
      while (again && !signal.aborted) {
        again = false;
        const index = state.index;
        const { frames: [seen] } = await post(`${base}/look`, { frames: [index], said: state.said }, signal);
        state.seen.set(index, seen);
        state.masks = { of: await maskImages(seen), frame: index };
        if (index === state.index) { screen.redraw(); tell(); }
      }
    } catch (error) { say(error); } finally { asking = false; }
  };
  const contact = async () => {
    const chosen = Array.from({ length: SHEET }, (_, k) => Math.round((k + 0.5) * (frames.count - 1) / SHEET));
    try {
      const found = await post(`${base}/look`, { frames: chosen, said: state.said }, signal);
      fill(sheet, found.frames.map((seen) => thumb(seen)));
    } catch (error) { say(error); }
  };
  const thumb = (seen) => {
    const missing = Object.entries(seen.marks).filter(([, one]) => one.status !== "ok");
    const small = surface((context, width, height) => {
      if (image.complete && image.naturalWidth) context.drawImage(image, 0, 0, width, height);
      for (const [name, one] of Object.entries(seen.marks)) {
        if (one.x_px === null) continue;
        context.strokeStyle = inkOf(name);
        context.lineWidth = pen(2);
        context.beginPath();
        context.arc((one.x_px / frames.width) * width, (one.y_px / frames.height) * height, pen(6), 0, 7);
        context.stroke();
      }
    }, signal);
    small.canvas.style.aspectRatio = `${frames.width} / ${frames.height}`;
    const image = new Image();
    image.onload = () => small.redraw();
    image.src = `${base}/frame?index=${seen.frame}&px=320`;
    return h("button", { class: missing.length ? "missing" : "", onclick: () => go(seen.frame), title: missing.map(([name, one]) => `${name}: ${one.status}`).join("; ") || "all marks found" }, small.canvas, h("span", { class: "small" }, `${fixed(seen.time_s, 2)} s${missing.length ? ` · no ${missing.map(([name]) => name).join(", ")}` : ""}`));
  };

  const tell = () => {
    const seen = state.seen.get(state.index);
    fill(readout, Object.keys(state.said.mark).map((name) => {
      const one = seen?.marks[name], own = state.said.mark[name], hand = state.rows.find((row) => row.frame === state.index && row.mark === name);
      const [low, high] = own.hue_deg ?? one?.hue_range_deg ?? [0, 0];
      const place_of = !one ? "…" : one.status === "ok" ? `centre ${fixed(one.x_px, 2)}, ${fixed(one.y_px, 2)} px · sigma ${num(one.x_sigma_px, 2)} px` : one.status;
      return h("div", { class: `card markcard ${state.mark === name ? "chosen" : ""}` },
        h("label", { class: "row" }, h("input", { type: "radio", name: "mark", checked: state.mark === name, onchange: () => { state.mark = name; tell(); } }), h("strong", {}, name), h("i", { class: "hue", style: { background: `linear-gradient(90deg, hsl(${low} 90% 50%), hsl(${(low + high) / 2} 90% 50%), hsl(${high} 90% 50%))` } }), h("span", { class: "small soft" }, !own.hue_deg && !one ? "…" : `hue ${Math.round(low)}° to ${Math.round(high)}°${own.hue_deg ? "" : " (default)"}`)),
        h("p", { class: `small ${one && one.status !== "ok" ? "warn" : ""}` }, place_of), hand && h("p", { class: "small" }, hand.x === null ? "dropped by hand in this frame" : `placed by hand at ${fixed(hand.x, 1)}, ${fixed(hand.y, 1)} px`),
        one && one.status !== "ok" && one.blobs.length ? h("ul", { class: "plainlist small soft" }, one.blobs.slice(0, 3).map((blob) => h("li", {}, `at ${Math.round(blob.x_px)}, ${Math.round(blob.y_px)}: ${blob.verdict}`))) : null);
    }));
    boxes();
    hint.textContent = HINTS[state.tool](state.mark.replaceAll("_", " "));
  };

  const save = (said) => {
    const before = state.said;
    state.said = said;
    say("");
    tell();
    look();
    undo.make(async () => {
      try {
        const next = await post(`/api/experiments/${id}/tracking`, { version: state.version, said: stored(said) }, signal);
        state.version = next.version;
        path.textContent = `Saved in ${next.path}.`;
        contact();
      } catch (error) {
        state.said = before;
        say(error);
        if (error.status === 409) { const next = await get(`/api/experiments/${id}/tracking`, signal); state.said = settings(next); state.version = next.version; }
        tell();
        look();
      }
    }).catch(say);
  };
  const correct = (x, y) => {
    const { index: frame, mark } = state;
    const rows = () => [...state.rows.filter((row) => row.frame !== frame || row.mark !== mark), ...(x === undefined ? [] : [{ frame, mark, x, y }])];
    undo.make(async () => {
      const next = await post(`${base}/corrections`, { version: state.correctionsVersion, rows: rows() }, signal);
      state.rows = next.rows;
      state.correctionsVersion = next.version;
      path.textContent = `Saved in ${next.path}: the next analysis uses it.`;
      tell();
      screen.redraw();
    }).catch(say);
  };
  const undo = undoing("marks", id, signal, async () => {
    const [settled, corrected] = await Promise.all([get(`/api/experiments/${id}/tracking`, signal), get(`${base}/corrections`, signal)]);
    Object.assign(state, { said: settings(settled), version: settled.version, rows: corrected.rows, correctionsVersion: corrected.version });
    tell();
    look();
    await contact();
  }, run.id);

  const press = (x, y) => {
    if (state.tool === "place") { correct(x, y); return; }
    const blobs = Object.values(state.seen.get(state.index)?.marks ?? {}).flatMap((one) => one.blobs);
    const near = blobs.map((blob) => ({ blob, d: Math.hypot(blob.x_px - x, blob.y_px - y) / Math.max(blob.radius_px, 4) })).sort((a, b) => a.d - b.d)[0];
    if (!near || near.d > 2) { say("No colour here; click the middle of a mark."); return; }
    const { color: _, ...own } = state.said.mark[state.mark];
    const hue = Math.round(near.blob.hue_deg);
    save({ ...state.said, mark: { ...state.said.mark, [state.mark]: { ...own, hue_deg: [hue - HALF_HUE, hue + HALF_HUE] } } });
  };
  const drawn = (box) => {
    if (box[2] - box[0] < 4 || box[3] - box[1] < 4) return;
    save(state.tool === "region" ? { ...state.said, region_px: box } : { ...state.said, mask_px: [...(state.said.mask_px ?? []), box] });
  };
  // Start of the cross: the chosen mark, if it was found.
  const start = () => {
    const one = state.seen.get(state.index)?.marks[state.mark];
    return one && one.x_px !== null ? [Math.round(one.x_px), Math.round(one.y_px)] : [Math.round(frames.width / 2), Math.round(frames.height / 2)];
  };
  pointing(screen, frames, state, { draws: () => state.tool === "region" || state.tool === "mask", press, drawn, start });
  document.addEventListener("keydown", (event) => {
    if (event.target.closest?.("input:not([type=radio]), select, textarea") || event.ctrlKey || event.metaKey) return;
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step && event.target.type !== "radio") { event.preventDefault(); go(state.index + step * (event.shiftKey ? 10 : 1)); }
    if (event.key === "Delete") correct(null, null);
  }, { signal });

  const path = h("p", { class: "small soft" }, file.version ? `Settings: ${file.path}` : "No settings yet: the tracker uses its defaults.");
  const tools = h("div", { class: "row", role: "group", "aria-label": "What a click does" }, TOOLS.map(([tool, words]) => h("button", { "aria-pressed": String(tool === state.tool), onclick: (event) => { state.tool = tool; for (const one of tools.children) one.setAttribute("aria-pressed", String(one === event.currentTarget)); tell(); } }, words)));
  const hint = h("p", { class: "small soft" });
  const shapes = h("div", { class: "row" });
  const boxes = () => fill(shapes,
    state.said.region_px && h("button", { class: "small", onclick: () => { const { region_px: _, ...other } = state.said; save(other); } }, "Remove the region"),
    (state.said.mask_px ?? []).map((_, k) => h("button", { class: "small", onclick: () => save({ ...state.said, mask_px: state.said.mask_px.filter((__, other) => other !== k) }) }, `Remove exclusion ${k + 1}`)),
    state.rows.some((row) => row.frame === state.index && row.mark === state.mark) && h("button", { class: "small", onclick: () => correct() }, "Undo the correction here"));
  fill(place, h("div", { class: "split" },
    h("section", { class: "stack" }, h("div", {}, tools, hint), screen.canvas, h("div", { class: "row" }, h("span", { style: { flex: "1 1 14rem" } }, scrub), clock),
      h("div", { class: "row" }, h("label", {}, h("input", { type: "checkbox", checked: true, onchange: (event) => { state.showMask = event.target.checked; screen.redraw(); } }), "Show the mask"), h("button", { onclick: () => correct(null, null), title: "Do not use the chosen mark in this frame (Delete)" }, "Drop the mark in this frame"), undo.undo, undo.redo), shapes, path),
    h("section", { class: "stack" }, readout, h("h2", {}, "Eight frames"), sheet)));
  tell();
  go(0);
  contact();
}

function settings({ said, sought }) {
  const { format: _, ...own } = said;
  return { ...own, mark: own.mark && Object.keys(own.mark).length ? own.mark : sought };
}

function stored(said) {
  const { mask_px: boxes, ...other } = said;
  return boxes?.length ? { ...other, mask_px: boxes } : other;
}
