// Undo and redo on every screen that writes: two buttons, and Ctrl+Z and Ctrl+Shift+Z where no text is typed.

import { get, post } from "./api.js";
import { h } from "./dom.js";
import { say } from "./say.js";

const TYPED = "input:not([type=range], [type=checkbox], [type=radio]), textarea";

// screen: its name on the server; id: of the experiment or gauge; changed(): updates the screen after undo or redo.
// make(change): makes a change of the screen after those before it, and returns its promise; make() without a change is
// called after a change by somebody else.
export function undoing(screen, id, signal, changed, run = "") {
  const path = `/api/undo/${screen}/${id}`;
  let next = { undo: null, redo: null };
  const button = (way, words, keys) => h("button", { title: `${words} (${keys})`, disabled: true, onclick: () => step(way) }, words);
  const buttons = { undo: button("undo", "Undo", "Ctrl+Z"), redo: button("redo", "Redo", "Ctrl+Shift+Z") };
  const ask = () => get(`${path}?run=${encodeURIComponent(run)}`, signal).then((found) => {
    next = found;
    for (const [way, one] of Object.entries(buttons)) {
      one.disabled = !next[way];
      one.title = `${one.textContent}${next[way] ? `: ${next[way].words}` : ""} (${way === "undo" ? "Ctrl+Z" : "Ctrl+Shift+Z"})`;
    }
  }).catch((error) => { if (error.name !== "AbortError") say(error); });
  // Changes and steps wait for each other: each starts from the result of the one before it.
  let line = ask();
  const make = (change) => {
    const made = line.then(change);
    line = made.then(ask, ask);
    return made;
  };
  const step = (way) => make(async () => {
    if (!next[way]) await ask(); // another tab may have made a change
    if (!next[way]) { say(`There is nothing to ${way} on this screen.`); return; }
    try {
      const { words } = await post(path, { way, number: next[way].number, run }, signal);
      await changed();
      say(`${way === "undo" ? "Undone" : "Done again"}: ${words}.`, true);
    } catch (error) {
      say(error);
      if (error.status === 409) await changed();
    }
  }).catch(say);
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.closest?.(TYPED)) return;
    event.preventDefault();
    step(event.shiftKey ? "redo" : "undo");
  }, { signal });
  return { ...buttons, make };
}
