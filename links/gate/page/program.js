// The program: a rail of blocks, the code of one as its source, ladder or function plan, live; who uses what.
import { fill, h, svg, table } from "./kit.js";
import { ask, state, want } from "./session.js";
import { say, told } from "./words.js";
import { why } from "./why.js";

const VIEWS = ["stl", "lad", "fbd"];
const chosen = { view: "lad", live: true };

/** Operands that a question can be about, in the code of a line. */
const OPERANDS = /"[^"]+"(?:\.[\w.[\]]+)?|(?<!\w)#\w+|\bDB\s?\d+\.DBX\s?\d+\.[0-7]|\b[EAIQM]\s?\d+\.[0-7]\b|\b[TZC]\s?\d+\b(?!#)/g;

const COMMENT = "//";

function code(text, block) {
  const [statement, ...comment] = text.split(COMMENT);
  const parts = [];
  let at = 0;
  for (const found of statement.matchAll(OPERANDS)) {
    const name = found[0].startsWith("#") ? `${block} ${found[0]}` : found[0].replace(/^"([^"]+)"$/, "$1");
    parts.push(statement.slice(at, found.index), h("button", { type: "button", class: "operand", "aria-label": say("whyAsk", found[0]), onclick: () => why(name) }, found[0]));
    at = found.index + found[0].length;
  }
  parts.push(statement.slice(at));
  if (comment.length > 0) parts.push(h("span", { class: "quiet" }, COMMENT + comment.join(COMMENT)));
  return parts;
}

const hex = (number) => number.toString(16).toUpperCase().padStart(8, "0");

/** Lines of a source, with room for the registers behind them. */
function listing(lines, block) {
  const row = ([number, network, text, symbols]) => h("tr", { id: number ? `line-${number}` : null, "data-line": number || null, "data-network": network || null },
    h("td", { class: "number quiet" }, number ? `${number}` : ""),
    h("td", { class: "code source" }, ...code(text, block), symbols.length ? h("span", { class: "quiet symbol" }, `  ${symbols.join(", ")}`) : null),
    h("td", { class: "code register" }));
  return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": block },
    h("table", { class: "listing" }, h("thead", {}, h("tr", {}, h("th", { scope: "col" }, say("line")), h("th", { scope: "col" }, say("stl")),
      h("th", { scope: "col", class: "register" }, say("registers")))), h("tbody", {}, lines.map(row))));
}

