// A recording of signals (docs/record.md) that somebody has as a file: .ob1trace, or the table that `ob1 record` makes
// of it. It is read here and goes nowhere.
import { h, local } from "./kit.js";
import { chart, CURVES, number, Series } from "./trend.js";
import { say } from "./words.js";

/** Columns of a row before its signals; of these, and of the table, the scan's own curves. */
const COLUMNS = 16;
const SCAN = { lateness_ns: 7, execution_ns: 8 };
/** Columns of the table before its signals. */
const TABLE = 11;
/** What happened that is listed at a time. */
const LISTED = 20;
/** Steps of the choice of a time. */
const STEPS = 1000;

/** What was recorded: series by name, what happened, rows, what is wrong with the file. Times are milliseconds. */
class Recording {
  series = new Map();
  happened = [];
  from = Infinity;
  to = 0;
  rows = 0;
  lost = 0;
  unix = 0;
  wrong = null;

  /** A row: its time, and the rows lost so far. */
  row(time, lost) {
    this.from = Math.min(this.from, time);
    this.to = Math.max(this.to, time);
    this.lost = lost;
    this.rows += 1;
  }
}

/** FNV-1a of 64 bits over these bytes, as two halves. */
function checksum(bytes, from, to) {
  let high = 0xCBF29CE4;
  let low = 0x84222325;
  for (let at = from; at < to; at += 1) {
    low = (low ^ bytes[at]) >>> 0;
    const product = low * 0x1B3;
    high = (Math.imul(high, 0x1B3) + Math.floor(product / 0x1_0000_0000) + (low << 8)) >>> 0;
    low = product >>> 0;
  }
  return [high, low];
}

/** The value of a signal's word by its type; NaN where there was none. */
function valued(type, word, view) {
  if (word >= 0x1_0000_0000) return NaN;
  switch (type) {
    case "INT": return (word << 16) >> 16;
    case "DINT": case "TIME": return word | 0;
    case "REAL": view.setUint32(0, word); return view.getFloat32(0);
    case "S5TIME": {
      const [hundreds, tens, ones] = [8, 4, 0].map((shift) => (word >> shift) & 15);
      return (hundreds * 100 + tens * 10 + ones) * 10 ** (1 + ((word >> 12) & 3));
    }
    default: return word;
  }
}

const HAPPENED = {
  part: ({ time_ns, why }) => [time_ns, say("recordPart", why)],
  late: ({ planned_ns, scan, what }) => [planned_ns, say("recordLate", scan, what ?? "")],
  diagnosis: ({ time_ns, number: event, text }) => [time_ns, `${event} ${text}`],
  process: ({ time_ns, name, up }) => [time_ns, `${name}: ${say(up ? "up" : "down")}`],
  order: ({ time_ns, module, what }) => [time_ns, `${module}: ${what}`],
};

/** Reads the blocks of a recording, up to the last whole one. */
function blocks(bytes, recording) {
  const [view, four, text] = [new DataView(bytes.buffer, bytes.byteOffset), new DataView(new ArrayBuffer(4)), new TextDecoder()];
  const curves = [];
  let types = [];
  let at = 8;
  const next = () => {
    let value = 0;
    let scale = 1;
    let byte;
    do {
      byte = bytes[at++];
      value += (byte & 127) * scale;
      scale *= 128;
    } while (byte > 127);
    return value;
  };
  while (at < bytes.length) {
    const end = at + 5 <= bytes.length ? at + 5 + view.getUint32(at, true) : Infinity;
    if (end + 8 > bytes.length) return void (recording.wrong = say("recordCut"));
    const [high, low] = checksum(bytes, at, end);
    if (view.getUint32(end, true) !== low || view.getUint32(end + 4, true) !== high) return void (recording.wrong = say("recordDamaged", at));
    const kind = bytes[at + 4];
    at += 5;
    if (kind === 0) {
      const head = JSON.parse(text.decode(bytes.subarray(at, end)));
      types = head.signals.map(({ type }) => type);
      recording.unix = head.clocks.unix_ns / 1e6;
      head.signals.forEach(({ name }, signal) => recording.series.set(name, curves[COLUMNS + signal] = new Series()));
      Object.entries(SCAN).forEach(([name, column]) => recording.series.set(name, curves[column] = new Series()));
    } else if (kind === 1) {
      const columns = new Array(COLUMNS + types.length).fill(0);
      const width = Math.ceil(columns.length / 8);
      const set = (column, time) => {
        const value = column < COLUMNS ? columns[column] : valued(types[column - COLUMNS], columns[column], four);
        curves[column]?.change(time, value);
      };
      for (let first = true; at < end; first = false) {
        const changed = at;
        const steps = [];
        at += width;
        for (let column = 0; column < columns.length; column += 1) {
          if (!(bytes[changed + (column >> 3)] >> (column & 7) & 1)) continue;
          const step = next();
          columns[column] += step % 2 ? -(step + 1) / 2 : step / 2;
          steps.push(column);
        }
        const time = columns[1] / 1e6;
        recording.row(time, columns[3]);
        // A block begins with all that is not 0.
        if (first) columns.forEach((_, column) => set(column, time)); else steps.forEach((column) => set(column, time));
      }
    } else if (kind === 3) {
      for (const event of JSON.parse(text.decode(bytes.subarray(at, end)))) {
        // Until the next part nothing was recorded.
        if (event.event === "complete") recording.series.forEach((series) => series.add(recording.to, NaN));
        const [time, told] = HAPPENED[event.event]?.(event) ?? [];
        if (told) recording.happened.push([time / 1e6, told]);
      }
    }
    at = end + 8;
  }
}

