// A run that only records: the lines with their rates, the radargram as it arrives, what has been recorded.

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
const NAMES = { radar: "Radar", gnss: "GNSS/INS", drive_by_wire: "Vehicle", controller: "Controller" };

// The radar's tile: scans per second, and how many so far.
export function radarWords(state) {
  const radar = state.lines.radar;
  if (!radar) return { figure: "–", more: "no radar configured", kind: "" };
  const silent = !radar.messages || radar.age_s > 1;
  const figure = silent ? "0 /s" : `${Math.round(radar.rate_hz)} /s`;
  return { figure, more: `${state.scans} scans`, kind: silent ? "warn" : "" };
}

// The tile of a hand cart: one sigma of the position and of the heading that the map is made with.
export function cartWords(field) {
  const { mapped_sigma_m: m, mapped_sigma_heading_deg: deg } = field;
  if (!isNumber(m) || !isNumber(deg)) return { figure: "–", more: "▲ nothing mapped", kind: "warn" };
  return { figure: centimetres(m), more: `heading ± ${deg.toFixed(1)}°`, kind: "" };
}

const centimetres = (value) => (isNumber(value) ? `${(100 * value).toFixed(1)} cm` : "–");

// Lines beside the plan: quality of the position, then each line's rate or silence.
export function lineWords(state) {
  const sigma = isNumber(state.sigma_m) ? ` ± ${(100 * state.sigma_m).toFixed(state.sigma_m < 0.1 ? 1 : 0)} cm` : "";
  const words = [state.quality ? `Position: ${state.quality.toLowerCase()}${sigma}` : "▲ No position yet"];
  if (state.field) {
    words[0] = `Newest place ± ${centimetres(state.field.sigma_m)}, mapped ${state.field.mapped_after_s.toFixed(0)} s later`;
  } else {
    if (state.lines.gnss) words.push(state.heading ? "Heading: from the receiver" : "Heading: from the track");
    words.push(state.odometer ? "Travel: odometer" : "Travel: positions");
  }
  for (const [name, line] of Object.entries(state.lines)) {
    const silent = !line.messages || line.age_s > 1;
    words.push(silent ? `▲ ${NAMES[name] || name}: no data` : `${NAMES[name] || name}: ${line.rate_hz.toFixed(0)} /s`);
  }
  return words;
}

// Sentences of the modes while a calibration commands the vehicle.
export const MANOEUVRE_MODES = {
  READY: "You drive. The steering button begins the manoeuvre.",
  STEERING: "The wheels turn by themselves. Override ends it.",
  SPEED: "The vehicle drives by itself. Override or the brake ends it.",
};

// A calibration: the tile of what is commanded, or of the position where the crew drives.
export function commandWords(state) {
  if (state.lines) {
    const sigma = isNumber(state.sigma_m) ? `± ${(100 * state.sigma_m).toFixed(state.sigma_m < 0.1 ? 1 : 0)} cm` : "";
    return { title: "Position", figure: state.quality ? state.quality.toLowerCase() : "none", more: sigma };
  }
  const degrees = (rad) => (isNumber(rad) ? `${((180 / Math.PI) * rad).toFixed(1)}°` : "–");
  if (!(state.cap_mps > 0)) {
    return { title: "Wheels", figure: degrees(state.measured_rad), more: `command ${degrees(state.front_rad)}` };
  }
  const [title, share] = state.brake > 0 ? ["Brake", state.brake] : ["Throttle", state.throttle];
  return { title, figure: `${Math.round(100 * (share || 0))} %`, more: `at most ${state.cap_mps.toFixed(1)} m/s` };
}

// What the crew is to do, and how far the step is.
export function promptWords(state) {
  const lines = Array.isArray(state.prompt) ? state.prompt.filter((text) => typeof text === "string") : [];
  return state.progress ? [...lines, state.progress] : lines;
}

// The radargram moves left by a column for each new scan.
export function drawColumn(canvas, column) {
  if (!Array.isArray(column) || !column.length) return;
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  if (canvas.height !== column.length) canvas.height = column.length;
  pen.drawImage(canvas, -1, 0);
  const image = pen.createImageData(1, column.length);
  column.forEach((grey, row) => image.data.set([grey, grey, grey, 255], 4 * row));
  pen.putImageData(image, canvas.width - 1, 0);
}
