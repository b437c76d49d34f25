// Dots of a gauge drawn over an image of it: those of the array, and others.

import { pen } from "./dom.js";

export function outline_dots(context, dots, scale) {
  dots.centers_px.forEach(([x, y], k) => {
    context.strokeStyle = dots.of_array[k] ? "#5aff78" : "#ff8a4c";
    context.lineWidth = pen(1.5);
    context.beginPath();
    context.arc(x * scale, y * scale, Math.max(((dots.diameter_px ?? 8) / 2) * scale * 1.2, 3), 0, 7);
    context.stroke();
  });
}
