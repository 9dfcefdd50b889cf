// The plan: path, vehicle, its uncertainty and the place by GNSS/INS, in metres of the map frame.

const LEAST_HALF_M = 18;
const VEHICLE_PX = 17;
const NEAR_M = 3; // shown around a vehicle without a plan
const SPARE_PX = 44; // above and below a field: scale bar, north arrow, legend

import { drawField, drawOrder, drawTool } from "./field.js";

const number = (value) => typeof value === "number" && Number.isFinite(value);
const pose = (value) => (Array.isArray(value) && value.length >= 3 && value.slice(0, 3).every(number) ? value : null);
export const points = (value) =>
  Array.isArray(value) ? value.filter((p) => Array.isArray(p) && number(p[0]) && number(p[1])) : [];

// How much an ellipse of a few centimetres is enlarged so that it is seen; the legend says it.
function enlargement(sigma_m, px_m) {
  return [1, 2, 5, 10, 20, 50, 100].find((times) => 3 * sigma_m * times * px_m >= 28) || 100;
}

function halfWidth(path, vehicle) {
  let nearest = Infinity;
  for (const [x, y] of path) nearest = Math.min(nearest, Math.hypot(x - vehicle[0], y - vehicle[1]));
  return Math.max(LEAST_HALF_M, Number.isFinite(nearest) ? 1.3 * nearest : 0);
}

// Before anything is engaged all of a field is shown, with the vehicle: its middle, and pixels a metre.
function overview(field, path, worked, vehicle, turn, width, height) {
  const rings = [field.perimeter, ...(Array.isArray(field.fence) ? field.fence : [])];
  const seen = [...rings.flatMap(points), ...(vehicle ? [vehicle] : [])];
  // Without a plan: what is worked, the way driven, and some metres around the vehicle.
  if (seen.length === 1) {
    const blocks = worked && Array.isArray(worked.runs) ? worked.runs : [];
    const ends = blocks.flatMap(([row, first, count]) => [[first, row], [first + count, row + 1]]);
    seen.push(...path, ...ends.map(([a, b]) => [worked.east_m + a * worked.block_m, worked.north_m + b * worked.block_m]));
    seen.push(...[-1, 1].flatMap((a) => [-1, 1].map((b) => [vehicle[0] + a * NEAR_M, vehicle[1] + b * NEAR_M])));
  }
  if (seen.length < 3) return null;
  const cos = Math.cos(turn), sin = Math.sin(turn);
  const spans = [([x, y]) => x * cos + y * sin, ([x, y]) => y * cos - x * sin].map((along) => {
    const values = seen.map(along);
    return [Math.min(...values), Math.max(...values)];
  });
  const [right, up] = spans.map(([low, high]) => 0.5 * (low + high));
  const [wide_m, high_m] = spans.map(([low, high]) => Math.max(high - low, 1));
  return {
    middle: [right * cos - up * sin, right * sin + up * cos],
    px_m: Math.min((width - 2 * VEHICLE_PX) / wide_m, (height - 2 * SPARE_PX) / high_m),
  };
}

