// Tissue without a picture: projections of springs, target and its 95 % ellipse along an axis, from positions in mm.

import { WITHIN_95 } from "./plots.js";
import { SPRING, TARGET, cross, ellipse, trace, word } from "./strokes.js";

const AXES = "xyz";
const PAIRS = { 2: [[0, 1]], 3: [[0, 1], [2, 1]] };

// Returns a notice in place of a drawing, or null
export function projections(context, scene, state, { width, height, old }) {
  if (state.nodes_mm === null) return "there is neither a picture nor positions of nodes to show";
  const pairs = PAIRS[scene.dim];
  pairs.forEach((pair, k) => {
    const room = width / pairs.length;
    panel(context, scene, state, { pair, left: k * room, width: room, height, old });
  });
  return null;
}

function panel(context, scene, state, { pair, left, width, height, old }) {
  const [i, j] = pair;
  // By the drawn positions, so that the frame stays fixed
  const drawn = scene.nodes.map((node) => node.drawn_mm);
  const range = (axis) => [Math.min(...drawn.map((p) => p[axis])), Math.max(...drawn.map((p) => p[axis]))];
  const [[u0, u1], [v0, v1]] = [range(i), range(j)];
  const scale = 0.6 * Math.min(width / Math.max(u1 - u0, 1), height / Math.max(v1 - v0, 1));
  const at = (p) => [left + width / 2 + scale * (p[i] - (u0 + u1) / 2), height / 2 - scale * (p[j] - (v0 + v1) / 2)];

  for (const [one, other] of scene.springs) {
    const ends = [state.nodes_mm[one], state.nodes_mm[other]];
    if (ends.every(Boolean)) trace(context, ends.map(at), SPRING, 1);
  }
  scene.nodes.forEach((node, k) => {
    if (state.nodes_mm[k] && scene.marks.some((mark) => mark.node === node.name)) {
      cross(context, at(state.nodes_mm[k]), 4, "#56b4e9", 2, false);
    }
  });
  if (state.target_mm !== null) {
    const place = at(state.target_mm);
    const radius = scale * scene.target.radius_mm;
    context.globalAlpha = old ? 0.45 : 1;
    trace(context, ellipse(place, [[radius, 0], [0, radius]]), TARGET, 1.2, [3, 3]);
    if (state.cov_mm2 !== null) {
      const [[a, b], [, d]] = [[state.cov_mm2[i][i], state.cov_mm2[i][j]], [0, state.cov_mm2[j][j]]];
      trace(context, ellipse(place, spread(a, b, d, scale * WITHIN_95[scene.dim])), TARGET, 2.2);
    }
    cross(context, place, 6, TARGET, 1.2, false);
    context.globalAlpha = 1;
  }
  word(context, `${AXES[i]} → · ${AXES[j]} ↑`, left + 14, height - 14, SPRING);
}

// Columns of Cholesky's factor of a covariance, (x right, y down), scaled
function spread(xx, xy, yy, scale) {
  const a = Math.sqrt(Math.max(xx, 0));
  const b = a > 0 ? xy / a : 0;
  const c = Math.sqrt(Math.max(yy - b * b, 0));
  return [[scale * a, -scale * b], [0, -scale * c]];
}