export function program(main) {
  const given = new URLSearchParams(location.hash.split("?")[1] ?? "");
  const detail = h("section", { id: "block", tabindex: "-1" }, h("p", { class: "quiet" }, say("closed")));
  const found = h("section", { class: "found" });
  const operand = h("input", { id: "operand", placeholder: say("findHelp"), autocapitalize: "off", spellcheck: "false" });
  const filter = h("input", { id: "filter", placeholder: say("filter"), "aria-label": say("filter"), oninput: () => sift() });
  const lists = h("div", { class: "lists" });
  const rail = h("details", { class: "rail", open: matchMedia("(min-width: 900px)").matches }, h("summary", {}, say("blocks")), filter, lists);
  const search = h("form", { class: "row", role: "search", onsubmit: (event) => { event.preventDefault(); find(); } },
    h("label", { for: "operand" }, say("find")), operand, h("button", { type: "submit" }, say("search")));
  main.replaceChildren(rail, h("div", { class: "work" }, search, found, detail));
  let shown = null;

  const sift = () => {
    const text = filter.value.toLowerCase();
    for (const item of lists.querySelectorAll("li")) item.hidden = !item.textContent.toLowerCase().includes(text);
  };

  const find = () => fill(found, () => ask(`xref?operand=${encodeURIComponent(operand.value)}`), (uses) => {
    const row = ([name, block, network, line, access, via]) => [h("code", {}, name),
      h("button", { type: "button", onclick: () => open(block, line, network) }, `${block}, ${say("line")} ${line}`), `${network}`, access, via ?? ""];
    const list = (possible) => uses.uses.filter((use) => use[6] === possible).map(row);
    const heads = [say("name"), say("place"), say("network"), say("access"), say("via")];
    const [certain, perhaps] = [list(false), list(true)];
    return [h("h2", {}, `${say("find")} ${uses.operand}`),
      certain.length ? table(heads, certain, say("find")) : h("p", {}, say("unused")),
      ...(perhaps.length ? [h("p", {}, say("perhaps")), table(heads, perhaps, say("perhaps"))] : []),
      uses.more ? h("p", {}, say("more")) : ""];
  });

  const open = (id, line, network) => fill(detail, () => ask(`block?id=${encodeURIComponent(id)}`), (block) => {
    if (matchMedia("(max-width: 899px)").matches) rail.open = false;
    for (const button of lists.querySelectorAll("button")) button.setAttribute("aria-pressed", `${button.dataset.id === id}`);
    shown?.leave();
    shown = null;
    history.replaceState(null, "", `#program?block=${encodeURIComponent(id)}`);
    const head = h("h2", {}, `${block.id} ${block.name ?? ""}`);
    if (!block.lines) return [head, ...data(block)];
    shown = blockView(block, head);
    queueMicrotask(() => {
      detail.focus({ preventScroll: true });
      shown?.go(line, network);
    });
    return shown.element;
  });

  fill(lists, () => ask("program"), (told) => {
    const link = (id, more) => h("li", {}, h("button", { type: "button", "data-id": id, onclick: () => open(id) }, id, " ", h("span", { class: "quiet" }, more)));
    const block = given.get("block");
    if (block) open(block, given.get("line"), given.get("network"));
    return [h("ul", {}, told.blocks.map((block) => link(block.id, `${block.name ?? ""}`))),
      h("h2", {}, say("data")), h("ul", {}, told.data.map((block) => link(block.id, `${block.name ?? ""}${block.of ? ` (${say("instance")} ${block.of})` : ""}`))),
      h("h2", {}, say("symbols")), h("ul", { class: "symbols" }, told.symbols.map(([name, address, comment]) => h("li", {},
        h("button", { type: "button", onclick: () => { operand.value = name; find(); } }, name, " ", h("span", { class: "quiet" }, `${address}${comment ? `: ${comment}` : ""}`)))))];
  });
  return { flow: (told) => shown?.flow(told), leave: () => shown?.leave() };
}

function data(block) {
  const names = block.components.filter(([, type]) => !/STRUCT|ARRAY|ANY|POINTER/.test(type)).slice(0, 200).map((row) => row[3]);
  return [h("p", {}, h("a", { href: `#variables?items=${encodeURIComponent(names.join("\n"))}` }, say("toTable"))),
    table([say("name"), say("type"), say("address")], block.components.map(([name, type, at]) => [h("code", {}, name), type, at]), block.id)];
}

