// What the station is, how it scans, what has happened, and the reports of soak runs.
import { clock, dialog, download, fill, h, local, redraw, svg, table, tell } from "./kit.js";
import { place, stopOf } from "./stop.js";
import { ask, may, state, want } from "./session.js";
import { reason as reasonText, say, told } from "./words.js";

const time = (ns) => ns >= 1e9 ? `${(ns / 1e9).toFixed(2)} s` : ns >= 1e6 ? `${(ns / 1e6).toFixed(2)} ms` : `${(ns / 1e3).toFixed(1)} µs`;

function duration(ns) {
  const seconds = Math.floor(ns / 1e9);
  const [days, hours, minutes] = [Math.floor(seconds / 86400), Math.floor(seconds / 3600) % 24, Math.floor(seconds / 60) % 60];
  return `${days > 0 ? `${days} d ` : ""}${hours} h ${minutes} min ${seconds % 60} s`;
}

const words = { RUN: "running", STOP: "stopped", STARTUP: "starting", HOLD: "held" };

/** Why the machine stands: in words, first of all. */
function reason(card, now, why) {
  const since = why?.since ? h("span", { class: "quiet since" }, ` ${say("sinceThen", local(why.since))}`) : "";
  const lines = why ? stopOf(why, now) : [];
  card.className = `card ${(now ?? "").toLowerCase()}`;
  card.replaceChildren(h("h2", {}, say(words[now] ?? "loading"), since), ...lines);
}

const colours = { SF: "red", BF: "red", ERR: "red", STOP: "yellow", RUN: "green", TXD: "green", RXD: "green", PW: "green" };
const led = (name) => h("span", { class: `led ${colours[name] ?? "yellow"}` }, name);

