"use strict";
// The designs of a sweep as points; a click or Enter selects one.
(() => {
  const { element, svg, path, ticks, number } = Studio;
  const PLOTS = [
    { name: "field", x: ["field_deg", "field of view, diagonal, deg"], y: ["depth_per_m", "depth of field, 1/near - 1/far, 1/m"] },
    { name: "grid", x: ["grid_error", "grid error, of a spacing"], y: ["efficiency", "pixel efficiency, mean of the depths"] },
  ];
  const SHADES = 5;

  const plot = (points, { name, x: [xKey, xLabel], y: [yKey, yLabel] }, go) => {
    const [width, height, left, bottom, top, right] = [460, 300, 46, 42, 26, 12];
    const values = (key) => points.map((point) => point[key]);
    // Axes start at 0, unless the points would fill less than half of the plot.
    const range = (key) => {
      const [low, high] = [Math.min(...values(key)), Math.max(...values(key))];
      const spread = high - low || high;
      return low < 0.5 * high ? [0, 1.06 * high] : [low - 0.08 * spread, high + 0.08 * spread];
    };
    const [[left0, right0], [low0, high0]] = [range(xKey), range(yKey)];
    const x = (value) => left + ((value - left0) / (right0 - left0)) * (width - left - right);
    const y = (value) => height - bottom - ((value - low0) / (high0 - low0)) * (height - bottom - top);
    const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "group", "aria-label": `${yLabel} over ${xLabel}` });
    const text = (content, place) => {
      const node = svg("text", { class: "tick", ...place });
      node.textContent = content;
      root.append(node);
    };
    for (const tick of ticks(low0, high0, 5)) {
      root.append(svg("path", { d: path([[left, y(tick)], [width - right, y(tick)]], false), class: "rule" }));
      text(number(tick), { x: left - 6, y: y(tick), "text-anchor": "end", "dominant-baseline": "middle" });
    }
    for (const tick of ticks(left0, right0, 6)) text(number(tick), { x: x(tick), y: height - bottom + 16, "text-anchor": "middle" });
    text(xLabel, { x: (left + width - right) / 2, y: height - 8, "text-anchor": "middle" });
    text(yLabel, { x: left, y: 14 });
    const best = points.filter((point) => point.best.includes(name)).sort((a, b) => a[xKey] - b[xKey]);
    root.append(svg("path", { d: path(best.map((point) => [x(point[xKey]), y(point[yKey])]), false), class: "front" }));
    for (const point of points) {
      const label = `${point.title}: ${number(point[xKey])} and ${number(point[yKey])}${point.best.includes(name) ? ", on the front" : ""}`;
      const shade = Math.min(SHADES, Math.ceil(Math.sqrt(point.spec.rows * point.spec.cols)));
      const place = { cx: x(point[xKey]), cy: y(point[yKey]), r: 7 };
      const mark = svg("circle", { ...place, class: `point shade${shade}`, role: "button", tabindex: 0, "aria-label": label });
      const title = svg("title");
      title.textContent = label;
      mark.append(title);
      mark.addEventListener("click", () => go(point));
      mark.addEventListener("keydown", (event) => {
        if (event.key === "Enter" || event.key === " ") {
          event.preventDefault();
          go(point);
        }
      });
      point.marks = [...(point.marks ?? []), mark];
      root.append(mark);
    }
    return element("div", { class: "drawing plot" }, root);
  };

  Studio.drawSweep = (host, points, go) => {
    if (!points.length) return () => {};
    host.hidden = false;
    host.replaceChildren(
      element("h2", {}, `Sweep of ${points.length} designs`),
      element("div", { class: "plots" }, ...PLOTS.map((axes) => plot(points, axes, go))),
      element("p", { class: "key" }, "Darker points have more views; the line joins the designs that no other surpasses in both figures. Click one to see it."),
    );
    return (spec) => {
      for (const point of points) {
        const isCurrent = JSON.stringify(point.spec) === JSON.stringify(spec);
        for (const mark of point.marks) mark.classList.toggle("here", isCurrent);
      }
    };
  };
})();
