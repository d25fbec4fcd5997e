// A body in space, turned by dragging or keys: shaded surface or springs, marks with names, target with its ellipsoid, needle
// and aim. Orthographic, from positions in mm. The surface follows the nodes near its corners.

import { WITHIN_95 } from "./plots.js";
import { LIGHT, SPRING, TARGET, cross, ellipse, light, trace, word } from "./strokes.js";

const START = { turn: 0.6, rise: 0.45 };
const TURN_KEY = Math.PI / 18;
const TURN_PX = 0.008; // rad for a pixel of a drag
const STEEPEST = Math.PI / 2;
const NEIGHBOURS = 4; // nodes that a corner of the surface follows
const MOST_SPRINGS = 600;
const LAMP = [-0.35, 0.45, 0.82]; // right, up, toward the viewer
const SKIN = [150, 166, 182];
const SHADE = 0.35; // light on faces turned away from the lamp
const SHAFT_MM = 1000;
const CLOSER = 0.3; // side of the close-up, relative to the canvas' height
const TURNS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Body {
  constructor() {
    this.reset();
  }

  reset() {
    Object.assign(this, START);
  }

  // by: angles to the right and up, rad
  turnBy(right, up) {
    this.turn = (this.turn - right) % (2 * Math.PI);
    this.rise = Math.min(STEEPEST, Math.max(-STEEPEST, this.rise + up));
  }

  dragged(dx, dy) {
    this.turnBy(TURN_PX * dx, TURN_PX * dy);
  }

  // Whether the key turned the body
  pressed(key) {
    if (key === "Home") this.reset();
    else if (TURNS[key]) this.turnBy(TURN_KEY * TURNS[key][0], -TURN_KEY * TURNS[key][1]);
    else return false;
    return true;
  }

  // Directions right, up and toward the viewer
  axes() {
    const [s, c, t, u] = [Math.sin(this.turn), Math.cos(this.turn), Math.sin(this.rise), Math.cos(this.rise)];
    return [[c, 0, -s], [-s * t, u, -c * t], [s * u, t, c * u]];
  }

  // Returns a notice if nothing can be drawn, else null
  draw(context, scene, state, { width, height, old, near }) {
    if (state.nodes_mm === null) return "there are no positions of nodes to show";
    if (this.scene !== scene) this.prepare(scene);
    // Beside the close-up in the corner
    const room = width - (near ? Math.round(CLOSER * height) : 0);
    const whole = view(this.axes(), this.middle, [room / 2, height / 2], (0.5 * Math.min(room, height)) / this.reach);
    this.surface(context, scene, state, whole);
    springs(context, scene, state, whole);
    this.marks(context, scene, state, whole);
    needle(context, state, whole);
    target(context, scene, state, whole, old);
    this.compass(context, whole, height);
    if (near && state.target_mm) this.closeUp(context, scene, state, { width, height, old });
    return null;
  }

  prepare(scene) {
    this.scene = scene;
    const drawn = scene.nodes.map((node) => node.drawn_mm);
    const { corners_mm: corners, faces } = scene.surface ?? { corners_mm: drawn, faces: [] };
    const all = [...corners, ...drawn];
    const ends = [0, 1, 2].map((k) => [Math.min(...all.map((p) => p[k])), Math.max(...all.map((p) => p[k]))]);
    this.middle = ends.map(([low, high]) => (low + high) / 2);
    this.reach = 1.03 * Math.max(10, ...all.map((p) => Math.hypot(...p.map((x, k) => x - this.middle[k]))));
    // Weights: inverse squares of distances; a corner at a node follows this node alone
    this.follows = corners.map((corner) => {
      const nearest = drawn.map((p, k) => [distance(p, corner), k]).sort((a, b) => a[0] - b[0]).slice(0, NEIGHBOURS);
      const weights = nearest.map(([d, k]) => [1 / (d * d + 1e-6), k]);
      const sum = weights.reduce((total, [w]) => total + w, 0);
      return weights.map(([w, k]) => [w / sum, k]);
    });
    const normals = normalsOf(corners, faces);
    this.outward = drawn.map((place) => {
      if (faces.length === 0) return null;
      const distances = corners.map((corner) => distance(place, corner));
      return normals[distances.indexOf(Math.min(...distances))];
    });
  }

  // Corners of the surface, moved with the nodes
  moved(scene, state) {
    return scene.surface.corners_mm.map((corner, i) => {
      const place = [...corner];
      for (const [weight, k] of this.follows[i]) {
        const at = state.nodes_mm[k] ?? scene.nodes[k].drawn_mm;
        for (let axis = 0; axis < 3; axis += 1) place[axis] += weight * (at[axis] - scene.nodes[k].drawn_mm[axis]);
      }
      return place;
    });
  }

  surface(context, scene, state, { at, axes }) {
    if (!scene.surface?.faces.length) return;
    const { faces } = scene.surface;
    const corners = this.moved(scene, state);
    const normals = normalsOf(corners, faces);
    const [places, depths] = [corners.map(at), corners.map((p) => dot(axes[2], p))];
    const lamp = [0, 1, 2].map((k) => LAMP[0] * axes[0][k] + LAMP[1] * axes[1][k] + LAMP[2] * axes[2][k]);
    const lit = normals.map((n) => SHADE + (1 - SHADE) * Math.max(0, dot(n, lamp)));
    faces
      .filter(([a, b, c]) => cross2(places[a], places[b], places[c]) < 0) // y of the canvas is down
      .map((face) => [face, depths[face[0]] + depths[face[1]] + depths[face[2]]])
      .sort((a, b) => a[1] - b[1])
      .forEach(([[a, b, c]]) => {
        const share = (lit[a] + lit[b] + lit[c]) / 3;
        context.fillStyle = context.strokeStyle = `rgb(${SKIN.map((x) => Math.round(share * x)).join(" ")})`;
        context.lineWidth = 0.6; // covers gaps between faces
        context.beginPath();
        for (const corner of [a, b, c]) context.lineTo(...places[corner]);
        context.closePath();
        context.fill();
        context.stroke();
      });
  }

  marks(context, scene, state, { at, axes }) {
    const seen = scene.marks
      .map((mark) => ({ mark, k: scene.nodes.findIndex((node) => node.name === mark.node) }))
      .filter(({ mark, k }) => state.nodes_mm[k] && mark.measured)
      .map(({ mark, k }) => ({ mark, place: at(state.nodes_mm[k]), depth: dot(axes[2], state.nodes_mm[k]), near: !this.outward[k] || dot(this.outward[k], axes[2]) > 0 }))
      .sort((a, b) => a.depth - b.depth);
    for (const { mark, place, near } of seen) {
      context.globalAlpha = near ? 1 : 0.35;
      trace(context, ellipse(place, near ? [[5, 0], [0, 5]] : [[2.5, 0], [0, 2.5]]), light(mark.hue_deg), near ? 2.5 : 1.5);
    }
    context.globalAlpha = 1;
    // The nearest names first; names that would overlap are omitted
    const taken = [];
    this.named = [];
    for (const { mark, place, near } of seen.toReversed()) {
      if (!near) continue;
      const [x, y, length] = [place[0] + 8, place[1] - 6, 8 * mark.node.length];
      if (taken.some(([u, v, other]) => x < u + other && u < x + length && Math.abs(y - v) < 14)) continue;
      taken.push([x, y, length]);
      this.named.push(mark.node);
      word(context, mark.node, x, y, light(mark.hue_deg), 12);
    }
  }

  // Directions of the axes, and a bar for the scale
  compass(context, { axes, scale }, height) {
    const origin = [44, height - 44];
    [..."xyz"].forEach((name, k) => {
      const end = [origin[0] + 26 * axes[0][k], origin[1] - 26 * axes[1][k]];
      trace(context, [origin, end], SPRING, 1.5);
      word(context, name, origin[0] + 36 * axes[0][k] - 4, origin[1] - 36 * axes[1][k] + 4, SPRING, 12);
    });
    const mm = [100, 50, 20, 10, 5].find((length) => length * scale < 120) ?? 1;
    trace(context, [[92, height - 20], [92 + mm * scale, height - 20]], SPRING, 2);
    word(context, `${mm} mm`, 92, height - 26, SPRING, 12);
  }

  // The target enlarged in a corner
  closeUp(context, scene, state, { width, height, old }) {
    const side = Math.round(CLOSER * height);
    const [left, top] = [width - side - 12, height - side - 12];
    const spread = state.sigma_mm === null ? 0 : WITHIN_95[3] * state.sigma_mm;
    const reach = Math.min(1.3 * Math.max(2 * scene.target.radius_mm, spread), this.reach);
    const inside = view(this.axes(), state.target_mm, [left + side / 2, top + side / 2], (0.5 * side) / reach);
    context.save();
    context.beginPath();
    context.rect(left, top, side, side);
    context.clip();
    context.fillStyle = "#1a232d";
    context.fillRect(left, top, side, side);
    needle(context, state, inside);
    target(context, scene, state, inside, old);
    const mm = reach > 24 ? 10 : reach > 10 ? 5 : 1;
    trace(context, [[left + 10, top + side - 10], [left + 10 + mm * inside.scale, top + side - 10]], LIGHT, 2);
    word(context, `${mm} mm`, left + 10, top + side - 16, LIGHT, 12);
    word(context, "target", left + 10, top + 18, TARGET, 12);
    context.restore();
    trace(context, [[left, top], [left + side, top], [left + side, top + side], [left, top + side], [left, top]], old ? LIGHT : TARGET, 1.5);
  }
}