function module(of) {
  const counters = of.counters ?? {};
  const telling = ["telegrams_sent", "telegrams_received", "send_errors", "receive_errors"];
  telling.push(...Object.keys(counters).filter((key) => counters[key] > 0
    && (/^ended_|_lost$/.test(key) || key === "rejected_full") && key !== "log_lost"));
  return h("section", { class: "module" },
    h("h3", {}, of.name), h("div", { class: "quiet" }, `${of.type}, ${of.address}, ${say(of.present ? "present" : "absent")}`),
    h("div", {}, led2(of.present), ...of.leds.map(led)),
    of.driver ? h("div", {}, `${say("driver")}: ${of.driver.state}`,
      of.driver.losses > 0 ? `, ${of.driver.losses} × ${say("restarted")}` : "") : null,
    of.reason ? h("div", { class: "reason" }, h("strong", {}, reasonText(of.reason)),
      of.reason.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${told(of.reason.remedy)}`) : null) : null,
    h("div", { class: "quiet" }, telling.filter((key) => key in counters)
      .map((key) => `${key.replace("_", " ")} ${counters[key]}`).join(", ")));
}

const led2 = (present) => h("span", { class: `led ${present ? "green" : "red"}` }, present ? "OK" : "SF");

export function station(main) {
  const card = h("section", { class: "card", "aria-live": "polite" });
  const short = h("dl", { class: "short" });
  const cpu = h("div", { class: "rack" });
  const figures = h("div");
  const links = h("p");
  const buttons = h("div", { class: "row" });
  main.replaceChildren(card, short, h("h2", {}, say("mode")), buttons, h("h2", {}, say("modules")), cpu,
    h("h2", {}, say("links")), links, h("details", {}, h("summary", {}, say("figures")), figures));
  let why = null;
  let shown = "";

  const look = async () => {
    try {
      why = await ask("why");
      links.replaceChildren(...(await ask("links")).map((link) => h("span", { class: `led ${link.up ? "green" : "red"}` }, `${link.name}: ${say(link.up ? "up" : "down")}`)));
    } catch (error) { tell(error.message); }
    if (state.status) draw(state.status);
  };

  const command = (name) => dialog({
    title: say(`ask_${name}`, state.session.station), action: say(name), danger: true,
    more: [h("p", {}, say(`tell_${name}`)), ...(name === "reset" ? [h("ul", {}, say("lose").split("|").map((what) => h("li", {}, what)))] : [])],
  }, () => ask("command", { command: name }));
  const allowed = may("operate");
  const commands = ["run", "stop", "warm", "cold", ...(state.session.family === 400 ? ["hot"] : []), "reset"];
  buttons.replaceChildren(...commands.map((name) =>
    h("button", { type: "button", id: `command-${name}`, disabled: !allowed, class: name === "stop" ? "danger" : "", onclick: () => command(name) }, say(name))));
  if (!allowed) buttons.append(h("span", { class: "quiet" }, say("mayNot", state.session.right)));

  function draw(status) {
    const key = JSON.stringify([status.state, why]);
    if (key !== shown) {
      shown = key;
      reason(card, status.state, why);
    }
    const stopped = status.state === "STOP";
    const missing = status.modules.filter((of) => !of.present);
    const wrong = status.modules.filter((of) => of.reason || of.leds.some((name) => colours[name] === "red"));
    const fact = (key, value, bad) => h("div", {}, h("dt", {}, say(key)), h("dd", { class: bad ? "bad" : "" }, value));
    short.replaceChildren(
      fact("modules", `${status.modules.length - missing.length} / ${status.modules.length}`, missing.length > 0),
      fact("cpErrors", wrong.map((of) => of.name).join(", ") || say("none"), wrong.length > 0),
      fact("cycleNow", time(status.cycle.p50_ns)), fact("cycleMax", time(status.cycle.max_ns)),
      fact("late", `${status.late}`, false), fact("forcedAll", status.forced.length ? `${status.forced.length}` : say("none"), status.forced.length > 0));
    cpu.replaceChildren(h("section", { class: "module" }, h("h3", {}, "CPU"),
      h("div", { class: "quiet" }, status.station),
      h("div", {}, missing.length > 0 || (stopped && why?.stop?.change === "fault") ? led("SF") : null, stopped ? led("STOP") : led("RUN"),
        status.forced.length ? led("FRCE") : null)),
      ...status.modules.map(module));
    redraw(figures, table([say("what"), say("value")], [
      [say("uptime"), duration(status.runtime_ns)], [say("scans"), `${status.scans}`],
      [`${say("execution")} (${say("median")}, 99 %, ${say("greatest")})`,
        `${time(status.execution.p50_ns)}, ${time(status.execution.p99_ns)}, ${time(status.execution.max_ns)}`],
      [say("late"), `${status.late}`], [say("overruns"), `${status.overruns}`], [say("missed"), `${status.missed}`],
      [say("watchdogs"), `${status.watchdogs}`],
      [say("memory"), `${(status.memory.resident_kib / 1024).toFixed(1)} MiB, ${status.memory.threads} ${say("threads")}`],
      ...status.forced.map((text) => [say("forcedAll"), text]),
      ...(status.stands_s ? [[say("stands"), duration(status.stands_s * 1e9)]] : []),
      ...(status.engine_lacks ? [[status.engine, status.engine_lacks]] : []),
      ...status.posture.filter((grant) => grant.outcome !== "granted")
        .map((grant) => [`${say("what_sched")}: ${grant.what}`, `${grant.outcome}: ${grant.detail} ${grant.remedy ?? ""}`]),
    ], say("figures")));
  }
  if (state.status) draw(state.status);
  look();
  return { status: draw, event: () => look() };
}

function histogram(title, spread) {
  const bounds = [1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6, 2e6, 5e6, 1e7, 2e7, 5e7, 1e8, 2e8, 5e8, 1e9, 1e10];
  const counts = bounds.map(() => 0);
  for (const [value, count] of spread.buckets ?? []) {
    const at = bounds.findIndex((bound) => value <= bound);
    counts[at < 0 ? bounds.length - 1 : at] += count;
  }
  const first = counts.findIndex((count) => count > 0);
  const last = counts.findLastIndex((count) => count > 0);
  const most = Math.max(...counts, 1);
  const rows = bounds.map((bound, at) => [bound, counts[at], at]).filter(([, , at]) => first >= 0 && at >= first && at <= last);
  const bar = (count) => {
    const fill = h("div", { class: "fill" });
    // Few among many are seen too.
    fill.style.width = count > 0 ? `${Math.max(1, 100 * Math.log1p(count) / Math.log1p(most))}%` : "0";
    return h("td", {}, h("div", { class: "track" }, fill));
  };
  return h("section", {}, h("h2", {}, title),
    h("p", { class: "quiet" }, `${spread.count} × · ${say("median")} ${time(spread.p50_ns)} · 99 % ${time(spread.p99_ns)} · 99.9 % ${time(spread.p999_ns)} · ${say("greatest")} ${time(spread.max_ns)}`),
    table([say("upTo"), "", say("count")], rows.map(([bound, count]) => [time(bound), bar(count), h("td", { class: "number" }, `${count}`)]), title));
}

/** The last ten minutes, one point a second; it stays while other pages are shown. */
const history = [];

export function remember(status) {
  const { p50_ns, p99_ns, max_ns } = status.execution;
  history.push({ at: Date.now(), p50_ns, p99_ns, max_ns });
  if (history.length > 600) history.shift();
}

/** The medians of these spreads as a line, their 99 % values as marks. */
function chart(points, label) {
  const [width, height] = [600, 120];
  const most = Math.max(...points.map((point) => point.p99_ns), 1);
  const x = (at) => (width - (points.length - 1 - at) * Math.max(1, width / Math.max(points.length, 600))).toFixed(1);
  const y = (ns) => (height - 4 - (height - 12) * ns / most).toFixed(1);
  const text = label(time(points.at(-1)?.p50_ns ?? 0), time(most));
  const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "chart", role: "img", preserveAspectRatio: "none", "aria-label": text });
  picture.append(svg("path", { class: "marks", d: points.map((point, at) => `M${x(at)} ${height}V${y(point.p99_ns)}`).join("") }),
    svg("polyline", { class: "line", points: points.map((point, at) => `${x(at)},${y(point.p50_ns)}`).join(" ") }));
  return h("figure", {}, picture, h("figcaption", { class: "quiet" }, text));
}

export function scan(main) {
  let busy = false;
  const picture = h("section");
  const rest = h("div", {}, h("p", { class: "quiet" }, say("loading")));
  main.replaceChildren(picture, rest);
  const look = async () => {
    redraw(picture, h("h2", {}, say("history")), chart(history, (now, most) => say("historyText", now, most)));
    if (busy) return;
    busy = true;
    try {
      const timing = await ask("timing");
      const late = timing.late;
      const classes = Object.entries(late.classes).map(([name, total]) =>
        [told(name), `${total.scans}`, time(total.time_ns), time(total.worst_ns)]);
      const newest = [...late.newest].reverse().slice(0, 20).map((entry) =>
        [`${entry.scan}`, time(entry.lateness_ns), time(entry.execution_ns), `${told(entry.class)}: ${told(entry.what)}`]);
      redraw(rest, h("h2", {}, `${say("late")}: ${late.scans}`),
        classes.length ? table([say("cause"), say("count"), say("delay"), say("greatest")], classes, say("cause"))
          : h("p", {}, say("nothingLate")),
        newest.length ? h("h2", {}, say("newest")) : null,
        newest.length ? table([say("scan"), say("delay"), say("execution"), say("cause")], newest, say("newest")) : null,
        h("div", { class: "columns" }, histogram(say("execution"), timing.execution), histogram(say("cycle"), timing.cycle),
          histogram(say("wake"), timing.wake)));
    } catch (error) { tell(error.message); }
    busy = false;
  };
  look();
  return { status: look };
}

function entry(of) {
  return h("li", { class: of.change === "fault" ? "fault" : "" },
    h("div", { class: "quiet" }, `${of.number}  ${local(of.wall)}  ${of.event}`), h("div", {}, told(of.text)),
    of.place ? h("div", {}, `${say("place")}: `, place(of)) : null,
    of.because ? h("div", {}, `${say("because")}: ${of.because}`) : null,
    of.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${told(of.remedy)}`) : null);
}

