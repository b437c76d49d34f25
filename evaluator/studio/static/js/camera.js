// The Camera screen: gauge images with the dots found, calibration, verdict, and where how well the plate is known.

import { get, latest, post } from "./api.js";
import { color, counted, fill, fixed, h, num, surface } from "./dom.js";
import { outline_dots } from "./dots.js";
import { onJobs } from "./jobs.js";
import { live_camera } from "./live.js";
import { say } from "./say.js";
import { undoing } from "./undo.js";
import { values_form } from "./values.js";

const SOFT_EDGE = 2.5; // px of blur from which on an image is out of focus

export async function show(view, { rest, signal }) {
  const known = new Map(); // dots by image
  const place = h("div"), live = h("div");
  fill(view, h("div", { class: "stack" }, h("div", {}, h("p", { class: "kind" }, "Camera"), h("h1", {}, "Camera calibration")), live, place));
  fill(place, h("p", { class: "soft", role: "status" }, "Looking for gauges, images and cameras …"));
  let undo = null, form = null;
  const rig = async () => {
    const found = await get("/api/rig", signal);
    const gauge = found.gauges.find((one) => one.id === rest[0]) ?? found.gauges[0];
    const camera = gauge && found.cameras.find((one) => one.folder === gauge.folder);
    return { found, gauge, solved: camera ? await get(`/api/cameras/${camera.id}`, signal) : null };
  };
  let gauge = null;
  const load = latest(rig, (now, shown) => {
    gauge = now.gauge;
    if (!gauge) { fill(place, nothing()); return; }
    undo ??= undoing("camera", gauge.id, signal, () => { form.again(); return load(); });
    form ??= values_form("Gauge", `/api/gauges/${gauge.id}/values`, signal, { make: undo.make });
    fill(place, bench(now, { known, signal, shown, undo, form }));
  });
  onJobs((_, ended) => {
    if (!ended.some((job) => job.kind === "calibrate" || job.kind === "samples")) return;
    (undo ? undo.make(load) : load()).catch(say);
  }, signal);
  await load();
  if (!gauge) return;
  const take = (said) => undo.make(async () => {
    const made = await post(`/api/gauges/${gauge.id}/take`, said, signal);
    await load(made.id);
    return made;
  });
  fill(live, await live_camera(signal, { seen: () => known.values(), take }));
}

function nothing() {
  return h("div", { class: "empty" }, h("h2", {}, "No gauge yet"), h("p", {}, "A camera is calibrated from images of a dot gauge. Make a new experiment on the first screen: it contains a gauge.toml to fill in and print. Then put the images beside it."), h("p", {}, h("a", { class: "button", href: "#/" }, "First screen")));
}

// Images beside a gauge, or in a folder around it: gauge images often lie with the recordings of several experiments.
const within = (folder, around) => around === "." || folder === around || folder.startsWith(`${around}/`);

