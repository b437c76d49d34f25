// The Diagnosis screen: verdict, disagreements, gap, alternatives, tolerances and next runs.

import { get, latest, post } from "./api.js";
import { fill, fixed, h, length, num, withBounds } from "./dom.js";
import { jobOf, onJobs } from "./jobs.js";
import { say } from "./say.js";
import { next_runs } from "./nextruns.js";
import { matrix } from "./matrix.js";
import { own_effects } from "./owneffects.js";
import { undoing } from "./undo.js";

const VERDICTS = { effect: "A missing effect was found", none: "No effect is missing", unknown: "An unknown effect is missing", insufficient: "The data cannot decide" };
// Length of a bar as a share of the longest one, which leaves room for its number.
const bar_of = (share) => ({ width: `calc((100% - 10.5rem) * ${Math.max(share, 0.008)})` });
const MENDED = { reversed: "Turn both commands round", "sides-swapped": "Swap left and right" };

export async function show(view, { id, signal }) {
  const undo = undoing("diagnosis", id, signal, () => load());
  let shown = null;
  // A form in use stays when a job ends.
  const effects = (typing) => (typing && view.querySelector("#own-effects form") ? shown : own_effects(id, signal, undo.make, () => load()));
  const load = latest(
    ({ typing = false } = {}) => Promise.all([get(`/api/experiments/${id}/diagnosis`, signal), effects(typing)]),
    ([found, own]) => {
      shown = own;
      fill(view, h("div", { class: "stack", style: { gap: "1.4rem" } }, found.content ? screen(found, id, signal, { load, own, undo }) : nothing(id, undo), own.box));
    },
  );
  onJobs((_, ended) => { if (ended.some((job) => job.experiment === id)) undo.make(() => load({ typing: true })).catch(say); }, signal);
  await load();
}

const start = (id, kind) => () => { say(""); post(`/api/experiments/${id}/jobs`, { kind }).catch(say); };

function nothing(id, undo) {
  return h("div", { class: "stack" }, h("div", { class: "row end" }, h("div", {}, h("p", { class: "kind" }, "Diagnosis"), h("h1", {}, "Why do model and robot differ?")), h("div", { class: "row" }, undo.undo, undo.redo)),
    h("div", { class: "empty" }, h("h2", {}, "No diagnosis yet"), h("p", {}, "The diagnosis tests every effect of the catalogue, and free-form terms, on all runs together, and checks the result on held-out runs. This takes one to a few minutes."),
      h("p", {}, h("button", { class: "main", disabled: Boolean(jobOf(id)), onclick: start(id, "diagnose") }, "Diagnose"))));
}

function screen(found, id, signal, { load, own, undo }) {
  const { content } = found;
  const again = h("div", { class: "row" }), notice = h("div");
  // Whether it is up to date is shown later, because every recording has to be read.
  get(`/api/experiments/${id}/state`, signal).then((state) => {
    const stale = state.diagnosis !== "current";
    fill(again, !stale && h("span", { class: "tag good" }, "up to date"), h("button", { class: stale ? "main" : "", disabled: Boolean(jobOf(id)), onclick: start(id, "diagnose") }, "Diagnose again"));
    fill(notice, stale && h("p", { class: "notice" }, "The experiment, its robot or its recordings changed after this diagnosis."));
  }).catch(say);
  return h("div", { class: "stack", style: { gap: "1.4rem" } },
    h("div", { class: "row end" },
      h("div", {}, h("p", { class: "kind" }, "Diagnosis"), h("h1", {}, content.stopped ? "The search ended before a decision" : VERDICTS[content.verdict] ?? content.verdict)),
      h("div", { class: "row" }, again, undo.undo, undo.redo)),
    notice,
    mistakes(content, id, load, undo),
    h("div", { class: "two" }, h("div", { class: "stack" }, ...content.effects.map((effect) => effect_card(effect, found.parameters[effect.id] ?? {})), offer(own), add(found, id, load, undo), words(found)), gaps(content)),
    content.where.length || Object.keys(found.pieces).length ? h("section", { class: "card stack" }, h("h2", {}, "Where model and robot disagree"), h("ul", { class: "plainlist" }, content.where.slice(0, 5).map((one) => h("li", {}, one.sentence.replaceAll(" -", " −")))), found.pieces.run ? matrix(found.pieces, id, signal) : null) : null,
    h("div", { class: "two" }, rivals(content), known(content)),
    next_runs(content, id, signal));
}

