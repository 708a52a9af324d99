"use strict";
// Figures of as-built devices: a bar for 90 % of them, their median, and the design.
(() => {
  const { element, svg } = Studio;

  Studio.drawTolerance = (host, study) => {
    if (study.reason) {
      host.replaceChildren(element("p", {}, `none: ${study.reason}`));
      return;
    }
    const rows = study.bars.map(({ label, design, low, median, high, text }) => {
      const max = 1.08 * Math.max(design, high, 1e-12);
      const x = (value) => (200 * value) / max;
      const picture = svg("svg", { viewBox: "0 0 200 16", preserveAspectRatio: "none", class: "bars", "aria-hidden": "true" });
      picture.append(
        svg("rect", { x: 0, y: 7, width: 200, height: 2, class: "track" }),
        svg("rect", { x: x(low), y: 3, width: Math.max(x(high) - x(low), 1), height: 10, class: "range" }),
        svg("rect", { x: x(median) - 0.75, y: 2, width: 1.5, height: 12, class: "median" }),
        svg("rect", { x: x(design) - 0.75, y: 0, width: 1.5, height: 16, class: "design" }),
      );
      return Studio.row(label, [picture, text]);
    });
    const hidden = study.hidden ? ` In ${Studio.percent(study.hidden)} of them a mirror hides part of another.` : "";
    host.replaceChildren(element("table", { class: "figures tolerance" }, element("tbody", {}, ...rows)), element("p", { class: "key" }, `${study.assumed}.${hidden}`));
  };
})();
