// What the views are made of: elements, tables, dialogs, times, what is said for a few seconds.
import { current, say } from "./words.js";

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

/** A part of a picture. */
export function svg(name, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
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

/** A time of this day here: 19:31:02. */
export const clock = (date) => date.toLocaleTimeString(current(), { hour: "2-digit", minute: "2-digit", second: "2-digit", hour12: false });

/** Date and time here, with the zone: 2026-11-29 19:31:02.125 CET. `wall` is UTC as the station tells it. */
export function local(wall) {
  const date = wall instanceof Date ? wall : new Date(`${wall.replace(" ", "T")}Z`);
  if (Number.isNaN(date.getTime())) return String(wall);
  const two = (number, digits = 2) => String(number).padStart(digits, "0");
  const zone = new Intl.DateTimeFormat(current(), { timeZoneName: "short" }).formatToParts(date).find((part) => part.type === "timeZoneName");
  return `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())} ${two(date.getHours())}:${two(date.getMinutes())}:${
    two(date.getSeconds())}.${two(date.getMilliseconds(), 3)} ${zone?.value ?? ""}`;
}

/** Fills a place with what is asked for. It says that it waits, and why there is nothing, with a second try. */
export async function fill(place, load, draw) {
  const timer = setTimeout(() => place.replaceChildren(h("p", { class: "quiet loading" }, say("loading"))), 300);
  try {
    const answer = await load();
    clearTimeout(timer);
    place.replaceChildren(...[draw(answer)].flat());
  } catch (error) {
    clearTimeout(timer);
    place.replaceChildren(h("p", { class: "trouble", role: "alert" }, error.message),
      h("button", { type: "button", onclick: () => fill(place, load, draw) }, say("again")));
  }
}

/** A file of this text, to be kept. */
export function download(name, type, text) {
  const link = h("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

let toldTimer;

/** Says something for a few seconds. */
export function tell(text) {
  byId("said").replaceChildren(h("p", {}, text));
  clearTimeout(toldTimer);
  toldTimer = setTimeout(() => byId("said").replaceChildren(), 6000);
}

/**
 * A question in a dialog. `more` are elements, `fields` are inputs; `act` does it with their values. An error of it is
 * told at the first field, and what was typed stays.
 */
export function dialog({ title, more = [], fields = [], action, danger }, act) {
  const box = byId("dialog");
  const input = (field) => field.choice
    ? h("select", { id: `field-${field.name}`, name: field.name },
      field.choice.map(([value, text]) => h("option", { value, selected: value === field.value }, text)))
    : h("input", { id: `field-${field.name}`, name: field.name, type: field.type ?? "text", value: field.value ?? "",
      autocomplete: field.autocomplete ?? "off", autocapitalize: "off", spellcheck: "false", required: true, "aria-describedby": "dialog-error" });
  const inputs = fields.map(input);
  const wrong = h("p", { id: "dialog-error", class: "trouble", role: "alert" });
  const go = h("button", { type: "submit", class: danger ? "danger" : "" }, action);
  const submit = async (event) => {
    event.preventDefault();
    go.disabled = true;
    try {
      await act(Object.fromEntries(inputs.map((one) => [one.name, one.value])));
      box.close();
    } catch (error) {
      wrong.textContent = error.message;
      inputs[0]?.setAttribute("aria-invalid", "true");
      inputs[0]?.focus();
    }
    go.disabled = false;
  };
  box.className = "";
  box.replaceChildren(h("form", { onsubmit: submit, novalidate: true },
    h("h2", { id: "dialog-title" }, title), ...more,
    fields.map((field, at) => h("p", {}, h("label", { for: `field-${field.name}` }, field.label), inputs[at])), wrong,
    h("div", { class: "row" }, go, h("button", { type: "button", onclick: () => box.close() }, say("cancel")))));
  if (!box.open) box.showModal();
  (inputs[0] ?? box.querySelector("button")).focus();
}
