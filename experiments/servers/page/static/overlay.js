// Annotation of the picture: springs, marks, needle, target. `at` maps pixels of the picture to the canvas.

import { LIGHT, SPRING, TARGET, cross, ellipse, light, trace, word } from "./strokes.js";

export function overlay(context, scene, seen, { at, scale, old }) {
  springs(context, scene, seen, at);
  const marks = Object.fromEntries(scene.marks.map((mark) => [mark.node, mark]));
  for (const mark of seen.marks) drawMark(context, mark, marks[mark.node], at, scale);
  if (seen.needle !== null) needle(context, seen.needle, at, scale);
  target(context, seen, { at, scale, old });
}

// The inset of the target: its size, 95 % ellipse, needle and aim
export function closer(context, seen, { at, scale, old }) {
  if (seen.needle !== null) needle(context, seen.needle, at, scale);
  target(context, seen, { at, scale, old });
}

function rows(axes, scale) {
  return axes.map(([x, y]) => [scale * x, scale * y]);
}

function columns([[a, b], [c, d]], scale, by = 1) {
  return rows([[by * a, by * c], [by * b, by * d]], scale);
}

function springs(context, scene, seen, at) {
  for (const [one, other] of scene.springs) {
    const ends = [seen.nodes_px[one], seen.nodes_px[other]];
    if (ends.every(Boolean)) trace(context, ends.map(at), SPRING, 1.2);
  }
  scene.nodes.forEach((node, k) => {
    const place = seen.nodes_px[k];
    if (!place) return;
    const [x, y] = at(place);
    const box = [[x - 4, y - 4], [x + 4, y - 4], [x + 4, y + 4], [x - 4, y + 4], [x - 4, y - 4]];
    trace(context, node.fixed ? box : ellipse([x, y], [[3, 0], [0, 3]]), SPRING, 1.2);
  });
}

function drawMark(context, mark, known, at, scale) {
  const colour = light(known?.hue_deg ?? 0);
  const width = known?.measured === false ? 1 : 2.5;
  if (mark.expected_px && mark.expected_ellipse_px && known?.measured !== false) {
    trace(context, ellipse(at(mark.expected_px), rows(mark.expected_ellipse_px, scale)), colour, 1, [3, 3]);
  }
  const place = mark.center_px ?? mark.expected_px;
  if (!place) return;
  const center = at(place);
  const outline = ellipse(center, columns(mark.shape_px, scale, 1.35));
  trace(context, outline, colour, width, mark.center_px ? [] : [6, 5]);
  const half = Math.max(...outline.map(([x]) => x)) - center[0];
  if (mark.fate === "refused") cross(context, center, 1.2 * half, LIGHT, 2.5, true);
  const text = mark.fate === "found" ? mark.node : `${mark.node} ${mark.fate}`;
  // The name of the target's own mark, for scoring, would cover the target
  if (known?.measured !== false) word(context, text, center[0] + half + 5, center[1] - half - 2, colour);
}

function needle(context, { shaft_px, ahead_px, aim_px, aim_ellipse_px }, at, scale) {
  if (ahead_px.every(Boolean)) trace(context, ahead_px.map(at), LIGHT, 1.5, [6, 5]);
  if (shaft_px.every(Boolean)) trace(context, shaft_px.map(at), LIGHT, 4);
  if (!aim_px) return;
  if (aim_ellipse_px) trace(context, ellipse(at(aim_px), rows(aim_ellipse_px, scale)), LIGHT, 1.2, [4, 4]);
  cross(context, at(aim_px), 7, LIGHT, 1.5, true);
}

function target(context, seen, { at, scale, old }) {
  if (!seen.target_px) return;
  const sure = seen.trusted && !old;
  const place = at(seen.target_px);
  context.globalAlpha = sure ? 1 : 0.45;
  trace(context, ellipse(place, columns(seen.target_shape_px, scale)), TARGET, 1.2, [3, 3]);
  if (seen.target_ellipse_px) {
    trace(context, ellipse(place, rows(seen.target_ellipse_px, scale)), TARGET, 2.2, sure ? [] : [7, 5]);
  }
  cross(context, place, 6, TARGET, 1.2, false);
  context.globalAlpha = 1;
}
