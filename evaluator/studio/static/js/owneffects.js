// User-defined effects on the Diagnosis screen: those beside the experiment, and the form that makes them from terms.

import { get, post } from "./api.js";
import { fill, h } from "./dom.js";
import { say } from "./say.js";

const FORM = /^[a-z][a-z0-9]*(-[a-z0-9]+)*$/;
const EMPTY = { version: "", id: "", name: "", sentence: "", fault: "", terms: [] };

// make(change): makes a change after the changes before it; written(): updates the screen. Returns the section, and open(),
// which opens the form with the offered effect.
export async function own_effects(id, signal, make, written) {
  const path = `/api/experiments/${id}/own-effects`;
  const found = await get(path, signal);
  const place = h("div", { class: "stack" });
  const box = h("section", { class: "card stack", id: "own-effects" }, h("div", {}, h("h2", {}, "Effects of your own"),
    h("p", { class: "small soft" }, "Physics that the catalogue lacks, as a sum of terms; each is a coefficient times what it depends on, and acts on one channel. It is written to the folder “effects” beside the experiment. The next diagnosis tests it, and the sandbox has sliders for it.")), place);
  const keep = async (sentence) => { await written(); say(sentence, true); };
  const remove = (one) => () => make(async () => {
    await post(`${path}/remove`, { id: one.id, version: one.version }, signal);
    await keep(`${one.id} is taken away; Ctrl+Z brings it back.`);
  }).catch(say);
  const list = () => fill(place,
    found.effects.map((one) => h("div", { class: "row end" },
      h("p", { class: "small" }, h("strong", {}, one.id), one.fault ? h("span", { class: "warn" }, ` ${one.fault}`) : `: ${one.name}`),
      h("span", { class: "row" }, !one.fault && h("button", { class: "small", "aria-label": `Change ${one.id}`, onclick: () => open(one) }, "Change"), h("button", { class: "small", "aria-label": `Take ${one.id} away`, onclick: remove(one) }, "Take away")))),
    h("div", { class: "row" }, h("button", { onclick: () => open({ ...EMPTY, terms: [first_term(found.grammar)] }) }, "New effect")));
  const open = (effect) => {
    const form = effect_form(effect, found.grammar, {
      save: (said) => make(async () => {
        const next = await post(path, said, signal);
        await keep(`Written to ${next.path}. The next diagnosis tests it.`);
      }),
      close: list,
    });
    fill(place, form);
    form.querySelector("input")?.focus();
    box.scrollIntoView({ block: "nearest" });
  };
  list();
  const offered = found.offered && !found.effects.some((one) => same(one.terms, found.offered.terms)) ? found.offered : null;
  return { box, offered, open: () => open({ ...offered, id: "" }) };
}

const same = (some, others) => JSON.stringify(some.map((one) => [one.channel, one.depends_on, one.pattern])) === JSON.stringify(others.map((one) => [one.channel, one.depends_on, one.pattern]));

function first_term(grammar) {
  return usual({ pattern: "common" }, grammar, grammar.channels[0].id, grammar.channels[0].bases[0].id);
}

// A term with the usual unit, bounds, step and name of its coefficient for its channel and basis.
function usual(term, grammar, channel, basis) {
  const { unit, low, high, step } = grammar.channels.find((one) => one.id === channel).bases.find((one) => one.id === basis);
  return { ...term, channel, depends_on: basis, coefficient: basis === "one" ? channel : `${channel}_by_${basis}`, unit, low, high, step };
}

