// What the station is, how it scans, what has happened, and the reports of soak runs.
import { dialog, h, redraw, table, tell } from "./kit.js";
import { ask, listen, may, state } from "./session.js";
import { reason as reasonText, say } from "./words.js";

const time = (ns) => ns >= 1e9 ? `${(ns / 1e9).toFixed(2)} s` : ns >= 1e6 ? `${(ns / 1e6).toFixed(2)} ms` : `${(ns / 1e3).toFixed(1)} µs`;

function duration(ns) {
  const seconds = Math.floor(ns / 1e9);
  const [days, hours, minutes] = [Math.floor(seconds / 86400), Math.floor(seconds / 3600) % 24, Math.floor(seconds / 60) % 60];
  return `${days > 0 ? `${days} d ` : ""}${hours} h ${minutes} min ${seconds % 60} s`;
}

const hex = (number, digits = 8) => number.toString(16).toUpperCase().padStart(digits, "0");

/** In what the program was interrupted: who has called whom, and the registers. */
function stack({ blocks, accus, addresses, local }) {
  const name = (of) => `${of.block}${of.name ? ` ${of.name}` : ""}, ${say("network")} ${of.network}`;
  const way = blocks.map((of, at) => h("li", {}, at > 0 ? `${say("calledBy")} ` : "", h("code", {}, name(of)),
    of.source ? ` (${of.source}:${of.line})` : ""));
  const [{ db, di }] = blocks;
  const registers = [...accus.map((value, at) => `ACCU${at + 1} ${hex(value)}`),
    ...addresses.map((value, at) => `AR${at + 1} ${hex(value)}`), `DB ${db}`, `DI ${di}`];
  return h("details", {}, h("summary", {}, `${say("stack")}: ${name(blocks[0])}`), h("ol", {}, ...way),
    h("p", {}, h("code", {}, registers.join(", "))),
    local ? h("p", {}, `${say("localData")}: `, h("code", {}, local)) : null);
}

const words = { RUN: "running", STOP: "stopped", STARTUP: "starting", HOLD: "held" };

/** Why the machine stands: in words, first of all. */
function reason(card, now, why) {
  const lines = [h("h2", {}, say(words[now] ?? "loading"))];
  if (why?.stop) {
    const told = why.cause ?? why.stop;
    const stands = now === "STOP" && !why.over;
    lines.push(h("p", { class: "quiet" }, `${say(stands ? "stoppedBy" : "lastStop")} ${told.wall}`));
    lines.push(h("p", {}, h("strong", {}, why.stop.change === "stop" ? `${say("orderly")} ` : "", told.text)));
    if (told.place) lines.push(h("p", {}, `${say("place")}: `, h("code", {}, told.place)));
    const because = told.because || why.stop.because;
    if (because) lines.push(h("p", {}, `${say("because")}: ${because}`));
    const remedy = told.remedy || why.stop.remedy;
    if (remedy) lines.push(h("p", { class: "remedy" }, `${say("remedy")}: ${remedy}`));
    if (why.stack && now !== "RUN") lines.push(stack(why.stack));
  } else if (why) {
    lines.push(h("p", { class: "quiet" }, say("noStop")));
  }
  card.className = `card ${(now ?? "").toLowerCase()}`;
  card.replaceChildren(...lines);
}

const colours = { SF: "red", BF: "red", ERR: "red", STOP: "yellow", RUN: "green", TXD: "green", RXD: "green", PW: "green" };
const led = (name) => h("span", { class: `led ${colours[name] ?? "yellow"}` }, name);

