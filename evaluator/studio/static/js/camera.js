// The Camera screen: gauge images with the dots found, calibration, verdict, and a map of the uncertainty on the plate.

import { get, latest, post } from "./api.js";
import { color, counted, fill, fixed, h, num, pen, surface } from "./dom.js";
import { outline_dots } from "./dots.js";
import { jobOf, onJobs } from "./jobs.js";
import { live_camera } from "./live.js";
import { say } from "./say.js";
import { undoing } from "./undo.js";
import { values_form } from "./values.js";

const SOFT_EDGE = 2.5; // px: larger blur is out of focus
const ENOUGH = 3; // images after which each further one starts a calibration: fewer do not determine a lens

export async function show(view, { id, rest, signal }) {
  const known = new Map(); // dots by image
  const choice = { seen: new Set(), chosen: new Set(), plate: null, again: false }; // of images; survives a new list
  const place = h("div"), live = h("div");
  fill(view, h("div", { class: "stack" }, h("div", {}, h("p", { class: "kind" }, "Camera"), h("h1", {}, "Camera calibration")), live, place));
  fill(place, h("p", { class: "soft", role: "status" }, "Looking for gauges, images and cameras …"));
  let undo = null, form = null;
  const rig = async () => {
    const [found, experiment] = await Promise.all([get("/api/rig", signal), id && get(`/api/experiments/${id}`, signal)]);
    const gauge = found.gauges.find((one) => one.id === rest[0]) ?? nearest(found.gauges, experiment) ?? found.gauges[0];
    const camera = gauge && found.cameras.find((one) => one.folder === gauge.folder);
    return { found, gauge, solved: camera ? await get(`/api/cameras/${camera.id}`, signal) : null };
  };
  let gauge = null, solve = null;
  const load = latest(rig, (now, shown) => {
    gauge = now.gauge;
    if (!gauge) { fill(place, nothing()); return; }
    undo ??= undoing("camera", gauge.id, signal, () => { form.again(); return load(); });
    form ??= values_form("Gauge", `/api/gauges/${gauge.id}/values`, signal, { make: undo.make });
    const go = (other) => { location.hash = `#/${id ? `x/${id}/` : ""}camera/${other}`; };
    const made = bench(now, { known, choice, signal, shown, undo, form, go });
    solve = made.solve;
    fill(place, made.box);
  });
  onJobs((_, ended) => {
    if (!ended.some((job) => job.kind === "calibrate" || job.kind === "samples")) return;
    (undo ? undo.make(load) : load()).then(() => { if (choice.again && !jobOf(gauge.id)) solve(); }).catch(say);
    const solved = ended.find((job) => job.kind === "calibrate" && job.state === "done");
    if (solved) say(`The camera is calibrated: ${solved.summary.level}.`, true, id && ["Back to the runs", `#/x/${id}/runs`]);
  }, signal);
  await load();
  if (!gauge) return;
  const take = (said, calibrating) => undo.make(async () => {
    const made = await post(`/api/gauges/${gauge.id}/take`, said, signal);
    await load(made.id);
    if (calibrating && choice.chosen.size >= ENOUGH) solve();
    return made;
  });
  fill(live, await live_camera(signal, { seen: () => known.values(), take }));
}

function nothing() {
  return h("div", { class: "empty" }, h("h2", {}, "No gauge yet"), h("p", {}, "A camera is calibrated from images of a dot gauge. Make a new experiment on the first screen: it contains a gauge.toml to fill in and print. Then put the images beside it."), h("p", {}, h("a", { class: "button", href: "#/" }, "First screen")));
}

const within = (folder, around) => around === "." || folder === around || folder.startsWith(`${around}/`);

// The gauge beside an experiment, or in the next folder around it.
function nearest(gauges, experiment) {
  if (!experiment) return undefined;
  const folder = experiment.path.split("/").slice(0, -1).join("/") || ".";
  return gauges.filter((one) => within(folder, one.folder)).sort((a, b) => b.folder.length - a.folder.length)[0];
}

// Images beside a gauge and in its parent folders, because gauge images often lie with the recordings of several
// experiments; if there are none, all images of the studio's folder.
const NAMED = /gauge/i;
function candidates(images, gauge) {
  const around = images.filter((one) => within(gauge.folder, one.folder));
  return around.some((one) => one.folder === gauge.folder || NAMED.test(one.name)) ? around : images;
}

