// The station as this browser sees it: who is here, what it is asked, what it tells without being asked.
import { byId } from "./kit.js";
import { say } from "./words.js";

export const state = { session: null, status: null, view: null, stream: null, items: "", period: 1000, telegrams: false };

/** What the frame does when somebody else is here, and when the operating state is another. */
export const frame = { session() {}, mode() {} };

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
    frame.mode();
    state.view?.status?.(status);
  });
  on("event", (event) => state.view?.event?.(event));
  on("table", (heads) => state.view?.heads?.(heads));
  on("values", (values) => state.view?.values?.(values));
  on("telegram", (told) => state.view?.telegram?.(told));
  on("trouble", (text) => { byId("connection").textContent = text; });
}

/** Finds out who is here, and listens. Again and again while the station does not answer. */
export async function begin() {
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
  if (!state.view || JSON.stringify(state.session) !== before) frame.session();
  if (!state.session.users || state.session.user) listen();
}
