// The values of a gauge or robot file as a form: a field for each value, written when it is left.

import { get, post } from "./api.js";
import { fill, h } from "./dom.js";
import { say } from "./say.js";

const AXES = ["x", "y", "z"]; // names of the entries of a list
const UNITS = { percent: "%", g_mm2: "g·mm²" }; // units that are written differently in a file
const UNIT = /_(percent|g_mm2|mm|m|g|kg|mN|N|deg|rpm|s)$/;
const words = (key) => {
  const [, unit] = String(key).match(UNIT) ?? [];
  return `${String(key).replace(UNIT, "").replaceAll("_", " ")}${unit ? `, ${UNITS[unit] ?? unit}` : ""}`;
};
const label = (keys) => keys.map((key) => (typeof key === "number" ? (AXES[key] ?? key + 1) : words(key))).join(", ");
const heading = (keys) => keys.map((key) => (typeof key === "number" ? key + 1 : words(key))).join(" ");

// make(change): makes a change after those before it; changed(): called after it. Returns {box, again}.
export function values_form(title, path, signal, { make, changed }) {
  const place = h("div", { class: "stack" }), file = h("p", { class: "small soft" });
  const box = h("details", { class: "card" }, h("summary", {}, title), file, place);
  let found = null;
  const write = (keys, value) => make(async () => {
    try {
      found = await post(path, { version: found.version, place: keys, value }, signal);
      say(`Written to ${found.path}.`, true);
      changed?.();
    } catch (error) {
      say(error);
      if (error.status === 409) found = await get(path, signal);
    }
    draw();
  }).catch(say);
  const field = (keys, name, value) => {
    if (typeof value === "boolean") return h("label", {}, h("input", { type: "checkbox", checked: value, onchange: (event) => write(keys, event.target.checked) }), name);
    const numeric = typeof value === "number";
    return h("label", { class: "field" }, h("span", {}, name), h("input", { value: String(value), inputmode: numeric ? "decimal" : null, autocomplete: "off", spellcheck: "false", onchange: (event) => {
      const text = event.target.value.trim(), said = numeric ? Number(text.replace("−", "-").replace(",", ".")) : text;
      if (text === "" || (numeric && !Number.isFinite(said))) { say(`“${text}” is not a ${numeric ? "number" : "text"}.`); event.target.value = String(value); return; }
      write(keys, said);
    } }));
  };
  const draw = () => {
    const tables = new Map(); // fields by table of the file
    for (const { place: keys, value } of found.values) {
      const at = keys.slice(0, keys.findLastIndex((key) => typeof key === "string")), name = JSON.stringify(at);
      tables.set(name, [...(tables.get(name) ?? []), field(keys, label(keys.slice(at.length)), value)]);
    }
    file.textContent = `Kept in ${found.path}.`;
    fill(place, [...tables].map(([name, fields]) => {
      const at = JSON.parse(name), entry = typeof at.at(-1) === "number";
      return h("fieldset", { class: "term" }, at.length ? h("legend", { class: "small" }, heading(at)) : null, fields,
        entry && h("button", { class: "small", "aria-label": `Take away ${heading(at)}`, onclick: () => write(at, null) }, "Take away"));
    }));
  };
  const load = async () => { found = await get(path, signal); draw(); };
  box.addEventListener("toggle", () => { if (box.open && !found) load().catch(say); });
  return { box, again: () => (found ? load() : null) };
}