function mistakes(content, id, load, undo) {
  if (!content.mistakes.length) return null;
  const mend = (one) => () => undo.make(async () => {
    await post(`/api/experiments/${id}/mend`, { mistake: one.kind, runs: one.runs });
    say("The commands are changed; analyse again.", true);
    await load();
  }).catch(say);
  const copy = () => post(`/api/experiments/${id}/mended`).then((made) => { say(`Written to ${made.path}: ${made.changes.join("; ")}.`, true); location.hash = `#/x/${made.id}/runs`; }).catch(say);
  return h("section", { class: "card warned" }, h("h2", {}, "Mistakes in the experiment"),
    content.mistakes.map((one) => h("div", { class: "row end" }, h("p", {}, one.sentence),
      MENDED[one.kind] ? h("button", { onclick: mend(one) }, MENDED[one.kind]) : h("a", { class: "button", href: `#/x/${id}/runs/${encodeURIComponent(one.runs[0])}` }, "See the run"))),
    h("div", { class: "row end" }, h("p", {}, "All of them can be corrected in a copy of the experiment; it leaves out the runs that cannot be corrected."), h("button", { onclick: copy }, "Write a mended experiment")));
}

// said: words and unit of a parameter, as the catalogue has them.
function sizeRow(name, parameter, said) {
  const [value, low, high] = withBounds(parameter);
  return h("tr", {}, h("th", { scope: "row", title: name }, said.words ?? name), h("td", {}, h("strong", {}, said.unit ? `${value} ${said.unit}` : value)), h("td", { class: "soft" }, `95 %: ${low} to ${high}`));
}

function effect_card(effect, said) {
  return h("section", { class: "card found" }, h("p", { class: "kind" }, effect.id), h("h2", {}, effect.name),
    h("table", { class: "parameters" }, h("tbody", {}, Object.entries(effect.parameters).map(([name, one], _, all) => sizeRow(name, one, { ...said[name], ...(all.length === 1 && { words: "size" }) })))),
    effect.equivalent?.length ? h("p", { class: "small soft" }, `These runs cannot distinguish it from: ${effect.equivalent.join(", ")}.`) : null);
}

function add(found, id, load, undo) {
  const inside = new Set(found.in_robot.map((one) => one.id));
  const all = found.content.effects.length && found.content.effects.every((effect) => inside.has(effect.id));
  if (all) return h("section", { class: "card" }, h("p", {}, h("span", { class: "tag good" }, "in the robot"), ` ${found.robot.path} has this effect. `), h("div", { class: "row" }, h("button", { class: "main", disabled: Boolean(jobOf(id)), onclick: start(id, "analyse") }, "Analyse with it"), h("a", { class: "button", href: `#/x/${id}/results` }, "Results")));
  if (!found.can_add) return null;
  const write = () => undo.make(async () => {
    try {
      await post(`/api/experiments/${id}/robot`, { version: found.robot.version });
      say(`The effect is now in ${found.robot.path}. Analyse again to see the gap that remains.`, true);
    } catch (error) {
      say(error);
      if (error.status !== 409) return;
    }
    await load();
  }).catch(say);
  return h("section", { class: "card row end" }, h("p", { class: "small" }, `Adds the effect to ${found.robot.path}; from then on it is simulated.`), h("button", { class: "main", onclick: write }, "Add it to the robot"));
}

// The free-form term that explains the runs of an "unknown" verdict.
function offer(own) {
  if (!own.offered) return null;
  return h("section", { class: "card stack" }, h("p", {}, "This free-form term explains the runs and is not in the catalogue. Give it a name, and the next diagnosis tests it like the other effects."),
    h("div", { class: "row" }, h("button", { class: "main", onclick: own.open }, "Add this as your effect")));
}

