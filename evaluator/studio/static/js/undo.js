// Undo and redo, on every screen that writes: two buttons, and Ctrl+Z and Ctrl+Shift+Z wherever no text is typed.

import { get, post } from "./api.js";
import { h } from "./dom.js";
import { say } from "./say.js";

const TYPED = "input:not([type=range], [type=checkbox], [type=radio]), textarea";

// screen: as the server calls it; id: of the experiment or gauge; changed(): show anew what was undone or redone.
export function undoing(screen, id, signal, changed, run = "") {
  const path = `/api/undo/${screen}/${id}`;
  let next = { undo: null, redo: null };
  const button = (way, words, keys) => h("button", { title: `${words} (${keys})`, disabled: true, onclick: () => step(way) }, words);
  const buttons = { undo: button("undo", "Undo", "Ctrl+Z"), redo: button("redo", "Redo", "Ctrl+Shift+Z") };
  const refresh = () => get(`${path}?run=${encodeURIComponent(run)}`, signal).then((found) => {
    next = found;
    for (const [way, one] of Object.entries(buttons)) {
      one.disabled = !next[way];
      one.title = `${one.textContent}${next[way] ? `: ${next[way].words}` : ""} (${way === "undo" ? "Ctrl+Z" : "Ctrl+Shift+Z"})`;
    }
  }).catch((error) => { if (error.name !== "AbortError") say(error); });
  // One step after another: each is meant for what the one before it left.
  let queue = Promise.resolve();
  const step = (way) => (queue = queue.then(async () => {
    if (!next[way]) await refresh(); // the key may be faster than the news of the change that it takes back
    if (!next[way]) { say(`There is nothing to ${way} on this screen.`); return; }
    try {
      const { words } = await post(path, { way, number: next[way].number, run }, signal);
      await changed();
      say(`${way === "undo" ? "Undone" : "Done again"}: ${words}.`, true);
    } catch (error) {
      say(error);
      if (error.status === 409) await changed();
    }
    await refresh();
  }));
  document.addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || event.target.closest?.(TYPED)) return;
    event.preventDefault();
    step(event.shiftKey ? "redo" : "undo");
  }, { signal });
  refresh();
  return { ...buttons, refresh };
}
