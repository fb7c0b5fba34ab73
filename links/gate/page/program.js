// The program: blocks and their statements, declarations of data blocks, who uses what.
import { h, table, tell } from "./kit.js";
import { ask } from "./session.js";
import { say } from "./words.js";

export function program(main) {
  const detail = h("section", { id: "block", tabindex: "-1" }, h("p", { class: "quiet" }, say("closed")));
  const found = h("section");
  const operand = h("input", { id: "operand", placeholder: say("findHelp") });

  const code = (block) => {
    let network = 0;
    const rows = block.statements.flatMap(([number, line, text]) => {
      const head = number !== network ? [h("tr", {}, h("th", { colspan: "2", scope: "rowgroup" }, `${say("network")} ${number}`))] : [];
      network = number;
      return [...head, h("tr", {}, h("td", { class: "number quiet" }, `${line}`), h("td", { class: "code" }, text))];
    });
    return [h("p", { class: "quiet" }, block.source ?? ""),
      h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": block.id }, h("table", {}, h("tbody", {}, rows)))];
  };

  const data = (block) => {
    const names = block.components.filter(([, type]) => !/STRUCT|ARRAY|ANY|POINTER/.test(type)).slice(0, 200).map((row) => row[3]);
    return [h("p", {}, h("a", { href: `#variables?items=${encodeURIComponent(names.join("\n"))}` }, say("toTable"))),
      table([say("name"), say("type"), say("address")], block.components.map(([name, type, at]) => [h("code", {}, name), type, at]), block.id)];
  };

  const open = async (id) => {
    try {
      const block = await ask(`block?id=${encodeURIComponent(id)}`);
      detail.replaceChildren(h("h2", {}, `${block.id} ${block.name ?? ""}`), ...(block.statements ? code(block) : data(block)));
      detail.focus();
    } catch (error) { tell(error.message); }
  };

  const find = async (event) => {
    event.preventDefault();
    try {
      const told = await ask(`xref?operand=${encodeURIComponent(operand.value)}`);
      const rows = Object.entries(told.operands).flatMap(([name, places]) => places.map(([block, network, line, access]) =>
        [h("code", {}, name), h("button", { type: "button", onclick: () => open(block) }, block), `${network}`, `${line}`, access]));
      found.replaceChildren(table([say("name"), say("blocks"), say("network"), say("line"), ""], rows, say("find")),
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
