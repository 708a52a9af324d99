"use strict";
// Compares pinned designs with each other and the current one: pictures, figures, and differences of their requests.
(() => {
  const { element } = Studio;
  const MAX_PINS = 4;
  const STORED = "mirrorcam.pins";
  const NAMES = { rows: "Rows", cols: "Columns" };
  const CURVES = [
    ["usable", "Usable pixels", (value) => Studio.percent(value)],
    ["disparity_px", "Disparity", (value) => `${Studio.number(value)} px`],
    ["resolution_mm", "Depth resolution", (value) => `${Studio.number(value)} mm`],
    ["sigma_mm", "\u03c3 of depth", (value) => `${Studio.number(value)} mm`],
  ];

  // A curve of a drawing at a depth, between the points nearest in log depth; null outside.
  const at = (drawing, name, depth) => {
    const { depths_mm: depths, [name]: values } = drawing.curves;
    const i = depths.findIndex((other) => other >= depth);
    if (depths[i] === depth) return values[i] ?? null;
    if (i < 1 || values[i] === null || values[i - 1] === null || values[i] === undefined) return null;
    const share = Math.log(depth / depths[i - 1]) / Math.log(depths[i] / depths[i - 1]);
    return values[i - 1] + share * (values[i] - values[i - 1]);
  };

  // Pins are {name, drawing}; all pages of the browser share them.
  Studio.Pins = class {
    constructor(host, labels, recall, changed) {
      Object.assign(this, { host, labels, recall, changed });
      this.load();
      addEventListener("storage", ({ key }) => {
        if (key !== STORED) return;
        this.load();
        this.changed();
      });
    }

    load() {
      try {
        this.pinned = JSON.parse(localStorage.getItem(STORED) ?? "[]");
      } catch {
        this.pinned = []; // stored by another version
      }
    }

    keep(pinned) {
      this.pinned = pinned;
      localStorage.setItem(STORED, JSON.stringify(pinned));
      this.changed();
    }

    get full() {
      return this.pinned.length >= MAX_PINS;
    }

    has(drawing) {
      return this.pinned.some((pin) => pin.drawing.identity === drawing.identity);
    }

    pin(drawing) {
      if (!this.full && !this.has(drawing)) this.keep([...this.pinned, { name: this.free(drawing.title), drawing }]);
    }

    // A title that no other pin has.
    free(title) {
      const used = new Set(this.pinned.map(({ name }) => name));
      let number = 2;
      let name = title;
      while (used.has(name)) name = `${title} (${number++})`;
      return name;
    }

    card({ name, drawing }, pin) {
      const picture = element("div", { class: "drawing sensor-shape" });
      Studio.drawSensor(picture, drawing);
      if (!pin) return element("div", { class: "card" }, element("h3", {}, `${name} (now)`), picture);
      const title = element("input", { class: "text", value: name, maxlength: 60, "aria-label": "Name of the pinned design" });
      title.addEventListener("change", () => this.keep(this.pinned.map((other) => (other === pin ? { ...pin, name: title.value || drawing.title } : other))));
      const recall = element("button", { type: "button", onclick: () => this.recall(drawing.spec) }, "Go to");
      const remove = element("button", { type: "button", "aria-label": `Remove ${name}`, onclick: () => this.keep(this.pinned.filter((other) => other !== pin)) }, "Remove");
      return element("div", { class: "card" }, title, picture, element("p", { class: "key" }, recall, " ", remove));
    }

    draw(current) {
      const { host } = this;
      host.hidden = !this.pinned.length;
      if (host.hidden) return;
      const pins = this.pinned.map((pin) => ({ ...pin, drawing: current?.identity === pin.drawing.identity ? current : pin.drawing }));
      const designs = [...pins, ...(current && !this.has(current) ? [{ name: current.title, drawing: current }] : [])];
      const cards = designs.map((design, i) => this.card(design, this.pinned[i]));
      const specs = designs.map(({ drawing }) => Studio.whole(drawing.spec));
      const names = Object.keys(specs[0]).filter((name) => new Set(specs.map((spec) => JSON.stringify(spec[name]))).size > 1);
      const title = (text) => element("tr", { class: "title" }, element("th", { scope: "rowgroup", colspan: designs.length + 1 }, text));
      const depths = (current ?? designs[0].drawing).depths_mm;
      const curves = depths.flatMap((depth) => CURVES.map(([name, label, format]) => {
        const values = designs.map(({ drawing }) => at(drawing, name, depth));
        return Studio.row(`${label} at ${depth} mm`, values.map((value) => (value === null ? "none" : format(value))));
      }));
      const table = element("div", { class: "wide-table", tabindex: 0, role: "region", "aria-label": "Figures of the designs" });
      Studio.drawFigures(table, designs.map(({ name, drawing }) => [drawing === current ? `${name} (now)` : name, drawing]), { common: true });
      const requests = names.length ? [title("Differences of the requests"), ...names.map((name) => Studio.row(NAMES[name] ?? this.labels[name] ?? name, specs.map((spec) => Studio.withUnit(spec[name], name)), "differs"))] : [];
      table.querySelector("tbody").prepend(...requests, title("At the working depths of the current design"), ...curves);
      host.replaceChildren(element("h2", {}, "Compare"), element("div", { class: "cards" }, ...cards), table, element("p", { class: "key" }, "Marks compare with the last column."));
    }
  };
})();
