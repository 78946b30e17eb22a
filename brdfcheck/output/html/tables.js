"use strict";
// The script of a report, first part: tables of the albedo, looked up and coloured. Nothing here knows of a page.

// --- numbers ---

const NO_VALUE = 65535;

// Values from 16-bit codes: evenly spaced in arsinh(10 (E - 1)), so that a table may hold 1.0001 and a million.
function decode(text, low, high) {
  const bytes = atob(text);
  const values = new Float64Array(bytes.length / 2);
  for (let i = 0; i < values.length; i++) {
    const code = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
    const squeezed = low + ((high - low) * code) / (NO_VALUE - 1);
    values[i] = code === NO_VALUE ? NaN : 1 + Math.sinh(squeezed) / 10;
  }
  return values;
}

// The interval of rising nodes that holds x, and where in it x lies, from 0 to 1; clamped at the ends.
function locate(nodes, x) {
  let low = 0;
  let high = nodes.length - 1;
  if (high < 1 || x <= nodes[0]) return [0, 0];
  if (x >= nodes[high]) return [high - 1, 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (nodes[middle] <= x) low = middle;
    else high = middle;
  }
  return [low, (x - nodes[low]) / (nodes[high] - nodes[low])];
}

// Linear between two values; a neighbour without weight is not looked at, for it may have no value.
const between = (a, b, part) => (part === 0 ? a : part === 1 ? b : a + (b - a) * part);

function look(nodes, values, x) {
  const [index, part] = locate(nodes, x);
  return between(values[index], values[Math.min(index + 1, values.length - 1)], part);
}

const valueAt = (axis, position) => look(axis.position, axis.values, position);
const positionOf = (axis, value) => look(axis.values, axis.position, value);

// The albedo over the angles at one place of the row axis.
function cutOverAngles(table, rows, columns, position) {
  const [index, part] = rows === null ? [0, 0] : locate(rows.position, position);
  const next = Math.min(index + 1, rows === null ? 0 : rows.values.length - 1);
  return Float64Array.from({ length: columns }, (_, k) => between(table[index * columns + k], table[next * columns + k], part));
}

// The albedo over the rows at one place of the axis of angles.
function cutOverRows(table, rows, angles, position) {
  const columns = angles.values.length;
  const [index, part] = locate(angles.position, position);
  const next = Math.min(index + 1, columns - 1);
  return Float64Array.from({ length: rows.values.length }, (_, k) =>
    between(table[k * columns + index], table[k * columns + next], part));
}

// Of several channels the largest value in each place.
function largest(tables) {
  if (tables.length === 1) return tables[0];
  return tables[0].map((_, i) => Math.max(...tables.map((table) => table[i])));
}

// Marching squares: segments [x0, y0, x1, y1] in units of nodes along which a table of `columns` equals `level`.
function contour(table, columns, level) {
  const segments = [];
  const rows = table.length / columns;
  for (let y = 0; y + 1 < rows; y++) {
    for (let x = 0; x + 1 < columns; x++) {
      const corner = [table[y * columns + x], table[y * columns + x + 1], table[(y + 1) * columns + x + 1], table[(y + 1) * columns + x]];
      if (corner.some(Number.isNaN)) continue;
      const above = corner.map((value) => value > level);
      const points = [];
      const ends = [[0, 0, 1, 0], [1, 0, 1, 1], [1, 1, 0, 1], [0, 1, 0, 0]];
      for (let side = 0; side < 4; side++) {
        const from = corner[side];
        const to = corner[(side + 1) % 4];
        if (above[side] === above[(side + 1) % 4]) continue;
        const part = (level - from) / (to - from);
        const [x0, y0, x1, y1] = ends[side];
        points.push([x + x0 + (x1 - x0) * part, y + y0 + (y1 - y0) * part]);
      }
      if (points.length === 4 && above[0] !== (corner[0] + corner[1] + corner[2] + corner[3]) / 4 > level) {
        points.push(points.shift()); // a saddle whose middle belongs to the other pair of corners
      }
      for (let i = 0; i + 1 < points.length; i += 2) segments.push([...points[i], ...points[i + 1]]);
    }
  }
  return segments;
}

