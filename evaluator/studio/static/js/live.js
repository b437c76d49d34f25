// The live camera: its image with the dots found, help with focus and exposure, and images taken from it.

import { bytes, get, post } from "./api.js";
import { counted, fill, h, num, surface } from "./dom.js";
import { outline_dots } from "./dots.js";
import { say } from "./say.js";

// seen(): dots of the existing images, drawn faintly to show what is covered. take(source, calibrate): takes an image, and
// calibrates with it if requested.
export async function live_camera(signal, { seen, take: take_from }) {
  const { cameras, files } = await get("/api/live", signal);
  const state = { on: false, bitmap: null, found: null, sharpest: Infinity, frames: 0, began: 0 };
  const pick = h("select", { "aria-label": "Camera", onchange: () => { if (state.on) start(); } },
    cameras.map((one) => h("option", { value: `camera=${encodeURIComponent(one.name)}` }, one.words)),
    files.map((one) => h("option", { value: `file=${one.id}` }, `recording ${one.path} in place of a camera`)));
  const size = h("input", { "aria-label": "Size", placeholder: "its own size", size: 10, autocomplete: "off" });
  const rate = h("input", { "aria-label": "Frames per second", placeholder: "its own rate", size: 10, inputmode: "decimal", autocomplete: "off" });
  const view = surface((context, width, height) => {
    if (!state.bitmap) return;
    const [wide, tall] = state.found.size_px, scale = Math.min(width / wide, height / tall);
    context.translate((width - wide * scale) / 2, (height - tall * scale) / 2);
    context.drawImage(state.bitmap, 0, 0, wide * scale, tall * scale);
    context.globalAlpha = 0.55;
    context.fillStyle = "#5ab4ff";
    for (const dots of seen()) dots.centers_px.forEach(([x, y], k) => { if (dots.of_array[k]) context.fillRect(x * scale - 1.5, y * scale - 1.5, 3, 3); });
    context.globalAlpha = 1;
    outline_dots(context, state.found, scale);
  }, signal, { class: "film", role: "img", "aria-label": "Camera image with the dots found" });
  const help = h("div", { class: "stack", "aria-live": "off" });
  const tell = () => {
    const { found } = state;
    if (!found) { fill(help, h("p", { class: "soft" }, "Opening the camera …")); return; }
    const count = found.of_array.filter(Boolean).length;
    const share = found.blur_px ? Math.min(1, state.sharpest / found.blur_px) : 0;
    fill(help,
      h("p", {}, h("strong", {}, counted(count, "dot")), count ? ` of the gauge, centres to ${num(found.sigma_px, 2)} px.` : found.late ? ": looking for them …" : ": is the gauge in the image, lit evenly, and not cut off?"),
      h("div", {}, h("p", { class: "small" }, found.blur_px ? `Focus: edges ${num(found.blur_px, 2)} px wide, ${num(state.sharpest, 2)} px at their sharpest. Turn the lens until the bar is longest.` : "Focus: known as soon as dots are found."),
        h("div", { class: "bar", role: "meter", "aria-label": "Focus", "aria-valuemin": 0, "aria-valuemax": 100, "aria-valuenow": Math.round(100 * share) }, h("i", { style: { width: `${100 * share}%` } }))),
      h("p", { class: `small ${found.light ? "warn" : ""}` }, found.light ? `Light: ${found.light}.` : "Light: well exposed."),
      h("p", { class: "small soft" }, `${num((1000 * state.frames) / (performance.now() - state.began), 2)} images/s, ${found.size_px.join(" × ")} px. Blue: dots of the images taken so far; tilt the gauge so that new ones fall where there are none.`));
  };
  const query = () => `${pick.value}${pick.value.startsWith("camera") ? `&size=${encodeURIComponent(size.value.trim())}&rate=${encodeURIComponent(rate.value.trim().replace(",", "."))}` : ""}`;
  const follow = async (wish) => {
    while (state.on === wish && !signal.aborted) {
      if (document.hidden) { await new Promise((done) => setTimeout(done, 300)); continue; }
      const buffer = await bytes(`/api/live/look?${wish}`, signal);
      const length = new DataView(buffer).getUint32(0);
      const bitmap = await createImageBitmap(new Blob([new Uint8Array(buffer, 4 + length)], { type: "image/jpeg" }));
      if (state.on !== wish) { bitmap.close(); return; }
      state.bitmap?.close();
      Object.assign(state, { bitmap, found: JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length))) });
      state.frames += 1;
      if (state.found.blur_px) state.sharpest = Math.min(state.sharpest, state.found.blur_px);
      view.canvas.style.aspectRatio = state.found.size_px.join(" / ");
      take.disabled = false;
      view.redraw();
      tell();
    }
  };
  const start = () => {
    const wish = query();
    Object.assign(state, { on: wish, found: null, sharpest: Infinity, frames: 0, began: performance.now() });
    toggle.textContent = "Stop";
    fill(body, h("div", { class: "split" }, view.canvas, h("section", { class: "stack" }, help, h("div", { class: "row" }, take, h("label", {}, calibrate, "calibrate after each image")))));
    tell();
    follow(wish).catch((error) => { if (state.on === wish) { stop(); say(error); } });
  };
  const stop = () => {
    state.on = false;
    toggle.textContent = "Start";
    take.disabled = true;
    fill(body);
    post("/api/live/close").catch(() => {});
  };
  const shoot = async () => {
    if (take.disabled) return;
    take.disabled = true;
    try {
      const made = await take_from(Object.fromEntries(new URLSearchParams(query())), calibrate.checked);
      say(`Taken: ${made.name}.`, true);
    } catch (error) { say(error); }
    take.disabled = !state.on;
  };
  const toggle = h("button", { onclick: () => (state.on ? stop() : start()) }, "Start");
  const take = h("button", { class: "main", disabled: true, title: "Take image (t)", onclick: shoot }, "Take image");
  const calibrate = h("input", { type: "checkbox", checked: true });
  const body = h("div");
  document.addEventListener("keydown", (event) => {
    if (event.key !== "t" || event.ctrlKey || event.metaKey || event.altKey || event.target.closest?.("input, select, textarea")) return;
    shoot();
  }, { signal });
  signal.addEventListener("abort", () => { if (state.on) stop(); state.bitmap?.close(); });
  return h("details", { class: "card" }, h("summary", {}, "Live camera"),
    cameras.length + files.length ? [h("div", { class: "row", style: { margin: ".7rem 0" } }, pick, size, rate, toggle), body]
      : h("p", { class: "soft" }, "No camera was found on this computer, and no recording in this folder to use in its place. Connect a camera and open this screen again."));
}
