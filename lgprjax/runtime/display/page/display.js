// The operator's page: shows what the control process says, and says loudly when it says nothing.

import { LETTERS, drawPlan, frame, placesOf, points } from "./plan.js";
import { MANOEUVRE_MODES, cartWords, commandWords, drawColumn, lineWords, promptWords, radarWords } from "./record.js";
import { FIELD_MODES, claimWords, computedCorner, drawToolPicture, fieldWords, isOpen, shapeOf, toolWords } from "./field.js";

const STALE_S = 0.5;
const NOMINAL_M = 0.305, MOST_M = 0.914; // one foot and three
const ENGAGED = ["STEERING", "SPEED"];
const MODES = {
  BOOT: ["STARTING", "You drive. The computer is starting.", "M50 12v38l24 14M50 5a45 45 0 1 0 .1 0"],
  CHECKS: ["CHECKING", "You drive. The system is being checked.", "M20 22h60M20 50h60M20 78h34"],
  READY: ["READY", "You drive. The controller's button can engage steering.", "M50 6a44 44 0 1 0 .1 0M30 52l14 15 27-32"],
  READY_REFUSED: ["READY", "You drive. Steering cannot be engaged now.", "M50 6a44 44 0 1 0 .1 0M28 50h44"],
  STEERING: ["STEERING", "The vehicle steers. You control throttle and brake.", "M50 6a44 44 0 1 0 .1 0M8 46h84M50 46v46"],
  SPEED: ["STEERING + SPEED", "The vehicle steers and holds the speed.", "M12 14l32 36-32 36M50 14l32 36-32 36"],
  MANUAL: ["MANUAL", "You drive.", "M10 10h80v80h-80z"],
  HANDED_OVER: ["TAKE OVER", "You drive: steering is released.", "M50 8 95 90H5zM50 38v24M50 76v1"],
  ERROR: ["ERROR", "You drive. Press override once the error is cleared.", "M50 8 95 90H5zM50 38v24M50 76v1"],
  EMERGENCY_STOP: ["EMERGENCY STOP", "Power is cut. Release the stop, then press override.",
    "M30 5h40l25 25v40l-25 25h-40l-25-25v-40zM28 50h44"],
  RECORD: ["RECORDING", "You drive. Nothing is commanded.", "M50 14a36 36 0 1 0 .1 0M50 34a16 16 0 1 0 .1 0"],
  RECORD_LOST: ["NOT RECORDING", "Stop. The recorder has failed.", "M50 14a36 36 0 1 0 .1 0M15 15 85 85"],
  NO_DATA: ["NO DATA", "The displayed values are old. Be ready to take over.", "M15 15 85 85M85 15 15 85"],
  UNKNOWN: ["MODE UNKNOWN", "The vehicle reports no mode. Be ready to drive.", "M15 15 85 85M85 15 15 85"],
};
const CODES = {
  ok: "good", low_correlation: "may be chance", ambiguous: "two places fit", edge: "edge of the search",
  off_map: "off the map", low_overlap: "too little map below", non_finite: "invalid data", no_window: "gathering scans",
};

