// The field of a skid-steer vehicle: what of it is worked, the tool, and how well the place is known.

const isNumber = (value) => typeof value === "number" && Number.isFinite(value);
const centimetres = (value) => (isNumber(value) ? `${(100 * value).toFixed(0)} cm` : "–");

export const FIELD_MODES = {
  READY: "You drive by remote control. The controller's button can engage.",
  READY_REFUSED: "You drive by remote control. It cannot be engaged now.",
  STEERING: "The computer holds the vehicle. It stands.",
  SPEED: "The vehicle drives its plan.",
  MANUAL: "You drive by remote control.",
};

// The tool's tile: which line, whether the tool does what it was told, how deep.
export function toolWords(field) {
  const line = isNumber(field.line) ? `line ${field.line} of ${field.lines}` : field.lines ? `turn, ${field.lines} lines` : "";
  const wrong = field.told_on && !(field.turns && field.depth_right);
  const figure = field.turns ? centimetres(field.depth_m) : field.turns === false ? "OFF" : "–";
  const told = field.told_on ? `told on, ${centimetres(field.depth_asked_m)}` : "told off";
  return { line, figure, more: wrong ? `▲ ${told}` : told, kind: wrong ? "warn" : "" };
}

// Lines beside the plan: worked share, GNSS, heading.
export function fieldWords(field, worked) {
  const words = [];
  if (worked && isNumber(worked.worked_m2) && worked.field_m2 > 0) {
    const share = Math.floor((1000 * worked.worked_m2) / worked.field_m2) / 10;
    words.push(`Worked at ${(100 * worked.level).toFixed(1).replace(".0", "")} %: ${share} % of ${Math.round(worked.field_m2)} m²`);
  }
  const off = isNumber(field.gnss_age_s) && field.gnss_age_s > 1.6;
  words.push(off ? `▲ GNSS off for ${Math.floor(field.gnss_age_s)} s` : `GNSS ${field.gnss}`);
  const sigma = isNumber(field.sigma_heading_deg) ? ` ± ${field.sigma_heading_deg.toFixed(1)}°` : "";
  words.push(field.heading_known ? `Heading known${sigma}` : "▲ Heading not known");
  return words;
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
