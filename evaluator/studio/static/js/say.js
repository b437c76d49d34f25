// One sentence at the top of the page, for people and for screen readers.

import { fill, h } from "./dom.js";

// next: [words, address] of what to do now.
export function say(message, good = false, next = null) {
  if (message?.name === "AbortError") return;
  const text = message instanceof Error ? message.message : message;
  const place = document.getElementById("said");
  if (!text) { fill(place); return; }
  fill(place, h("p", { class: good ? "" : "bad" }, h("span", {}, text, next && [" ", h("a", { href: next[1] }, next[0])]), h("button", { class: "plain small", onclick: () => fill(place) }, "Close")));
}
