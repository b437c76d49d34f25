// One sentence at the top of the page, for people and for screen readers.

import { Refused } from "./api.js";
import { fill, h } from "./dom.js";

// next: [words, address] of the next step.
export function say(message, good = false, next = null) {
  if (message?.name === "AbortError") return;
  if (message instanceof Error && !(message instanceof Refused)) console.error(message); // a defect of the page
  const text = message instanceof Error ? message.message : message;
  const place = document.getElementById("said");
  if (!text) { fill(place); return; }
  fill(place, h("p", { class: good ? "" : "bad" }, h("span", {}, text, next && [" ", h("a", { href: next[1] }, next[0])]), h("button", { class: "plain small", onclick: () => fill(place) }, "Close")));
}