/** Reads the table of a recording: cells between commas, in quotes where they need it. */
function table(text, recording) {
  const cell = /(?:"((?:[^"]|"")*)"|([^",\r\n]*))(,|\r?\n|$)/gy;
  let [cells, heads, columns] = [[], null, []];
  for (let found = cell.exec(text); found && cell.lastIndex <= text.length; found = cell.exec(text)) {
    cells.push(found[1]?.replaceAll('""', '"') ?? found[2]);
    if (found[3] === ",") continue;
    if (!heads) {
      if (cells[0] !== "time_ns" || cells.length < TABLE) throw new Error(say("noRecording"));
      heads = cells;
      columns = [...heads.keys()].slice(TABLE).concat(Object.keys(SCAN).map((name) => heads.indexOf(name)));
      columns.forEach((column) => recording.series.set(heads[column], new Series()));
    } else if (cells.length === heads.length) {
      const time = cells[0] / 1e6;
      recording.row(time, Number(cells[3]));
      [...recording.series.values()].forEach((series, at) => series.change(time, number(cells[columns[at]])));
    } else if (cells.length > 1) {
      recording.wrong = say("recordCut");
    }
    cells = [];
    if (found[3] === "") break;
  }
}

/** Reads a file of either form. */
export function read(bytes) {
  const recording = new Recording();
  const first = new TextDecoder("latin1").decode(bytes.subarray(0, 8));
  if (first === "OB1REC\u0001\n") blocks(bytes, recording);
  else table(new TextDecoder().decode(bytes), recording);
  if (recording.rows === 0) throw new Error(recording.wrong ?? say("noRecording"));
  return recording;
}

/** What is open stays while other pages are shown. */
const kept = { name: "", recording: null, chosen: [], from: 0, to: STEPS };

/** The place where a recording is opened and shown. */
export function recordings() {
  const wrong = h("p", { class: "trouble", role: "alert" });
  const shown = h("div", { id: "recorded" });
  const picture = h("div");

  const draw = () => {
    const { recording, chosen } = kept;
    const whole = recording.to - recording.from;
    const [from, to] = [kept.from, kept.to].map((step) => recording.from + whole * step / STEPS);
    const inside = recording.happened.filter(([time]) => time >= from && time <= to);
    const marks = inside.map(([time]) => `M${(600 * (time - from) / Math.max(to - from, 1e-6)).toFixed(1)} 0V160`).join("");
    const seconds = (time) => `${((time - recording.from) / 1000).toFixed(3)} s`;
    const begun = recording.unix ? `${local(new Date(recording.unix + from))}, ` : "";
    picture.replaceChildren(...chart(chosen.map((name) => [name, recording.series.get(name)]), from, to, `${begun}${seconds(from)} – ${seconds(to)}`, marks),
      h("ul", {}, inside.slice(0, LISTED).map(([time, told]) => h("li", {}, `${seconds(time)} ${told}`)),
        inside.length > LISTED ? h("li", { class: "quiet" }, say("recordMore", inside.length - LISTED)) : null));
  };

  const choose = (name, on) => {
    kept.chosen = kept.chosen.filter((one) => one !== name);
    if (on) kept.chosen = [...kept.chosen, name].slice(-CURVES);
    show();
  };

  const slider = (key) => h("label", {}, say(`record_${key}`), h("input", { type: "range", min: 0, max: STEPS, value: kept[key], oninput: (event) => {
    kept[key] = Number(event.target.value);
    if (kept.from >= kept.to) [kept.from, kept.to] = [Math.min(kept.from, STEPS - 1), Math.min(kept.from, STEPS - 1) + 1];
    draw();
  } }));

  const show = () => {
    const { recording, chosen, name } = kept;
    if (!recording) return;
    wrong.textContent = recording.wrong ?? "";
    shown.replaceChildren(h("p", {}, say("recorded", name, recording.rows, recording.lost)),
      h("fieldset", { class: "row" }, h("legend", {}, say("recordSignals", CURVES)), [...recording.series.keys()].map((one) => h("label", {},
        h("input", { type: "checkbox", checked: chosen.includes(one), onchange: (event) => choose(one, event.target.checked) }), ` ${one}`))),
      h("div", { class: "row" }, slider("from"), slider("to")), picture);
    draw();
  };

  const open = async (event) => {
    const [file] = event.target.files;
    if (!file) return;
    shown.replaceChildren(h("p", { class: "quiet loading" }, say("loading")));
    try {
      const bytes = new Uint8Array(await file.arrayBuffer());
      // A large file takes seconds: what was just said is drawn first.
      await new Promise((go) => { setTimeout(go, 30); });
      const recording = read(bytes);
      Object.assign(kept, { name: file.name, recording, chosen: [...recording.series.keys()].slice(0, 1), from: 0, to: STEPS });
      show();
    } catch (error) {
      shown.replaceChildren();
      wrong.textContent = `${file.name}: ${error.message}`;
    }
  };

  show();
  return h("section", { id: "recording" }, h("h2", {}, say("recording")), h("p", {}, h("label", { for: "recording-file" }, say("recordingFile")),
    h("input", { id: "recording-file", type: "file", accept: ".ob1trace,.csv", onchange: open })), wrong, shown);
}