const date = (ns) => ns ? local(new Date(ns / 1e6)) : "";

/** A table as CSV: quoted, with the mark that spreadsheets read UTF-8 by. */
const csv = (rows) => `\u{FEFF}${rows.map((row) => row.map((cell) => `"${String(cell ?? "").replaceAll('"', '""')}"`).join(";")).join("\r\n")}\r\n`;

export function diagnostics(main) {
  const look = () => fill(main, async () => [await ask("diagnostics"), await ask("buffers")], ([entries, buffers]) => {
    const cp = (buffer) => h("section", {}, h("h2", {}, `${buffer.name} (${buffer.type}, ${buffer.address}): ${buffer.driver}`),
      buffer.reason ? h("p", {}, h("strong", {}, reasonText(buffer.reason))) : null,
      buffer.entries.length ? h("ol", { class: "buffer" }, buffer.entries.map((of) =>
        h("li", {}, h("div", { class: "quiet" }, `${date(of.unix_ns)}  ${of.number}`),
          h("div", {}, `${of.incoming ? "" : `${say("gone")}: `}${told(of.text)}`),
          of.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${told(of.remedy)}`) : null)))
        : h("p", {}, say("noEntries")));
    const keep = () => download(`${state.session.station}-diagnostics.csv`, "text/csv", csv([
      ["", say("number"), say("time"), say("event"), say("text"), say("place"), say("remedy")],
      ...entries.map((of) => ["CPU", of.number, local(of.wall), of.event, told(of.text), of.place, told(of.remedy)]),
      ...buffers.flatMap((buffer) => buffer.entries.map((of) => [buffer.name, of.number, date(of.unix_ns), "", told(of.text), "", told(of.remedy)]))]));
    return [h("div", { class: "row" }, h("button", { type: "button", id: "csv", onclick: keep }, say("csv"))),
      h("h2", {}, "CPU"), h("ol", { class: "buffer" }, entries.map(entry)), ...buffers.map(cp)];
  });
  look();
  return { event: (event) => { if (event.what === "diagnosis") look(); } };
}

/** What a report has as figures, as pictures. */
function pictures({ timing, intervals }) {
  const series = (intervals ?? []).map((of) => of.execution);
  const scale = Math.max(1, Math.ceil(series.length / 600));
  // The worst of several stands for them, where there are more than points.
  const points = series.flatMap((_, at) => at % scale ? [] : [series.slice(at, at + scale).reduce((worst, of) => of.p99_ns > worst.p99_ns ? of : worst)]);
  return [points.length > 1 ? chart(points, (_, most) => say("seriesText", points.length, most)) : null,
    timing ? h("div", { class: "columns" }, histogram(say("execution"), timing.execution), histogram(say("cycle"), timing.cycle),
      histogram(say("wake"), timing.wake)) : null].filter(Boolean);
}

export function reports(main) {
  const shown = h("section", { id: "report" });
  const look = async () => {
    try {
      const names = await ask("reports");
      const open = async (name) => {
        try {
          const report = await ask(`reports?name=${encodeURIComponent(name)}`);
          const findings = (report.findings ?? []).map((of) => [of.budget, of.measured, of.verdict, of.why]);
          shown.replaceChildren(h("h2", {}, name), h("p", {}, h("strong", {}, `${say("verdict")}: ${report.verdict}`)),
            h("p", {}, `${report.station} · ${date(report.began_unix_s * 1e9)} · ${duration(report.measured_ns)} · ${report.ended}`),
            table([say("budget"), say("measured"), say("verdict"), ""], findings, say("verdict")), ...pictures(report),
            h("details", {}, h("summary", {}, "JSON"),
              h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": name }, h("pre", { class: "code" }, JSON.stringify(report, null, 1)))));
        } catch (error) { tell(error.message); }
      };
      main.replaceChildren(h("h2", {}, say("reports")),
        names.length ? h("ul", {}, names.map((name) => h("li", {}, h("button", { type: "button", onclick: () => open(name) }, name))))
          : h("p", {}, say("noReports")), shown);
    } catch (error) { tell(error.message); }
  };
  look();
  return {};
}

/** Telegrams and control characters as they come, one row each: way, meaning, user data. */
export function telegrams(main) {
  const body = h("tbody");
  const rows = [];
  let paused = false;
  const text = (hex) => hex.replace(/../g, (pair) => {
    const code = parseInt(pair, 16);
    return code >= 32 && code < 127 ? String.fromCharCode(code) : "·";
  });
  const ways = { out: `→ ${say("sent")}`, in: `← ${say("received")}` };
  const isShort = (told) => /^(STX|DLE|NAK|ETX|XON|XOFF|BCC)\b/.test(told.what) && !told.hex;
  const isWrong = (told) => /error|wrong|missing|NAK|gone|timeout|no answer|not /i.test(told.what);
  const sift = (of) => (handshake.checked || !isShort(of)) && (!errors.checked || isWrong(of))
    && `${of.cp} ${of.what} ${of.hex} ${text(of.hex)}`.toLowerCase().includes(filter.value.toLowerCase());
  const row = (of) => h("tr", { class: isWrong(of) ? "wrong" : "" }, h("td", { class: "code" }, `${clock(new Date(of.ms))}.${String(of.ms % 1000).padStart(3, "0")}`),
    h("td", {}, of.cp), h("td", {}, ways[of.way] ?? ""), h("td", {}, of.what), h("td", { class: "code" }, of.hex.replace(/../g, "$& ")), h("td", { class: "code" }, text(of.hex)));
  const draw = () => body.replaceChildren(...rows.filter(sift).slice(0, 200).map(row));
  const filter = h("input", { id: "telegram-filter", placeholder: say("filter"), "aria-label": say("filter"), oninput: draw });
  const box = (id, key, on) => [h("input", { type: "checkbox", id, checked: on, onchange: draw }), h("label", { for: id }, say(key))];
  const [handshake, handshakeLabel] = box("handshake", "handshake", true);
  const [errors, errorsLabel] = box("errors", "errorsOnly", false);
  const hold = h("button", { type: "button", id: "pause", "aria-pressed": "false", onclick: () => {
    paused = !paused;
    hold.textContent = say(paused ? "goOn" : "pause");
    hold.setAttribute("aria-pressed", `${paused}`);
    if (!paused) draw();
  } }, say("pause"));
  const keep = h("button", { type: "button", onclick: () => download(`${state.session.station}-telegrams.csv`, "text/csv", csv([
    ["time", "name", "way", "what", "hex"].map((key) => key === "hex" ? "hex" : say(key)),
    ...rows.filter(sift).map((of) => [local(new Date(of.ms)), of.cp, ways[of.way] ?? "", of.what, of.hex])])) }, say("download"));
  main.replaceChildren(h("p", { class: "quiet" }, say("telegramsHelp")),
    h("div", { class: "row" }, hold, filter, handshake, handshakeLabel, errors, errorsLabel, keep),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": say("telegrams") },
      h("table", { id: "telegrams" }, h("thead", {}, h("tr", {}, ["time", "name", "way", "what"].map((key) => h("th", { scope: "col" }, say(key))),
        h("th", { scope: "col" }, "HEX"), h("th", { scope: "col" }, "ASCII"))), body)));
  want({ telegrams: true });
  return {
    telegram(of) {
      if (of.none) { main.append(h("p", {}, say("noTaps"))); return; }
      rows.unshift(of);
      if (rows.length > 1000) rows.pop();
      if (paused || !sift(of)) return;
      body.prepend(row(of));
      while (body.children.length > 200) body.lastElementChild.remove();
    },
  };
}
