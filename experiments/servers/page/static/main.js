// The page of a live run: shows new states, and reports missing ones.

import { Age } from "./age.js";
import { Commands } from "./commands.js";
import { Picture } from "./picture.js";
import { Plots, Traces, WITHIN_95 } from "./plots.js";
import { Stream } from "./stream.js";
import { judged, turning } from "./verdict.js";

const LOOK_MS = 25; // interval of checks whether the display is still fresh
const SLOW_MS = 100; // interval of drawing plots and numbers
const IMAGE_MS = 250; // after this time without a picture, states are drawn as they come; otherwise with their pictures
const NO_IMAGE_MS = 1000; // after this time without a picture, the picture is reported as old
const SPOKEN_MS = 1000; // least interval of spoken advice
const ANSWER_MS = 8000; // duration of an answer on the page
const MOST_EVENTS = 5;
const PICTURE = "The picture with marks, springs, target and needle";
const BODY = "The body in space with marks, target and needle; arrow keys turn it, Home restores the view";

const find = (id) => document.getElementById(id);
const age = new Age();
const traces = new Traces();
const plots = new Plots(traces);
const picture = new Picture(find("picture"));
const now = { scene: null, state: null, image: null, imageAt: -Infinity, lostAt: performance.now(), refused: null, decoding: false, waiting: null };

const stream = new Stream({
  scene(message) {
    now.scene = message;
    now.refused = now.lostAt = null;
    restart();
    commands.scene(message);
    text("source", message.source);
    text("note", message.notes.join("; "));
    const turns = message.dim === 3 && message.picture_px === null;
    find("view").classList.toggle("turns", turns);
    find("picture").setAttribute("aria-label", turns ? BODY : PICTURE);
  },
  state(message) {
    const at = performance.now();
    if (now.state && message.counters.frames < now.state.counters.frames) restart();
    // A state without an annotation keeps the last one
    if (message.picture === null) message.picture = now.state?.picture ?? null;
    now.state = message;
    age.take(message.utc_s, at);
    traces.take(message, now.scene.dim, at, now.scene.stale_ms);
    commands.take(message);
    show();
    if (at - now.imageAt > IMAGE_MS) draw(message);
    alive(at);
  },
  picture(blob) {
    now.waiting = { blob, state: now.state };
    decode();
  },
  answer(message) {
    const name = message.command ?? "command";
    tell(message.error === null ? `${name}: handed over` : `${name} refused: ${message.error}`, message.error !== null);
  },
  lost(why) {
    now.refused = why;
    now.lostAt ??= performance.now();
    show();
  },
});
const commands = new Commands(picture, (command) => stream.command(command), tell);

// Dead man's switch: an animation of the browser covers the advice, unless each state postpones it. It
// works even if this script hangs or fails.
const dead = find("dead").animate([{ opacity: 0 }, { opacity: 1 }], { duration: 1, fill: "both" });
dead.cancel();

function alive(at) {
  dead.effect.updateTiming({ delay: Math.max(0, now.scene.stale_ms - age.at(at)) });
  dead.currentTime = 0;
  dead.play();
}

function restart() {
  now.state = now.waiting = null;
  age.forget();
  traces.clear();
  picture.forget();
}

// Only the newest picture is decoded; it is drawn with its own state
async function decode() {
  if (now.decoding) return;
  now.decoding = true;
  while (now.waiting) {
    const { blob, state } = now.waiting;
    now.waiting = null;
    try {
      const image = await createImageBitmap(blob);
      now.image?.close();
      now.image = image;
      now.imageAt = performance.now();
      if (state && now.state) draw(state);
    } catch {
      tell("an invalid picture came", true);
    }
  }
  now.decoding = false;
}

function draw(state) {
  now.drawn = state;
  picture.draw(now.scene, state, now.image, document.body.classList.contains("old"));
  text("unseen", picture.notice ?? "");
  find("unseen").hidden = picture.notice === null;
}

function show() {
  const at = performance.now();
  const lostMs = now.lostAt === null ? null : at - now.lostAt;
  const staleMs = now.scene?.stale_ms ?? 0;
  const { health, advice, live } = judged({ state: now.state, ageMs: age.at(at), lostMs, staleMs, refused: now.refused });
  say("health", health);
  say("advice", advice);
  find("advice").querySelector(".word").classList.toggle("long", advice.word.length > 7);
  find("advice").querySelector(".word").classList.toggle("middling", advice.word.length === 7);
  find("probability").hidden = advice.probability === null;
  text("percent", advice.probability === null ? "" : `${Math.floor(100 * advice.probability)} %`);
  text("turn", live && advice.probability !== null ? turning(now.state) : "");
  speak(advice.word, at);
  document.body.classList.toggle("live", live);
  const old = !live && now.state !== null;
  find("view").dataset.old = advice.word;
  if (document.body.classList.toggle("old", old) !== now.old) {
    now.old = old;
    if (now.drawn && now.state) draw(now.drawn);
  }
}