/** A block of statements: its networks, drawn as far as they are in view. */
function blockView(block, head) {
  const canLive = block.networks.some((network) => !network.empty);
  const seen = new Map();
  const instance = h("select", { id: "instance", "aria-label": say("instances"), onchange: () => follow() },
    h("option", { value: "" }, say("anyInstance")), block.instances.map((db) => h("option", { value: db }, `DB ${db}`)));
  const views = h("div", { class: "choice", role: "group", "aria-label": say("view") }, VIEWS.map((view) =>
    h("button", { type: "button", id: `view-${view}`, onclick: () => { chosen.view = view; draw(); } }, say(view))));
  const live = h("button", { type: "button", id: "live", onclick: () => { chosen.live = !chosen.live; draw(); } }, say("live"));
  const says = h("p", { id: "live-says", class: "quiet", role: "status" });
  const legend = h("p", { class: "legend quiet" }, ["power", "noPower", "notRun"].map((key) => h("span", { class: `key ${key}` }, say(key))));
  const body = h("div", { class: "networks" });
  const element = [head, h("p", { class: "quiet" }, block.source || say("printed")),
    h("div", { class: "row bar" }, views, canLive ? live : null, h("button", { type: "button", id: "print", onclick: () => paper() }, say("print")), block.instances.length > 0 ? instance : null), says, legend, body];
  const observer = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const network = Number(target.dataset.network);
      if (isIntersecting && !seen.has(network)) {
        seen.set(network, target);
        picture(target, network);
      } else if (!isIntersecting && seen.delete(network)) {
        // Only what is in view is drawn; its room stays.
        const drawing = target.querySelector(".drawing");
        if (drawing?.firstChild) {
          drawing.dataset.tall = drawing.offsetHeight;
          drawing.style.minHeight = `${drawing.offsetHeight}px`;
          drawing.replaceChildren();
        }
      }
    }
    follow();
  }, { rootMargin: "200px" });
  let after;

  const isDrawn = (network) => chosen.view !== "stl" && !network.left && !network.empty;

  function draw() {
    observer.disconnect();
    seen.clear();
    for (const button of views.children) button.setAttribute("aria-pressed", `${button.id === `view-${chosen.view}`}`);
    live.setAttribute("aria-pressed", `${chosen.live}`);
    legend.hidden = !chosen.live || chosen.view === "stl";
    const parts = block.networks.map((network) => {
      const title = `${say("network")} ${network.number}${network.title ? `: ${network.title}` : ""}`;
      const lines = ofNetwork(network.number);
      const inside = isDrawn(network) ? [h("div", { class: "drawing" })]
        : network.empty && chosen.view !== "stl" ? [h("p", { class: "quiet" }, say("emptyNetwork"))]
          : [network.left && chosen.view !== "stl" ? h("p", { class: "quiet" }, say("asStatements", told(network.left))) : null, listing(lines, block.id)];
      return h("section", { class: "network", "data-network": network.number }, h("h3", {}, title),
        network.comment && isDrawn(network) ? h("p", { class: "comment quiet" }, network.comment) : null, ...inside.filter(Boolean),
        h("p", { class: "quiet silent", hidden: true }, say("networkSilent")));
    });
    const before = chosen.view === "stl" ? block.lines.filter(([number]) => number && number < firstLine()) : [];
    body.replaceChildren(...(before.length ? [h("section", {}, listing(before, block.id))] : []), ...parts);
    for (const part of body.querySelectorAll(".network")) observer.observe(part);
    says.textContent = "";
    follow();
  }

  /** All networks are drawn for the printer, in view or not. */
  async function paper() {
    for (const target of body.querySelectorAll(".network")) {
      if (!target.querySelector("svg")) await picture(target, Number(target.dataset.network));
    }
    print();
  }

  // A network reaches from behind the one before to the line in front of the next.
  const starts = [];
  block.lines.forEach(([, network], at) => { if (network && starts[network] === undefined) starts[network] = at; });
  const begin = (network) => {
    let at = starts[network];
    if (at === undefined) return undefined;
    for (let up = at; up > 0 && up > at - 40; up -= 1) {
      if (block.lines[up - 1][1]) break;
      if (/^\s*NETWORK\b/i.test(block.lines[up - 1][2])) { at = up - 1; break; }
    }
    return at;
  };
  const ofNetwork = (network) => {
    const first = begin(network);
    if (first === undefined) return [];
    const next = block.networks.map((one) => begin(one.number)).filter((at) => at !== undefined && at > first);
    return block.lines.slice(first, Math.min(...next, block.lines.length));
  };
  const firstLine = () => block.lines[Math.min(...block.networks.map((one) => begin(one.number)).filter((at) => at !== undefined), block.lines.length)]?.[0] ?? Infinity;

  async function picture(target, network) {
    const drawing = target.querySelector(".drawing");
    if (!drawing) return;
    await fill(drawing, () => ask(`drawing?id=${encodeURIComponent(block.id)}&network=${network}&form=${chosen.view}`), (text) => {
      const drawn = document.importNode(new DOMParser().parseFromString(text, "image/svg+xml").documentElement, true);
      return h("div", { class: "scroll", tabindex: "0", role: "region", "aria-label": `${say("network")} ${network}` }, drawn);
    });
    touch(drawing);
    drawing.style.minHeight = "";
  }

  /** What has a bit can be asked for. */
  function touch(drawing) {
    for (const part of drawing.querySelectorAll("g[data-operand]")) {
      const name = part.dataset.operand;
      if (!/^(#\w|[EAIQM] ?\d+\.\d|DB ?\d+\.DBX|[TZC] ?\d)/.test(name)) continue;
      const box = part.getBBox();
      part.prepend(svg("rect", { x: box.x - 2, y: box.y - 2, width: box.width + 4, height: box.height + 4, class: "room" }));
      part.setAttribute("tabindex", "0");
      part.setAttribute("role", "button");
      part.setAttribute("aria-label", say("whyAsk", part.querySelector("title")?.textContent ?? name));
      const act = () => why(name.startsWith("#") ? `${block.id} ${name}` : name);
      part.addEventListener("click", act);
      part.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); act(); } });
    }
  }

  const key = () => `${block.id}|${[...seen.keys()].sort((a, b) => a - b).join(",")}|${chosen.view === "fbd" ? "fbd" : "lad"}|${instance.value}`;

  /** Asks for the values of what is in view, when scrolling has ended. */
  function follow() {
    clearTimeout(after);
    after = setTimeout(() => want({ flows: chosen.live && canLive && seen.size > 0 ? [key()] : [] }), 150);
    if (!chosen.live) {
      colour({ networks: {}, lines: [] });
      says.textContent = "";
    }
  }

  const WORD = { 1: "on", 0: "off" };

  function colour(told) {
    for (const [network, target] of seen) {
      const states = told.networks[network];
      for (const part of target.querySelectorAll("svg > g")) {
        const node = part.dataset.node;
        const now = states?.[node === undefined ? 0 : 1 + 3 * Number(node) + Number(part.dataset.part)];
        part.classList.remove("on", "off");
        if (WORD[now]) part.classList.add(WORD[now]);
      }
      const silent = target.querySelector(".silent");
      if (silent) silent.hidden = !(chosen.live && states && !states.includes("1") && !states.includes("0"));
    }
    const registers = new Map(told.lines.map((line) => [line[0], line]));
    for (const row of body.querySelectorAll("tr[data-network]")) {
      const line = registers.get(Number(row.dataset.line));
      // Of what is out of view nothing is known.
      const isWatched = seen.has(Number(row.closest(".network")?.dataset.network));
      const text = line ? `${line[1]} ${line[2]} ${hex(line[3])}` : isWatched && told.outcome ? "– –" : "";
      const cell = row.querySelector(".register");
      if (cell.textContent !== text) cell.textContent = text;
      cell.classList.toggle("on", line?.[1] === 1);
    }
  }

  function flow({ of, told }) {
    if (of !== key() || !told || !chosen.live) return;
    says.textContent = told.outcome === "whole" ? say("live_whole", told.ob, told.caller ? `, ${say("calledBy")} ${told.caller}` : "")
      : told.text ?? say(`live_${told.outcome.replace(" ", "_")}`);
    colour(told);
  }

  draw();
  return {
    element, flow,
    go(line, network) {
      const target = (line && document.getElementById(`line-${line}`)) || (network && body.querySelector(`[data-network="${network}"]`));
      target?.scrollIntoView({ block: "center" });
      target?.classList.add("found");
    },
    leave() { observer.disconnect(); clearTimeout(after); if (state.wants.flows.length > 0) want({}); },
  };
}