const at = (id) => document.getElementById(id);
const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
// A small negative number must not read "-0.0".
const fixed = (value, digits) => (isNumber(value) ? value.toFixed(digits).replace(/^-(0\.?0*)$/, "$1") : "–");
// A file is named, not the folders that lead to it.
const fileName = (text) => text.replace(/(^|[\s"'(])(?:\.{0,2}\/|[A-Za-z]:\\)(?:[^\s/\\]+[/\\])*(?=[^\s/\\])/g, "$1");
const routeName = (name) => fileName(name).replace(/\.route\.toml$/, "");
const texts = (value) => (Array.isArray(value) ? value.filter((text) => typeof text === "string" && text) : []);
const plain = (name) => (/^[A-Z_]+_[A-Z_]+$/.test(name) ? name.toLowerCase().replaceAll("_", " ") : name);
const now = () => performance.now() / 1000;
const tell = (id, text) => { if (at(id).textContent !== text) at(id).textContent = text; };

let socket = null, session = null, asked = 0;
let received_s = -Infinity, age_s = null, leastDelay_s = Infinity, delay_s = 0;
let state = null, path = [], worked = null, shape = null, refused = 0, vehicleUp = false, broken = false, closedBecause = "";

// --- what the vehicle is doing -----------------------------------------------------------------------------------
function showMode(mode, refusedNow) {
  const [word, sentence, shape] = refusedNow ? MODES.READY_REFUSED : MODES[mode];
  at("top").dataset.mode = mode;
  at("top").dataset.refused = refusedNow ? "yes" : "no";
  const calibrates = Boolean(state && state.manoeuvre) && ENGAGED.includes(mode);
  tell("mode", calibrates ? "CALIBRATING" : word);
  const open = state && isOpen(state.field) && (mode === "READY" || mode === "MANUAL");
  const sentences = state && (state.field ? FIELD_MODES : state.manoeuvre ? MANOEUVRE_MODES : null);
  const own = sentences && sentences[open ? "OPEN" : refusedNow ? "READY_REFUSED" : mode];
  tell("mode-text", own || sentence);
  at("shape-path").setAttribute("d", shape);
}

function refusal() {
  if (typeof state.refusal !== "string" || state.refusal === "NONE") return null;
  return state.refusal_text || plain(state.refusal);
}

// The operator has the pedals for good: the limit is told, and the button that would hold a speed is explained.
function limitWords(slow) {
  const told = `Drive slower than ${fixed(state.limit_mps, 1)} m/s`;
  const why = slow.length ? `: ${slow.join(", ")}` : "";
  const said = [];
  if (Math.abs(state.speed_mps) > state.limit_mps) said.push(["bad", `■ ${told}, or steering is released${why}`]);
  else if (slow.length) said.push(["warn", `▲ ${told}${why}`]);
  if (typeof state.refusal_text === "string" && state.refusal_text) said.push(["warn", `▲ Refused: ${state.refusal_text}`]);
  return said;
}

function sayings(mode, engaged) {
  const said = [];
  if (state.estop === true) said.push(["bad", "■ Emergency stop is pressed."]);
  if (state.override === true) said.push(["warn", "▲ Override is pressed."]);
  if (typeof state.cause === "string" && state.cause) {
    said.push([["ERROR", "HANDED_OVER"].includes(mode) ? "bad" : "", `Because: ${state.cause}`]);
  }
  for (const fault of texts(state.faults)) {
    if (!state.cause) said.push(["bad", `■ Fault: ${plain(fault)}`]);
  }
  if (!engaged && refusal() !== null && !isOpen(state.field)) said.push(["warn", `▲ Cannot engage: ${fileName(refusal())}`]);
  const reasons = texts(state.reasons).map(plain), slow = texts(state.slow).map(plain);
  // Who drives himself is not stopped or slowed: then a reason is a warning, once.
  if (engaged && state.reaction === "STOP") said.push(["bad", `■ Stopping: ${reasons.join(", ")}`]);
  else {
    if (engaged && isNumber(state.limit_mps)) said.push(...limitWords(slow));
    else if (engaged && slow.length) said.push(["warn", `▲ Slowed: ${slow.join(", ")}`]);
    const told = engaged ? slow.join() : refusal() || "";
    for (const reason of reasons) if (!told.includes(reason)) said.push(["warn", `▲ ${reason}`]);
  }
  for (const warning of texts(state.warnings)) {
    if (!slow.includes(warning) && !(refusal() || "").includes(warning)) said.push(["warn", `▲ ${fileName(warning)}`]);
  }
  if (state.field && !engaged && computedCorner(worked)) {
    said.push(["warn", "▲ One corner of the field is computed: visit it first"]);
  }
  for (const [name, stage] of Object.entries(state.processes || {})) {
    if (stage !== "ready") said.push(["warn", `▲ ${name}: ${stage}`]);
  }
  if (state.recording && state.recording.lost > 0) said.push(["warn", `▲ Recording lost ${state.recording.lost} records`]);
  if (state.manoeuvre) said.push(...promptWords(state).map((text) => ["", text]));
  return said.length ? said : [["", "✓ No warnings"]];
}

function showWords(mode, engaged) {
  const list = at("words");
  const said = sayings(mode, engaged);
  const all = JSON.stringify(said) + list.clientHeight;
  if (list.dataset.said === all) return;
  list.dataset.said = all;
  const item = ([kind, text]) => Object.assign(document.createElement("li"), { className: kind, textContent: text });
  // What does not fit is counted; the weightiest stands first.
  for (let shown = said.length; shown > 0; shown -= 1) {
    const more = shown < said.length ? [["warn", `▲ and ${said.length - shown} more`]] : [];
    list.replaceChildren(...[...said.slice(0, shown), ...more].map(item));
    if (list.scrollHeight <= list.clientHeight) break;
  }
}

// Without a map nothing is matched: how well GNSS/INS knows the place.
function showPosition() {
  const bounded = (state.bounded_by || []).length > 0;
  tell("correlation-title", "Position");
  tell("share", "GNSS/INS alone");
  tell("correlation", isNumber(state.sigma_cross_m) ? `${(100 * state.sigma_cross_m).toFixed(1)} cm` : "–");
  tell("correlation-more", bounded ? "1σ across the route" : "1σ across, nothing bounds it");
  at("correlation").className = `figure ${bounded ? "" : "warn"}`;
}

function showCorrelation() {
  tell("correlation", fixed(state.correlation, 2));
  const by = texts(state.bounded_by), alone = by.length === 1 && by[0] === "GNSS";
  const code = typeof state.code === "string" ? CODES[state.code] || state.code : "no scan";
  tell("correlation-more", alone ? `${code}; driven by GNSS/INS` : code);
  tell("share", isNumber(state.ok_share) ? `${Math.round(100 * state.ok_share)} % good in 10 s` : "");
  at("correlation").className = `figure ${state.code === "ok" ? "" : "warn"}`;
}

function showTool() {
  const tool = toolWords(state.field);
  tell("correlation-title", "Tool");
  tell("share", tool.line);
  tell("correlation", tool.figure);
  tell("correlation-more", tool.more);
  at("correlation").className = `figure ${tool.kind}`;
}

function showRecord() {
  tell("correlation-title", state.field ? "Map accuracy" : "Radar");
  const radar = state.field ? cartWords(state.field) : radarWords(state);
  tell("share", "");
  tell("correlation", radar.figure);
  tell("correlation-more", radar.more);
  at("correlation").className = `figure ${radar.kind}`;
  tell("speed", fixed(state.speed_mps, state.field ? 2 : 1));
  tell("speed-more", "");
  tell("cross-title", state.field ? "Mapped" : "Recorded");
  tell("cross", `${fixed(state.travel_m, 0)} m`);
  tell("route-title", "Connections");
  const own = state.field ? fieldWords(state.field, worked, false) : [];
  at("route-list").replaceChildren(
    ...[...own, ...lineWords(state)].map((text) => Object.assign(document.createElement("p"), { textContent: text })));
}

function showManoeuvre() {
  const told = commandWords(state);
  tell("speed", fixed(state.speed_mps, 1));
  tell("speed-more", "");
  tell("correlation-title", told.title);
  tell("share", "");
  tell("correlation", told.figure);
  tell("correlation-more", told.more);
  at("correlation").className = "figure";
  tell("cross-title", state.lines ? "Recorded" : "Done");
  tell("cross", state.lines ? `${fixed(state.travel_m, 0)} m` : `${Math.round(100 * (state.share || 0))} %`);
  tell("route-title", `Calibration: ${state.manoeuvre}`);
  at("route-list").replaceChildren();
}

function showField(engaged) {
  tell("route-title", typeof state.route === "string" ? `Field ${fileName(state.route)}` : "No plan: recorded as you drive");
  const words = fieldWords(state.field, worked, engaged);
  const all = JSON.stringify(words);
  if (at("route-list").dataset.all === all) return;
  at("route-list").dataset.all = all;
  at("route-list").replaceChildren(...words.map((text) => Object.assign(document.createElement("p"), { textContent: text })));
}

// The tool at the level of confidence for the errors of this moment, and the levels to choose from.
function showClaim() {
  at("claim").hidden = !(state.field && shape);
  if (at("claim").hidden) return;
  const known = state.field.heading_known === true, words = claimWords(shape, known);
  tell("claim-title", words.title);
  tell("claim-width", words.claimed);
  tell("claim-more", words.more);
  const levels = worked && Array.isArray(worked.levels) ? worked.levels.filter(isNumber) : [];
  const all = JSON.stringify([levels, shape.level]);
  if (at("levels").dataset.all !== all) {
    at("levels").dataset.all = all;
    at("levels").replaceChildren(...levels.map((level) => {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: fixed(100 * level, 1).replace(".0", "") });
      button.setAttribute("aria-pressed", String(level === shape.level));
      button.setAttribute("aria-label", `${button.textContent} percent`);
      button.addEventListener("click", () => ask({ select_level: level }));
      return button;
    }));
  }
  const style = getComputedStyle(document.documentElement);
  const { pen, width, height } = frame(at("tool-shape"));
  drawToolPicture(pen, width, height, shape, known, (name) => style.getPropertyValue(name).trim());
}

// A servo that has lost torque: the look-ahead is longer than the schedule's.
function torqueWords() {
  const share = state.torque_share, ahead = state.look_ahead_m;
  if (!isNumber(share) || share > 0.95) return "";
  return `servo at ${Math.round(100 * share)} % of its torque${isNumber(ahead) ? `, look-ahead ${ahead.toFixed(1)} m` : ""}`;
}

function showFigures() {
  tell("speed", fixed(state.speed_mps, state.field ? 2 : 1));
  const own = ENGAGED.includes(state.mode) && isNumber(state.limit_mps);
  const held = isNumber(state.set_speed_mps) ? `set ${fixed(state.set_speed_mps, 2)}` : isOpen(state.field) ? "" : "not held";
  const set = own ? `limit ${fixed(state.limit_mps, 1)}` : held;
  // A limit above the set speed limits nothing.
  const limits = !own && isNumber(state.cap_mps) && !(isNumber(state.set_speed_mps) && state.cap_mps >= state.set_speed_mps);
  tell("speed-more", limits && ENGAGED.includes(state.mode) ? `${set}, limit ${fixed(state.cap_mps, 1)}` : set);
  if (state.field) showTool();
  else if (state.lgpr === false) showPosition();
  else showCorrelation();
  const cross = state.cross_track_m, size = Math.abs(cross);
  const kind = !isNumber(cross) || size <= NOMINAL_M ? "" : size <= MOST_M ? "warn" : "bad";
  tell("cross", isNumber(cross) ? `${size.toFixed(2)} m ${size < 0.005 ? "" : cross > 0 ? "left" : "right"}` : "–");
  at("cross").className = `figure ${kind}`;
  at("bar-mark").className = kind;
  at("bar-mark").style.left = `${50 - 50 * Math.max(-0.97, Math.min(0.97, isNumber(cross) ? cross : 0))}%`;
  at("bar-mark").style.visibility = isNumber(cross) ? "visible" : "hidden";
  tell("to-go", [isNumber(state.to_go_m) ? `${Math.round(state.to_go_m)} m to go` : "", torqueWords()].filter(Boolean).join(", "));
}

function showRoutes(engaged) {
  const routes = (Array.isArray(state.routes) ? state.routes : []).filter((r) => r && typeof r.name === "string");
  const shown = engaged ? routes.filter((r) => r.name === state.route) : routes;
  const places = engaged ? [] : placesOf(state);
  tell("route-title", engaged ? "Route" : places.length ? `The route passes here ${places.length} times: choose` : "Choose a route");
  const all = JSON.stringify([shown, state.route, engaged, places.map((p) => [p.place, Math.round(p.to_go_m)]), state.taken]);
  if (at("route-list").dataset.all === all) return;
  at("route-list").dataset.all = all;
  at("route-list").classList.toggle("two", places.length > 0);
  at("route-list").replaceChildren(...places.map((place, at_) => choice(place.place === state.taken,
    `${LETTERS[at_]}: ${place.place}`, `${Math.round(place.to_go_m)} m to go`, () => ask({ select_route: state.route, place: place.place }))),
  ...shown.map((route) => {
    const more = route.problem ? fileName(String(route.problem)) : isNumber(route.length_m) ? `${Math.round(route.length_m)} m` : "";
    const button = choice(route.name === state.route, routeName(route.name), more, () => ask({ select_route: route.name }));
    button.title = route.name;
    button.disabled = engaged || Boolean(route.problem);
    return button;
  }));
}

function choice(chosen, text, moreText, act) {
  const button = document.createElement("button");
  const name = document.createElement("span"), more = document.createElement("em");
  name.textContent = `${chosen ? "●\u00a0" : "○\u00a0"}${text}`;
  more.textContent = moreText;
  button.append(name, more);
  button.type = "button";
  button.setAttribute("aria-pressed", String(chosen));
  button.addEventListener("click", act);
  return button;
}

function showFoot() {
  const monitor = state.monitor || {};
  const ready = Object.entries(state.processes || {}).filter(([, stage]) => stage === "ready").map(([name]) => name);
  const parts = [ready.length ? `ready: ${ready.join(", ")}` : ""];
  if (isNumber(monitor.free_mb)) parts.push(`${(monitor.free_mb / 1000).toFixed(1)} GB of disk free`);
  const own = Object.values(monitor.rss_mb || {}).filter(isNumber).reduce((sum, mb) => sum + mb, 0);
  if (own > 0) parts.push(`this run holds ${(own / 1000).toFixed(1)} GB`);
  if (isNumber(monitor.memory_mb)) parts.push(`${(monitor.memory_mb / 1000).toFixed(1)} GB of memory free`);
  if (isNumber(monitor.hottest_c)) parts.push(`${Math.round(monitor.hottest_c)} °C`);
  if (refused) parts.push(`${refused} requests refused`);
  tell("foot", parts.filter(Boolean).join("  ·  "));
}

function render() {
  const known = Object.hasOwn(MODES, state.mode) ? state.mode : "UNKNOWN";
  // Handed over by the computer, with the light of the button on until override is pressed.
  const mode = known === "MANUAL" && state.lit === true && state.override !== true ? "HANDED_OVER" : known;
  const engaged = ENGAGED.includes(mode);
  showMode(mode, mode === "READY" && refusal() !== null);
  document.body.classList.toggle("record", Boolean(state.lines || state.manoeuvre));
  document.body.classList.toggle("manoeuvre", Boolean(state.manoeuvre));
  document.body.classList.toggle("open", isOpen(state.field));
  if (state.manoeuvre) showManoeuvre();
  else if (state.lines) showRecord();
  else showFigures();
  showClaim();
  showWords(mode, engaged);
  if (state.lines || state.manoeuvre) tell("answer", "");
  else if (state.field) showField(engaged);
  else showRoutes(engaged);
  showFoot();
  drawWhole();
}

function drawWhole() {
  const { times, reverse, corner } = drawPlan(at("plan"), state, path, vehicleUp, worked, shape, ENGAGED.includes(state.mode));
  tell("path-key", state.field && typeof state.route !== "string" ? "driven" : "path");
  at("tool-key").hidden = !(state.field && shape);
  at("reverse-key").hidden = !reverse;
  at("corner-key").hidden = !corner;
  at("worked-key").hidden = !(state.field && worked && Array.isArray(worked.runs) && worked.runs.length);
  tell("ellipse-key", times === null ? "uncertainty unknown" : times === 1 ? "3σ" : `3σ × ${times}`);
}

// --- how old it is -----------------------------------------------------------------------------------------------
function staleBecause() {
  const silent_s = now() - received_s;
  if (broken) return "The page failed. Reload it.";
  if (socket.readyState !== WebSocket.OPEN || silent_s > STALE_S) {
    return `No connection to the vehicle's computer${closedBecause && `: ${closedBecause}`}.`;
  }
  if (age_s === null) return "No data from the control process yet.";
  if (age_s + silent_s > STALE_S) {
    // Both make it old: the larger part is to blame.
    if (age_s < silent_s) return "The connection is slow.";
    return `No data from the control process for ${(age_s + silent_s).toFixed(1)} s.`;
  }
  if (delay_s > STALE_S) return `The connection is slow: data is ${delay_s.toFixed(1)} s old.`;
  return null;
}

function watch() {
  const because = staleBecause();
  document.body.classList.toggle("stale", because !== null);
  if (because === null) return;
  showMode("NO_DATA");
  tell("no-data-text", because);
}

// --- the line ----------------------------------------------------------------------------------------------------
function take(said) {
  if (said.kind === "hello") {
    session = said.session;
    asked = 0;
    leastDelay_s = Infinity;
  } else if (said.kind === "answer") {
    tell("answer", said.refused ? `Refused: ${said.refused}` : "");
  } else if (said.kind === "state") {
    // The clocks have nothing in common: the quickest message is the measure, let go slowly for their drift.
    const apart_s = now() - said.sent_s;
    leastDelay_s = Math.min(apart_s, leastDelay_s + 1e-4);
    delay_s = apart_s - leastDelay_s;
    age_s = said.age_s;
    refused = said.refused;
    if ("path" in said) path = points(said.path);
    if ("worked" in said) worked = said.worked;
    shape = shapeOf(said.shape);
    received_s = now();
    if ("column" in said) drawColumn(at("radargram"), said.column);
    if (said.state === null) return;
    state = said.state;
    if (staleBecause() === null) render();
  }
  watch();
}

function ask(wanted) {
  if (socket === null || socket.readyState !== WebSocket.OPEN || session === null) return;
  asked += 1;
  tell("answer", "");
  socket.send(JSON.stringify({ session, number: asked, ...wanted }));
}

function connect() {
  session = null;
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
  const mine = socket;
  const late = setTimeout(() => mine.close(), 3000);
  mine.addEventListener("open", () => { clearTimeout(late); closedBecause = ""; });
  mine.addEventListener("message", (event) => {
    if (mine !== socket) return;
    try {
      take(JSON.parse(event.data));
      broken = false;
    } catch (error) {
      broken = true;
      console.error(error);
      watch();
    }
  });
  mine.addEventListener("close", (event) => {
    clearTimeout(late);
    closedBecause = event.reason;
    setTimeout(connect, 1000);
  });
}

// --- the page itself ---------------------------------------------------------------------------------------------
function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  tell("theme", theme === "night" ? "DAY" : "NIGHT");
  if (state !== null) drawWhole();
}

const dark = window.matchMedia("(prefers-color-scheme: dark)");
setTheme(dark.matches ? "night" : "day");
dark.addEventListener("change", () => setTheme(dark.matches ? "night" : "day"));
at("theme").addEventListener("click", () => setTheme(document.documentElement.dataset.theme === "night" ? "day" : "night"));
at("up").addEventListener("click", () => {
  vehicleUp = !vehicleUp;
  tell("up", vehicleUp ? "NORTH UP" : "VEHICLE UP");
  if (state !== null) drawWhole();
});
connect();
setInterval(watch, 100);