export function frame(canvas) {
  const ratio = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

function scaleBar(pen, px_m, width, ink) {
  const length_m = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((m) => m * px_m > 60) || 1000;
  const right = width - 12;
  pen.strokeStyle = pen.fillStyle = ink;
  pen.lineWidth = 3;
  pen.beginPath();
  pen.moveTo(right - length_m * px_m, 16);
  pen.lineTo(right - length_m * px_m, 22);
  pen.lineTo(right, 22);
  pen.lineTo(right, 16);
  pen.stroke();
  pen.font = "bold 15px sans-serif";
  pen.textAlign = "right";
  pen.fillText(`${length_m} m`, right, 40);
}

function northArrow(pen, turn, ink) {
  pen.save();
  pen.translate(28, 34);
  pen.rotate(turn);
  pen.fillStyle = ink;
  pen.beginPath();
  pen.moveTo(0, -22);
  pen.lineTo(9, 10);
  pen.lineTo(0, 4);
  pen.lineTo(-9, 10);
  pen.fill();
  pen.restore();
  pen.fillStyle = ink;
  pen.font = "bold 15px sans-serif";
  pen.textAlign = "left";
  pen.fillText("N", 46, 40);
}

function drawPath(pen, path, place, ink, width) {
  if (path.length < 2) return;
  pen.strokeStyle = ink;
  pen.lineWidth = width;
  pen.lineJoin = "round";
  pen.beginPath();
  path.forEach((p, i) => (i ? pen.lineTo(...place(p[0], p[1])) : pen.moveTo(...place(p[0], p[1]))));
  pen.stroke();
}

// Where the route passes here several times: how it goes on from each place, with the letters of the list.
export const LETTERS = "ABCDEFGH";
export const placesOf = (state) => (Array.isArray(state.places) ? state.places : []).filter(
  (p) => p && typeof p.place === "string" && number(p.to_go_m)).slice(0, LETTERS.length);

function drawPlaces(pen, state, place, colour) {
  placesOf(state).forEach((each, at) => {
    const ahead = points(each.ahead);
    if (!ahead.length) return;
    pen.setLineDash([14, 6 + 8 * at]);
    drawPath(pen, ahead, place, colour("--vehicle"), each.place === state.taken ? 9 : 4);
    pen.setLineDash([]);
    const [x, y] = place(...ahead[ahead.length - 1]);
    pen.fillStyle = colour("--paper");
    pen.beginPath();
    pen.arc(x, y, 13, 0, 2 * Math.PI);
    pen.fill();
    pen.fillStyle = colour("--ink");
    pen.font = "bold 18px sans-serif";
    pen.textAlign = "center";
    pen.fillText(LETTERS[at], x, y + 6);
  });
}

function drawVehicle(pen, at, heading, ink) {
  pen.save();
  pen.translate(...at);
  pen.rotate(heading);
  pen.fillStyle = ink;
  pen.beginPath();
  pen.moveTo(0, -1.5 * VEHICLE_PX);
  pen.lineTo(0.8 * VEHICLE_PX, 0.6 * VEHICLE_PX);
  pen.lineTo(0, 0.2 * VEHICLE_PX);
  pen.lineTo(-0.8 * VEHICLE_PX, 0.6 * VEHICLE_PX);
  pen.fill();
  pen.restore();
}

function drawGnss(pen, at, ink) {
  pen.strokeStyle = ink;
  pen.lineWidth = 5;
  pen.beginPath();
  pen.moveTo(at[0] - 13, at[1]);
  pen.lineTo(at[0] + 13, at[1]);
  pen.moveTo(at[0], at[1] - 13);
  pen.lineTo(at[0], at[1] + 13);
  pen.stroke();
}

// Draws, and returns how many times the uncertainty is enlarged, null where none is known, and what the legend names.
export function drawPlan(canvas, state, path, vehicleUp, worked, shape, engaged) {
  const { pen, width, height } = frame(canvas);
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue(name).trim();
  const vehicle = pose(state.pose), gnss = pose(state.gnss_pose);
  const centre = vehicle || gnss || (path.length ? [...path[0], 0] : null);
  if (!centre) {
    pen.fillStyle = colour("--faint");
    pen.font = "bold 18px sans-serif";
    pen.textAlign = "center";
    pen.fillText("no place known", width / 2, height / 2);
    return { times: null, reverse: false, corner: false };
  }
  // Angles of the canvas run clockwise, yaw runs counter-clockwise from east.
  const turn = vehicleUp ? centre[2] - Math.PI / 2 : 0;
  const whole = state.field && !engaged ? overview(state.field, path, worked, vehicle, turn, width, height) : null;
  const ahead = engaged ? [] : placesOf(state).flatMap((each) => points(each.ahead));
  const reach_m = 1.15 * Math.max(0, ...ahead.map(([x, y]) => Math.hypot(x - centre[0], y - centre[1])));
  const px_m = whole ? whole.px_m : Math.min(width, height) / 2 / Math.max(halfWidth(path, centre), reach_m);
  const middle = whole ? whole.middle : centre;
  const place = (x, y) => {
    const east = x - middle[0], north = y - middle[1];
    const right = east * Math.cos(turn) + north * Math.sin(turn);
    const up = north * Math.cos(turn) - east * Math.sin(turn);
    return [width / 2 + right * px_m, height / 2 - up * px_m];
  };
  if (state.field) drawField(pen, state.field, worked, place, colour);
  drawPath(pen, path, place, colour("--path"), state.field ? 2 : 5);
  if (!engaged) drawPlaces(pen, state, place, colour);
  const named = state.field ? drawOrder(pen, worked, place, colour, engaged) : { reverse: false, corner: false };
  let times = null;
  if (vehicle) {
    const heading = Math.PI / 2 - vehicle[2] + turn;
    if (number(state.sigma_along_m) && number(state.sigma_cross_m)) {
      times = enlargement(Math.max(state.sigma_along_m, state.sigma_cross_m), px_m);
      const across = 3 * times * px_m;
      pen.strokeStyle = colour("--ellipse");
      pen.lineWidth = 4;
      pen.beginPath();
      pen.ellipse(...place(vehicle[0], vehicle[1]), Math.abs(state.sigma_cross_m) * across,
        Math.abs(state.sigma_along_m) * across, heading, 0, 2 * Math.PI);
      pen.stroke();
    }
    if (shape) drawTool(pen, shape, state.field.heading_known, vehicle, place, colour);
    drawVehicle(pen, place(vehicle[0], vehicle[1]), heading, colour("--vehicle"));
  }
  if (gnss) drawGnss(pen, place(gnss[0], gnss[1]), colour("--gnss"));
  northArrow(pen, turn, colour("--ink"));
  scaleBar(pen, px_m, width, colour("--ink"));
  return { times, ...named };
}
