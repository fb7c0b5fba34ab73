// The frame of the page: who is here, which view is shown.
import { current, say, switchLanguage } from "./words.js";
import { byId, h } from "./kit.js";
import { ask, begin, frame, state, want } from "./session.js";
import { diagnostics, remember, reports, scan, station, telegrams } from "./views.js";
import { alarms, watch } from "./alarms.js";
import { io } from "./io.js";
import { variables } from "./table.js";
import { program } from "./program.js";

const views = { station, alarms, io, program, variables, diagnostics, scan, telegrams, reports };

const chosen = () => {
  const key = location.hash.slice(1).split("?")[0];
  return key in views ? key : "station";
};

/** What somebody has typed stays, when the words or the session are others. */
const typed = { user: "" };

function login(main) {
  const wrong = h("p", { class: "trouble", role: "alert", id: "login-error" });
  const field = (name, attributes) => h("p", {}, h("label", { for: `field-${name}` }, say(name)),
    h("input", { id: `field-${name}`, name, required: true, "aria-describedby": "login-error", ...attributes }));
  const user = field("user", { autocomplete: "username", autocapitalize: "off", spellcheck: "false", value: typed.user,
    oninput: (event) => { typed.user = event.target.value; } });
  const password = field("password", { type: "password", autocomplete: "current-password" });
  const go = h("button", { type: "submit" }, say("login"));
  const submit = async (event) => {
    event.preventDefault();
    go.disabled = true;
    try {
      await ask("login", { user: byId("field-user").value, password: byId("field-password").value });
      await begin();
    } catch (error) {
      wrong.textContent = error.message;
      byId("field-password")?.focus();
    }
    go.disabled = false;
  };
  main.replaceChildren(h("form", { class: "card login", onsubmit: submit }, h("h2", {}, say("loginWanted")), user, password, wrong, go));
  byId(typed.user ? "field-password" : "field-user").focus();
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
  document.title = `${say(chosen())} · ${name} · ob1`;
  const account = byId("account");
  account.hidden = !(state.session?.users && state.session.user);
  account.textContent = `${say("logout")} (${state.session?.user})`;
  account.onclick = logout;
  const shown = Object.keys(views).filter((key) => key !== "reports" || state.session?.reports);
  byId("nav").setAttribute("aria-label", say("pages"));
  byId("nav").replaceChildren(...shown.map((key) => h("a", { href: `#${key}`, "aria-current": key === chosen() ? "page" : null }, say(key))));
  byId("menu").textContent = `☰ ${say(chosen())}`;
  byId("menu").setAttribute("aria-label", `${say("menu")}: ${say(chosen())}`);
  menu(false);
  mode();
}

function menu(open) {
  document.querySelector("header").classList.toggle("open", open);
  byId("menu").setAttribute("aria-expanded", `${open}`);
}

function mode() {
  const element = byId("mode");
  const now = state.status?.state;
  if (element.textContent !== (now ?? "…")) element.textContent = now ?? "…";
  element.className = `mode ${(now ?? "").toLowerCase()}`;
}

function show() {
  state.view?.leave?.();
  state.view = null;
  heads();
  const main = byId("main");
  if (state.session?.users && !state.session.user) {
    want({});
    login(main);
    return;
  }
  // Each visit has an element of its own. An answer that comes when the visitor has gone on changes an element that
  // is no longer shown.
  const place = h("div", { class: `view ${chosen()}` });
  main.replaceChildren(place);
  want({});
  state.view = views[chosen()](place);
}

[frame.session, frame.mode, frame.remember] = [show, mode, remember];
byId("language").addEventListener("click", () => { switchLanguage(); show(); });
byId("menu").addEventListener("click", () => menu(!document.querySelector("header").classList.contains("open")));
addEventListener("hashchange", () => {
  byId("dialog").close();
  show();
  byId("main").focus({ preventScroll: true });
  scrollTo(0, 0);
});
begin().then(watch);
