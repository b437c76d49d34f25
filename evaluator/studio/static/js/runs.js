// The Runs screen: the table of the experiment, the player of the chosen run, and the analysis of all of them.

import { get, latest, post } from "./api.js";
import { fill, h } from "./dom.js";
import { jobOf, onJobs } from "./jobs.js";
import { player } from "./player.js";
import { say } from "./say.js";
import { sheet } from "./table.js";
import { undoing } from "./undo.js";
import { values_form } from "./values.js";

const COLUMNS = [
  { key: "id", title: "run", kind: "text" },
  { key: "left_rpm", title: "left, rpm", kind: "number" },
  { key: "right_rpm", title: "right, rpm", kind: "number" },
  { key: "start_s", title: "start, s", kind: "number" },
  { key: "stop_s", title: "stop, s", kind: "number" },
  { key: "video", title: "video", kind: "text", list: "recordings", path: true },
  { key: "group", title: "group", kind: "text" },
  { key: "notes", title: "notes", kind: "text" },
];

export async function show(view, { id, rest, signal }) {
  let found = await get(`/api/experiments/${id}`, signal);
  let outdated = null, playing = null, shown = null, unpasted = [];
  const stage = h("section", { class: "stage stack", "aria-label": "Player" });
  const work = h("div", { class: "row" });
  const path = `/api/experiments/${id}`;

  const states = () => found.rows.map((row) => {
    const job = jobOf(id), steps = outdated?.[row.id];
    if (found.faults.some((one) => one.row !== null && found.rows[one.row] === row)) return { kind: "warn", title: "error in this run" };
    if (job?.outdated?.[row.id]?.length) return job.finished.includes(row.id) ? { kind: "good", title: "done" } : job.working.includes(row.id) ? { kind: "busy", title: "being analysed" } : { kind: "stale", title: "waits to be analysed" };
    if (steps === undefined) return { kind: "", title: "" };
    return steps.length ? { kind: "stale", title: `to do: ${steps.join(", ")}` } : { kind: "good", title: "up to date" };
  });

  const accept = (next, extra = []) => { found = next; unpasted = extra; draw(); refresh(); };
  const edit = (edits, extra) => {
    say("");
    undo.make(async () => {
      try {
        accept(await post(`${path}/edit`, { version: found.version, edits }), extra);
        choose(shown ?? 0, false);
      } catch (error) {
        say(error);
        if (error.status === 409) accept(await get(path, signal));
        else draw();
        choose(shown ?? 0, false); // the axis shows the times of the file again
      }
    }).catch(say);
  };
  const undo = undoing("runs", id, signal, async () => { form.again(); accept(await get(path, signal)); choose(shown ?? 0, false); });
  const form = values_form("Robot", `${path}/robot/values`, signal, { make: undo.make, changed: () => refresh() });

  const table = sheet(COLUMNS, { edit, chosen: (row) => choose(row), signal });
  const recordings = h("datalist", { id: "recordings" });
  const title = h("h1");
  const draw = () => {
    table.draw(found, states(), unpasted); // errors of a paste are shown until the next change
    fill(recordings, found.recordings.map((one) => h("option", { value: one })));
    title.textContent = String(found.head.name ?? "");
    drawWork();
  };
  const tell = () => {
    table.states(states());
    drawWork();
  };
  const drawWork = () => {
    const job = jobOf(id);
    const start = (kind) => () => { say(""); post(`${path}/jobs`, { kind }).catch(say); };
    const fault = found.faults.some((one) => one.key !== "video");
    const no_camera = found.faults.some((one) => one.key === "camera"), idle = Boolean(job) || fault || !found.rows.length;
    const todo = outdated ? Object.values(outdated).filter((steps) => steps.length).length : null;
    fill(work,
      no_camera && h("a", { class: "button", href: `#/x/${id}/camera` }, "Calibrate the camera"),
      h("button", { class: todo === 0 ? "" : "main", disabled: idle, onclick: start("analyse"), title: fault ? "Correct the marked cells of the table first" : "Track, measure and simulate every run that is not up to date" },
        job ? "Working …" : todo ? `Analyse ${todo} of ${found.rows.length} runs` : "Analyse"),
      h("button", { class: todo === 0 ? "main" : "", disabled: idle, onclick: start("diagnose"), title: "Find the effect that the model lacks" }, "Diagnose"));
  };
  const asked = latest(() => get(`${path}/state`, signal), (state) => {
    outdated = state.outdated;
    if (state.fault && !found.faults.length) say(state.fault);
    tell();
  });
  const refresh = () => asked().catch(() => {});

  let inner = null;
  signal.addEventListener("abort", () => inner?.abort());
  const choose = async (row, anew = true) => {
    const run = found.rows[row];
    table.choose(row);
    if (!anew && run && playing?.key === `${run.id}|${run.video}`) { playing.edges(run.start_s, run.stop_s); return; }
    const key = run && `${run.id}|${run.video}`, here = playing?.key === key ? playing.time() : undefined; // the same run stays at its frame
    shown = row;
    inner?.abort();
    inner = new AbortController();
    playing = null;
    if (!run) { fill(stage, empty()); return; }
    if (!run.video || found.faults.some((one) => one.row === row && ["video", "id"].includes(one.key))) {
      fill(stage, h("div", { class: "empty" }, h("h2", {}, run.id ?? "This run"), h("p", {}, run.marks ? "This run is given as marks; it has no video to show." : "Choose its recording in the column “video”.")));
      return;
    }
    try {
      const { signal: own } = inner;
      const made = await player(stage, id, run, { signal: own, at: here ?? (rest[0] === run.id && rest[1] ? Number(rest[1]) : undefined), changed: (key, value) => edit([{ kind: "set", row: found.rows.findIndex((one) => one.id === run.id), key, value }]) });
      if (made && !own.aborted) playing = { ...made, key };
    } catch (error) {
      if (error.name !== "AbortError") fill(stage, h("div", { class: "empty" }, h("h2", {}, `${run.id} cannot be shown`), h("p", {}, error.message)));
    }
  };
  const empty = () => h("div", { class: "empty" }, h("h2", {}, "No runs yet"), h("p", {}, "Add a run for each recording, or paste rows from a spreadsheet: run, left rpm, right rpm, start, stop, video."));

  fill(view, recordings,
    h("div", { class: "row end" }, h("div", {}, h("p", { class: "kind" }, "Runs"), title), work),
    h("div", { class: "split" },
      h("section", { class: "stack", "aria-label": "Table of runs" }, table.box,
        h("div", { class: "row" }, h("button", { onclick: () => table.add() }, "Add a run"), undo.undo, undo.redo, h("span", { class: "soft small" }, "Paste from a spreadsheet into any cell.")), form.box),
      stage));
  draw();
  refresh();
  const wanted = rest[0] ? found.rows.findIndex((row) => row.id === rest[0]) : 0;
  choose(Math.max(wanted, 0));
  onJobs((_, ended) => {
    const mine = ended.filter((job) => job.experiment === id);
    for (const job of mine) {
      const faults = Object.entries(job.summary?.faults ?? {});
      if (faults.length) say(`${faults[0][0]}: ${faults[0][1]}${faults.length > 1 ? ` (and ${faults.length - 1} more runs)` : ""}`);
      else if (job.state === "done" && job.kind === "diagnose") say("The diagnosis is done.", true, ["See the diagnosis", `#/x/${id}/diagnosis`]);
      else if (job.state === "done") say("All runs are analysed.", true, ["See the results", `#/x/${id}/results`]);
    }
    tell();
    if (mine.length) { refresh(); choose(shown ?? 0); }
  }, signal);
}
