// The verdict at this moment: health and advice, each a word, a kind (its colour and shape) and a reason.
// GO is shown only for a new, reliable state without a fault, and not while paused; ABORT also with a fault.

const HEALTH = { TRACKING: "good", COASTING: "care", INITIALISING: "info", LOST: "bad", DIVERGED: "bad" };
const ADVICE = { GO: "good", WAIT: "care", REALIGN: "info", ABORT: "stop" };
const HEALTHY = new Set(["TRACKING", "COASTING"]);

// inside: whether the needle was inside when it was last known
function same(word, kind, reason, inside = false) {
  const why = inside ? `${reason}. The needle is inside: stop` : reason;
  return { health: { word, kind, why }, advice: { word, kind, why, probability: null }, live: false };
}

// state: the newest, or null; ageMs: its age, including the delay; lostMs: time since the connection ended, or null
export function judged({ state, ageMs, lostMs, staleMs, refused }) {
  if (refused) return same("NO ACCESS", "bad", refused);
  const inside = (state?.needle?.depth_mm ?? 0) > 0;
  if (lostMs !== null) return same("NO CONNECTION", "bad", `for ${seconds(lostMs)}; trying again`, inside);
  if (state === null) return same("WAITING", "none", "no state yet");
  if (ageMs > staleMs) return same("STALE", "bad", `nothing new for ${seconds(ageMs)}`, inside);

  const health = { word: state.status, kind: HEALTH[state.status] ?? "bad", why: known(state) };
  const said = advised(state.advice);
  const found = (health, advice) => ({ health, advice, live: true });
  const none = (why, kind = "none") => ({ word: "NO GUIDANCE", kind, why, probability: null });
  const aborts = said.word === "ABORT";
  if (state.fault !== null) {
    if (state.status === "INITIALISING") return found({ ...health, why: state.fault }, aborts ? said : none(state.fault));
    return found({ word: "FAULT", kind: "bad", why: state.fault }, aborts ? said : none(state.fault, "bad"));
  }
  if (state.paused) {
    return found({ word: "PAUSED", kind: "info", why: "frames are not used" }, aborts ? said : none("paused"));
  }
  if (said.word === "GO" && !HEALTHY.has(state.status)) return found(health, none(`the estimate is ${state.status}`));
  return found(health, said);
}

function advised(advice) {
  if (advice === null) return { word: "NO NEEDLE", kind: "none", why: "there is no advice without a needle", probability: null };
  const word = advice.advice.replaceAll("_", " ");
  const probability = word === "ABORT" ? null : advice.probability; // a stop shows only the reason
  return { word, kind: ADVICE[advice.advice] ?? "none", why: advice.reason, probability };
}

function known(state) {
  const marks = `${state.marks_used} ${state.marks_used === 1 ? "mark" : "marks"} used`;
  return state.from_frame ? marks : `${marks}, no frame`;
}

function seconds(ms) {
  return `${(ms / 1000).toFixed(1)} s`;
}

// How to turn the needle, as text; empty without a correction
export function turning(state) {
  const advice = state.advice;
  if (advice === null || advice.probability === null) return "";
  const parts = [
    [advice.turn_deg, (x) => `turn ${x.toFixed(1)}°`],
    [advice.lateral_mm, (x) => `off ${x.toFixed(1)} mm`],
    [advice.depth_mm, (x) => `depth ${x.toFixed(1)} mm`],
    [advice.arrival_s, (x) => `arrives in ${Math.max(0, x - state.time_s).toFixed(1)} s`],
  ];
  return parts.filter(([x]) => x !== null).map(([x, text]) => text(x)).join(" · ");
}