const BELOW = [[16, 24, 58], [29, 74, 124], [62, 138, 176], [148, 199, 210], [240, 246, 240]];
const ABOVE = [[255, 208, 140], [246, 136, 60], [212, 52, 40], [120, 10, 44]];

function ramp(stops, part) {
  const place = Math.min(Math.max(part, 0), 1) * (stops.length - 1);
  const index = Math.min(Math.floor(place), stops.length - 2);
  return stops[index].map((from, k) => from + (stops[index + 1][k] - from) * (place - index));
}

// Cold up to 1, warm above, so that a violation of a ten-thousandth is seen as well as one of a hundred.
function colour(value, scale) {
  if (Number.isNaN(value)) return [128, 128, 128];
  if (value <= scale.limit) return ramp(BELOW, scale.low < 1 ? (value - scale.low) / (1 - scale.low) : 1);
  return ramp(ABOVE, Math.sqrt((value - scale.limit) / Math.max(scale.high - scale.limit, 1e-12)));
}

// The pixels of a heat map, RGBA, of `width` x `height`: the angles to the right, the rows upwards.
function heatPixels(table, rows, angles, scale, width, height) {
  const steps = 512; // of each half of the colours
  const colours = new Uint8Array(3 * (2 * steps + 1));
  for (let k = 0; k < steps; k++) {
    colours.set(ramp(BELOW, k / (steps - 1)).map(Math.round), 3 * k);
    colours.set(ramp(ABOVE, k / (steps - 1)).map(Math.round), 3 * (steps + k));
  }
  colours.set([128, 128, 128], 6 * steps);
  const cold = scale.low < 1 ? 1 / (1 - scale.low) : Infinity;
  const warm = 1 / Math.max(scale.high - scale.limit, 1e-12);
  const columns = Array.from({ length: width }, (_, x) => locate(angles.position, (x + 0.5) / width));
  const last = angles.values.length - 1;
  const pixels = new Uint8ClampedArray(4 * width * height);
  for (let y = 0, at = 0; y < height; y++) {
    const cut = cutOverAngles(table, rows, last + 1, 1 - (y + 0.5) / height);
    for (let x = 0; x < width; x++, at += 4) {
      const [index, part] = columns[x];
      const value = between(cut[index], cut[Math.min(index + 1, last)], part);
      let step = 2 * steps;
      if (value <= scale.limit) step = Math.min(Math.max((value - scale.low) * cold, 0), 1) * (steps - 1);
      else if (value > scale.limit) step = steps + Math.min(Math.sqrt((value - scale.limit) * warm), 1) * (steps - 1);
      const from = 3 * Math.round(step);
      pixels[at] = colours[from];
      pixels[at + 1] = colours[from + 1];
      pixels[at + 2] = colours[from + 2];
      pixels[at + 3] = 255;
    }
  }
  return pixels;
}

const encoded = (linear) =>
  255 * (linear <= 0.0031308 ? 12.92 * Math.max(linear, 0) : 1.055 * Math.min(linear, 1) ** (1 / 2.4) - 0.055);

// How bright the furnace's walls are shown: so dark that what exceeds them is seen to be brighter.
const WALL = 0.42;

// A sphere in a white furnace, RGBA: what leaves towards the viewer is E of the angle between view and normal, times the walls.
// `cuts`: over the angles, one for each channel. `marked`: what exceeds the limit is red.
function spherePixels(size, angles, cuts, limit, marked) {
  const pixels = new Uint8ClampedArray(4 * size * size);
  const radius = 0.44 * size;
  const wall = encoded(WALL);
  const shades = Array.from({ length: 257 }, (_, k) => {
    const angle = (180 / Math.PI) * Math.asin(k / 256);
    const values = cuts.map((cut) => look(angles.values, cut, angle));
    if (values.some(Number.isNaN)) return [128, 128, 128];
    const rgb = [0, 1, 2].map((channel) => encoded(WALL * values[cuts.length === 3 ? channel : 0]));
    return marked && Math.max(...values) > limit ? [235, 0.42 * rgb[1], 0.36 * rgb[2]] : rgb;
  });
  for (let y = 0; y < size; y++) {
    for (let x = 0; x < size; x++) {
      const away = Math.sqrt((x + 0.5 - size / 2) ** 2 + (y + 0.5 - size / 2) ** 2);
      const shade = shades[Math.min(256, Math.round((256 * away) / radius))];
      const cover = Math.min(Math.max(radius - away + 0.5, 0), 1);
      const at = 4 * (y * size + x);
      pixels[at] = wall + (shade[0] - wall) * cover;
      pixels[at + 1] = wall + (shade[1] - wall) * cover;
      pixels[at + 2] = wall + (shade[2] - wall) * cover;
      pixels[at + 3] = 255;
    }
  }
  return pixels;
}

