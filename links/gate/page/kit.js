// What the views are made of: elements, tables, dialogs, what is said for a few seconds.
import { say } from "./words.js";

export const byId = (id) => document.getElementById(id);

/** An element: `h("p", { class: "quiet" }, "text", child)`. Text stays text. */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** A table with heads; a cell may be an element. */
export function table(heads, rows, caption) {
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": caption },
    h("table", {}, h("thead", {}, h("tr", {}, heads.map((head) => h("th", { scope: "col" }, head)))),
      h("tbody", {}, rows.map((row) => h("tr", {}, row.map((cell) =>
        cell instanceof HTMLTableCellElement ? cell : h("td", {}, cell)))))));
}

/** Draws anew; whoever was at one of the tables by keyboard stays there. */
export function redraw(parent, ...children) {
  const places = () => [...parent.querySelectorAll("[tabindex='0']")];
  const at = places().indexOf(document.activeElement);
  parent.replaceChildren(...children.filter((child) => child !== null && child !== undefined));
  if (at >= 0) places()[at]?.focus({ preventScroll: true });
}

let toldTimer;

/** Says something for a few seconds. */
export function tell(text) {
  byId("said").replaceChildren(h("p", {}, text));
  clearTimeout(toldTimer);
  toldTimer = setTimeout(() => byId("said").replaceChildren(), 6000);
}

/** A question in a dialog; `fields` are inputs. Answers their values, or null. */
export function dialog(title, text, fields, action, danger) {
  const box = byId("dialog");
  const inputs = fields.map((field) => h("input", { id: `field-${field.name}`, name: field.name, type: field.type ?? "text",
    value: field.value ?? "", autocomplete: field.autocomplete ?? "off", required: true }));
  return new Promise((resolve) => {
    const done = (value) => { box.close(); resolve(value); };
    const submit = (event) => {
      event.preventDefault();
      done(Object.fromEntries(inputs.map((input) => [input.name, input.value])));
    };
    box.oncancel = () => resolve(null);
    box.replaceChildren(h("form", { onsubmit: submit },
      h("h2", { id: "dialog-title" }, title), text ? h("p", {}, text) : null,
      fields.map((field, at) => h("p", {}, h("label", { for: `field-${field.name}` }, field.label), inputs[at])),
      h("div", { class: "row" },
        h("button", { type: "submit", class: danger ? "danger" : "" }, action),
        h("button", { type: "button", onclick: () => done(null) }, say("cancel")))));
    if (!box.open) box.showModal();
    (inputs[0] ?? box.querySelector("button")).focus();
  });
}
