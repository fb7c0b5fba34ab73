// The station as this browser sees it: who is here, what it is asked, what it tells without being asked.
import { byId, clock } from "./kit.js";
import { Stream } from "./stream.js";
import { say, told } from "./words.js";

const NOTHING = { items: [], period: 1000, telegrams: false, flows: [] };

export const state = { session: null, status: null, view: null, wants: { ...NOTHING } };

/** What the frame does when somebody else is here, and when the operating state is another. */
export const frame = { session() {}, mode() {}, remember() {} };

/** How long an answer is waited for. */
const LIMIT = 10000;
/** After so long without a word of the station nothing that is shown counts as present. */
const DEAF = 4000;

/** Asks the station; an error says why. */
export async function ask(path, body) {
  const options = body === undefined ? {}
    : { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  let answer;
  try {
    answer = await fetch(`api/${path}`, { ...options, signal: AbortSignal.timeout(LIMIT) });
  } catch (error) {
    throw new Error(say(error.name === "TimeoutError" ? "tooLate" : "noConnection", LIMIT / 1000));
  }
  if (answer.status === 401 && path !== "login") {
    await begin();
    throw new Error(say("loginWanted"));
  }
  if (!answer.ok) {
    const error = new Error(told((await answer.text()).trim()));
    error.status = answer.status;
    throw error;
  }
  return answer.headers.get("content-type")?.startsWith("application/json") ? answer.json() : answer.text();
}

/** Whether the user may do this. */
export function may(right) {
  const order = ["read", "write", "operate"];
  return order.indexOf(state.session?.right) >= order.indexOf(right);
}

/** What the shown view wants from the stream. */
export function want(wants) {
  state.wants = { ...NOTHING, ...wants };
  listen();
}

// The stream: of the worker that all tabs share, else of this tab.
let send;
let heard = 0;

function connect() {
  if (send) return;
  if (globalThis.SharedWorker) {
    try {
      const worker = new SharedWorker(new URL("hub.js", import.meta.url), { type: "module", name: "ob1" });
      worker.onerror = () => alone();
      worker.port.onmessage = ({ data }) => hear(data);
      send = (message) => worker.port.postMessage(message);
      return;
    } catch { /* a browser that forbids it */ }
  }
  alone();
}

function alone() {
  const stream = new Stream();
  send = (message) => { if ("wants" in message) stream.set(stream, message.wants, hear); };
  listen();
}

const isHere = () => document.visibilityState !== "hidden" && state.session && (!state.session.users || state.session.user);

/** Listens to the station, as long as this page is seen. */
export function listen() {
  connect();
  if (heard === 0) heard = Date.now();
  send({ wants: isHere() ? { ...state.wants, user: state.session.user ?? "" } : null });
}

function hear({ name, data }) {
  if (name === "again") {
    listen();
    return;
  }
  if (name === "lost" || name === "refused") {
    stale();
    if (name === "refused") setTimeout(begin, 2000);
    return;
  }
  heard = Date.now();
  if (name === "trouble") {
    byId("connection").textContent = told(data);
    return;
  }
  if (name === "status") {
    state.status = { forced: [], ...data };
    fresh();
    frame.mode();
    frame.remember(data);
  }
  const act = { status: "status", event: "event", table: "heads", values: "values", telegram: "telegram", flow: "flow" }[name];
  state.view?.[act]?.(name === "status" ? state.status : data);
}

function fresh() {
  document.body.classList.remove("stale");
  byId("connection").textContent = "";
}

/** What is shown is old: it says since when. */
function stale() {
  document.body.classList.add("stale");
  byId("connection").textContent = state.status ? say("asOf", clock(new Date(heard))) : say("noConnection");
}

setInterval(() => {
  if (!send || !isHere()) return;
  send({});
  if (Date.now() - heard > DEAF) stale();
}, 1000);
document.addEventListener("visibilitychange", () => {
  heard = Date.now();
  listen();
});
addEventListener("pagehide", () => send?.({ wants: null }));
addEventListener("pageshow", (event) => { if (event.persisted) { heard = Date.now(); listen(); } });

let beginning = false;

/** Finds out who is here, and listens. Again and again while the station does not answer. */
export async function begin() {
  if (beginning) return;
  beginning = true;
  const before = JSON.stringify(state.session);
  try {
    const answer = await fetch("api/session", { signal: AbortSignal.timeout(LIMIT) });
    if (!answer.ok) throw new Error((await answer.text()).trim());
    state.session = await answer.json();
  } catch {
    stale();
    setTimeout(begin, 1000);
    return;
  } finally {
    beginning = false;
  }
  if (!state.view || JSON.stringify(state.session) !== before) frame.session();
  listen();
}
