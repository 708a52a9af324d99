"use strict";
// Figures of designs as tables and tiles.
(() => {
  const { element } = Studio;

  const DEVIATION = "\u00b1 is the standard deviation of the estimate's error";

  const all = (drawing) => Object.values(drawing.figures).flat();
  Studio.figureOf = (drawing, name) => all(drawing).find((figure) => figure.name === name);

  // The mean of the figures whose names begin like this; null if none is known.
  Studio.mean = (drawing, start) => {
    const values = all(drawing).filter((figure) => figure.name.startsWith(start) && figure.value !== null).map((figure) => figure.value);
    return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : null;
  };

  // Relative change of a value, marked as better or worse; null for none.
  const relative = (now, before, lower, digits = 2) => {
    if (now === null || !before) return null;
    const percent = 100 * (now / before - 1);
    if (Math.abs(percent) < (digits ? 0.05 : 0.5)) return null;
    const text = `${percent > 0 ? "+" : "\u2212"}${digits ? Studio.number(Math.abs(percent), digits) : Math.abs(percent).toFixed(0)}\u00a0%`;
    return element("span", { class: percent < 0 === lower ? "better" : "worse" }, text);
  };

  // Tiles of the headline figures; `before` is {name, drawing} of the design to compare with.
  Studio.drawTiles = (host, drawing, before) => {
    const tiles = Studio.compared.map(({ start, label, lower_is_better: lower }) => {
      const figures = all(drawing).filter((figure) => figure.name.startsWith(start));
      // Rounded once, from the value; an estimate has the digits that its error leaves.
      const short = ({ value, text }) => (text.includes("\u00b1") ? text : text.replace(/^\d+\.\d+/, () => Studio.number(text.includes("%") ? 100 * value : value)));
      const texts = figures.map((figure) => short(figure).replace(" grid spacings", " spacings"));
      // With several depths, show the nearest and the farthest.
      const unit = / \S+$/;
      const first = texts.length > 1 && texts[0].match(unit)?.[0] === texts.at(-1).match(unit)?.[0] ? texts[0].replace(unit, "") : texts[0];
      const text = texts.length > 1 ? `${first} \u2026 ${texts.at(-1)}` : (first ?? "none");
      const [value, error] = text.split(" \u00b1");
      const reason = figures.find((figure) => figure.reason)?.reason ?? (error && DEVIATION);
      const ofDepths = figures.some(({ name }) => /_[\d.e+]+mm$/.test(name));
      const same = before && (!ofDepths || Studio.same(before.drawing.depths_mm, drawing.depths_mm));
      const change = same ? relative(Studio.mean(drawing, start), Studio.mean(before.drawing, start), lower) : null;
      const where = ofDepths ? `, at ${[...new Set([drawing.depths_mm[0], drawing.depths_mm.at(-1)])].join(" \u2026 ")} mm` : "";
      return element("div", { title: reason, "data-start": start }, element("dt", {}, label + where), element("dd", {}, value, ...(error ? [element("span", { class: "error" }, ` \u00b1${error}`)] : []), element("small", { title: before?.name }, ...(change ? [change, ` to ${before.name}`] : ["\u00a0"]))));
    });
    host.replaceChildren(...tiles);
  };

  // Marks the tiles of the terms of a target that the design misses.
  const TILES = { depth_sigma: "depth_sigma", field: "fov_x", price: "device_price", mass: "device_mass", print: "device_print", size: "device_size" };
  Studio.markTiles = (host, misses) => {
    const missed = misses.map((kind) => TILES[kind]);
    for (const tile of host.children) tile.classList.toggle("misses", missed.includes(tile.dataset.start));
  };

  // What one step of a control does, as buttons that take it: smaller at the left, larger at the right. `points` are
  // solved designs near the drawing's.
  const EFFECTS = [["usable_efficiency", "pixels", false], ["depth_sigma", "\u03c3", true], ["device_size", "size", true], ["device_mass", "mass", true], ["device_price", "price", true]];
  Studio.drawSteps = (drawing, points, go) => {
    document.querySelectorAll(".next").forEach((host) => host.replaceChildren());
    const steps = points.filter(({ step }) => step).sort((a, b) => a.changes[a.step] - b.changes[b.step]);
    for (const { step: control, changes, values } of steps) {
      const isCount = control === "cols" || control === "rows";
      const spec = { ...drawing.spec, ...changes };
      const effects = EFFECTS.map(([start, label, lower]) => [relative(values[start], Studio.mean(drawing, start), lower, 0), label]).filter(([change]) => change);
      const text = isCount ? `${spec.rows} \u00d7 ${spec.cols}` : Studio.withUnit(spec[control], control);
      const side = spec[control] < drawing.spec[control] ? "less" : "more";
      const lines = effects.length ? effects.map(([change, label]) => element("span", {}, `${label} `, change)).flatMap((line) => [line, " "]) : ["the same"];
      Studio.byId(`${isCount ? "rows" : control}-next`)?.append(
        element("button", { type: "button", class: `${control} ${side}`, title: "Take this step: changes of usable pixels, standard deviation of depth, size, mass and price", onclick: () => go(spec) }, element("b", {}, text), ...lines),
      );
    }
  };

  // A sign for better or worse, with a title; nothing for equal or unknown figures.
  const change = (figure, other) => {
    if (!other || figure.text === other.text || figure.value === null || other.value === null) return null;
    const less = figure.value < other.value;
    const kind = figure.lower_is_better === null ? "other" : less === figure.lower_is_better ? "better" : "worse";
    return element("span", { class: kind, title: `${kind} than ${other.text} of the last column` }, `${less ? "\u25bc" : "\u25b2"}`);
  };

  // The text of a figure, with the reason if it is unknown.
  const textOf = (figure) => (figure.reason ? [`${figure.text}: `, element("span", { class: "why" }, figure.reason)] : [figure.text]);

  // A table of figures: a row per name, a column per drawing; changes are relative to the last column. With
  // `common`, only figures that all have: those at other depths cannot be compared.
  Studio.drawFigures = (host, columns, { common = false } = {}) => {
    const [, first] = columns[0];
    const reference = columns.length > 1 ? columns.at(-1)[1] : null;
    const body = [];
    for (const [group, figures] of Object.entries(first.figures)) {
      const shown = common ? figures.filter(({ name }) => columns.every(([, drawing]) => Studio.figureOf(drawing, name))) : figures;
      if (shown.length) body.push(element("tr", { class: "title" }, element("th", { scope: "rowgroup", colspan: columns.length + 1 }, group)));
      for (const figure of shown) {
        const cells = columns.map(([, drawing]) => {
          const own = Studio.figureOf(drawing, figure.name);
          const mark = own && reference && drawing !== reference ? change(own, Studio.figureOf(reference, figure.name)) : null;
          return element("td", { class: own && !own.passed ? "failed" : undefined }, ...(own ? textOf(own) : []), ...(mark ? [" ", mark] : []));
        });
        body.push(element("tr", {}, element("th", { scope: "row" }, figure.label), ...cells));
      }
    }
    host.replaceChildren(Studio.table("figures", ["Figure", ...columns.map(([name]) => name)], body));
  };

  Studio.drawVerdict = (host, drawing) => {
    const rows = drawing.verdict.map((figure) =>
      element("tr", { class: figure.passed ? undefined : "failed" }, element("th", { scope: "row" }, figure.label), element("td", {}, ...textOf(figure)), element("td", { class: "limit" }, figure.limit), element("td", {}, figure.passed ? "passes" : "FAILS")),
    );
    host.replaceChildren(Studio.table("figures", ["Check", "Measured", "Limit", "Result"], rows));
  };
})();
