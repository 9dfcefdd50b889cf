// The field of a skid-steer vehicle: what of it is worked, the tool, and how well the place is known.

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
const centimetres = (value) => (isNumber(value) ? `${(100 * value).toFixed(0)} cm` : "–");

export const FIELD_MODES = {
  READY: "You drive by remote control. Its button engages.",
  READY_REFUSED: "You drive by remote control. It cannot engage.",
  STEERING: "The computer controls the vehicle. It is stationary.",
  SPEED: "The vehicle drives its plan.",
  MANUAL: "You drive by remote control.",
  OPEN: "You drive by remote control. What is worked is recorded.",
};
// Without a plan nothing engages.
export const isOpen = (field) => Boolean(field) && !field.lines;

// The tool's tile: which line, whether the tool does what it was told, how deep.
export function toolWords(field) {
  const line = isNumber(field.line) ? `line ${field.line} of ${field.lines}` : field.lines ? `turn, ${field.lines} lines` : "";
  const wrong = field.told_on && !(field.turns && field.depth_right);
  const figure = field.turns ? centimetres(field.depth_m) : field.turns === false ? "OFF" : "–";
  if (isOpen(field)) {
    const off = field.turns && !field.depth_right;
    return { line, figure, more: off ? "▲ wrong depth" : field.turns ? "at its depth" : "not counted", kind: off ? "warn" : "" };
  }
  const told = field.told_on ? `command: on, ${centimetres(field.depth_asked_m)}` : "command: off";
  return { line, figure, more: wrong ? `▲ ${told}` : told, kind: wrong ? "warn" : "" };
}

const duration = (seconds) => (seconds < 5400 ? `${Math.ceil(seconds / 60)} min` : `${(seconds / 3600).toFixed(1)} h`);
// Of a plan that the page can draw, whatever came.
const planOf = (worked) => {
  const plan = worked && worked.plan;
  return plan && ["swaths", "reverse", "keep_outs"].every((name) => Array.isArray(plan[name])) ? plan : null;
};

// A corner that follows from three that were driven to: nobody has been there.
export const computedCorner = (worked) => {
  const plan = planOf(worked);
  return plan && Array.isArray(plan.computed_corner) ? plan.computed_corner : null;
};

// Lines beside the plan: what is to be driven, worked share, GNSS, heading.
export function fieldWords(field, worked, engaged) {
  const words = [], plan = planOf(worked);
  if (plan && !engaged) {
    words.push(`Plan: ${plan.swaths.length} swaths, ${Math.round(plan.length_m)} m, ${duration(plan.time_s)}`);
  }
  if (worked && isNumber(worked.worked_m2)) {
    const share = Math.floor((1000 * worked.worked_m2) / worked.field_m2) / 10;
    const area = worked.field_m2 > 0 ? `${share} % of ${Math.round(worked.field_m2)} m²` : `${worked.worked_m2.toFixed(1)} m²`;
    words.push(`Worked at ${percent(worked.level)}: ${area}`);
    if (worked.full === true) words.push("▲ The live map is full. Recording goes on.");
  }
  const off = isNumber(field.gnss_age_s) && field.gnss_age_s > 1.6;
  words.push(off ? `▲ GNSS off for ${Math.floor(field.gnss_age_s)} s` : `GNSS ${field.gnss}`);
  const sigma = isNumber(field.sigma_heading_deg) ? ` ± ${field.sigma_heading_deg.toFixed(1)}°` : "";
  words.push(field.heading_known ? `Heading known${sigma}` : "▲ Heading not known");
  return words;
}

// --- the tool at the level of confidence -------------------------------------------------------------------------
const percent = (level) => `${(100 * level).toFixed(1).replace(".0", "")} %`;
const pair = (value) => Array.isArray(value) && value.length > 1 && value.every(isNumber);
// Of a shape that the page can draw, whatever came.
export const shapeOf = (value) =>
  value && pair(value.tool) && value.tool.length === 4 && pair(value.pass_m) && Array.isArray(value.shape)
    && value.shape.every(pair) && isNumber(value.level) ? value : null;

