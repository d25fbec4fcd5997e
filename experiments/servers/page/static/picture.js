// The picture on its canvas, zoomed to the body or whole, with an inset of the target in a corner.

import { Body } from "./body.js";
import { closer, overlay } from "./overlay.js";
import { LIGHT, TARGET, cross, trace, word } from "./strokes.js";

const AROUND = 0.36; // margin on each side, relative to the body's size
const CLOSER = 0.3; // side of the inset, relative to the canvas' height
const GROUND = "#1a232d";

export class Picture {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.near = true;
    this.body = new Body();
    this.forget();
    new ResizeObserver(() => this.fit()).observe(canvas);
    canvas.addEventListener("pointerdown", (event) => this.turning && canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (!this.turning || event.buttons !== 1) return;
      this.body.dragged(event.movementX, event.movementY);
      this.redraw();
    });
    this.fit();
  }

  // A new scene
  forget() {
    this.box = null;
    this.cursor = null;
    this.reach = null;
    this.views = [];
  }

  // Whether a body in space is shown, which can be turned
  get turning() {
    return this.last?.[0].dim === 3 && this.last[0].picture_px === null;
  }

  fit() {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    [this.width, this.height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.canvas.width = Math.round(ratio * this.width);
    this.canvas.height = Math.round(ratio * this.height);
    this.context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.redraw();
  }

  draw(scene, state, image, old) {
    this.last = [scene, state, image, old];
    this.redraw();
  }

  redraw() {
    if (!this.last || this.width === 0) return;
    const [scene, state, image, old] = this.last;
    const { context } = this;
    context.fillStyle = GROUND;
    context.fillRect(0, 0, this.width, this.height);
    this.views = [];
    if (state.picture === null && image && scene.picture_px) {
      // Without a state: only the whole picture
      const whole = this.through([0, 0, ...scene.picture_px], 0, 0, this.width, this.height);
      this.notice = null;
      this.inside(whole, image, scene, () => {});
      return;
    }
    if (state.picture === null) {
      const room = { width: this.width, height: this.height, old, near: this.near };
      this.notice = this.turning ? this.body.draw(context, scene, state, room) : "there is no picture to show";
      return;
    }
    this.notice = null;
    const view = this.view(scene, state.picture);
    this.views.push(view);
    this.inside(view, image, scene, () => overlay(context, scene, state.picture, { ...view, old }));
    if (this.near && state.picture.target_px) this.look(scene, state, image, old);
    if (this.cursor) cross(context, view.at(this.cursor), 16, "#56b4e9", 2, false);
  }

  // A part of the canvas with the picture and its annotation
  inside(view, image, scene, draw) {
    const { context } = this;
    context.save();
    context.beginPath();
    context.rect(view.left, view.top, view.width, view.height);
    context.clip();
    if (image) {
      const [x, y] = view.at([-0.5, -0.5]);
      const [width, height] = scene.picture_px;
      context.drawImage(image, x, y, view.scale * width, view.scale * height);
    }
    draw();
    context.restore();
  }

  // box: part of the picture [px] to show within a part of the canvas
  through(box, left, top, width, height) {
    const scale = Math.min(width / (box[2] - box[0]), height / (box[3] - box[1]));
    const [u, v] = [(box[0] + box[2]) / 2, (box[1] + box[3]) / 2];
    const [x, y] = [left + width / 2, top + height / 2];
    const at = (place) => [x + scale * (place[0] - u), y + scale * (place[1] - v)];
    const from = (place) => [u + (place[0] - x) / scale, v + (place[1] - y) / scale];
    return { at, from, scale, left, top, width, height };
  }

  view(scene, seen) {
    const [width, height] = scene.picture_px;
    const whole = [-0.5, -0.5, width - 0.5, height - 0.5];
    if (!this.near) return this.through(whole, 0, 0, this.width, this.height);
    const body = extent(seen.nodes_px.filter(Boolean));
    if (body === null) return this.through(whole, 0, 0, this.width, this.height);
    // The view is fixed until the body leaves it, so that the display does not sway
    if (this.box === null || body[0] < this.box[0] || body[1] < this.box[1] || body[2] > this.box[2] || body[3] > this.box[3]) {
      const more = AROUND * Math.max(body[2] - body[0], body[3] - body[1], 20);
      this.box = [body[0] - more, body[1] - more, body[2] + more, body[3] + more];
    }
    return this.through(this.box, 0, 0, this.width, this.height);
  }

  look(scene, state, image, old) {
    const seen = state.picture;
    const side = Math.round(CLOSER * this.height);
    const [left, top] = [this.width - side - 12, this.height - side - 12];
    const pxPerMm = Math.hypot(seen.target_shape_px[0][0], seen.target_shape_px[1][0]) / scene.target.radius_mm;
    const spread = Math.max(...(seen.target_ellipse_px ?? [[0, 0]]).map(([x, y]) => Math.hypot(x, y)));
    const needed = Math.max(2 * scene.target.radius_mm * pxPerMm, 1.15 * spread);
    // The size changes in steps, not in each frame
    if (this.reach === null || needed > this.reach || needed < 0.4 * this.reach) this.reach = 1.5 * needed;
    const [u, v] = seen.target_px;
    const view = this.through([u - this.reach, v - this.reach, u + this.reach, v + this.reach], left, top, side, side);
    this.views.push(view);
    const { context } = this;
    context.fillStyle = GROUND;
    context.fillRect(left, top, side, side);
    this.inside(view, image, scene, () => closer(context, seen, { ...view, old }));
    const outline = [[left, top], [left + side, top], [left + side, top + side], [left, top + side], [left, top]];
    trace(context, outline, old ? LIGHT : TARGET, 1.5);
    const mm = this.reach / pxPerMm > 12 ? 10 : this.reach / pxPerMm > 4 ? 2 : 1;
    const length = mm * pxPerMm * view.scale;
    trace(context, [[left + 10, top + side - 10], [left + 10 + length, top + side - 10]], LIGHT, 2);
    word(context, `${mm} mm`, left + 10, top + side - 16, LIGHT, 12);
    word(context, "target", left + 10, top + 18, TARGET, 12);
  }

  // The position in the picture [px] at a position of the canvas; null outside it
  placeAt(x, y) {
    const view = this.views.findLast((one) => x >= one.left && x < one.left + one.width && y >= one.top && y < one.top + one.height);
    return view && this.last[0].picture_px ? this.clamped(view.from([x, y])) : null;
  }

  clamped([u, v]) {
    const [width, height] = this.last[0].picture_px;
    return [Math.min(Math.max(u, 0), width - 1), Math.min(Math.max(v, 0), height - 1)];
  }
}

function extent(places) {
  if (places.length === 0) return null;
  const us = places.map(([u]) => u);
  const vs = places.map(([, v]) => v);
  return [Math.min(...us), Math.min(...vs), Math.max(...us), Math.max(...vs)];
}