function bench({ found, gauge, solved }, { known, choice, signal, shown: first, undo, form, go }) {
  const images = candidates(found.images, gauge);
  const beside = images.filter((one) => one.folder === gauge.folder), near = beside.length ? beside : images;
  const named = near.filter((one) => NAMED.test(one.path)), { chosen } = choice;
  for (const one of named.length ? named : near) if (!choice.seen.has(one.id)) { choice.seen.add(one.id); chosen.add(one.id); }
  const gained = new Map((solved?.images ?? []).map((one) => [one.name.split(/[\\/]/).pop(), one]));
  let guide = false;
  if (!images.some((one) => one.id === choice.plate)) choice.plate = images.find((one) => chosen.has(one.id))?.id;
  let shown = images.find((one) => one.id === (first ?? choice.plate)) ?? images[0];
  const pick = h("select", { "aria-label": "Gauge", onchange: (event) => go(event.target.value) }, found.gauges.map((one) => h("option", { value: one.id, selected: one === gauge }, one.path)));
  const facts = h("p", { class: "small soft" });
  const list = h("tbody");
  const covered = () => images.filter((one) => chosen.has(one.id) && known.has(one.id)).map((one) => known.get(one.id));
  const said = solved && verdict(solved, signal, { guide: (on) => { guide = on; view.redraw(); }, covered });
  const image = new Image();
  const view = surface((context, width, height) => {
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

  // Rows are made once and then updated, so that the focus stays for users of the keyboard.
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
      h("td", {}, h("input", { type: "checkbox", checked: chosen.has(one.id), "aria-label": `Use ${one.name}`, onchange: (event) => { event.target.checked ? chosen.add(one.id) : chosen.delete(one.id); said?.redraw(); } })),
      h("td", {}, h("button", { class: "plain", onclick: () => look(one), title: one.path }, one.name)),
      h("td", {}, h("input", { type: "radio", name: "plate", checked: one.id === choice.plate, "aria-label": `${one.name} shows the gauge on the plate`, onchange: () => { choice.plate = one.id; } })),
      count, h("td", {}, given(gained.get(one.name)))) });
  }
  fill(list, [...made.values()].map(({ row }) => row));
  const solve = () => {
    const ids = images.filter((one) => chosen.has(one.id)).map((one) => one.id);
    if (!ids.includes(choice.plate)) { say("Choose which image shows the gauge lying on the plate."); return; }
    say("");
    choice.again = Boolean(jobOf(gauge.id)); // a calibration with an earlier choice is running
    if (!choice.again) post(`/api/gauges/${gauge.id}/calibrate`, { images: ids, plate: ids.indexOf(choice.plate) }).catch(say);
  };
  if (shown) look(shown).then(async () => {
    for (const one of images) { // meanwhile the other images, for the table and for the live camera
      if (known.has(one.id) || signal.aborted) continue;
      try { known.set(one.id, await get(`/api/images/${one.id}/dots`, signal)); rows(); said?.redraw(); } catch { continue; }
    }
  });
  const box = h("div", { class: "stack" },
    h("div", { class: "row end" }, pick, h("div", { class: "row" }, undo.undo, undo.redo, h("a", { class: "button", href: `/api/gauges/${gauge.id}/sheet.pdf`, download: "gauge.pdf" }, "Print the gauge (PDF)"), h("button", { class: "main", disabled: !images.length, onclick: solve }, solved ? "Calibrate again" : "Calibrate"))), form.box,
    images.length ? h("div", { class: "split" }, h("section", { class: "stack" }, view.canvas, facts), h("section", { class: "stack" },
      h("div", { class: "scroll tall" }, h("table", { class: "wordlist" }, h("thead", {}, h("tr", {}, ["use", "image", "on the plate", "dots", "without it"].map((text) => h("th", { scope: "col" }, text)))), list)), solved ? [h("p", { class: "small soft" }, "Without it: increase of the uncertainty if this image were left out."), said.box] : h("p", { class: "soft" }, "Not calibrated yet: choose the images and which of them shows the gauge lying flat on the plate.")))
      : h("div", { class: "empty" }, h("h2", {}, "No images beside this gauge"), h("p", {}, `Take them with the live camera above, or put them into ${gauge.folder === "." ? "the folder of the studio" : gauge.folder} or a folder around it: one with it lying on the plate, five or more with it tilted by 20° to 40° in different directions.`)));
  return { box, solve };
}

// A sentence with its full stop, which the verdict's file leaves out.
const stopped = (text) => (/[.!?]$/.test(text) ? text : `${text}.`);

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
  context.lineWidth = pen(2);
  context.beginPath();
  for (const [x, y] of corners) context.lineTo(x * scale, y * scale);
  context.closePath();
  context.stroke();
  context.restore();
}

function verdict(found, signal, { guide, covered }) {
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
    context.globalAlpha = 0.75;
    context.fillStyle = color("ink");
    const [scale, size] = [width / found.size_px[0], Math.max(width / 320, 1.4)];
    for (const dots of covered()) dots.centers_px.forEach(([x, y], k) => { if (dots.of_array[k]) context.fillRect(x * scale - size / 2, y * scale - size / 2, size, size); });
    context.globalAlpha = 1;
  }, signal, { class: "uncertainty", role: "img", "aria-label": `Uncertainty of positions, from ${num(least)} to ${num(most)} µm, and the dots of the images in use` });
  chart.canvas.style.aspectRatio = `${found.size_px[0]} / ${found.size_px[1]}`;
  const box = h("div", { class: "card stack verdict" },
    h("div", { class: "row" }, h("h2", { style: { margin: 0 } }, "Verdict"), h("span", { class: `tag ${said.level === "sound" ? "good" : "warn"}` }, said.level)),
    h("p", {}, stopped(said.summary.replace(`${said.level}: `, ""))), [...said.reasons, ...said.next_steps, ...said.notes].map((text) => h("p", { class: "small" }, stopped(text))),
    h("p", { class: "small soft" }, `${counted(found.images.length, "image")}, residual ${fixed(found.rms_px, 3)} px RMS; dots cover ${Math.round(100 * said.coverage)} % of the image.`),
    found.next_image ? h("p", {}, `Most useful further image: ${found.next_image.sentence}. `, h("label", {}, h("input", { type: "checkbox", onchange: (event) => guide(event.target.checked) }), " show its outline")) : null,
    h("h3", {}, `Standard uncertainty of a position ${num(map.height_mm)} mm above the plate, relative to the middle of the image`), chart.canvas, h("p", { class: "small soft" }, `Colour: from ${num(least)} µm (weak) to ${num(most)} µm (full), 1 sigma. Points: dots of the images in use, which show what is covered.`));
  return { box, redraw: chart.redraw };
}