// Beside the tool's picture: level, width that a pass claims, and the error that it follows from.
export function claimWords(shape, known) {
  const width = shape.pass_m[1] - shape.pass_m[0], whole = 2 * shape.tool[3];
  const sigma = isNumber(shape.sigma_m) ? `position ± ${(100 * shape.sigma_m).toFixed(1)} cm` : "position unknown";
  const claimed = known && width > 0 ? `${width.toFixed(2)} of ${whole.toFixed(2)} m per pass` : "▲ nothing claimed";
  return { title: `Tool at ${percent(shape.level)}`, claimed, more: known ? sigma : "heading not known" };
}

const trace = (pen, corners, close) => {
  pen.beginPath();
  corners.forEach((corner, i) => (i ? pen.lineTo(...corner) : pen.moveTo(...corner)));
  if (close) pen.closePath();
};
const corners = ([ahead, left, length, width]) =>
  [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([a, b]) => [ahead + a * length, left + b * width]);

// The tool's outline, what of it is claimed now, and the width that a straight pass claims; ``at`` places body points.
function drawClaim(pen, shape, known, at, colour, width) {
  if (known && shape.shape.length > 2) {
    pen.fillStyle = colour("--claimed");
    trace(pen, shape.shape.map(at), true);
    pen.fill();
  }
  pen.strokeStyle = colour("--ink");
  pen.lineWidth = width;
  trace(pen, corners(shape.tool).map(at), true);
  pen.stroke();
  if (known && shape.pass_m[1] > shape.pass_m[0]) {
    const [ahead, left] = shape.tool;
    pen.strokeStyle = colour("--claimed-edge");
    pen.lineWidth = width + 1;
    trace(pen, shape.pass_m.map((side) => at([ahead, left + side])), false);
    pen.stroke();
  }
}

// At the vehicle's place, in the plan.
export function drawTool(pen, shape, known, [x, y, yaw], place, colour) {
  const cos = Math.cos(yaw), sin = Math.sin(yaw);
  drawClaim(pen, shape, known, ([a, l]) => place(x + a * cos - l * sin, y + a * sin + l * cos), colour, 2);
}

// Large, the way forward up; with a scale bar of ten centimetres.
export function drawToolPicture(pen, width, height, shape, known, colour) {
  const [ahead, left, length, half] = shape.tool;
  const px_m = Math.min((width - 12) / (2 * half), (height - 24) / (2 * length));
  drawClaim(pen, shape, known, ([a, l]) => [width / 2 - (l - left) * px_m, (height - 12) / 2 - (a - ahead) * px_m], colour, 2);
  pen.fillStyle = pen.strokeStyle = colour("--faint");
  pen.lineWidth = 2;
  trace(pen, [[4, height - 5], [4 + 0.1 * px_m, height - 5]], false);
  pen.stroke();
  pen.font = "bold 11px sans-serif";
  pen.textAlign = "left";
  pen.fillText("10 cm", 8 + 0.1 * px_m, height - 1);
}

// Worked blocks and the perimeter, under the path.
export function drawField(pen, field, worked, place, colour) {
  if (worked && Array.isArray(worked.runs)) {
    pen.fillStyle = colour("--worked");
    for (const [row, first, count] of worked.runs) {
      const x = worked.east_m + first * worked.block_m, y = worked.north_m + row * worked.block_m;
      const corners = [[x, y], [x + count * worked.block_m, y], [x + count * worked.block_m, y + worked.block_m], [x, y + worked.block_m]];
      pen.beginPath();
      corners.forEach((corner, i) => (i ? pen.lineTo(...place(...corner)) : pen.moveTo(...place(...corner))));
      pen.closePath();
      pen.fill();
    }
  }
  // What nothing may cross: the border of the safe ground, and of what must be kept out of.
  pen.strokeStyle = colour("--bad");
  pen.lineWidth = 2;
  for (const ring of Array.isArray(field.fence) ? field.fence : []) {
    if (!Array.isArray(ring) || ring.length < 3) continue;
    pen.beginPath();
    ring.forEach((corner, i) => (i ? pen.lineTo(...place(...corner)) : pen.moveTo(...place(...corner))));
    pen.closePath();
    pen.stroke();
  }
  const perimeter = Array.isArray(field.perimeter) ? field.perimeter : [];
  if (perimeter.length > 2) {
    pen.strokeStyle = colour("--ink");
    pen.lineWidth = 3;
    pen.setLineDash([12, 8]);
    pen.beginPath();
    perimeter.forEach((corner, i) => (i ? pen.lineTo(...place(...corner)) : pen.moveTo(...place(...corner))));
    pen.closePath();
    pen.stroke();
    pen.setLineDash([]);
  }
}

