// Why the CPU is, or was last, in STOP: when, where, what for, what to do, and what was under way.
import { h, local } from "./kit.js";
import { say, told } from "./words.js";

const hex = (number, digits = 8) => number.toString(16).toUpperCase().padStart(digits, "0");

/** In what the program was interrupted: who has called whom, and the registers. */
function stack({ blocks, accus, addresses, local }) {
  const name = (of) => `${of.block}${of.name ? ` ${of.name}` : ""}, ${say("network")} ${of.network}`;
  const way = blocks.map((of, at) => h("li", {}, at > 0 ? `${say("calledBy")} ` : "", h("code", {}, name(of)),
    of.source ? ` (${of.source}:${of.line})` : ""));
  const [{ db, di }] = blocks;
  const registers = [...accus.map((value, at) => `ACCU${at + 1} ${hex(value)}`),
    ...addresses.map((value, at) => `AR${at + 1} ${hex(value)}`), `DB ${db}`, `DI ${di}`];
  return h("details", {}, h("summary", {}, `${say("stack")}: ${name(blocks[0])}`), h("ol", {}, ...way),
    h("p", {}, h("code", {}, registers.join(", "))),
    local ? h("p", {}, `${say("localData")}: `, h("code", {}, local)) : null);
}

/** A place in the source, with a way to it. */
export function place({ place, block, line }) {
  return block ? h("a", { href: `#program?block=${encodeURIComponent(block)}&line=${line}` }, h("code", {}, place)) : h("code", {}, place);
}

/** The last STOP of `why`, line by line; `now` is the state of the CPU. */
export function stopOf(why, now) {
  if (!why.stop) return [h("p", { class: "quiet" }, say("noStop"))];
  const entry = why.cause ?? why.stop;
  const stands = now === "STOP" && !why.over;
  const lines = [h("p", { class: "quiet" }, `${say(stands ? "stoppedBy" : "lastStop")} ${local(entry.wall)}`),
    h("p", {}, h("strong", {}, why.stop.change === "stop" ? `${say("orderly")} ` : "", told(entry.text)))];
  if (entry.place) lines.push(h("p", {}, `${say("place")}: `, place(entry)));
  const because = entry.because || why.stop.because;
  if (because) lines.push(h("p", {}, `${say("because")}: ${because}`));
  const remedy = told(entry.remedy || why.stop.remedy);
  if (remedy) lines.push(h("p", { class: "remedy" }, `${say("remedy")}: ${remedy}`));
  if (why.stack && now !== "RUN") lines.push(stack(why.stack));
  return lines;
}
