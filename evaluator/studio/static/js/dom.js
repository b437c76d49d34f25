// Elements from plain values. Text stays text: nothing that comes from a file is read as HTML.

export function h(name, attributes = {}, ...children) {
  const element = document.createElement(name);
  for (const [key, value] of Object.entries(attributes ?? {})) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "value" || key === "checked" || key === "disabled") element[key] = value;
    else if (key === "style") Object.assign(element.style, value);
    else element.setAttribute(key, value === true ? "" : String(value));
  }
  element.append(...children.flat(3).filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

export function fill(parent, ...children) {
  const nodes = children.flat(3).filter((child) => child !== null && child !== undefined && child !== false);
  if (pressed && parent.contains(pressed)) held.set(parent, nodes);
  else {
    held.delete(parent);
    replace(parent, nodes);
  }
  return parent;
}

// After a part of the page is replaced, the focus moves to the same element, else to one of the same name, else to one at
// the same place, else to the part itself, so that users of the keyboard can go on.
const FOCUSABLE = ["a[href]", "button", "input", "select", "textarea", "summary", "[tabindex='0']"].map((one) => `${one}:not(:disabled)`).join();
const nameOf = (element) => element.getAttribute("aria-label") ?? element.labels?.[0]?.textContent ?? element.textContent;
const pathTo = (element, parent) => (element === parent ? [] : [...pathTo(element.parentElement, parent), [...element.parentElement.children].indexOf(element)]);
let entered = null; // element that has the focus, also while it is out of the page
document.addEventListener("focusin", (event) => { entered = event.target; });
function replace(parent, nodes) {
  const taken = entered && !entered.isConnected ? entered : null, active = document.activeElement;
  const before = taken ?? active, lost = !taken && parent !== active && parent.contains(active);
  const name = lost && nameOf(before), path = lost ? pathTo(before, parent) : [];
  parent.replaceChildren(...nodes);
  if (!(lost || (taken && parent.contains(taken)))) return;
  const namesake = [...parent.querySelectorAll(FOCUSABLE)].find((one) => one.tagName === before.tagName && nameOf(one) === name);
  let next = parent.contains(before) ? before : namesake;
  for (let there = path.reduce((found, k) => found.children[k] ?? found, parent); !next && parent.contains(there); there = there.parentElement)
    next = there.matches(FOCUSABLE) ? there : there.querySelector(FOCUSABLE);
  (next ?? parent).focus({ preventScroll: true });
  if (document.activeElement !== document.body) return;
  parent.tabIndex = -1;
  parent.focus({ preventScroll: true });
}

// A part in which the pointer is pressed is replaced after the release: browsers drop the click on a replaced button.
let pressed = null;
const held = new Map(); // new content by parent
const let_go = () => {
  pressed = null;
  for (const [parent, nodes] of held) replace(parent, nodes);
  held.clear();
};
const OWN_PRESS = "select, input"; // their popups consume the release
window.addEventListener("pointerdown", (event) => { pressed = event.button === 0 && !event.target.closest(OWN_PRESS) ? event.target : null; }, true);
window.addEventListener("click", () => { pressed = null; }, true); // content shown by the click itself is not delayed
for (const end of ["pointerup", "pointercancel"]) window.addEventListener(end, () => setTimeout(let_go), true);
window.addEventListener("blur", let_go);

// A number as text: with some digits, a true minus sign, and a dash if it is unknown.
export function num(value, digits = 3) {
  if (value === null || value === undefined || !Number.isFinite(Number(value))) return "–";
  const text = Number(value).toPrecision(digits);
  return (text.includes("e") ? Number(text).toString() : text.includes(".") ? text.replace(/0+$/, "").replace(/\.$/, "") : text).replace("-", "−");
}

export const fixed = (value, decimals) =>
  value === null || value === undefined || !Number.isFinite(value) ? "–" : value.toFixed(decimals).replace("-", "−");

// A value and its 95 % bounds with as many decimals as the interval justifies, as in the report.
export function withBounds({ value, low, high }) {
  if (![value, low, high].every(Number.isFinite) || high <= low) return [value, low, high].map((one) => num(one));
  const decimals = Math.max(0, -Math.floor(Math.log10((high - low) / 4)));
  return [value, low, high].map((one) => fixed(Math.abs(one) < 0.5 / 10 ** decimals ? 0 : one, decimals));
}

// A length: in µm, or in mm from ten millimetres on (large robots).
export const length = (mm) => (mm >= 10 ? `${num(mm)} mm` : `${num(1000 * mm)} µm`);

export const counted = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;

// A colour of the theme; cached, because reading it costs a layout of the page.
const colors = new Map();
export function color(name) {
  if (!colors.has(name)) colors.set(name, getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim());
  return colors.get(name);
}

// A width or radius on a canvas, px at the usual size of text. It grows with the text, so that lines stay visible on large screens.
const USUAL_FONT_PX = 15; // of a window 1366 px wide, by the rule for html in base.css
let growth = 0; // 0: to be measured again
window.addEventListener("resize", () => { growth = 0; });
export const pen = (px) => px * (growth ||= parseFloat(getComputedStyle(document.documentElement).fontSize) / USUAL_FONT_PX);

// The font of labels on a canvas: it grows with the page.
export function labels(share = 0.74) {
  const style = getComputedStyle(document.documentElement);
  return `${Math.round(share * parseFloat(style.fontSize))}px ${style.getPropertyValue("--font")}`;
}

const dark = window.matchMedia("(prefers-color-scheme: dark)");
dark.addEventListener("change", () => colors.clear()); // first of all listeners
export function whenThemeChanges(redraw, signal) {
  dark.addEventListener("change", redraw, { signal });
}

// A canvas that fills its box at the resolution of the screen; draw(context, width, height) in CSS px.
export function surface(draw, signal, attributes = {}) {
  const canvas = h("canvas", attributes);
  let width = 0, height = 0;
  const redraw = () => {
    if (!width || !height || signal.aborted) return; // images of a screen that was left are closed
    const scale = window.devicePixelRatio || 1;
    if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
      canvas.width = Math.round(width * scale);
      canvas.height = Math.round(height * scale);
    }
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, scale, 0, 0);
    context.clearRect(0, 0, width, height);
    draw(context, width, height);
  };
  const watcher = new ResizeObserver(() => { ({ clientWidth: width, clientHeight: height } = canvas); redraw(); });
  watcher.observe(canvas);
  signal.addEventListener("abort", () => watcher.disconnect());
  whenThemeChanges(redraw, signal);
  return { canvas, redraw };
}
