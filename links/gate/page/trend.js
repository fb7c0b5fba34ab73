// Values as curves: the last ones of variables, a small curve in each row of the table, those that were chosen below
// it; and those of a recording.
import { clock, h, svg } from "./kit.js";
import { say } from "./words.js";

/** Points that are kept of a variable. */
const POINTS = 1200;
/** Curves in the picture. */
export const CURVES = 6;

/** What a name was: a value from each time on until the next; NaN where it had none. */
export class Series {
  times = [];
  values = [];

  add(time, value) {
    this.times.push(time);
    this.values.push(value);
  }

  /** The same, where only changes matter. */
  change(time, value) {
    if (!Object.is(this.values.at(-1), value)) this.add(time, value);
  }

  /** The place of the last value that had begun by then. */
  place(time) {
    let [low, high] = [0, this.times.length];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.times[middle] <= time) low = middle; else high = middle;
    }
    return low;
  }

  /** The least and the greatest value from one time to another. */
  bounds(from, to) {
    let [least, most] = [Infinity, -Infinity];
    for (let at = this.place(from); at < this.times.length && this.times[at] <= to; at += 1) {
      const value = this.values[at];
      if (value < least) least = value;
      if (value > most) most = value;
    }
    return [least, most];
  }

  /** Steps from value to value: between two looks nobody knows. A column of the picture has at most three of them. */
  path(from, to, width, height) {
    const [least, most] = this.bounds(from, to);
    const y = (value) => (most === least ? height / 2 : height - 2 - (height - 4) * (value - least) / (most - least)).toFixed(1);
    let [drawn, column, low, high, last] = ["", -1, NaN, NaN, NaN];
    const step = () => (Number.isNaN(last) ? "" : [...new Set([low, high, last])].map((value) => `V${y(value)}`).join(""));
    for (let at = this.place(from); at < this.times.length && this.times[at] <= to; at += 1) {
      const [x, value] = [Math.max(0, Math.round(2 * width * (this.times[at] - from) / Math.max(to - from, 1)) / 2), this.values[at]];
      if (x !== column || Number.isNaN(value) || Number.isNaN(last)) {
        drawn += step();
        if (!Number.isNaN(last)) drawn += `H${x}`;
        if (Number.isNaN(last) && !Number.isNaN(value)) drawn += `M${x} ${y(value)}`;
        [column, low, high] = [x, value, value];
      }
      [low, high, last] = [Math.min(low, value), Math.max(high, value), value];
    }
    return drawn + step() + (Number.isNaN(last) ? "" : `H${width}`);
  }
}

/** What was seen of a name, as long as this page is open. */
const seen = new Map();

/** A number as it is written; NaN for anything else. */
export const number = (text) => {
  const value = Number(text);
  return text !== "" && Number.isFinite(value) ? value : NaN;
};

/** A value as it came, or as it still is. Texts have no curve. */
export function note(name, text) {
  const value = number(text);
  if (Number.isNaN(value)) return;
  const series = seen.get(name) ?? new Series();
  seen.set(name, series);
  series.add(Date.now(), value);
  if (series.times.length > POINTS) [series.times, series.values].forEach((all) => all.shift());
}

const picture = (name, width, height, label) =>
  svg("svg", { viewBox: `0 0 ${width} ${height}`, class: name, role: "img", preserveAspectRatio: "none", "aria-label": label });

/** The small curve of a row, or nothing. */
export function spark(name) {
  const series = seen.get(name);
  if (!series) return null;
  const [from, to] = [series.times[0], series.times.at(-1)];
  const drawn = picture("spark", 100, 20, say("trendOf", name, ...series.bounds(from, to)));
  drawn.append(svg("path", { class: "line", d: series.path(from, to, 100, 20) }));
  return drawn;
}

/** Curves of series by their names, each from its least to its greatest value, on one axis of time. */
export function chart(named, from, to, caption, marks = "") {
  const drawn = picture("chart", 600, 160, say("trend"));
  drawn.append(svg("path", { class: "marks", d: marks }));
  named.forEach(([, series], at) => drawn.append(svg("path", { class: `line c${at}`, d: series.path(from, to, 600, 160) })));
  const told = named.map(([name, series], at) => h("li", { class: `c${at}` }, say("trendOf", name, ...series.bounds(from, to))));
  return [h("figure", {}, drawn, h("figcaption", { class: "quiet" }, caption)), h("ul", { class: "legend" }, told)];
}

/** The curves of these names as they were seen. */
export function curves(names) {
  const known = names.filter((name) => seen.has(name)).slice(0, CURVES).map((name) => [name, seen.get(name)]);
  if (known.length === 0) return [];
  const [from, to] = [Math.min(...known.map(([, { times }]) => times[0])), Math.max(...known.map(([, { times }]) => times.at(-1)))];
  return chart(known, from, to, `${clock(new Date(from))} – ${clock(new Date(to))}`);
}
