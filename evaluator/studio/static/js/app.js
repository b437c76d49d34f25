// The screen that is shown. Addresses: #/, #/camera, #/sandbox, and #/x/EXPERIMENT/SCREEN for all but the first.

import { fill, h } from "./dom.js";
import { get, GONE, Refused } from "./api.js";
import { listen } from "./jobs.js";
import { say } from "./say.js";

const SCREENS = {
  home: () => import("./home.js"),
  runs: () => import("./runs.js"),
  marks: () => import("./marks.js"),
  camera: () => import("./camera.js"),
  results: () => import("./results.js"),
  diagnosis: () => import("./diagnosis.js"),
  sandbox: () => import("./sandbox.js"),
};
const OF_EXPERIMENT = [["camera", "Camera"], ["runs", "Runs"], ["marks", "Marks"], ["results", "Results"], ["diagnosis", "Diagnosis"], ["sandbox", "Sandbox"]];
const HOME = ["home", "Home"];
const ALONE = [HOME, ["camera", "Camera"], ["sandbox", "Sandbox"]];

let leaving = new AbortController();

function place() {
  const parts = location.hash.replace(/^#\/?/, "").split("/").filter(Boolean).map(decodeURIComponent);
  if (parts[0] === "x" && parts[1]) return { screen: parts[2] ?? "runs", id: parts[1], rest: parts.slice(3) };
  return { screen: parts[0] ?? "home", id: null, rest: parts.slice(1) };
}

async function show() {
  leaving.abort();
  leaving = new AbortController();
  const { signal } = leaving;
  const { screen, id, rest } = place();
  const load = SCREENS[screen] ?? SCREENS.home;
  top_bar(screen, id);
  const main = document.getElementById("main");
  say("");
  try {
    const module = await load().catch(() => { throw new Refused(GONE, 0); });
    if (signal.aborted) return;
    const view = h("div", { class: `screen ${screen}` }, h("p", { class: "soft", role: "status" }, "…"));
    fill(main, view);
    main.focus({ preventScroll: true }); // now, because a user may have moved the focus when the screen is complete
    window.scrollTo(0, 0);
    await module.show(view, { id, rest, signal });
    if (signal.aborted) return;
    document.title = `${screen === "home" ? "" : `${screen} · `}turnscope studio`;
  } catch (error) {
    if (error.name !== "AbortError" && !signal.aborted) {
      fill(main, h("div", { class: "empty" }, h("h2", {}, "This cannot be shown"), h("p", {}, error.message), h("p", { class: "row" }, id && screen !== "runs" && h("a", { href: `#/x/${id}/runs` }, "See its runs"), h("a", { href: "#/" }, "Back to the first screen"))));
    }
  }
}

let names = new Map();
async function top_bar(screen, id) {
  const bar = document.getElementById("top");
  const link = ([name, words]) => h("a", { href: name === "home" ? "#/" : id ? `#/x/${id}/${name}` : `#/${name}`, "aria-current": name === screen ? "page" : null }, words);
  const draw = () => fill(bar,
    h("a", { class: "brand", href: "#/", "aria-label": "turnscope studio, first screen" }, h("img", { src: "/static/icon.svg", alt: "" }), "turnscope"),
    id && h("span", { class: "where", title: names.get(id) ?? "" }, names.get(id) ?? ""),
    h("nav", { "aria-label": "Screens" }, (id ? [HOME, ...OF_EXPERIMENT] : ALONE).map(link)));
  draw();
  if (id && !names.has(id)) {
    try {
      const home = await get("/api/home");
      names = new Map(home.experiments.map((one) => [one.id, one.name]));
      if (place().id === id) draw();
    } catch (error) { say(error); }
  }
}

window.addEventListener("hashchange", show);
listen();
show();
