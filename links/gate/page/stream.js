// One stream of events for all that this browser shows of the station: who takes what, and what is asked for in sum.
export class Stream {
  #takers = new Map();
  #source = null;
  #key = "";
  #asked = { items: [], flows: [] };
  #after = "";
  #latest = new Map();

  /** `send` gets `{ name, data }`; `wants`: { user, items, period, telegrams, flows }, or null for nothing any more. */
  set(taker, wants, send) {
    if (wants) this.#takers.set(taker, { wants, send });
    else this.#takers.delete(taker);
    this.#open();
    if (!wants) return;
    // What does not come again by itself is told to the newcomer.
    for (const name of ["status", "table"]) {
      if (this.#latest.has(name)) this.#tell(taker, name, this.#latest.get(name));
    }
    for (const flow of wants.flows) {
      if (this.#latest.has(flow)) this.#tell(taker, "flow", this.#latest.get(flow));
    }
  }

  #open() {
    const all = [...this.#takers.values()].map((taker) => taker.wants);
    if (all.length === 0) {
      this.#source?.close();
      [this.#source, this.#key] = [null, ""];
      this.#latest.clear();
      return;
    }
    const sum = (of) => [...new Set(all.flatMap((wants) => wants[of]))];
    const asked = { items: sum("items"), flows: sum("flows") };
    const query = new URLSearchParams();
    if (asked.items.length > 0) {
      query.set("items", asked.items.join("\n"));
      query.set("period", Math.min(...all.filter((wants) => wants.items.length > 0).map((wants) => wants.period)));
    }
    if (asked.flows.length > 0) query.set("flows", asked.flows.join("\n"));
    if (all.some((wants) => wants.telegrams)) query.set("telegrams", "1");
    const key = `${all.at(-1).user} ${query}`;
    if (key === this.#key && this.#source && this.#source.readyState !== EventSource.CLOSED) return;
    this.#source?.close();
    [this.#key, this.#asked] = [key, asked];
    this.#latest.clear();
    if (this.#after) query.set("after", this.#after);
    const source = new EventSource(`api/stream?${query}`);
    this.#source = source;
    source.onerror = () => {
      if (source !== this.#source) return;
      // A refused stream is not tried again by the browser.
      const name = source.readyState === EventSource.CLOSED ? "refused" : "lost";
      for (const taker of this.#takers.keys()) this.#tell(taker, name, null);
    };
    for (const name of ["status", "event", "table", "values", "telegram", "trouble", "flow"]) {
      source.addEventListener(name, (event) => {
        if (source !== this.#source) return;
        if (event.lastEventId) this.#after = event.lastEventId;
        const data = JSON.parse(event.data);
        this.#latest.set(name === "flow" ? data.of : name, data);
        for (const taker of this.#takers.keys()) this.#tell(taker, name, data);
      });
    }
  }

  /** Each gets of tables, telegrams and flows what is its own. */
  #tell(taker, name, data) {
    const { wants, send } = this.#takers.get(taker);
    const own = (list) => wants.items.map((item) => list[this.#asked.items.indexOf(item)] ?? null);
    if (name === "table") {
      if (wants.items.length > 0) send({ name, data: own(data) });
    } else if (name === "values") {
      if (wants.items.length > 0) send({ name, data: { scan: data.scan, values: own(data.values) } });
    } else if (name === "telegram") {
      if (wants.telegrams) send({ name, data });
    } else if (name === "flow") {
      if (wants.flows.includes(data.of)) send({ name, data });
    } else {
      send({ name, data });
    }
  }
}
