// Curves over time with a line at the frame that is shown. uPlot draws them.

/* global uPlot */
import { color, h, labels, pen, whenThemeChanges } from "./dom.js";

// lines: [{label, values, ink, dash}] over times; seek(time) is called for a click.
// timed: whether times are written below it, as below the last of several plots.
export function curvePlot(title, times, lines, { signal, seek, timed }) {
  const box = h("div", { class: "curve", role: "img", "aria-label": title });
  const rem = parseFloat(labels(1)), tall = () => box.clientHeight;
  let plot = null, head = null, shown = null;
  const options = (width) => ({
    width, height: tall(), title: null, legend: { show: false }, cursor: { points: { show: false }, drag: { x: false, y: false } },
    scales: { x: { time: false } },
    series: [{}, ...lines.map((line) => ({ label: line.label, stroke: () => color(line.ink), width: pen(1.5), dash: line.dash, points: { show: false } }))],
    axes: [{ ...axis((value) => (timed ? `${value} s` : "")), size: (timed ? 1.7 : 0.5) * rem, space: 4 * rem }, { ...axis((value) => value), label: title, labelSize: 1.1 * rem, labelFont: labels(), size: 3.4 * rem, space: 1.4 * rem }],
  });
  const axis = (words) => ({
    stroke: () => color("soft"), font: labels(),
    values: (_, splits) => splits.map((split) => words(split.toLocaleString("en").replace("-", "−"))),
    grid: { stroke: () => color("faint"), width: 1 }, ticks: { stroke: () => color("faint"), width: 1, size: 4 },
  });
  const build = () => {
    const width = box.clientWidth;
    if (!width) return;
    if (plot) { plot.setSize({ width, height: tall() }); place(); return; }
    plot = new uPlot(options(width), [times, ...lines.map((line) => line.values)], box);
    head = h("div", { class: "head" });
    plot.over.append(head);
    plot.over.addEventListener("click", (event) => seek(plot.posToVal(event.offsetX, "x")));
    place();
  };
  const place = () => { if (plot && shown !== null) head.style.transform = `translateX(${plot.valToPos(shown, "x")}px)`; };
  const watcher = new ResizeObserver(build);
  watcher.observe(box);
  whenThemeChanges(() => plot?.redraw(false), signal);
  signal.addEventListener("abort", () => { watcher.disconnect(); plot?.destroy(); });
  return { box, at: (time) => { shown = time; place(); } };
}
