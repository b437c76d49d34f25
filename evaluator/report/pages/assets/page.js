"use strict";
// Figures are saved with plain colours: programs that read SVG files do not know the variables of this page.
for (const link of document.querySelectorAll("a.svg")) {
  link.addEventListener("click", (event) => {
    event.preventDefault();
    const panels = [...link.closest("figure").querySelectorAll(".drawing svg")];
    const columns = Math.min(3, panels.length), { width, height } = panels[0].viewBox.baseVal;
    const inside = panels.map((panel, index) => {
      const copy = panel.cloneNode(true);
      const place = { x: (index % columns) * width, y: Math.floor(index / columns) * height, width, height };
      for (const [key, value] of Object.entries(place)) copy.setAttribute(key, value);
      return copy.outerHTML;
    });
    const rows = Math.ceil(panels.length / columns);
    const text = `<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" `
      + `viewBox="0 0 ${columns * width} ${rows * height}">${inside.join("")}</svg>`
        .replace(/var\(--[a-z]+, (#[0-9a-f]{6})\)/g, "$1");
    const place = URL.createObjectURL(new Blob([text], { type: "image/svg+xml" }));
    const saver = Object.assign(document.createElement("a"), { href: place, download: link.download });
    saver.click();
    setTimeout(() => URL.revokeObjectURL(place), 1000);
  });
}

const source = document.getElementById("player-data");
if (source) startPlayer(JSON.parse(source.textContent));

function startPlayer({ runs, robot, lines, unit: length }) {
  const find = (name) => document.getElementById(`player-${name}`);
  const [choice, play, slider, clock, plot, image, note] =
    ["run", "play", "time", "clock", "plot", "image", "note"].map(find);
  const film = image.parentElement;
  let run, timer = null, moving = {};

  runs.forEach((item, index) => choice.add(new Option(item.label, index)));
  choice.addEventListener("change", () => show(runs[choice.value]));
  slider.addEventListener("input", () => { stop(); moveTo(slider.value / 1000); });
  play.addEventListener("click", () => (timer ? stop() : start()));
  show(runs[0]);

  function draw(parent, name, attributes) {
    const element = document.createElementNS("http://www.w3.org/2000/svg", name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    return parent.appendChild(element);
  }

  // Plate millimetres with y up; a missing point breaks the line.
  function path(x, y) {
    let text = "", pen = "M";
    for (let i = 0; i < x.length; i++) {
      if (x[i] === null || y[i] === null) { pen = "M"; continue; }
      text += `${pen}${x[i]} ${-y[i]}`;
      pen = "L";
    }
    return text;
  }

  function show(chosen) {
    run = chosen;
    stop();
    plot.replaceChildren();
    const known = (values) => values.filter((value) => value !== null);
    const xs = known([...run.marks.flatMap(([x]) => x), ...run.x, ...run.sx]);
    const ys = known([...run.marks.flatMap(([, y]) => y), ...run.y, ...run.sy]);
    const [left, right] = [Math.min(...xs), Math.max(...xs)], [low, high] = [Math.min(...ys), Math.max(...ys)];
    const pad = Math.hypot(robot.length, robot.width) / 2;
    let width = right - left + 2 * pad, height = high - low + 2 * pad;
    width = Math.max(width, (height * 4) / 3);
    height = Math.max(height, (width * 3) / 4);
    const [cx, cy] = [(left + right) / 2, -(low + high) / 2];
    plot.setAttribute("viewBox", `${cx - width / 2} ${cy - height / 2} ${width} ${height}`);
    const unit = width / 400;
    grid(cx - width / 2, cy - height / 2, width, height, unit);
    // As in the legend: the marks, then centre, simulated centre, circle.
    const looks = lines.map(({ color, width, dash }) => ({
      fill: "none", stroke: `var(--${color})`, "stroke-width": width * unit,
      ...(dash.length ? { "stroke-dasharray": dash.map((part) => part * width * unit).join(" ") } : {}),
    }));
    const [centre, simulated, circle] = looks.slice(-3);
    run.marks.forEach(([x, y], k) => draw(plot, "path", { d: path(x, y), ...looks[k] }));
    draw(plot, "path", { d: path(run.x, run.y), ...centre });
    draw(plot, "path", { d: path(run.sx, run.sy), ...simulated });
    if (run.circle) {
      const [x, y, r] = run.circle;
      draw(plot, "circle", { cx: x, cy: -y, r, ...circle });
    }
    const body = draw(plot, "g", {});
    draw(body, "rect", { x: -robot.length / 2, y: -robot.width / 2, width: robot.length, height: robot.width, rx: 0.3,
      fill: "var(--ink)", "fill-opacity": 0.14, stroke: "var(--ink)", "stroke-width": unit });
    for (const { color, place: [x, y], size } of robot.marks)
      draw(body, "circle", { cx: x, cy: -y, r: size / 2, fill: `var(--${color})` });
    moving = { body };
    film.classList.toggle("empty", run.thumbnails.length === 0);
    moveTo(0);
    slider.value = 0;
  }

  function grid(left, top, width, height, unit) {
    const raw = width / 6, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((value) => value >= raw);
    const label = (x, y, text, anchor) => {
      draw(plot, "text", { x, y, "font-size": 11 * unit, fill: "var(--soft)", "text-anchor": anchor }).textContent = `${text}`.replace("-", "−");
    };
    for (let x = Math.ceil(left / step) * step; x < left + width; x += step) {
      draw(plot, "line", { x1: x, x2: x, y1: top, y2: top + height, stroke: "var(--faint)", "stroke-width": 0.7 * unit });
      if (x > left + width * 0.08 && x < left + width * 0.9) label(x, top + height - 5 * unit, +(x / length.mm).toPrecision(6), "middle");
    }
    for (let y = Math.ceil(top / step) * step; y < top + height; y += step) {
      draw(plot, "line", { x1: left, x2: left + width, y1: y, y2: y, stroke: "var(--faint)", "stroke-width": 0.7 * unit });
      if (y < top + height * 0.93) label(left + 4 * unit, y - 3 * unit, +(-y / length.mm).toPrecision(6) || 0, "start");
    }
    label(left + width - 5 * unit, top + height - 5 * unit, length.name, "end");
  }

  function moveTo(share) {
    const last = run.t.length - 1, at = Math.round(share * last);
    clock.textContent = `${run.t[at].toFixed(2)} s`;
    const visible = run.x[at] !== null && run.heading[at] !== null;
    moving.body.setAttribute("visibility", visible ? "visible" : "hidden");
    if (visible) moving.body.setAttribute("transform", `translate(${run.x[at]} ${-run.y[at]}) rotate(${-run.heading[at]})`);
    note.textContent = run.note + (visible ? "" : " No pose at this time: a mark is missing.");
    if (run.thumbnails.length) {
      const nearest = run.thumbnails.reduce((best, item) =>
        Math.abs(item[0] - run.t[at]) < Math.abs(best[0] - run.t[at]) ? item : best);
      if (image.dataset.at !== `${run.label}${nearest[0]}`) {
        image.src = `data:image/jpeg;base64,${nearest[1]}`;
        image.dataset.at = `${run.label}${nearest[0]}`;
      }
      note.textContent += ` Frame at ${nearest[0].toFixed(2)} s.`;
    }
  }

  function start() {
    play.textContent = "❚❚";
    const length = run.t.at(-1) - run.t[0], from = slider.value >= 1000 ? 0 : slider.value / 1000, began = performance.now();
    const step = (now) => {
      const share = from + (now - began) / 1000 / length;
      slider.value = 1000 * Math.min(share, 1);
      moveTo(Math.min(share, 1));
      timer = share < 1 ? requestAnimationFrame(step) : null;
      if (!timer) play.textContent = "▶";
    };
    timer = requestAnimationFrame(step);
  }

  function stop() {
    if (timer) cancelAnimationFrame(timer);
    timer = null;
    play.textContent = "▶";
  }
}