function module(of) {
  const counters = of.counters ?? {};
  const telling = ["telegrams_sent", "telegrams_received", "send_errors", "receive_errors"];
  telling.push(...Object.keys(counters).filter((key) => counters[key] > 0
    && (/^ended_|_lost$/.test(key) || key === "rejected_full") && key !== "log_lost"));
  return h("section", { class: "module" },
    h("h3", {}, of.name), h("div", { class: "quiet" }, `${of.type}, ${of.address}`),
    h("div", {}, led2(of.present), ...of.leds.map(led)),
    h("div", {}, say(of.present ? "present" : "absent")),
    of.driver ? h("div", {}, `${say("driver")}: ${of.driver.state}`,
      of.driver.losses > 0 ? `, ${of.driver.losses} × ${say("restarted")}` : "") : null,
    of.reason ? h("div", { class: "reason" }, h("strong", {}, reasonText(of.reason)),
      of.reason.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${of.reason.remedy}`) : null) : null,
    h("div", { class: "quiet" }, telling.filter((key) => key in counters)
      .map((key) => `${key.replace("_", " ")} ${counters[key]}`).join(", ")));
}

const led2 = (present) => h("span", { class: `led ${present ? "green" : "red"}` }, present ? "OK" : "SF");

export function station(main) {
  const card = h("section", { class: "card", "aria-live": "polite" });
  const cpu = h("div", { class: "rack" });
  const figures = h("div");
  const links = h("p");
  const buttons = h("div", { class: "row" });
  main.replaceChildren(card, h("h2", {}, say("modules")), cpu, h("h2", {}, say("mode")), buttons,
    h("h2", {}, say("figures")), figures, h("h2", {}, say("links")), links);
  let why = null;
  let shown = "";

  const look = async () => {
    try {
      why = await ask("why");
      links.textContent = (await ask("links")).map((link) => `${link.name}: ${say(link.up ? "up" : "down")}`).join(", ");
    } catch (error) { tell(error.message); }
    if (state.status) draw(state.status);
  };

  const command = async (name) => {
    const asked = await dialog(say("confirmTitle"), say("confirm", say(name), state.session.station), [], say(name), true);
    if (!asked) return;
    try { await ask("command", { command: name }); } catch (error) { tell(error.message); }
  };
  const allowed = may("operate");
  const commands = ["run", "stop", "warm", "cold", ...(state.session.family === 400 ? ["hot"] : []), "reset"];
  buttons.replaceChildren(...commands.map((name) =>
    h("button", { type: "button", disabled: !allowed, class: name === "stop" ? "danger" : "", onclick: () => command(name) }, say(name))));
  if (!allowed) buttons.append(h("span", { class: "quiet" }, say("mayNot", state.session.right)));

  function draw(status) {
    const key = JSON.stringify([status.state, why]);
    if (key !== shown) {
      shown = key;
      reason(card, status.state, why);
    }
    const stopped = status.state === "STOP";
    const missing = status.modules.some((of) => !of.present);
    cpu.replaceChildren(h("section", { class: "module" }, h("h3", {}, "CPU"),
      h("div", { class: "quiet" }, status.station),
      h("div", {}, missing || (stopped && why?.stop?.change === "fault") ? led("SF") : null, stopped ? led("STOP") : led("RUN"))),
      ...status.modules.map(module));
    redraw(figures, table([say("what"), say("value")], [
      [say("uptime"), duration(status.runtime_ns)], [say("scans"), `${status.scans}`],
      [`${say("execution")} (${say("median")}, 99 %, ${say("greatest")})`,
        `${time(status.execution.p50_ns)}, ${time(status.execution.p99_ns)}, ${time(status.execution.max_ns)}`],
      [say("late"), `${status.late}`], [say("overruns"), `${status.overruns}`], [say("missed"), `${status.missed}`],
      [say("watchdogs"), `${status.watchdogs}`],
      [say("memory"), `${(status.memory.resident_kib / 1024).toFixed(1)} MiB, ${status.memory.threads} ${say("threads")}`],
      ...(status.stands_s ? [[`${say("serious")}: ${say("stands")}`, duration(status.stands_s * 1e9)]] : []),
      ...(status.engine_lacks ? [[`${say("serious")}: ${status.engine}`, status.engine_lacks]] : []),
      ...status.posture.filter((grant) => grant.outcome !== "granted")
        .map((grant) => [`${say("serious")}: ${grant.what}`, `${grant.outcome}: ${grant.detail} ${grant.remedy ?? ""}`]),
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

export function scan(main) {
  let busy = false;
  const look = async () => {
    if (busy) return;
    busy = true;
    try {
      const timing = await ask("timing");
      const late = timing.late;
      const classes = Object.entries(late.classes).map(([name, total]) =>
        [name, `${total.scans}`, time(total.time_ns), time(total.worst_ns)]);
      const newest = [...late.newest].reverse().slice(0, 20).map((entry) =>
        [`${entry.scan}`, time(entry.lateness_ns), time(entry.execution_ns), `${entry.class}: ${entry.what}`]);
      redraw(main, histogram(say("execution"), timing.execution), histogram(say("cycle"), timing.cycle),
        histogram(say("wake"), timing.wake), h("h2", {}, `${say("late")}: ${late.scans}`),
        classes.length ? table([say("cause"), say("count"), say("delay"), say("greatest")], classes, say("cause"))
          : h("p", {}, say("nothingLate")),
        newest.length ? h("h2", {}, say("newest")) : null,
        newest.length ? table([say("scan"), say("delay"), say("execution"), say("cause")], newest, say("newest")) : null);
    } catch (error) { tell(error.message); }
    busy = false;
  };
  look();
  return { status: look };
}

function entry(of) {
  return h("li", { class: of.change === "fault" ? "fault" : "" },
    h("div", { class: "quiet" }, `${of.number}  ${of.wall}  ${of.event}`), h("div", {}, of.text),
    of.place ? h("div", {}, `${say("place")}: `, h("code", {}, of.place)) : null,
    of.because ? h("div", {}, `${say("because")}: ${of.because}`) : null,
    of.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${of.remedy}`) : null);
}

