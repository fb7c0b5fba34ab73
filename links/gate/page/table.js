// The variable table: names, forms, values as they change, writing with right, tables that this browser keeps.
import { dialog, h, tell } from "./kit.js";
import { ask, may, state, want } from "./session.js";
import { has, say } from "./words.js";

const KEY = () => `ob1-tables-${state.session.station}`;

function saved() {
  try { return JSON.parse(localStorage.getItem(KEY()) ?? "{}"); } catch { return {}; }
}

function keep(tables) {
  try { localStorage.setItem(KEY(), JSON.stringify(tables)); } catch { tell(say("notKept")); }
}

/** What stays while other pages are shown. */
const kept = { period: 1000 };

const FORMS = ["", ":hex", ":bin", ":anzw", ":status"];

export function variables(main) {
  const given = new URLSearchParams(location.hash.split("?")[1] ?? "").get("items");
  const names = h("textarea", { id: "names", spellcheck: "false", autocapitalize: "off" });
  names.value = given ?? saved()[""] ?? "";
  const period = h("select", { id: "period", "aria-label": say("period") },
    [100, 200, 500, 1000, 5000].map((ms) => h("option", { value: ms, selected: ms === kept.period }, `${say("period")} ${ms} ms`)));
  const choice = h("select", { id: "tables", "aria-label": say("table") });
  const body = h("tbody");
  const scan = h("p", { class: "quiet" });
  let lines = [];
  let cells = [];
  let before = [];

  const fill = () => choice.replaceChildren(...(Object.keys(saved()).filter((name) => name !== "").length
    ? Object.keys(saved()).filter((name) => name !== "").map((name) => h("option", { value: name }, name))
    : [h("option", { value: "" }, say("noTables"))]));

  const watch = () => {
    lines = [...new Set(names.value.split("\n").map((line) => line.trim()).filter(Boolean))];
    kept.period = Number(period.value);
    keep({ ...saved(), "": lines.join("\n") });
    body.replaceChildren();
    want({ items: lines, period: kept.period });
  };

  const bare = (line) => FORMS.slice(1).reduce((name, form) => name.toLowerCase().endsWith(form) ? name.slice(0, -form.length) : name, line);

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
    lines[at] = bare(lines[at]) + form;
    names.value = lines.join("\n");
    watch();
  };

  const save = () => dialog({ title: say("save"), fields: [{ name: "name", label: say("name"), value: choice.value }], action: say("save") }, (answer) => {
    keep({ ...saved(), [answer.name]: names.value });
    fill();
    choice.value = answer.name;
  });

  const load = () => {
    const found = saved()[choice.value];
    if (found === undefined) return;
    names.value = found;
    watch();
  };

  const remove = () => {
    const tables = saved();
    delete tables[choice.value];
    keep(tables);
    fill();
  };

  const button = (key, act) => h("button", { type: "button", id: `table-${key}`, onclick: act }, say(key));
  main.replaceChildren(
    h("p", {}, h("label", { for: "names" }, say("names")), names, h("span", { class: "quiet" }, say("namesHelp"))),
    h("div", { class: "row" }, button("watch", watch), period, choice, button("load", load), button("save", save), button("remove", remove)),
    h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": say("variables") }, h("table", { id: "values" }, h("thead", {}, h("tr", {},
      ["name", "type", "value", "write"].map((key) => h("th", { scope: "col" }, say(key))))), body)), scan);
  if (!may("write")) main.append(h("p", { class: "quiet" }, say("mayNot", state.session.right)));
  fill();
  if (names.value) watch();

  return {
    heads(heads) {
      heads = heads.filter(Boolean);
      if (heads.length !== lines.length) return;
      before = [];
      cells = heads.map((head) => h("td", { class: "value" }, head.error ?? "…"));
      body.replaceChildren(...heads.map((head, at) => h("tr", {}, h("td", { class: "code" }, bare(lines[at])),
        h("td", {}, head.error ? "" : h("select", { "aria-label": `${say("type")} ${lines[at]}`, onchange: (event) => choose(at, event.target.value) },
          FORMS.map((form) => h("option", { value: form, selected: lines[at].toLowerCase().endsWith(form || "\u0000") }, form ? form.slice(1) : head.type)))),
        cells[at],
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
    },
  };
}
