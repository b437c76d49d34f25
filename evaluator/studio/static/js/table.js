// A table that is edited like a spreadsheet: arrows, Enter, paste of whole blocks, errors at their cells.

import { fill, h } from "./dom.js";

const MOST_NAMED = 5; // runs named in the sentence of a fault; all cells are marked
// A path that is too long for its cell is shown from the first word from which the rest fits: its end distinguishes it.
const ruler = new OffscreenCanvas(1, 1).getContext("2d");
const to_end = (input) => requestAnimationFrame(() => {
  input.style.textIndent = "";
  if (input === document.activeElement) return;
  const beyond = input.scrollWidth - input.clientWidth, text = input.value;
  if (beyond <= 0) return;
  const { fontSize, fontFamily } = getComputedStyle(input);
  ruler.font = `${fontSize} ${fontFamily}`;
  const before = [...text.matchAll(/[/\\ _-]+/g)].map((gap) => ruler.measureText(text.slice(0, gap.index + gap[0].length)).width);
  input.style.textIndent = `${-(before.find((width) => width >= beyond) ?? beyond)}px`;
});
const listed = (runs) => (runs.length > MOST_NAMED ? `${runs.slice(0, MOST_NAMED).join(", ")} and ${runs.length - MOST_NAMED} more` : runs.join(", "));

