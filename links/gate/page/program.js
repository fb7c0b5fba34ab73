// The program: blocks and their statements, declarations of data blocks, who uses what.
import { h, table, tell } from "./kit.js";
import { ask } from "./session.js";
import { say } from "./words.js";

export function program(main) {
  const detail = h("section", { id: "block", tabindex: "-1" }, h("p", { class: "quiet" }, say("closed")));
  const found = h("section");
  const operand = h("input", { id: "operand", placeholder: say("findHelp") });

  // A line of the source: its symbols beside it where it has addresses.
  const code = (block) => {
    const rows = block.lines.map(([line, network, text, symbols]) => h("tr", { id: `line-${line}`, "data-network": `${network}` },
      h("td", { class: "number quiet" }, line ? `${line}` : ""), h("td", { class: "code" }, text), h("td", { class: "quiet" }, symbols.join(", "))));
    return [h("p", { class: "quiet" }, block.source || say("printed")),
      h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": block.id }, h("table", {}, h("tbody", {}, rows)))];
  };

  const data = (block) => {
    const names = block.components.filter(([, type]) => !/STRUCT|ARRAY|ANY|POINTER/.test(type)).slice(0, 200).map((row) => row[3]);
    return [h("p", {}, h("a", { href: `#variables?items=${encodeURIComponent(names.join("\n"))}` }, say("toTable"))),
      table([say("name"), say("type"), say("address")], block.components.map(([name, type, at]) => [h("code", {}, name), type, at]), block.id)];
  };

  const open = async (id, line) => {
    try {
      const block = await ask(`block?id=${encodeURIComponent(id)}`);
      detail.replaceChildren(h("h2", {}, `${block.id} ${block.name ?? ""}`), ...(block.lines ? code(block) : data(block)));
      detail.focus();
      document.getElementById(`line-${line}`)?.scrollIntoView({ block: "center" });
    } catch (error) { tell(error.message); }
  };

  const find = async (event) => {
    event.preventDefault();
    try {
      const told = await ask(`xref?operand=${encodeURIComponent(operand.value)}`);
      const row = ([name, block, network, line, access, via]) => [h("code", {}, name),
        h("button", { type: "button", onclick: () => open(block, line) }, `${block}, ${say("line")} ${line}`), `${network}`, access, via ?? ""];
      const list = (possible) => told.uses.filter((use) => use[6] === possible).map(row);
      const heads = [say("name"), say("blocks"), say("network"), "", ""];
      const [certain, perhaps] = [list(false), list(true)];
      found.replaceChildren(h("h2", {}, `${say("find")} ${told.operand}`),
        certain.length ? table(heads, certain, say("find")) : h("p", {}, say("unused")),
        ...(perhaps.length ? [h("p", {}, say("perhaps")), table(heads, perhaps, say("perhaps"))] : []),
        told.more ? h("p", {}, say("more")) : "");
    } catch (error) { tell(error.message); }
  };

  const link = (id, more) => h("li", {}, h("button", { type: "button", onclick: () => open(id) }, `${id} ${more}`));
  (async () => {
    try {
      const told = await ask("program");
      main.replaceChildren(
        h("form", { class: "row", role: "search", onsubmit: find }, h("label", { for: "operand" }, say("find")), operand, h("button", { type: "submit" }, "?")), found,
        h("h2", {}, say("blocks")), h("ul", {}, told.blocks.map((block) => link(block.id, `${block.name ?? ""} (${block.statements} ${say("statements")})`))),
        h("h2", {}, say("data")), h("ul", {}, told.data.map((block) => link(block.id, `${block.name ?? ""} (${block.bytes} bytes${block.of ? `, ${say("instance")} ${block.of}` : ""})`))),
        detail, h("h2", {}, say("symbols")), table([say("name"), say("address")], told.symbols, say("symbols")));
    } catch (error) { tell(error.message); }
  })();
  return {};
}