function words(found) {
  return h("details", { class: "card" }, h("summary", {}, "The diagnosis in words"), found.lines.map((line) => h("p", { class: "small" }, line)));
}

function gaps(content) {
  const { gap } = content;
  if (!gap) return h("p", { class: "soft" }, content.reason);
  const groups = [["start pose and random effects of each run fitted", gap], ["predicted from the start poses alone", gap.predicted]].filter(([, one]) => one?.before);
  const bars = groups.flatMap(([words, one]) => [["fitted runs", "fit"], ["held-out runs", "held_out"]].filter(([, key]) => one.before[key] !== null).map(([who, key]) => ({ words: `${who}, ${words}`, before: one.before[key], after: one.after[key] })));
  const most = Math.max(...bars.flatMap((bar) => [bar.before, bar.after]), gap.noise_floor);
  const bar = (value, ink) => h("div", { class: "measure" }, h("i", { class: ink, style: bar_of(value / most) }), h("span", {}, length(value)));
  return h("section", { class: "card stack" }, h("h2", {}, "RMS distance of simulated and measured marks, before and after"),
    bars.map((one) => h("div", {}, h("p", { class: "small" }, one.words), bar(one.before, "vermillion"), bar(one.after, "green"))),
    h("p", { class: "legend small soft" }, h("i", { class: "vermillion" }), "before", h("i", { class: "green" }), "after"),
    h("p", { class: "small soft" }, `The noise floor is ${length(gap.noise_floor)}.`),
    gap.held_out_runs?.length ? h("p", { class: "small soft" }, `Held out: ${gap.held_out_runs.join(", ")}. The sizes of the effects were fitted without them, but the effects themselves were chosen with all runs.`) : null);
}

function rivals(content) {
  const words = content.verdict === "insufficient" ? "reference" : "verdict"; // without a verdict, the nominal model
  const chosen = { effects: content.effects.map((one) => one.id), log_odds: 0, reason: `the ${words}` };
  const rows = [chosen, ...content.rivals];
  const lowest = Math.min(...rows.map((row) => row.log_odds), -1);
  return h("section", { class: "card stack" }, h("h2", {}, "Alternatives"), h("p", { class: "small soft" }, `Bar: logarithm of the odds against it, relative to the ${words}.`),
    rows.map((row) => h("div", {}, h("p", { class: "small" }, h("strong", {}, row.effects.join(" + ") || "no effect"), ` — ${row.reason}`),
      h("div", { class: "measure" }, h("i", { class: row === chosen ? "green" : "soft", style: bar_of(Math.log1p(Math.max(-row.log_odds, 0)) / Math.log1p(-lowest)) }), h("span", {}, row === chosen ? words : `${fixed(row.log_odds / Math.LN10, 1)} powers of ten`)))));
}

function known(content) {
  if (!content.known_to.length) return null;
  const made = (one) => {
    const reach = 3 * one.taken, at = (value) => `${50 + 50 * Math.max(-1, Math.min(1, value / reach))}%`;
    return h("tr", {}, h("td", {}, one.name), h("td", { class: "strip" }, h("div", { class: "band", title: `known to ${num(one.taken)} ${one.unit}; found ${num(one.found)}` },
      h("i", { class: "zone", style: { left: at(-one.taken), right: `calc(100% - ${at(one.taken)})` } }), h("i", { class: "span", style: { left: at(one.low), right: `calc(100% - ${at(one.high)})` } }), h("i", { class: "mid", style: { left: at(one.found) } }))),
      h("td", { class: "small soft nowrap" }, `± ${num(one.taken)} ${one.unit === "1" ? "" : one.unit}`));
  };
  return h("section", { class: "card" }, h("h2", {}, "Quantities known to a tolerance"), h("p", { class: "small soft" }, "Band: stated tolerance, 1 sigma. Line: fitted value, 95 %."), h("div", { class: "scroll tall", tabindex: 0, role: "region", "aria-label": "Quantities known to a tolerance" }, h("table", { class: "words" }, h("tbody", {}, content.known_to.map(made)))));
}

