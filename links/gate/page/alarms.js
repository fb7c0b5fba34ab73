// Alarms: the bell in the frame, and the view with what is active or waits for its acknowledgement.
import { byId, h, local, redraw, table, tell } from "./kit.js";
import { ask, may, state } from "./session.js";
import { say } from "./words.js";

/** How often the station is asked, in milliseconds. */
const PERIOD = 2000;

const hex = (number) => `DW#16#${number.toString(16).toUpperCase().padStart(8, "0")}`;

let known = [];
let draw = null;

/** How long an alarm stands, by the runtime's clock: 1:02:03. */
function since(alarm) {
  const runtime = state.status?.runtime_ns;
  if (!runtime || !alarm.came_ns) return "";
  const seconds = Math.max(0, Math.floor((runtime - alarm.came_ns) / 1e9));
  const two = (number) => String(number).padStart(2, "0");
  return `${Math.floor(seconds / 3600)}:${two(Math.floor(seconds / 60) % 60)}:${two(seconds % 60)}`;
}

function bell() {
  const open = known.filter((alarm) => !alarm.acknowledged).length;
  const element = byId("bell");
  element.hidden = known.length === 0;
  const [count, text] = [element.lastElementChild, String(known.length)];
  if (count.textContent !== text) count.textContent = text;
  element.classList.toggle("open", open > 0);
  element.setAttribute("aria-label", say("bell", known.length, open));
}

async function look() {
  const isHere = document.visibilityState !== "hidden" && state.session && (!state.session.users || state.session.user);
  if (!isHere) return;
  try {
    known = await ask("alarms");
  } catch { return; /* The frame says what is wrong with the connection. */ }
  bell();
  draw?.();
}

/** Asks as long as the page is open. */
export function watch() {
  byId("bell").addEventListener("click", () => { location.hash = "alarms"; });
  look();
  setInterval(look, PERIOD);
}

async function acknowledge(numbers) {
  try {
    await ask("acknowledge", { numbers: [...new Set(numbers)].slice(0, 256) });
    await look();
  } catch (error) { tell(error.message); }
}

function row(alarm) {
  const what = alarm.active ? say("alarmActive") : say("alarmGone");
  const button = alarm.acknowledged ? say("alarmDone")
    : may("write") ? h("button", { type: "button", onclick: () => acknowledge([alarm.number]) }, say("acknowledge"))
      : say("alarmOpen");
  return [what, alarm.came ? local(alarm.came) : "", since(alarm), alarm.class ?? "",
    h("div", {}, h("strong", {}, alarm.text), alarm.info ? h("div", { class: "quiet" }, alarm.info) : null,
      alarm.locked ? h("div", { class: "quiet" }, say("alarmLocked")) : null),
    h("span", { class: "code" }, `${hex(alarm.number)}.${alarm.signal}`), button];
}

export function alarms(main) {
  const list = h("div", { class: "alarms" });
  main.replaceChildren(list);
  draw = () => {
    const open = known.filter((alarm) => !alarm.acknowledged).map((alarm) => alarm.number);
    const all = open.length && may("write")
      ? h("div", { class: "row" }, h("button", { type: "button", id: "ack-all", onclick: () => acknowledge(open) }, say("acknowledgeAll"))) : null;
    const heads = ["alarmState", "alarmCame", "alarmSince", "alarmClass", "text", "number", "alarmAck"];
    redraw(list, all, known.length ? table(heads.map((head) => say(head)), known.map(row), say("alarms")) : h("p", {}, say("noAlarms")));
  };
  draw();
  look();
  return { leave() { draw = null; } };
}
