// Current work, reported by the server, and shown in a corner of every screen.

import { GONE, post, Refused } from "./api.js";
import { fill, h } from "./dom.js";
import { say } from "./say.js";

const listeners = new Set();
const dismissed = new Set();
let jobs = [];
let known = null;

const NAMES = { analyse: "Analysis", diagnose: "Diagnosis", samples: "Samples", calibrate: "Calibration" };
const RESUMABLE = ["analyse", "diagnose"];
const ENDED = ["done", "failed", "cancelled", "paused"];

export const current = () => jobs;
export const jobOf = (experiment) => jobs.find((job) => job.experiment === experiment && !ENDED.includes(job.state));

// listener: called with all jobs, and with those that have just ended.
export function onJobs(listener, signal) {
  listeners.add(listener);
  signal?.addEventListener("abort", () => listeners.delete(listener));
}

export function listen() {
  const source = new EventSource("/api/events");
  let gone = false;
  source.onerror = () => { gone = true; say(new Refused(GONE, 0)); };
  source.onopen = () => { if (gone) say(""); gone = false; };
  source.onmessage = (event) => {
    jobs = JSON.parse(event.data);
    const ended = known === null ? [] : jobs.filter((job) => ENDED.includes(job.state) && known.get(job.number) !== job.state && !(known.get(job.number) === undefined && job.state === "cancelled"));
    known = new Map(jobs.map((job) => [job.number, job.state]));
    draw();
    for (const listener of listeners) listener(jobs, ended);
  };
}

function draw() {
  const shown = jobs.filter((job) => !dismissed.has(job.number) && (!ENDED.includes(job.state) || job.state === "failed" || job.state === "paused")).slice(0, 4);
  fill(document.getElementById("jobs"), shown.map(card));
}

function card(job) {
  const percent = Math.round(100 * job.share);
  const title = `${NAMES[job.kind] ?? job.kind}: ${job.target}`;
  const end = (how) => () => post(`/api/jobs/${job.number}`, { how }).catch(say);
  const again = () => post(`/api/experiments/${job.experiment}/jobs`, { kind: job.kind }).catch(say);
  const running = job.state === "running" || job.state === "waiting";
  const words = { waiting: "waits for other work", running: `${job.wish ? "ending …" : job.stage || "starting …"}`, failed: job.sentence, paused: "paused; what is finished is kept" }[job.state];
  return h("div", { class: "card stack", style: { gap: ".45rem" } },
    h("div", { class: "row end" }, h("strong", { class: "small" }, title), running && h("span", { class: "small soft" }, `${percent} %`)),
    running && h("div", { class: "bar", role: "progressbar", "aria-valuenow": percent, "aria-valuemin": 0, "aria-valuemax": 100, "aria-label": title }, h("i", { style: { width: `${percent}%` } })),
    h("div", { class: "row end" }, h("span", { class: `small ${job.state === "failed" ? "warn" : "soft"}` }, words),
      h("span", { class: "row", style: { gap: ".2rem" } },
        running && RESUMABLE.includes(job.kind) && h("button", { class: "plain small", onclick: end("paused") }, "Pause"),
        running && h("button", { class: "plain small", onclick: end("cancelled") }, "Cancel"),
        job.state === "paused" && h("button", { class: "plain small", onclick: again }, "Resume"),
        !running && h("button", { class: "plain small", onclick: () => { dismissed.add(job.number); draw(); } }, "Close"))));
}
