// Inputs and outputs: each module as a strip of channels with LED, address, symbol and forced mark.
import { fill, h } from "./kit.js";
import { ask, want } from "./session.js";
import { say } from "./words.js";
import { why } from "./why.js";

/** The bytes and the bit that a forced cell covers, and whether they are inputs: `QB2=16#5A`, `I0.3=1`, `PQW256=1`. */
const covers = (text) => {
  const [, area, width, byte, bit] = text.match(/^P?([IEQA])([BWD]?)\s*(\d+)(?:\.(\d))?\s*=/) ?? [];
  const bytes = { W: 2, D: 4 }[width] ?? 1;
  return { inputs: area === "I" || area === "E", from: Number(byte), to: Number(byte) + bytes, bit: bit && Number(bit) };
};

export function io(main) {
  const strips = h("div", { class: "strips" });
  const cells = new Map();
  let forced = [];
  let items = [];
  main.replaceChildren(h("p", { class: "quiet" }, say("ioHelp")), strips);

  const isInput = (area) => area === "I" || area === "E";
  const channel = (area, byte, bit, symbols) => {
    const address = `${area} ${byte}.${bit}`;
    const led = h("span", { class: "dot" });
    const value = h("span", { class: "sr" });
    const mark = h("span", { class: "force", hidden: true }, say("forced"));
    const symbol = symbols[address] ?? ["", ""];
    cells.set(`${byte}.${bit}.${area}`, { led, value, mark, inputs: isInput(area), from: byte, to: byte + 1, bit });
    return h("li", {}, h("button", { type: "button", class: "channel", onclick: () => why(address) }, led, value,
      h("span", { class: "code" }, address), h("span", { class: "symbol" }, symbol[0]), h("span", { class: "quiet comment" }, symbol[1]), mark));
  };

  const word = (area, byte, symbols) => {
    const address = `${area}W ${byte}`;
    const value = h("span", { class: "code value" }, "…");
    const mark = h("span", { class: "force", hidden: true }, say("forced"));
    const symbol = symbols[address] ?? ["", ""];
    cells.set(`${byte}.W.${area}`, { text: value, mark, inputs: isInput(area), from: byte, to: byte + 2 });
    return h("li", {}, h("div", { class: "channel" }, value, h("span", { class: "code" }, address),
      h("span", { class: "symbol" }, symbol[0]), h("span", { class: "quiet comment" }, symbol[1]), mark));
  };

  const strip = (module, told) => {
    const part = (area, at, bytes, name) => {
      if (!bytes) return null;
      const rows = [];
      for (let byte = at; byte < at + bytes; byte += module.analog ? 2 : 1) {
        if (module.analog) {
          items.push([`${area}W ${byte}`, area, byte, true]);
          rows.push(word(area, byte, told.symbols));
        } else {
          items.push([`${area}B ${byte}:hex`, area, byte, false]);
          for (let bit = 0; bit < 8; bit += 1) rows.push(channel(area, byte, bit, told.symbols));
        }
      }
      return [h("h4", {}, say(name)), h("ul", { class: "channels" }, rows)];
    };
    return h("section", { class: `strip ${module.present ? "" : "absent"}` }, h("h3", {}, module.name, " ",
      h("span", { class: "quiet" }, `${module.type}${module.present ? "" : `, ${say("absent")}`}`)),
    part(told.areas[0], ...module.inputs, "inputs"), part(told.areas[1], ...module.outputs, "outputs"));
  };

  const marks = () => {
    const meets = (cell, of) => cell.inputs === of.inputs && cell.from < of.to && of.from < cell.to
      && (cell.bit === undefined || of.bit === undefined || cell.bit === of.bit);
    for (const cell of cells.values()) cell.mark.hidden = !forced.some((of) => meets(cell, of));
  };

  fill(strips, () => ask("io"), (told) => {
    items = [];
    const parts = told.modules.filter((module) => module.inputs[1] + module.outputs[1] > 0).map((module) => strip(module, told));
    items = items.slice(0, 500);
    want({ items: items.map(([name]) => name), period: 200 });
    return parts.length ? parts : h("p", {}, say("noIo"));
  });
  return {
    status(status) {
      forced = status.forced.map(covers);
      marks();
    },
    values({ values }) {
      values.forEach((text, at) => {
        const item = items[at];
        if (!item || typeof text !== "string") return;
        const [, area, byte, analog] = item;
        if (analog) {
          const cell = cells.get(`${byte}.W.${area}`);
          if (cell.text.textContent !== text) cell.text.textContent = text;
          return;
        }
        const bits = parseInt(text.split("#")[1], 16);
        for (let bit = 0; bit < 8; bit += 1) {
          const cell = cells.get(`${byte}.${bit}.${area}`);
          const on = bits >> bit & 1;
          cell.led.classList.toggle("on", on === 1);
          if (cell.value.textContent !== `${on}`) cell.value.textContent = `${on}`;
        }
      });
    },
  };
}
