// Pointing in a frame, by mouse or keyboard: arrows move a cross (with Shift by ten px), Enter presses and releases, Escape
// cancels what is being drawn.

const WAYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };

// The caller draws state.cursor and state.draft. press(x, y) and drawn(box) receive px of the frame.
export function pointing(screen, frames, state, { draws, press, drawn, start }) {
  const { canvas } = screen;
  const at = (event) => {
    const { clientWidth: width, clientHeight: height } = canvas;
    const scale = Math.min(width / frames.width, height / frames.height);
    return [(event.offsetX - (width - frames.width * scale) / 2) / scale, (event.offsetY - (height - frames.height * scale) / 2) / scale];
  };
  const begin = (x, y) => { if (draws()) state.draft = [x, y, x, y]; else press(x, y); };
  const drag = (x, y) => { if (state.draft) { state.draft = [state.draft[0], state.draft[1], x, y]; screen.redraw(); } };
  const end = () => {
    if (!state.draft) return;
    const [x0, y0, x1, y1] = state.draft.map(Math.round);
    state.draft = null;
    screen.redraw();
    drawn([Math.min(x0, x1), Math.min(y0, y1), Math.max(x0, x1), Math.max(y0, y1)]);
  };
  canvas.addEventListener("pointerdown", (event) => { begin(...at(event)); if (state.draft) canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => drag(...at(event)));
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("mousedown", (event) => event.preventDefault()); // no focus: after a click the arrows step frames
  canvas.addEventListener("blur", () => { state.cursor = null; screen.redraw(); });
  canvas.addEventListener("keydown", (event) => {
    const way = WAYS[event.key];
    if (event.ctrlKey || event.metaKey || !(way || ["Enter", "Escape"].includes(event.key))) return;
    event.preventDefault();
    event.stopPropagation(); // arrows step frames elsewhere
    state.cursor ??= start();
    if (way) {
      const step = event.shiftKey ? 10 : 1;
      const within = (value, most) => Math.max(0, Math.min(most - 1, value));
      state.cursor = [within(state.cursor[0] + way[0] * step, frames.width), within(state.cursor[1] + way[1] * step, frames.height)];
      drag(...state.cursor);
    } else if (event.key === "Escape") state.draft = null;
    else if (state.draft) end();
    else begin(...state.cursor);
    screen.redraw();
  });
}