function say(id, { word, kind, why }) {
  const root = find(id);
  if (root.dataset.kind !== kind) {
    root.dataset.kind = kind;
    root.querySelector("use").setAttribute("href", `#shape-${kind}`);
  }
  text(`${id}-word`, word);
  text(id === "advice" ? "why" : "health-why", why);
}

// Advice is spoken when it changes, but not too often; a stale state is spoken at once
function speak(word, at) {
  const urgent = document.body.classList.contains("old") || word === "ABORT";
  if (word === now.spoken || (!urgent && at - (now.spokenAt ?? -Infinity) < SPOKEN_MS)) return;
  [now.spoken, now.spokenAt] = [word, at];
  text("spoken", word);
}

function tell(message, bad) {
  text("message", message);
  find("message").classList.toggle("bad", bad);
  clearTimeout(now.telling);
  now.telling = setTimeout(() => text("message", commands.mayWrite === false ? "read only" : ""), ANSWER_MS);
}

function text(id, value) {
  const root = find(id);
  if (root.textContent !== value) root.textContent = value;
}

// Details that are read occasionally
function slow() {
  const at = performance.now();
  plots.draw(at);
  const { state, scene } = now;
  if (state === null) return;
  const { counters } = state;
  now.latencies = [...(now.latencies ?? []), counters.latency_ms].filter((x) => x !== null).slice(-200);
  const middle = now.latencies.toSorted((a, b) => a - b)[now.latencies.length >> 1];
  text("latency", `${number(middle, 1)} / ${number(counters.latency_p99_ms, 1)} ms`);
  text("rate", `${number(counters.rate_hz, 0)} Hz`);
  text("missed", String(counters.deadlines_missed));
  text("memory", `${number(counters.memory_mb, 0)} MB`);
  const sigma = state.sigma_mm;
  text("sigma-now", sigma === null ? "–" : `σ ${sigma.toFixed(2)} · 95 % ${(WITHIN_95[scene.dim] * sigma).toFixed(1)} mm`);
  text("errors-now", state.errors);
  text("nis-now", number(state.nis, 1));
  text("poke-now", state.poked === null ? "–" : `${(100 * state.poked).toFixed(0)} %`);
  find("recording").hidden = state.recording === null;
  if (state.recording) text("recording", `● REC ${state.recording.frames} frames`);
  text("seen", seen(state, at).join("\n"));
  events(state);
}

function seen(state, at) {
  const measured = now.scene.marks.filter((mark) => mark.measured).length;
  if (state.picture === null) return [now.scene.dim === 3 ? `marks ${state.marks_used} of ${measured} used` : "no picture"];
  const marks = state.picture.marks.filter((mark) => now.scene.marks.find((one) => one.node === mark.node)?.measured !== false);
  const found = marks.filter((mark) => mark.fate === "found").length;
  const lines = [`marks ${found} of ${marks.length} found`];
  for (const mark of marks.filter((one) => one.fate !== "found").slice(0, 4)) {
    lines.push(`${mark.node} ${mark.fate}${mark.why ? `: ${mark.why}` : ""}`);
  }
  if (at - now.imageAt > NO_IMAGE_MS) lines.push(now.image ? `picture ${((at - now.imageAt) / 1000).toFixed(0)} s old` : "no picture yet");
  return [...lines, ...state.picture.notes];
}

function events(state) {
  const shown = state.events.slice(-MOST_EVENTS).reverse();
  const key = JSON.stringify(shown);
  if (key === now.events) return;
  now.events = key;
  find("event-list").replaceChildren(
    ...shown.map((event) => {
      const [row, time] = ["li", "time"].map((name) => document.createElement(name));
      time.textContent = new Date(1000 * event.utc_s).toLocaleTimeString();
      row.append(time, event.text);
      return row;
    }),
  );
}

function number(value, digits) {
  return value === null || value === undefined ? "–" : value.toFixed(digits);
}

addEventListener("hashchange", () => location.reload());
setInterval(show, LOOK_MS);
setInterval(slow, SLOW_MS);
show();