// A label that can be read over lines.
function label(pen, text, [x, y], ink, paper) {
  pen.font = "bold 14px sans-serif";
  pen.textAlign = "center";
  pen.textBaseline = "middle";
  pen.strokeStyle = paper;
  pen.lineWidth = 4;
  pen.strokeText(text, x, y);
  pen.fillStyle = ink;
  pen.fillText(text, x, y);
  pen.textBaseline = "alphabetic";
}

const LEAST_APART_PX = 22;
const MOST_NUMBERS = 12;

// Swaths that are numbered: the first, the last, and every so many, as far as they can be read side by side.
function numbered(swaths, place) {
  const every = [1, 2, 5, 10, 20, 50, 100].find((n) => swaths.length / n <= MOST_NUMBERS) || 200;
  const shown = [];
  const order = [...swaths.keys()].filter((k) => k === 0 || (k + 1) % every === 0);
  for (const k of [0, swaths.length - 1, ...order]) {
    const at = place(swaths[k][0], swaths[k][1]);
    if (shown.every((other) => Math.hypot(at[0] - other.at[0], at[1] - other.at[1]) >= LEAST_APART_PX)) shown.push({ k, at });
  }
  return shown;
}

// What is to be driven, over the path: ways in reverse, keep-outs, order of the swaths, a corner that nobody drove to.
// Returns which of these there are, for the legend.
export function drawOrder(pen, worked, place, colour, engaged) {
  const plan = planOf(worked);
  if (!plan) return { reverse: false, corner: false };
  const trace = (line) => {
    pen.beginPath();
    line.forEach((point, i) => (i ? pen.lineTo(...place(...point)) : pen.moveTo(...place(...point))));
  };
  const lines = (ways, ink, width, dash) => {
    pen.strokeStyle = ink;
    pen.lineWidth = width;
    pen.setLineDash(dash);
    for (const way of ways) {
      trace(way);
      pen.stroke();
    }
  };
  // The path's own line gives way to the dashes, but for swaths: a vehicle that backs out does so along one.
  if (plan.reverse.length) {
    lines(plan.reverse, colour("--paper"), 4, []);
    lines(plan.swaths.map(([x, y, endX, endY]) => [[x, y], [endX, endY]]), colour("--path"), 2, []);
    lines(plan.reverse, colour("--reverse"), 3, [5, 5]);
  }
  pen.setLineDash([]);
  plan.keep_outs.forEach((ring, i) => {
    pen.fillStyle = pen.strokeStyle = colour("--bad");
    pen.lineWidth = 2;
    trace(ring);
    pen.closePath();
    pen.globalAlpha = 0.25;
    pen.fill();
    pen.globalAlpha = 1;
    pen.stroke();
    const middle = [0, 1].map((axis) => ring.reduce((sum, point) => sum + point[axis], 0) / ring.length);
    label(pen, plan.keep_outs.length > 1 ? `keep out ${i + 1}` : "keep out", place(...middle), colour("--bad-text"), colour("--paper"));
  });
  const corner = engaged ? null : computedCorner(worked);
  if (corner) {
    const at = place(...corner);
    pen.strokeStyle = colour("--ink");
    pen.lineWidth = 3;
    for (const radius of [6, 12]) {
      pen.beginPath();
      pen.arc(...at, radius, 0, 2 * Math.PI);
      pen.stroke();
    }
    label(pen, "visit", [at[0], at[1] - 22], colour("--ink"), colour("--paper"));
  }
  if (!engaged) {
    for (const { k, at } of numbered(plan.swaths, place)) label(pen, `${k + 1}`, at, colour("--ink"), colour("--paper"));
  }
  return { reverse: plan.reverse.length > 0, corner: corner !== null };
}
