// The frame of the page: who is here, which view is shown.
import { current, say, switchLanguage } from "./words.js";
import { byId, dialog, h, tell } from "./kit.js";
import { ask, begin, frame, state } from "./session.js";
import { diagnostics, reports, scan, station, telegrams } from "./views.js";
import { variables } from "./table.js";
import { program } from "./program.js";

const views = { station, scan, diagnostics, variables, program, telegrams, reports };

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

function heads() {
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
  heads();
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

[frame.session, frame.mode] = [show, mode];
byId("language").addEventListener("click", () => { switchLanguage(); show(); });
addEventListener("hashchange", () => {
  show();
  byId("main").focus({ preventScroll: true });
  scrollTo(0, 0);
});
begin();
