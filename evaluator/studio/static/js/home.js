// The first screen: contents of the folder, results that are out of date, and what to do first.

import { get, latest, post } from "./api.js";
import { counted, fill, h } from "./dom.js";
import { onJobs } from "./jobs.js";
import { say } from "./say.js";

const LEVELS = { sound: "good", limited: "warn", "ill-conditioned": "warn" };

export async function show(view, { signal }) {
  const draw = latest(() => get("/api/home", signal), (found) => fill(view, screen(found, signal)));
  onJobs((_, ended) => { if (ended.length) draw().catch(say); }, signal);
  await draw();
}

function screen(found, signal) {
  const nothing = !found.experiments.length;
  return h("div", { class: "stack", style: { gap: "2rem" } },
    h("div", { class: "row end" },
      h("div", {}, h("p", { class: "kind" }, "Folder"), h("h1", {}, found.folder),
        h("p", { class: "soft" }, `${counted(found.recordings, "recording")}, ${counted(found.images, "image")}, ${counted(found.experiments.length, "experiment")}, ${counted(found.cameras.length, "camera")}`)),
      !nothing && h("div", { class: "row" }, h("button", { class: "main", onclick: () => create(found) }, "New experiment"), samplesButton(false))),
    nothing ? first(found) : h("section", {}, h("h2", {}, "Experiments"), h("div", { class: "cards" }, found.experiments.map((one) => experiment(one, signal)))),
    h("section", {}, h("h2", {}, "Cameras"), found.cameras.length
      ? h("div", { class: "cards" }, found.cameras.map(camera))
      : h("p", { class: "soft" }, "No camera is calibrated yet. It is calibrated from images of a dot gauge; the samples contain both.")));
}

function first(found) {
  return h("div", { class: "empty stack" },
    h("div", {}, h("h2", {}, "Nothing is measured here yet"),
      h("p", {}, found.recordings
        ? `There ${found.recordings === 1 ? "is one recording" : `are ${found.recordings} recordings`} in this folder. Make an experiment of them, with the command of each run.`
        : "Put the recordings of your runs into this folder, or begin with the samples, which lead from video to diagnosis.")),
    h("div", { class: "row" },
      h("button", { class: found.recordings ? "main" : "", onclick: () => create(found) }, "New experiment"), samplesButton(!found.recordings)));
}

function samplesButton(main) {
  return h("button", { class: main ? "main" : "", onclick: (event) => {
    event.currentTarget.disabled = true;
    post("/api/samples").then(() => say("Copying the samples and calibrating their camera …", true)).catch(say);
  } }, "Open the samples");
}

function experiment(one, signal) {
  const tags = h("p", { class: "row", style: { gap: ".4rem" } }, one.fault ? h("span", { class: "tag warn" }, "cannot be read") : h("span", { class: "tag" }, "…"));
  if (!one.fault) get(`/api/experiments/${one.id}/state`, signal).then((state) => fill(tags, stateTags(state))).catch(() => {});
  return h("a", { class: "card", href: `#/x/${one.id}/runs` },
    h("h3", {}, one.name), h("p", { class: "small soft" }, one.path),
    h("p", {}, one.fault || `${counted(one.runs, "run")}${one.videos ? `, ${one.videos} from video` : ""}`), tags);
}

export function stateTags(state) {
  if (state.fault) return [h("span", { class: "tag warn" }, "needs attention"), h("span", { class: "small" }, state.fault)];
  const runs = Object.values(state.outdated);
  const stale = runs.filter((steps) => steps.length).length;
  const results = !state.results ? h("span", { class: "tag" }, "not analysed yet")
    : stale ? h("span", { class: "tag warn" }, `${counted(stale, "run")} to analyse again`)
    : h("span", { class: "tag good" }, "results up to date");
  const diagnosis = { current: h("span", { class: "tag good" }, "diagnosed"), stale: h("span", { class: "tag warn" }, "diagnosis is older than the data") }[state.diagnosis];
  return [results, diagnosis];
}

function camera(one) {
  return h("div", { class: "card" },
    h("h3", {}, one.path), h("p", {}, h("span", { class: `tag ${LEVELS[one.level] ?? ""}` }, one.level)), h("p", { class: "small" }, one.summary.replace(`${one.level}: `, "")));
}

function create(found) {
  const name = h("input", { name: "name", required: true, autocomplete: "off", placeholder: "monday" });
  const robot = h("select", { name: "robot" }, found.robots.map((one) => h("option", {}, one)));
  const place = h("select", { name: "place" }, h("option", { value: "" }, "no, I add runs by hand"),
    found.places.map((one) => h("option", { value: one }, one === "." ? "yes, of the recordings in this folder" : `yes, of the recordings in ${one}`)));
  if (found.places.length === 1 || found.places.includes(".")) place.value = found.places.includes(".") ? "." : found.places[0];
  const fault = h("p", { class: "warn small", role: "alert" });
  const dialog = h("dialog", { "aria-label": "New experiment", onclose: () => dialog.remove() },
    h("form", { class: "stack", method: "dialog", onsubmit: async (event) => {
      event.preventDefault();
      try {
        const made = await post("/api/experiments", { name: name.value, robot: robot.value, place: place.value || null });
        dialog.close();
        location.hash = `#/x/${made.id}/runs`;
      } catch (error) { fault.textContent = error.message; }
    } },
    h("h2", {}, "New experiment"),
    h("label", { class: "field" }, h("span", {}, "Name of its folder"), name),
    h("label", { class: "field" }, h("span", {}, "Robot to start from (its values can be changed afterwards)"), robot),
    h("label", { class: "field" }, h("span", {}, "A run for each recording?"), place),
    fault,
    h("div", { class: "row" }, h("button", { class: "main" }, "Create"), h("button", { type: "button", onclick: () => dialog.close() }, "Cancel"))));
  document.body.append(dialog);
  dialog.showModal();
}