// columns: [{key, title, kind: "number" | "text", list, path}]. edit(edits) writes; chosen(row) when a row is entered.
export function sheet(columns, { edit, chosen, signal }) {
  const body = h("tbody");
  const problems = h("ul", { class: "problems", "aria-live": "polite" });
  const box = h("div", { class: "sheet" }, h("div", { class: "scroll" },
    h("table", {}, h("thead", {}, h("tr", {}, h("th", { class: "state" }, h("span", { class: "hidden" }, "State")), columns.map((column) => h("th", { scope: "col" }, column.title)), h("th", {}, h("span", { class: "hidden" }, "Remove")))), body)), problems);
  let rows = [], active = 0;
  const lines = []; // elements of each row: {row, dot, cells, remove}

  const parsed = (column, text) => {
    const trimmed = text.trim();
    if (trimmed === "") return { value: null };
    if (column.kind !== "number") return { value: trimmed };
    const value = Number(trimmed.replace("−", "-").replace(",", "."));
    return Number.isFinite(value) ? { value } : { fault: `“${trimmed}” is not a number` };
  };

  const cell = (index, column) => {
    const input = h("input", { class: column.kind, list: column.list ?? null, autocomplete: "off", spellcheck: "false", inputmode: column.kind === "number" ? "decimal" : null });
    input.dataset.row = index;
    input.dataset.key = column.key;
    input.addEventListener("change", () => {
      const { value, fault: wrong } = parsed(column, input.value);
      input.setCustomValidity(wrong ?? "");
      if (wrong) { input.setAttribute("aria-invalid", "true"); input.title = wrong; tell([wrong]); return; }
      edit([{ kind: "set", row: index, key: column.key, value }]);
    });
    let pointed = false; // focus by keyboard selects the whole text, so that typing replaces it
    input.addEventListener("pointerdown", () => { pointed = true; });
    input.addEventListener("focus", () => { if (!pointed) input.select(); pointed = false; if (active !== index) { active = index; mark(); chosen(index); } });
    if (column.path) for (const event of ["focus", "blur"]) input.addEventListener(event, () => to_end(input));
    return { input, box: h("td", {}, input), text: "", path: column.path };
  };
  const line = (index) => {
    const dot = h("span", { role: "img" }), cells = columns.map((column) => cell(index, column));
    const remove = h("button", { class: "plain small", title: "Remove this run from the table", onclick: () => edit([{ kind: "remove", row: index }]) }, "×");
    return { dot, cells, remove, row: h("tr", {}, h("td", { class: "state" }, dot), cells.map((one) => one.box), h("td", {}, remove)) };
  };
  // typing: text that is being typed stays, and is written when it is finished
  const show = (one, value, label, fault, typing) => {
    const { input } = one, text = value === undefined || value === null ? "" : String(value);
    input.setAttribute("aria-label", label);
    if (typing && input === document.activeElement && input.value !== one.text) return;
    one.text = text;
    if (input.value !== text) {
      input.value = text;
      if (input === document.activeElement) input.select();
    }
    input.setCustomValidity("");
    input.title = fault ?? (one.path ? text : "");
    if (one.path) to_end(input);
    one.box.className = fault ? "fault" : "";
    if (fault) input.setAttribute("aria-invalid", "true"); else input.removeAttribute("aria-invalid");
  };

  // Tab goes through the chosen row and on to its recording; arrows and Enter go from row to row.
  const mark = () => lines.forEach(({ row, cells, remove }, index) => {
    row.setAttribute("aria-selected", String(index === active));
    for (const one of [...cells.map(({ input }) => input), remove]) one.tabIndex = index === active ? 0 : -1;
  });
  const tell = (sentences) => fill(problems, sentences.map((sentence) => h("li", {}, sentence)));
  const at = (row, key) => body.querySelector(`input[data-row="${row}"][data-key="${key}"]`);

  body.addEventListener("keydown", (event) => {
    const input = event.target.closest("input[data-row]");
    if (!input) return;
    const row = Number(input.dataset.row), column = columns.findIndex((one) => one.key === input.dataset.key);
    const edge = input.selectionStart === input.selectionEnd && (event.key === "ArrowLeft" ? input.selectionStart === 0 : input.selectionEnd === input.value.length);
    const move = { ArrowUp: [-1, 0], ArrowDown: [1, 0], Enter: [event.shiftKey ? -1 : 1, 0], ArrowLeft: edge ? [0, -1] : null, ArrowRight: edge ? [0, 1] : null }[event.key];
    if (!move) return;
    const target = at(row + move[0], columns[column + move[1]]?.key);
    if (!target) { if (event.key === "Enter") input.blur(); return; }
    event.preventDefault();
    target.focus();
    target.select();
  });

  body.addEventListener("paste", (event) => {
    const input = event.target.closest("input[data-row]");
    const text = event.clipboardData.getData("text").replace(/\r/g, "").replace(/\n$/, "");
    if (!input || !/[\t\n]/.test(text)) return;
    event.preventDefault();
    pasteAt(Number(input.dataset.row), columns.findIndex((one) => one.key === input.dataset.key), text.split("\n").map((line) => line.split("\t")));
  });

  const pasteAt = (top, left, block) => {
    const edits = [], faults = [];
    block.forEach((cells, down) => {
      const values = {};
      cells.slice(0, columns.length - left).forEach((text, right) => {
        const column = columns[left + right];
        const { value, fault } = parsed(column, text);
        if (fault) faults.push(`row ${top + down + 1}, ${column.title}: ${fault}`);
        else if (top + down < rows.length) edits.push({ kind: "set", row: top + down, key: column.key, value });
        else if (value !== null) values[column.key] = value;
      });
      if (top + down >= rows.length && Object.keys(values).length) edits.push({ kind: "add", values });
    });
    if (edits.length) edit(edits, faults); else tell(faults);
  };

  // Per row {kind, title}.
  const tell_states = (states) => lines.forEach(({ dot }, index) => {
    const { kind = "", title = "" } = states[index] ?? {};
    dot.className = `dot ${kind}`;
    dot.title = title;
    dot.setAttribute("aria-label", title);
  });
  // Rows are made once and then updated, so that the focus stays while somebody types. extra: sentences shown with the faults.
  const draw = (found, states, extra = []) => {
    const typing = rows.length === found.rows.length; // else the row may be another run's now
    rows = found.rows;
    active = Math.min(active, Math.max(rows.length - 1, 0));
    const faults = new Map(found.faults.filter((one) => one.row !== null).map((one) => [`${one.row}.${one.key || "id"}`, one.sentence]));
    while (lines.length > rows.length) lines.pop().row.remove();
    while (lines.length < rows.length) {
      lines.push(line(lines.length));
      body.append(lines.at(-1).row);
    }
    lines.forEach(({ cells, remove }, index) => {
      const run = `run ${rows[index].id ?? index + 1}`;
      remove.setAttribute("aria-label", `Remove ${run}`);
      cells.forEach((one, k) => show(one, rows[index][columns[k].key], `${columns[k].title}, ${run}`, faults.get(`${index}.${columns[k].key}`), typing));
    });
    tell_states(states);
    mark();
    const concerned = new Map(); // runs by sentence
    for (const { row, sentence } of found.faults) concerned.set(sentence, [...(concerned.get(sentence) ?? []), ...(row === null ? [] : [rows[row]?.id ?? `row ${row + 1}`])]);
    tell([...extra, ...[...concerned].map(([sentence, runs]) => (runs.length ? `${listed(runs)}: ${sentence}` : sentence))]);
  };
  const unused = (number) => { const id = `r${String(number).padStart(2, "0")}`; return rows.some((row) => row.id === id) ? unused(number + 1) : id; };
  void signal;
  return { box, draw, states: tell_states, choose: (row) => { active = row; mark(); }, add: () => edit([{ kind: "add", values: { id: unused(rows.length + 1), start_s: 0.5 } }]) };
}