// middle: a position [mm], drawn at this position of the canvas; scale: px/mm
function view(axes, middle, [x, y], scale) {
  const at = (p) => {
    const from = p.map((value, k) => value - middle[k]);
    return [x + scale * dot(axes[0], from), y - scale * dot(axes[1], from)];
  };
  return { at, axes, scale };
}

function springs(context, scene, state, { at, axes }) {
  if (scene.springs.length > MOST_SPRINGS) return;
  const known = scene.springs.map((ends) => ends.map((k) => state.nodes_mm[k])).filter((ends) => ends.every(Boolean));
  const depths = known.map(([a, b]) => dot(axes[2], a) + dot(axes[2], b));
  const [far, close] = [Math.min(...depths), Math.max(...depths)];
  known.forEach((ends, i) => {
    context.globalAlpha = 0.2 + (0.6 * (depths[i] - far)) / Math.max(close - far, 1e-9);
    trace(context, ends.map(at), SPRING, 1);
  });
  context.globalAlpha = 1;
}

function target(context, scene, state, { at, axes, scale }, old) {
  if (state.target_mm === null) return;
  const place = at(state.target_mm);
  const radius = scale * scene.target.radius_mm;
  const sure = !old && state.fault === null;
  context.globalAlpha = sure ? 1 : 0.45;
  trace(context, ellipse(place, [[radius, 0], [0, radius]]), TARGET, 1.2, [3, 3]);
  if (state.cov_mm2 !== null) {
    const [xx, xy, yy] = [[0, 0], [0, 1], [1, 1]].map(([i, j]) => dot(axes[i], state.cov_mm2.map((row) => dot(row, axes[j]))));
    trace(context, ellipse(place, factor(xx, xy, yy, scale * WITHIN_95[3])), TARGET, 2.2, sure ? [] : [7, 5]);
  }
  cross(context, place, 6, TARGET, 1.2, false);
  context.globalAlpha = 1;
}

