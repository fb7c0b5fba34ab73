// The frame of the page: who is here, which view is shown, what the station tells without being asked.
import { current, say, switchLanguage } from "./words.js";
import { diagnostics, reports, scan, station, telegrams } from "./views.js";
import { variables } from "./table.js";
import { program } from "./program.js";

const views = { station, scan, diagnostics, variables, program, telegrams, reports };
const byId = (id) => document.getElementById(id);

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

export const state = { session: null, status: null, view: null, stream: null, items: "", period: 1000, telegrams: false };
let toldTimer;

/** Says something for a few seconds. */
export function tell(text) {
  byId("said").replaceChildren(h("p", {}, text));
  clearTimeout(toldTimer);
  toldTimer = setTimeout(() => byId("said").replaceChildren(), 6000);
}

/** Asks the station; an error says why. */
export async function ask(path, body) {
  const options = body === undefined ? {}
    : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(`api/${path}`, { ...options, signal: AbortSignal.timeout(15000) });
  if (answer.status === 401 && path !== "login") {
    await begin();
    throw new Error(say("loginWanted"));
  }
  if (!answer.ok) throw new Error((await answer.text()).trim());
  return answer.json();
}

/** Whether the user may do this. */
export function may(right) {
  const order = ["read", "write", "operate"];
  return order.indexOf(state.session?.right) >= order.indexOf(right);
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

async function login() {
  const given = await dialog(say("login"), say("loginWanted"), [
    { name: "user", label: say("user"), autocomplete: "username" },
    { name: "password", label: say("password"), type: "password", autocomplete: "current-password" },
  ], say("login"));
  if (!given) return;
  try {
    await ask("login", given);
  } catch (error) {
    tell(error.message);
  }
  await begin();
}

async function logout() {
  await ask("logout", {});
  await begin();
}

function frame() {
  document.documentElement.lang = current();
  byId("language").textContent = say("language");
  byId("language").lang = current() === "de" ? "en" : "de";
  document.querySelector(".skip").textContent = say("skip");
  const name = state.session?.station ?? "ob1";
  byId("name").textContent = name;
  document.title = `${name} · ob1`;
  const account = byId("account");
  account.hidden = !state.session?.users;
  account.textContent = state.session?.user ? `${say("logout")} (${state.session.user})` : say("login");
  account.onclick = state.session?.user ? logout : login;
  const chosen = location.hash.slice(1).split("?")[0] || "station";
  byId("nav").replaceChildren(...Object.keys(views).map((key) =>
    h("a", { href: `#${key}`, "aria-current": key === chosen ? "page" : null }, say(key))));
  mode();
}

function mode() {
  const element = byId("mode");
  const now = state.status?.state;
  if (element.textContent !== (now ?? "…")) element.textContent = now ?? "…";
  element.className = `mode ${(now ?? "").toLowerCase()}`;
}

function show() {
  const key = location.hash.slice(1).split("?")[0] || "station";
  state.view?.leave?.();
  state.view = null;
  frame();
  const main = byId("main");
  if (state.session && state.session.users && !state.session.user) {
    main.replaceChildren(h("p", {}, say("loginWanted")), h("button", { type: "button", onclick: login }, say("login")));
    return;
  }
  // Each visit has an element of its own. An answer that comes when the visitor has gone on changes an element that
  // is no longer shown.
  const place = h("div", {});
  main.replaceChildren(place);
  state.view = (views[key] ?? station)(place);
}

/** Listens to the station; a table asks for its values too. */
export function listen() {
  state.stream?.close();
  const query = state.items ? `?period=${state.period}&items=${encodeURIComponent(state.items)}` : state.telegrams ? "?telegrams=1" : "";
  const stream = new EventSource(`api/stream${query}`);
  state.stream = stream;
  const on = (name, act) => stream.addEventListener(name, (event) => act(JSON.parse(event.data)));
  stream.onopen = () => { byId("connection").textContent = ""; };
  stream.onerror = () => {
    byId("connection").textContent = say("noConnection");
    // A refused stream is not tried again by the browser.
    if (stream.readyState === EventSource.CLOSED && state.stream === stream) setTimeout(begin, 2000);
  };
  on("status", (status) => {
    state.status = status;
    byId("connection").textContent = "";
    mode();
    state.view?.status?.(status);
  });
  on("event", (event) => state.view?.event?.(event));
  on("table", (heads) => state.view?.heads?.(heads));
  on("values", (values) => state.view?.values?.(values));
  on("telegram", (told) => state.view?.telegram?.(told));
  on("trouble", (text) => { byId("connection").textContent = text; });
}

async function begin() {
  state.stream?.close();
  const before = JSON.stringify(state.session);
  try {
    const answer = await fetch("api/session", { signal: AbortSignal.timeout(10000) });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    state.session = await answer.json();
  } catch {
    byId("connection").textContent = say("noConnection");
    setTimeout(begin, 1000);
    return;
  }
  byId("connection").textContent = "";
  // What somebody is typing stays when a connection comes back.
  if (!state.view || JSON.stringify(state.session) !== before) show();
  if (!state.session.users || state.session.user) listen();
}

byId("language").addEventListener("click", () => { switchLanguage(); show(); });
addEventListener("hashchange", () => {
  show();
  byId("main").focus({ preventScroll: true });
  scrollTo(0, 0);
});
begin();