function effect_form(effect, grammar, { save, close }) {
  const anew = !effect.version;
  let terms = effect.terms.map((one) => ({ ...one }));
  const id = h("input", { value: effect.id, required: true, disabled: !anew, autocomplete: "off", spellcheck: "false", placeholder: "mixed-drive" });
  const name = h("input", { value: effect.name, required: true, autocomplete: "off", placeholder: "the drive mixes the sides" });
  const sentence = h("input", { value: effect.sentence, autocomplete: "off" });
  const fault = h("p", { class: "warn small", role: "alert" });
  const rows = h("div", { class: "stack" });
  const draw = () => fill(rows, terms.map((term, k) => term_row(term, k, grammar, terms.length > 1, {
    turn: (next) => { terms[k] = next; draw(); rows.children[k].querySelector("select")?.focus(); },
    remove: () => { terms = terms.filter((_, other) => other !== k); draw(); rows.querySelector("select")?.focus(); },
  })));
  draw();
  return h("form", { class: "stack", "aria-label": anew ? "New effect" : `Effect ${effect.id}`, onkeydown: (event) => { if (event.key === "Escape") close(); }, onsubmit: async (event) => {
    event.preventDefault();
    if (!FORM.test(id.value.trim())) { fault.textContent = "The id must consist of lower-case letters, digits and hyphens, such as mixed-drive."; id.focus(); return; }
    try {
      await save({ version: effect.version, id: id.value.trim(), name: name.value, sentence: sentence.value || name.value, terms });
    } catch (error) { fault.textContent = error.message; }
  } },
  h("div", { class: "fields" }, h("label", { class: "field" }, h("span", {}, "Id, and name of its file"), id), h("label", { class: "field" }, h("span", {}, "What is wrong, in a few words"), name),
    h("label", { class: "field" }, h("span", {}, "What it does, in a sentence"), sentence)),
  rows, fault,
  h("div", { class: "row" }, h("button", { class: "main" }, "Write it"), h("button", { type: "button", onclick: () => { terms = [...terms, first_term(grammar)]; draw(); rows.lastElementChild.querySelector("select").focus(); } }, "Add a term"), h("button", { type: "button", onclick: close }, "Cancel")));
}

function term_row(term, k, grammar, several, { turn, remove }) {
  const channel = grammar.channels.find((one) => one.id === term.channel);
  const choice = (label, value, options, chosen) => h("label", { class: "field" }, h("span", {}, label),
    h("select", { "aria-label": `${label}, term ${k + 1}`, onchange: (event) => chosen(event.target.value) },
      (options.some(([one]) => one === value) ? options : [...options, [value, value]]).map(([one, words]) => h("option", { value: one, selected: one === value }, words))));
  const field = (label, key, number) => h("label", { class: "field" }, h("span", {}, label),
    h("input", { value: term[key] ?? "", "aria-label": `${label}, term ${k + 1}`, autocomplete: "off", spellcheck: "false", inputmode: number ? "decimal" : null, oninput: (event) => { term[key] = number ? event.target.value.trim().replace("−", "-").replace(",", ".") : event.target.value; } }));
  const of_channel = (next) => {
    const bases = grammar.channels.find((one) => one.id === next).bases;
    const takes = grammar.channels.find((one) => one.id === next).of_wheels;
    turn(usual({ pattern: takes ? term.pattern : "common" }, grammar, next, (bases.find((one) => one.id === term.depends_on) ?? bases[0]).id));
  };
  return h("fieldset", { class: "term" }, h("legend", { class: "small soft" }, `Term ${k + 1}`),
    choice("where it acts", term.channel, grammar.channels.map((one) => [one.id, one.words]), of_channel),
    choice("what it depends on", term.depends_on, (channel?.bases ?? []).map((one) => [one.id, one.words]), (basis) => turn(usual({ pattern: term.pattern }, grammar, term.channel, basis))),
    channel?.of_wheels ? choice("on which wheels", term.pattern, grammar.patterns.map((one) => [one, one === "common" ? "all alike" : one]), (pattern) => turn({ ...term, pattern })) : null,
    field("coefficient", "coefficient"), field("unit", "unit"), field("from", "low", true), field("to", "high", true), field("smallest visible step", "step", true),
    several ? h("button", { type: "button", class: "plain small", "aria-label": `Take term ${k + 1} away`, onclick: remove }, "Take away") : null);
}
