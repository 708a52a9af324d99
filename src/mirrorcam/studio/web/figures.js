"use strict";
// Figures of designs as tables and tiles.
(() => {
  const { element } = Studio;

  const HEADLINES = [
    ["usable_efficiency", "usable pixels"],
    ["grid_error", "grid error"],
    ["fov_x", "field of view, x"],
    ["baseline_x", "baseline, x"],
    ["depth_sigma", "\u03c3 of depth"],
    ["smallest_area", "smallest mirror"],
  ];

  const all = (drawing) => Object.values(drawing.figures).flat();
  Studio.figureOf = (drawing, name) => all(drawing).find((figure) => figure.name === name);

  Studio.drawTiles = (host, drawing) => {
    const tiles = HEADLINES.map(([start, label]) => {
      const figures = all(drawing).filter((figure) => figure.name.startsWith(start));
      const short = (number) => Studio.number(+number);
      const texts = figures.map((figure) => figure.text.replace(/\d+\.\d+/, short).replace(" grid spacings", " spacings"));
      // With several depths, show the nearest and the farthest.
      const unit = / \S+$/;
      const first = texts.length > 1 && texts[0].match(unit)?.[0] === texts.at(-1).match(unit)?.[0] ? texts[0].replace(unit, "") : texts[0];
      const text = texts.length > 1 ? `${first} \u2026 ${texts.at(-1)}` : (first ?? "none");
      const reason = figures.find((figure) => figure.reason)?.reason;
      return element("div", { title: reason }, element("dt", {}, label), element("dd", {}, text));
    });
    host.replaceChildren(...tiles);
  };

  // A sign for better or worse, with a title; nothing for equal or unknown figures.
  const change = (figure, other) => {
    if (!other || figure.text === other.text || figure.value === null || other.value === null) return null;
    const less = figure.value < other.value;
    const better = less === figure.lower_is_better;
    return element("span", { class: better ? "better" : "worse", title: `${better ? "better" : "worse"} than the first column: ${other.text}` }, `${less ? "\u25bc" : "\u25b2"}`);
  };

  // The text of a figure, with the reason if it is unknown.
  const textOf = (figure) => (figure.reason ? [`${figure.text}: `, element("span", { class: "why" }, figure.reason)] : [figure.text]);

  // A table of figures: a row per name, a column per drawing; changes are relative to the last column.
  Studio.drawFigures = (host, columns, { title = true } = {}) => {
    const [, first] = columns[0];
    const reference = columns.length > 1 ? columns.at(-1)[1] : null;
    const heads = element("tr", {}, element("th", { scope: "col" }, "Figure"), ...columns.map(([name]) => element("th", { scope: "col" }, name)));
    const body = [];
    for (const [group, figures] of Object.entries(first.figures)) {
      if (title) body.push(element("tr", { class: "title" }, element("th", { scope: "rowgroup", colspan: columns.length + 1 }, group)));
      for (const figure of figures) {
        const cells = columns.map(([, drawing]) => {
          const own = Studio.figureOf(drawing, figure.name);
          const mark = own && reference && drawing !== reference ? change(own, Studio.figureOf(reference, figure.name)) : null;
          return element("td", { class: own && !own.passed ? "failed" : undefined }, ...(own ? textOf(own) : []), ...(mark ? [" ", mark] : []));
        });
        body.push(element("tr", {}, element("th", { scope: "row" }, figure.label), ...cells));
      }
    }
    host.replaceChildren(element("table", { class: "figures" }, element("thead", {}, heads), element("tbody", {}, ...body)));
  };

  Studio.drawVerdict = (host, drawing) => {
    const rows = drawing.verdict.map((figure) =>
      element("tr", { class: figure.passed ? undefined : "failed" }, element("th", { scope: "row" }, figure.label), element("td", {}, ...textOf(figure)), element("td", { class: "limit" }, figure.limit), element("td", {}, figure.passed ? "passes" : "FAILS")),
    );
    const heads = element("tr", {}, ...["Check", "Measured", "Limit", "Result"].map((text) => element("th", { scope: "col" }, text)));
    host.replaceChildren(element("table", { class: "figures" }, element("thead", {}, heads), element("tbody", {}, ...rows)));
  };
})();
