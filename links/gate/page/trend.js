// The last values of variables as curves: a small one in each row of the table, those that were chosen below it.
import { clock, h, svg } from "./kit.js";
import { say } from "./words.js";

/** Points that are kept of a variable. */
const POINTS = 1200;
/** Curves in the picture. */
const CURVES = 6;

/** What was seen of a name, as long as this page is open: times and values. */
const seen = new Map();

const number = (text) => {
  const value = Number(text);
  return text !== "" && Number.isFinite(value) ? value : NaN;
};

/** A value as it came, or as it still is. Texts have no curve. */
export function note(name, text) {
  const value = number(text);
  if (Number.isNaN(value)) return;
  const points = seen.get(name) ?? [];
  seen.set(name, points);
  points.push([Date.now(), value]);
  if (points.length > POINTS) points.shift();
}

const bounds = (points) => points.reduce(([least, most], [, value]) => [Math.min(least, value), Math.max(most, value)], [Infinity, -Infinity]);

/** Steps from point to point: between two looks nobody knows. */
function path(points, from, to, width, height) {
  const [least, most] = bounds(points);
  const x = (at) => (width * (at - from) / Math.max(to - from, 1)).toFixed(1);
  const y = (value) => (most === least ? height / 2 : height - 2 - (height - 4) * (value - least) / (most - least)).toFixed(1);
  return points.map(([at, value], place) => place === 0 ? `M${x(at)} ${y(value)}` : `H${x(at)}V${y(value)}`).join("") + `H${width}`;
}

const picture = (name, width, height, label) =>
  svg("svg", { viewBox: `0 0 ${width} ${height}`, class: name, role: "img", preserveAspectRatio: "none", "aria-label": label });

/** The small curve of a row, or nothing. */
export function spark(name) {
  const points = seen.get(name);
  if (!points) return null;
  const [least, most] = bounds(points);
  const drawn = picture("spark", 100, 20, say("trendOf", name, least, most));
  drawn.append(svg("path", { class: "line", d: path(points, points[0][0], points.at(-1)[0], 100, 20) }));
  return drawn;
}

/** The curves of these names, each from its least to its greatest value, on one axis of time. */
export function curves(names) {
  const known = names.filter((name) => seen.has(name)).slice(0, CURVES);
  if (known.length === 0) return [];
  const all = known.map((name) => seen.get(name));
  const [from, to] = [Math.min(...all.map((points) => points[0][0])), Math.max(...all.map((points) => points.at(-1)[0]))];
  const drawn = picture("chart", 600, 160, say("trend"));
  known.forEach((name, at) => drawn.append(svg("path", { class: `line c${at}`, d: path(all[at], from, to, 600, 160) })));
  const told = known.map((name, at) => h("li", { class: `c${at}` }, say("trendOf", name, ...bounds(all[at]))));
  return [h("figure", {}, drawn, h("figcaption", { class: "quiet" }, `${clock(new Date(from))} – ${clock(new Date(to))}`)), h("ul", { class: "legend" }, told)];
}