function needle(context, { needle: at_mm, advice }, { at }) {
  if (at_mm) {
    const along = (by) => at_mm.tip_mm.map((x, k) => x + by * at_mm.direction[k]);
    const ahead = advice?.depth_mm ?? 0;
    if (ahead > 0) trace(context, [at(at_mm.tip_mm), at(along(ahead))], LIGHT, 1.5, [6, 5]);
    trace(context, [at(along(-SHAFT_MM)), at(at_mm.tip_mm)], LIGHT, 3);
  }
  if (advice?.aim_mm) cross(context, at(advice.aim_mm), 7, LIGHT, 1.5, true);
}

// Columns of Cholesky's factor of a covariance, x right, y down, scaled
function factor(xx, xy, yy, scale) {
  const a = Math.sqrt(Math.max(xx, 0));
  const b = a > 0 ? xy / a : 0;
  const c = Math.sqrt(Math.max(yy - b * b, 0));
  return [[scale * a, -scale * b], [0, -scale * c]];
}

// Outward unit normals at corners
function normalsOf(corners, faces) {
  const sums = corners.map(() => [0, 0, 0]);
  for (const face of faces) {
    const [a, b, c] = face.map((k) => corners[k]);
    const [u, v] = [b, c].map((p) => p.map((x, k) => x - a[k]));
    const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const corner of face) for (let k = 0; k < 3; k += 1) sums[corner][k] += n[k];
  }
  return sums.map((n) => n.map((x) => x / (Math.hypot(...n) || 1)));
}

function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
}

function cross2(a, b, c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}
