// Why is it off? The statement that gave a bit its value, and which scans decide it; one level deeper by tap.
import { byId, fill, h } from "./kit.js";
import { ask, state } from "./session.js";
import { stopOf } from "./stop.js";
import { say } from "./words.js";

const isBlock = (name) => /^(OB|FB|FC|SFB|SFC)\s*\d+$/i.test(name);

/** A light, and a word for whoever sees no colours. */
export const bit = (on) => h("span", { class: `bit ${on ? "on" : "off"}` }, on ? "1" : "0");

const place = (statement) => {
  const [block, network] = statement.place.split(", ");
  const number = network?.match(/\d+/)?.[0];
  const line = statement.place.match(/:(\d+)$/)?.[1] ?? "";
  const text = statement.place.replace(/, network (\d+)/, `, ${say("network")} $1`);
  return h("a", { href: `#program?block=${encodeURIComponent(block)}&line=${line}&network=${number ?? ""}` }, text);
};

function answer(why, deeper) {
  const name = h("strong", {}, why.operand);
  const block = isBlock(why.operand);
  const about = why.comments?.[why.operand.match(/"([^"]+)"$/)?.[1]];
  const head = why.outcome === "" || block ? h("p", {}, name) : h("p", {}, bit(why.now), " ", name, about ? `: ${about}` : "");
  const parts = [head];
  if (why.writers.length === 0) {
    parts.push(h("p", {}, say(/^OB/.test(why.operand) ? "why_event" : block ? "why_noCall" : /^[EI] ?\d/.test(why.operand) ? "why_input" : "why_none")));
    return parts;
  }
  if (why.outcome === "not called") {
    parts.push(h("p", {}, say("why_notCalled", why.block)), h("ul", {}, why.writers.map((writer) => h("li", {}, place({ place: writer })))),
      h("button", { type: "button", onclick: () => deeper({ name: why.block }) }, say("whyBlock", why.block)));
    return parts;
  }
  if (why.statement) {
    const did = why.skipped ? "why_led" : why.took_effect ? "why_by" : "why_left";
    parts.push(h("p", { class: "quiet" }, say(did), " ", place(why.statement)), h("pre", { class: "code" }, why.statement.text));
  } else if (why.skipped) {
    parts.push(h("p", {}, say("why_unreached")));
  }
  const comment = (operand) => why.comments?.[operand.match(/"([^"]+)"$/)?.[1]];
  const decides = (term) => why.decisive.some((other) => other.operand === term.operand) || (why.decisive.length === 0 && term.turns);
  const row = (term) => {
    const text = [bit(term.bit), " ", h("span", { class: "code" }, term.operand), " ", comment(term.operand) ? h("span", { class: "said" }, `${comment(term.operand)} `) : "", h("span", { class: "quiet code" }, term.statement.text),
      decides(term) ? h("strong", { class: "decides" }, ` ◀ ${say("why_decides")}`) : null];
    return h("li", { class: decides(term) ? "decides" : "" }, term.ask && term.is_written
      ? h("button", { type: "button", class: "term", onclick: () => deeper({ name: term.ask, db: term.inside?.db, from: term.inside?.from }) }, ...text) : h("span", { class: "term" }, ...text.filter(Boolean)));
  };
  const elsewhere = why.decisive.filter((term) => !why.terms.some((own) => own.operand === term.operand));
  const terms = [...why.terms, ...elsewhere];
  if (terms.length > 0) parts.push(h("p", { class: "quiet" }, say("why_scans")), h("ul", { class: "terms" }, terms.map(row)));
  if (why.inside) {
    const { ask: name, db, from } = why.inside;
    parts.push(h("button", { type: "button", onclick: () => deeper({ name, db, from }) }, say("why_inside", name)));
  }
  if (why.decisive.length === 0 && terms.length > 0 && !terms.some((term) => term.turns)) parts.push(h("p", {}, say("why_many")));
  if (why.is_open) parts.push(h("p", { class: "quiet" }, say("why_open")));
  if (why.writers.length > 1) {
    parts.push(h("details", {}, h("summary", {}, `${say("why_places")}: ${why.writers.length}`),
      h("ul", {}, why.writers.map((writer) => h("li", {}, place({ place: writer }))))));
  }
  return parts;
}

/** Asks, in a dialog. */
export function why(name) {
  const box = byId("dialog");
  const asked = [{ name }];
  const title = h("h2", { id: "dialog-title" }, say("whyAsk", name));
  const body = h("div", { class: "answer", "aria-live": "polite" });
  const back = h("button", { type: "button", onclick: () => { asked.pop(); look(); } }, say("back"));
  const look = () => {
    const now = asked.at(-1);
    back.disabled = asked.length < 2;
    title.textContent = isBlock(now.name) ? say("whyBlock", now.name) : say("whyAsk", now.name);
    const query = new URLSearchParams({ name: now.name, ...(now.db ? { db: now.db } : {}), ...(now.from ? { from: now.from } : {}) });
    const stands = state.status?.state;
    if (stands === "HOLD") return body.replaceChildren(h("p", {}, say("why_stands")));
    // Then the cause of the STOP is the answer.
    if (stands === "STOP") return fill(body, () => ask("why"), (last) => [h("p", {}, say("why_stands")), ...stopOf(last, stands)]);
    return fill(body, () => ask(`reason?${query}`), (told) => {
      if (!isBlock(now.name) && told.outcome) title.textContent = say(told.now ? "whyOn" : "whyOff", told.operand);
      return answer(told, (next) => { asked.push(next); look(); });
    });
  };
  box.className = "why";
  box.replaceChildren(title, body, h("div", { class: "row" }, back,
    h("button", { type: "button", onclick: look }, say("again")), h("button", { type: "button", onclick: () => box.close() }, say("close"))));
  if (!box.open) box.showModal();
  look();
}