function bench({ found, gauge, solved }, { known, signal, shown: first, undo, form }) {
  const images = found.images.filter((one) => within(gauge.folder, one.folder));
  const beside = images.filter((one) => one.folder === gauge.folder);
  const chosen = new Set((beside.length ? beside : images).filter((one) => one.name.startsWith("gauge")).map((one) => one.id));
  if (!chosen.size) for (const one of images) chosen.add(one.id);
  const gained = new Map((solved?.images ?? []).map((one) => [one.name.split(/[\\/]/).pop(), one]));
  let guide = false;
  let plate = images.find((one) => chosen.has(one.id))?.id, shown = images.find((one) => one.id === first || (!first && one.id === plate)) ?? images[0];
  const pick = h("select", { "aria-label": "Gauge", onchange: (event) => { location.hash = `#/camera/${event.target.value}`; } }, found.gauges.map((one) => h("option", { value: one.id, selected: one === gauge }, one.path)));
  const facts = h("p", { class: "small soft" });
  const list = h("tbody");
  const image = new Image();
  const view = surface((context, width, height) => {
    context.fillStyle = "#000";
    context.fillRect(0, 0, width, height);
    if (!image.naturalWidth) return;
    const dots = known.get(shown?.id), size = dots?.size_px ?? [image.naturalWidth, image.naturalHeight];
    const scale = Math.min(width / size[0], height / size[1]);
    context.translate((width - size[0] * scale) / 2, (height - size[1] * scale) / 2);
    context.drawImage(image, 0, 0, size[0] * scale, size[1] * scale);
    if (guide) outline(context, solved.next_image.outline_px, scale);
    if (!dots) return;
    outline_dots(context, dots, scale);
  }, signal, { class: "film", role: "img", "aria-label": "Image of the gauge with the dots found in it" });
  image.onload = view.redraw;

  // Rows are made once and then only told what is new: who works by keyboard keeps the place.
  const made = new Map();
  const rows = () => {
    for (const [one, { row, count }] of made) {
      row.setAttribute("aria-selected", String(one === shown));
      count.textContent = known.has(one.id) ? String(known.get(one.id).of_array.filter(Boolean).length) : "–";
    }
  };
  const look = async (one) => {
    shown = one;
    rows();
    image.src = `/api/images/${one.id}`;
    view.canvas.style.aspectRatio = "4 / 3";
    try {
      if (!known.has(one.id)) known.set(one.id, await get(`/api/images/${one.id}/dots`, signal));
      if (shown === one) { facts.textContent = sentence(known.get(one.id)); view.redraw(); }
    } catch (error) { facts.textContent = error.message; }
    rows();
  };
  for (const one of images) {
    const count = h("td");
    made.set(one, { count, row: h("tr", {},
      h("td", {}, h("input", { type: "checkbox", checked: chosen.has(one.id), "aria-label": `Use ${one.name}`, onchange: (event) => (event.target.checked ? chosen.add(one.id) : chosen.delete(one.id)) })),
      h("td", {}, h("button", { class: "plain", onclick: () => look(one), title: one.path }, one.name)),
      h("td", {}, h("input", { type: "radio", name: "plate", checked: one.id === plate, "aria-label": `${one.name} shows the gauge on the plate`, onchange: () => { plate = one.id; } })),
      count, h("td", {}, given(gained.get(one.name)))) });
  }
  fill(list, [...made.values()].map(({ row }) => row));
  const solve = () => {
    const ids = images.filter((one) => chosen.has(one.id)).map((one) => one.id);
    if (!ids.includes(plate)) { say("Choose which image shows the gauge lying on the plate."); return; }
    say("");
    post(`/api/gauges/${gauge.id}/calibrate`, { images: ids, plate: ids.indexOf(plate) }).catch(say);
  };
  if (shown) look(shown).then(async () => {
    for (const one of images) { // the others meanwhile: the table says their dots, the live camera draws them
      if (known.has(one.id) || signal.aborted) continue;
      try { known.set(one.id, await get(`/api/images/${one.id}/dots`, signal)); rows(); } catch { continue; }
    }
  });
  return h("div", { class: "stack" },
    h("div", { class: "row end" }, pick, h("div", { class: "row" }, undo.undo, undo.redo, h("a", { class: "button", href: `/api/gauges/${gauge.id}/sheet.pdf`, download: "gauge.pdf" }, "Print the gauge (PDF)"), h("button", { class: "main", disabled: !images.length, onclick: solve }, solved ? "Calibrate again" : "Calibrate"))), form.box,
    images.length ? h("div", { class: "split" }, h("section", { class: "stack" }, view.canvas, facts), h("section", { class: "stack" },
      h("div", { class: "scroll tall" }, h("table", { class: "wordlist" }, h("thead", {}, h("tr", {}, ["use", "image", "on the plate", "dots", "without it"].map((text) => h("th", { scope: "col" }, text)))), list)), solved ? [h("p", { class: "small soft" }, "Without it: increase of the uncertainty if this image were left out."), verdict(solved, signal, (on) => { guide = on; view.redraw(); })] : h("p", { class: "soft" }, "Not calibrated yet: choose the images and which of them shows the gauge lying flat on the plate.")))
      : h("div", { class: "empty" }, h("h2", {}, "No images beside this gauge"), h("p", {}, `Take them with the live camera above, or put them into ${gauge.folder === "." ? "the folder of the studio" : gauge.folder} or a folder around it: one with it lying on the plate, five or more with it tilted by 20° to 40° in different directions.`)));
}

