"use strict";
// Compares pinned designs with each other and the current one: pictures, figures, and differences of their requests.
(() => {
  const { element } = Studio;
  const MAX_PINS = 4;
  const NAMES = { rows: "Rows", cols: "Columns", pattern: "Pattern" };

  Studio.Pins = class {
    constructor(host, labels, recall, changed) {
      Object.assign(this, { host, labels, recall, changed, pinned: [] });
    }

    get full() {
      return this.pinned.length >= MAX_PINS;
    }

    pin(drawing) {
      if (this.full || drawing.kind !== "exact" || this.pinned.some((pin) => pin.identity === drawing.identity)) return;
      this.pinned = [...this.pinned, drawing];
    }

    text(value) {
      return typeof value === "object" && value !== null ? (Array.isArray(value) ? value.join(", ") : (value.name ?? "")) : String(value);
    }

    draw(current) {
      const { host } = this;
      const designs = [...this.pinned, ...(current && !this.pinned.some((pin) => pin.identity === current.identity) ? [current] : [])];
      host.hidden = !this.pinned.length;
      if (host.hidden) return;
      const cards = this.pinned.map((drawing) => {
        const picture = element("div", { class: "drawing sensor-shape" });
        Studio.drawSensor(picture, drawing);
        const recall = element("button", { type: "button" }, "Go to");
        recall.addEventListener("click", () => this.recall(drawing.spec));
        const remove = element("button", { type: "button", "aria-label": `Remove ${drawing.title}` }, "Remove");
        remove.addEventListener("click", () => {
          this.pinned = this.pinned.filter((pin) => pin !== drawing);
          this.draw(current);
          this.changed();
        });
        return element("div", { class: "card" }, element("h3", {}, drawing.title), picture, element("p", { class: "key" }, recall, " ", remove));
      });
      const columns = designs.map((drawing) => [drawing === current ? `${drawing.title} (now)` : drawing.title, drawing]);
      const names = Object.keys(designs[0].spec).filter((name) => new Set(designs.map((d) => JSON.stringify(d.spec[name]))).size > 1);
      const requestRows = names.map((name) =>
        element("tr", {}, element("th", { scope: "row" }, NAMES[name] ?? this.labels[name] ?? name), ...designs.map((d) => element("td", { class: "differs" }, this.text(d.spec[name])))),
      );
      const table = element("div", { class: "wide-table", tabindex: 0, role: "region", "aria-label": "Figures of the designs" });
      Studio.drawFigures(table, columns, { title: true });
      if (requestRows.length) {
        const heading = element("tr", { class: "title" }, element("th", { scope: "rowgroup", colspan: designs.length + 1 }, "Differences of the requests"));
        table.querySelector("tbody").prepend(heading, ...requestRows);
      }
      const note = "Marks compare with the last column.";
      host.replaceChildren(element("h2", {}, "Compare"), element("div", { class: "cards" }, ...cards), table, element("p", { class: "key" }, note));
    }
  };
})();
