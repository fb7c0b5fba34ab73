// The variable table: names, forms, values as they change, writing with right, tables that the station keeps.
import { dialog, h, redraw, tell } from "./kit.js";
import { recordings } from "./recording.js";
import { ask, may, state, want } from "./session.js";
import { curves, note, spark } from "./trend.js";
import { has, say } from "./words.js";

const KEY = () => `ob1-names-${state.session.station}`;

/** What was watched last in this browser, as far as it keeps anything. */
const last = () => { try { return localStorage.getItem(KEY()); } catch { return null; } };
const keep = (text) => { try { localStorage.setItem(KEY(), text); } catch { /* then it is forgotten */ } };

/** What stays while other pages are shown. */
const kept = { period: 1000, chosen: [] };

const FORMS = ["", ":hex", ":bin", ":anzw", ":status"];
/** Names that are offered at a time. */
const OFFERED = 50;

/** A line of a table: its name with the form, and the comment. */
const parts = (line) => {
  const [name, comment = ""] = line.split(/\/\/(.*)/);
  return [name.trim(), comment.trim()];
};
const bare = (name) => FORMS.slice(1).reduce((text, form) => text.toLowerCase().endsWith(form) ? text.slice(0, -form.length) : text, name);
const plain = (name) => bare(name).replaceAll('"', "").replaceAll(" ", "").toLowerCase();

/** Symbols by name and by address, and the components of data blocks as far as they were asked for. */
class Names {
  constructor() {
    this.symbols = [];
    this.comments = new Map();
    this.components = new Map();
  }

  async load() {
    const { symbols, data } = await ask("program");
    this.symbols = [...symbols.map(([name, address]) => [name, address]), ...data.map(({ id, name }) => [`${id.replace(" ", "")}.`, name ?? ""])];
    for (const [name, address, comment] of symbols) {
      for (const key of [plain(name), plain(address)]) if (comment) this.comments.set(key, comment);
    }
  }

  /** What begins or holds what was typed; of a data block its components. */
  async like(typed) {
    const db = typed.match(/^DB ?(\d+)\./i)?.[1];
    if (db && !this.components.has(db)) {
      this.components.set(db, []);
      const { components } = await ask(`block?id=${encodeURIComponent(`DB ${db}`)}`);
      this.components.set(db, components.map(([, type, , name]) => [name, type]));
    }
    const wanted = plain(typed);
    const all = db ? this.components.get(db) : this.symbols;
    return all.filter(([name, about]) => plain(name).includes(wanted) || plain(about).startsWith(wanted)).slice(0, OFFERED);
  }
}