// Round numbers within [low, high], about `count` of them.
function ticks(low, high, count) {
  if (!(high > low)) return [low];
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
  const first = Math.ceil(low / step - 1e-9);
  return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => Number(((first + k) * step).toPrecision(12)));
}

// Round numbers for an axis: powers of ten where its values rise geometrically.
function axisTicks(axis, count) {
  const low = axis.values[0];
  const high = axis.values[axis.values.length - 1];
  if (!(high > low)) return [low];
  if (unitOf(axis.name)) {
    // Degrees are divided by 15, 30, 45 and 90 rather than by tens.
    const step = [1, 5, 10, 15, 30, 45, 90].find((step) => (high - low) / step <= count) ?? 90;
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
  }
  const straight = Math.abs(valueAt(axis, 0.5) - (low + high) / 2) < 0.1 * (high - low);
  if (straight) return ticks(low, high, count);
  const powers = [];
  for (let power = Math.floor(Math.log10(Math.max(low, high * 1e-6))); 10 ** power <= high * 1.0001; power++) {
    const factors = high / Math.max(low, high * 1e-6) < 2000 ? [1, 2, 5] : [1];
    for (const factor of factors) powers.push(Number((factor * 10 ** power).toPrecision(3)));
  }
  const apart = [];
  for (const value of powers.filter((value) => value >= low && value <= high * 1.0001)) {
    if (!apart.length || positionOf(axis, value) - positionOf(axis, apart[apart.length - 1]) > 0.5 / count) apart.push(value);
  }
  return apart;
}

// How large the values of a table are, for its colours and cuts: a pole in a few nodes must not flatten all the rest.
function extent(table) {
  const finite = table.filter(Number.isFinite).sort();
  if (!finite.length) return { least: 0, high: 1, cut: false };
  const high = finite[finite.length - 1];
  const usual = Math.max(finite[Math.floor(0.95 * (finite.length - 1))], 1);
  const cut = high > 10 * usual;
  return { least: finite[0], high: cut ? 2 * usual : high, cut };
}

const shown = (value, digits = 5) =>
  !Number.isFinite(value) ? "no value" : Math.abs(value) < 1e6 ? String(Number(value.toPrecision(digits))) : value.toExponential(2);
const albedoText = (value) => (!Number.isFinite(value) ? "no value" : Math.abs(value) < 1000 ? value.toFixed(4) : value.toPrecision(6));
const unitOf = (name) => (name === "angle" || name === "azimuth" ? "\u00b0" : "");

// The order of the rows of a table by their keys: numbers by size, and after them texts by the alphabet.
function sortedOrder(keys, falling) {
  const order = keys.map((_, i) => i);
  const numeric = (key) => key !== "" && !Number.isNaN(Number(key));
  const compare = (a, b) => {
    if (numeric(a) && numeric(b)) return Number(a) - Number(b);
    if (numeric(a) !== numeric(b)) return numeric(a) ? -1 : 1;
    return a.localeCompare(b);
  };
  return order.sort((i, j) => (falling ? -1 : 1) * compare(keys[i], keys[j]) || i - j);
}

// The slice for indices of the parameters that stand still. Where not every combination has one, the other parameters go back
// to the place: then [its key, the indices].
function sliceFor(entry, indices, moved) {
  const key = indices.join(",");
  if (key in entry.tables) return [key, indices];
  const back = entry.others.map((axis, k) => (k === moved ? indices[k] : axis.at));
  return [back.join(","), back];
}
