// Buttons, keys and picking of a position in the picture: each sends a command to the run.

const ARMED_MS = 3000;
const STEP_PX = { near: 1, far: 10 };
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const find = (id) => document.getElementById(id);

export class Commands {
  // picture: its canvas is clicked; send: takes a command, false without a connection; tell: shows a line
  constructor(picture, send, tell) {
    Object.assign(this, { picture, send, tell, picking: null, armed: null, state: null });
    this.keys = { r: "record", p: "pause", f: "fix", h: "hue", x: "reset", z: "zoom", "?": "help" };
    find("record").onclick = () => this.ask({ command: "record", on: !this.state?.recording });
    find("pause").onclick = () => this.ask({ command: "pause", on: !this.state?.paused });
    find("fix").onclick = () => this.pick("fix", "Click the target in the picture, or use arrows and Enter · Esc cancels");
    find("hue").onclick = () => this.pick("hue", `Click the mark on ${find("hue-node").value}, or use arrows and Enter · Esc cancels`);
    find("reset").onclick = () => this.reset();
    find("zoom").onclick = () => this.zoom();
    find("help").onclick = () => find("legend").showModal();
    this.picture.canvas.addEventListener("click", (event) => this.clicked(event));
    document.addEventListener("keydown", (event) => this.pressed(event));
  }

  scene(scene) {
    this.mayWrite = scene.may_write;
    const marks = scene.marks.filter((mark) => mark.measured);
    find("hue-node").replaceChildren(...marks.map((mark) => new Option(mark.node)));
    for (const id of ["record", "pause", "reset"]) find(id).disabled = !scene.may_write;
    for (const id of ["fix", "fix-sd", "hue", "hue-node"]) find(id).disabled = !scene.may_write || !scene.picture_px;
    find("hue").disabled ||= marks.length === 0;
    this.leave();
    this.tell(scene.may_write ? "" : "read only: to send commands, open the address that the command printed, with its token", false);
  }

  take(state) {
    this.state = state;
    press("record", state.recording !== null);
    press("pause", state.paused);
  }

  ask(command) {
    if (!this.send(command)) this.tell("no connection: nothing was sent", true);
  }

  pick(what, prompt) {
    if (this.picking === what) {
      this.leave();
      return;
    }
    this.leave();
    this.picking = what;
    press(what, true);
    find("view").classList.add("picking");
    find("prompt").textContent = prompt;
    find("prompt").hidden = false;
    this.picture.canvas.focus();
  }

  leave() {
    for (const id of ["fix", "hue"]) press(id, false);
    find("view").classList.remove("picking");
    find("prompt").hidden = true;
    this.picking = this.picture.cursor = null;
  }

  picked(place) {
    const place_px = place.map((x) => Math.round(100 * x) / 100);
    if (this.picking === "hue") {
      this.ask({ command: "hue", node: find("hue-node").value, place_px });
    } else {
      const sd = find("fix-sd").valueAsNumber;
      this.ask({ command: "fix", place_px, sd_mm: sd > 0 ? sd : 1 });
    }
    this.leave();
  }

  clicked(event) {
    if (this.picking === null) return;
    const { left, top } = this.picture.canvas.getBoundingClientRect();
    const place = this.picture.placeAt(event.clientX - left, event.clientY - top);
    if (place) this.picked(place);
  }

  pressed(event) {
    if (event.ctrlKey || event.altKey || event.metaKey || find("legend").open) return;
    if (event.key === "Escape") {
      this.leave();
      return;
    }
    if (["INPUT", "SELECT"].includes(event.target.tagName)) return;
    if (this.picking !== null && event.target === this.picture.canvas && this.moved(event)) {
      event.preventDefault();
      return;
    }
    if (this.picture.turning && event.target.tagName !== "BUTTON" && this.picture.body.pressed(event.key)) {
      event.preventDefault();
      this.picture.redraw();
      return;
    }
    const id = this.keys[event.key.toLowerCase()];
    if (id && !event.repeat && !find(id).disabled) {
      event.preventDefault();
      find(id).click();
    }
  }

  // Whether the key moved the cursor of the picture, or picked its position
  moved({ key, shiftKey }) {
    const target = this.state?.picture?.target_px;
    const from = this.picture.cursor ?? target;
    if (!from) return false;
    if (key === "Enter") {
      this.picked(from);
    } else if (ARROWS[key]) {
      const step = shiftKey ? STEP_PX.far : STEP_PX.near;
      this.picture.cursor = this.picture.clamped(from.map((x, k) => x + step * ARROWS[key][k]));
      this.picture.redraw();
    } else {
      return false;
    }
    return true;
  }

  // Must be pressed twice, because it discards the state
  reset() {
    const again = this.armed !== null;
    clearTimeout(this.armed);
    this.arm(!again);
    if (again) this.ask({ command: "reset" });
  }

  arm(on) {
    this.armed = on ? setTimeout(() => this.arm(false), ARMED_MS) : null;
    find("reset").classList.toggle("armed", on);
    if (on) this.tell("Reset discards the state: press again to confirm", false);
  }

  zoom() {
    this.picture.near = !this.picture.near;
    press("zoom", this.picture.near);
    this.picture.redraw();
  }
}

function press(id, on) {
  find(id).setAttribute("aria-pressed", String(on));
}
