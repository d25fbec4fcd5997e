// Lines, ellipses and text that are legible on any picture: light with a dark edge. Positions are in pixels of the canvas.

const DARK = "rgb(0 0 0 / .75)";
const CORNERS = 48;

export const TARGET = "#f0e442";
export const LIGHT = "#ffffff";
export const SPRING = "#d7d7d7";

export function light(hueDeg) {
  return `hsl(${hueDeg} 100% 68%)`;
}

// Points of center + A (cos t, sin t); A is given by its columns
export function ellipse([x, y], [a, b]) {
  return Array.from({ length: CORNERS + 1 }, (_, k) => {
    const t = (2 * Math.PI * k) / CORNERS;
    return [x + Math.cos(t) * a[0] + Math.sin(t) * b[0], y + Math.cos(t) * a[1] + Math.sin(t) * b[1]];
  });
}

export function trace(context, points, colour, width, dash = []) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(x, y);
  context.setLineDash([]);
  context.lineWidth = width + 2;
  context.strokeStyle = DARK;
  context.stroke();
  context.setLineDash(dash);
  context.lineWidth = width;
  context.strokeStyle = colour;
  context.stroke();
  context.setLineDash([]);
}

export function cross(context, [x, y], half, colour, width, diagonal) {
  const ends = diagonal ? [[half, half], [half, -half]] : [[half, 0], [0, half]];
  for (const [u, v] of ends) trace(context, [[x - u, y - v], [x + u, y + v]], colour, width);
}

export function word(context, text, x, y, colour, size = 13) {
  context.font = `600 ${size}px system-ui, "DejaVu Sans", sans-serif`;
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = DARK;
  context.strokeText(text, x, y);
  context.fillStyle = colour;
  context.fillText(text, x, y);
}