function wall(ns) {
  return ns ? new Date(ns / 1e6).toISOString().replace("T", " ").replace("Z", "") : "";
}

export function diagnostics(main) {
  const look = async () => {
    try {
      const [entries, buffers] = [await ask("diagnostics"), await ask("buffers")];
      const cp = (buffer) => h("section", {}, h("h2", {}, `${buffer.name} (${buffer.type}, ${buffer.address}): ${buffer.driver}`),
        buffer.reason ? h("p", {}, h("strong", {}, reasonText(buffer.reason))) : null,
        buffer.entries.length ? h("ol", { class: "buffer" }, buffer.entries.map((of) =>
          h("li", {}, h("div", { class: "quiet" }, `${wall(of.unix_ns)}  ${of.number}`),
            h("div", {}, `${of.incoming ? "" : `${say("gone")}: `}${of.text}`),
            of.remedy ? h("div", { class: "remedy" }, `${say("remedy")}: ${of.remedy}`) : null)))
          : h("p", {}, say("noEntries")));
      main.replaceChildren(h("h2", {}, "CPU"), h("ol", { class: "buffer" }, entries.map(entry)), ...buffers.map(cp));
    } catch (error) { tell(error.message); }
  };
  look();
  return { event: (event) => { if (event.what === "diagnosis") look(); } };
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
            h("p", {}, `${report.station} · ${wall(report.began_unix_s * 1e9)} · ${duration(report.measured_ns)} · ${report.ended}`),
            table([say("budget"), say("measured"), say("verdict"), ""], findings, say("verdict")),
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

/** Telegrams and control characters as they come, each with its meaning and its user data. */
export function telegrams(main) {
  const body = h("tbody");
  const text = (hex) => hex.replace(/../g, (pair) => {
    const code = parseInt(pair, 16);
    return code >= 32 && code < 127 ? String.fromCharCode(code) : "·";
  });
  const ways = { out: `→ ${say("sent")}`, in: `← ${say("received")}` };
  main.replaceChildren(h("p", { class: "quiet" }, say("telegramsHelp")), h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": say("telegrams") },
    h("table", { id: "telegrams" }, h("thead", {}, h("tr", {}, ["since", "name", "way", "what"].map((key) => h("th", { scope: "col" }, say(key))))), body)));
  state.telegrams = true;
  listen();
  return {
    telegram(told) {
      if (told.none) { main.append(h("p", {}, say("noTaps"))); return; }
      body.prepend(h("tr", {}, h("td", {}, new Date(told.ms).toISOString().slice(11, 23)), h("td", {}, told.cp), h("td", {}, ways[told.way] ?? ""),
        h("td", {}, told.what, told.hex ? h("div", { class: "code quiet" }, `${told.hex.replace(/../g, "$& ")} ${text(told.hex)}`) : null)));
      while (body.children.length > 200) body.lastElementChild.remove();
    },
    leave() { state.telegrams = false; listen(); },
  };
}