function sentence(dots) {
  const count = dots.of_array.filter(Boolean).length;
  if (!count) return "No regular array of dots was found. Is the gauge in the image, lit evenly, and not cut off?";
  const focus = dots.blur_px > SOFT_EDGE ? ` The edges are ${num(dots.blur_px, 2)} px wide: focus the lens.` : "";
  return `${counted(count, "dot")} of the array, centres to ${num(dots.sigma_px, 2)} px (1 sigma), ${counted(dots.of_array.length - count, "dot")} beside it.${focus}${dots.light ? ` Light: ${dots.light}.` : ""}`;
}

function given(image) {
  if (!image || image.gain === null) return image ? "needed" : "–";
  return image.adds_nothing ? "adds nothing" : `+${num(100 * (image.gain - 1), 2)} %`;
}

function outline(context, corners, scale) {
  context.save();
  context.setLineDash([8, 5]);
  context.strokeStyle = "#ffd84d";
  context.lineWidth = 2;
  context.beginPath();
  for (const [x, y] of corners) context.lineTo(x * scale, y * scale);
  context.closePath();
  context.stroke();
  context.restore();
}

function verdict(found, signal, guide) {
  const { verdict: said, map } = found;
  const most = Math.max(...map.sigma_um), least = Math.min(...map.sigma_um);
  const chart = surface((context, width, height) => {
    const w = width / map.columns, t = height / map.rows;
    const ink = color("vermillion");
    map.sigma_um.forEach((value, k) => {
      context.globalAlpha = 0.05 + (0.85 * (value - least)) / Math.max(most - least, 1e-9);
      context.fillStyle = ink;
      const [x, y] = [Math.floor((k % map.columns) * w), Math.floor(Math.floor(k / map.columns) * t)];
      context.fillRect(x, y, Math.floor(((k % map.columns) + 1) * w) - x, Math.floor((Math.floor(k / map.columns) + 1) * t) - y);
    });
    context.globalAlpha = 1;
  }, signal, { class: "uncertainty", role: "img", "aria-label": `Uncertainty of positions, from ${num(least)} to ${num(most)} µm` });
  chart.canvas.style.aspectRatio = `${found.size_px[0]} / ${found.size_px[1]}`;
  return h("div", { class: "card stack" },
    h("div", { class: "row" }, h("h2", { style: { margin: 0 } }, "Verdict"), h("span", { class: `tag ${said.level === "sound" ? "good" : "warn"}` }, said.level)),
    h("p", {}, said.summary), [...said.reasons, ...said.next_steps, ...said.notes].map((text) => h("p", { class: "small" }, text)),
    h("p", { class: "small soft" }, `${counted(found.images.length, "image")}, residual ${fixed(found.rms_px, 3)} px RMS; dots cover ${Math.round(100 * said.coverage)} % of the image.`),
    found.next_image ? h("p", {}, `Most useful further image: ${found.next_image.sentence}. `, h("label", {}, h("input", { type: "checkbox", onchange: (event) => guide(event.target.checked) }), " show its outline")) : null,
    h("h3", {}, `Standard uncertainty of a position ${num(map.height_mm)} mm above the plate, relative to the middle of the image`), chart.canvas, h("p", { class: "small soft" }, `From ${num(least)} µm (pale) to ${num(most)} µm (full colour), 1 sigma.`));
}