export function variables(main) {
  const given = new URLSearchParams(location.hash.split("?")[1] ?? "").get("items");
  const names = h("textarea", { id: "names", spellcheck: "false", autocapitalize: "off" });
  names.value = given ?? last() ?? "";
  const known = new Names();
  const offered = h("datalist", { id: "offered" });
  const more = h("input", { id: "add-name", list: "offered", spellcheck: "false", autocapitalize: "off", placeholder: say("addHelp"), "aria-label": say("addHelp"),
    oninput: () => offer(), onkeydown: (event) => { if (event.key === "Enter") add(); } });
  const period = h("select", { id: "period", "aria-label": say("period") },
    [100, 200, 500, 1000, 5000].map((ms) => h("option", { value: ms, selected: ms === kept.period }, `${say("period")} ${ms} ms`)));
  const choice = h("select", { id: "tables", "aria-label": say("table") });
  const body = h("tbody");
  const scan = h("p", { class: "quiet" });
  const picture = h("div", { id: "trends" });
  let tables = {};
  let lines = [];
  let comments = [];
  let cells = [];
  let sparks = [];
  let before = [];
  let drawn = 0;

  const fill = (all) => {
    tables = all;
    const present = choice.value;
    const stored = Object.keys(tables);
    choice.replaceChildren(...(stored.length ? stored.map((name) => h("option", { value: name, selected: name === present }, name))
      : [h("option", { value: "" }, say("noTables"))]));
  };

  const watch = () => {
    const asked = new Map(names.value.split("\n").map(parts).filter(([name]) => name));
    [lines, comments] = [[...asked.keys()], [...asked.values()]];
    kept.period = Number(period.value);
    keep(names.value);
    body.replaceChildren();
    want({ items: lines, period: kept.period });
  };

  const offer = async () => {
    try {
      const found = await known.like(more.value);
      offered.replaceChildren(...found.map(([name, about]) => h("option", { value: name }, about)));
    } catch { /* what is not offered can be typed */ }
  };

  const add = () => {
    const name = more.value.trim();
    if (!name) return;
    names.value = `${names.value.trim()}\n${name}`.trim();
    more.value = "";
    watch();
  };

  const write = (at, type) => {
    const name = bare(lines[at]);
    const form = has(`form_${type}`) ? `form_${type}` : "form_other";
    const present = h("span", { class: "code" }, before[at] ?? "");
    const field = type === "BOOL"
      ? { name: "value", label: say("newValue"), value: before[at] === "1" ? "FALSE" : "TRUE", choice: [["TRUE", "TRUE (1)"], ["FALSE", "FALSE (0)"]] }
      : { name: "value", label: say("newValue"), value: lines[at] === name ? before[at] ?? "" : "" };
    dialog({
      title: say("writeName", name), fields: [field], action: say("write"), danger: true,
      more: [h("dl", {}, h("dt", {}, say("presentValue")), h("dd", {}, present), h("dt", {}, say("type")), h("dd", {}, type),
        h("dt", {}, say("allowedForm")), h("dd", {}, say(form)))],
    }, async ({ value }) => {
      const done = await ask("write", { item: name, value });
      tell(say("written", name, done.scan));
    });
  };

  const choose = (at, form) => {
    const rows = names.value.split("\n");
    const place = rows.findIndex((line) => parts(line)[0] === lines[at]);
    rows[place] = bare(lines[at]) + form + (comments[at] ? ` // ${comments[at]}` : "");
    names.value = rows.join("\n");
    watch();
  };

  const save = () => dialog({ title: say("save"), fields: [{ name: "name", label: say("name"), value: choice.value }], action: say("save") }, async ({ name }) => {
    fill(await ask("tables", { name, lines: names.value }));
    choice.value = name.trim();
    tell(say("tableKept", name));
  });

  const load = () => {
    const found = tables[choice.value];
    if (found === undefined) return;
    names.value = found;
    watch();
  };

  const remove = () => choice.value && dialog({ title: say("askRemove", choice.value), action: say("remove"), danger: true }, async () => {
    fill(await ask("tables", { name: choice.value, lines: "" }));
  });

  const curve = (name) => {
    kept.chosen = kept.chosen.includes(name) ? kept.chosen.filter((one) => one !== name) : [...kept.chosen, name];
    draw();
  };

  /** The curves, once a second: nobody sees more. */
  const draw = () => {
    drawn = Date.now();
    sparks.forEach((cell, at) => cell.replaceChildren(...[spark(bare(lines[at]))].filter(Boolean)));
    redraw(picture, ...curves(kept.chosen.filter((name) => lines.some((line) => bare(line) === name))));
  };

  const button = (key, act) => h("button", { type: "button", id: `table-${key}`, onclick: act }, say(key));
  main.replaceChildren(
    h("p", {}, h("label", { for: "names" }, say("names")), names, h("span", { class: "quiet" }, say("namesHelp"))),
    h("div", { class: "row" }, more, offered, button("add", add), button("watch", watch), period),
    h("div", { class: "row" }, choice, button("load", load), button("save", save), button("remove", remove)),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": say("variables") }, h("table", { id: "values" }, h("thead", {}, h("tr", {},
      ["name", "comment", "type", "value", "trend", "write"].map((key) => h("th", { scope: "col" }, say(key))))), body)), scan, picture, recordings());
  if (!may("write")) picture.before(h("p", { class: "quiet" }, say("mayNot", state.session.right)));
  fill({});
  if (names.value) watch();
  ask("tables").then(fill, (error) => tell(error.message));
  // Comments of symbols come when they come.
  known.load().then(() => body.querySelectorAll("td.comment").forEach((cell, at) => { cell.textContent ||= known.comments.get(plain(lines[at])) ?? ""; }), () => {});

  return {
    heads(heads) {
      heads = heads.filter(Boolean);
      if (heads.length !== lines.length) return;
      before = [];
      cells = heads.map((head) => h("td", { class: "value" }, head.error ?? "…"));
      sparks = heads.map((head, at) => head.error ? h("span")
        : h("button", { type: "button", class: "plain", "aria-label": say("trendShow", bare(lines[at])), onclick: () => curve(bare(lines[at])) }));
      body.replaceChildren(...heads.map((head, at) => h("tr", {}, h("td", { class: "code" }, bare(lines[at])),
        h("td", { class: "comment" }, comments[at] || (known.comments.get(plain(lines[at])) ?? "")),
        h("td", {}, head.error ? "" : h("select", { "aria-label": `${say("type")} ${lines[at]}`, onchange: (event) => choose(at, event.target.value) },
          FORMS.map((form) => h("option", { value: form, selected: lines[at].toLowerCase().endsWith(form || "\u0000") }, form ? form.slice(1) : head.type)))),
        cells[at], h("td", {}, sparks[at]),
        h("td", {}, head.error ? "" : h("button", { type: "button", disabled: !may("write"), "aria-label": `${say("write")} ${bare(lines[at])}`,
          onclick: () => write(at, head.type) }, say("write"))))));
    },
    values(told) {
      scan.textContent = `${say("scan")} ${told.scan}`;
      told.values.forEach((value, at) => {
        if (!cells[at] || value === null) return;
        const text = typeof value === "string" ? value : value.error;
        cells[at].classList.toggle("changed", before[at] !== undefined && before[at] !== text);
        if (before[at] !== text) cells[at].textContent = text;
        before[at] = text;
      });
      before.forEach((text, at) => note(bare(lines[at]), text ?? ""));
      if (Date.now() - drawn >= 1000) draw();
    },
  };
}
