"use strict";
// Solved designs as points over two figures to choose; a click or Enter selects one.
(() => {
  const { element, svg, path, ticks, number } = Studio;
  const SHADES = 5;
  const [HEIGHT, LEFT, BOTTOM, TOP, RIGHT] = [330, 52, 42, 26, 14];
  const short = (tick) => String(+tick.toPrecision(5));

  const of = (start) => Studio.compared.find((each) => each.start === start);

  // Axes start at 0, unless the points would fill less than half of the plot.
  const range = (values) => {
    const [low, high] = [Math.min(...values), Math.max(...values)];
    const spread = high - low || high || 1;
    return low < 0.5 * high ? [0, 1.06 * high] : [low - 0.08 * spread, high + 0.08 * spread];
  };

  // The points that no other surpasses in both figures, by increasing first figure.
  const front = (points, x, y) => {
    const signs = [x, y].map((start) => (of(start).lower_is_better ? -1 : 1));
    const better = (a, b) => signs[0] * (b.values[x] - a.values[x]) || signs[1] * (b.values[y] - a.values[y]);
    let best = -Infinity;
    const found = [...points].sort(better).filter(({ values }) => {
      const isOn = signs[1] * values[y] > best;
      if (isOn) best = signs[1] * values[y];
      return isOn;
    });
    return found.sort((a, b) => a.values[x] - b.values[x]);
  };

  Studio.DesignMap = class {
    constructor(host, go) {
      Object.assign(this, { host, go, points: [], pending: 0, plot: element("div", { class: "drawing plot" }), note: element("p", { class: "key", role: "status" }) });
      const select = (label, chosen) => {
        const node = element("select", { "aria-label": label }, ...Studio.compared.map(({ start, label }) => element("option", { value: start, selected: start === chosen }, label)));
        node.addEventListener("change", () => this.draw());
        return node;
      };
      this.axes = [select("Horizontal axis of the map", "device_size"), select("Vertical axis of the map", "depth_sigma")];
      new ResizeObserver(() => this.draw()).observe(this.plot);
      host.replaceChildren(element("div", { class: "head" }, element("h2", {}, "Designs nearby"), element("div", { class: "axes" }, this.axes[1], " over ", this.axes[0])), this.plot, this.note);
    }

    // `points` are those of the server; `spec` is the request that they are near to.
    show({ points, pending }, spec) {
      Object.assign(this, { points: points.map((point) => ({ ...point, spec: Studio.whole({ ...spec, ...point.changes }) })), pending });
      this.draw();
    }

    draw() {
      const [x, y] = this.axes.map(({ value }) => value);
      const known = this.points.filter(({ values }) => values[x] !== null && values[y] !== null);
      const solving = this.pending ? ` ${this.pending} more are being solved in the background.` : "";
      this.note.textContent = `Solved designs for this camera and these depths, ${known.length} so far; darker ones have more views. None surpasses those on the line in both figures.${this.marks()} Click one to open it; arrow keys lead from one to the next.${solving}`;
      const focused = this.plot.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
      if (known.length && this.plot.clientWidth) this.plot.replaceChildren(this.picture(known, x, y));
      this.makeOneStop(focused);
    }

    // The points are one tab stop: arrow keys lead from each to the next along the horizontal axis.
    makeOneStop(focused) {
      const marks = [...this.plot.querySelectorAll(".point")].sort((a, b) => a.cx.baseVal.value - b.cx.baseVal.value);
      const stop = (mark) => marks.forEach((other) => (other.tabIndex = other === mark ? 0 : -1));
      stop(marks.find((mark) => mark.getAttribute("aria-label") === focused) ?? marks.find((mark) => mark.matches(".here")) ?? marks[0]);
      if (focused) this.plot.querySelector("[tabindex='0']")?.focus();
      marks.forEach((mark, i) => mark.addEventListener("keydown", (event) => {
        const next = marks[i + ({ ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[event.key] ?? NaN)];
        if (!next) return;
        event.preventDefault();
        stop(next);
        next.focus();
      }));
    }

    marks() {
      const judged = this.points.filter(({ misses }) => misses);
      const met = judged.filter(({ misses }) => !misses.length).length;
      const recut = this.points.some(({ changes }) => Studio.otherMirrors(changes)) ? " Dashed ones have other mirrors." : "";
      return `${judged.length ? ` ${met} of them meet the target, the others are hollow.` : ""}${recut}`;
    }

    picture(points, x, y) {
      const [[left, right], [low, high]] = [x, y].map((start) => range(points.map(({ values }) => values[start])));
      const { clientWidth: width } = this.plot;
      const across = (value) => LEFT + ((value - left) / (right - left)) * (width - LEFT - RIGHT);
      const up = (value) => HEIGHT - BOTTOM - ((value - low) / (high - low)) * (HEIGHT - BOTTOM - TOP);
      const [xLabel, yLabel] = [x, y].map((start) => `${of(start).label}, ${of(start).unit}`);
      const root = svg("svg", { viewBox: `0 0 ${width} ${HEIGHT}`, role: "group", "aria-label": `${yLabel} over ${xLabel}` });
      const text = (content, place) => root.append(svg("text", { class: "tick", ...place }, content));
      for (const tick of ticks(low, high, 5)) {
        root.append(svg("path", { d: path([[LEFT, up(tick)], [width - RIGHT, up(tick)]], false), class: "rule" }));
        text(short(tick), { x: LEFT - 6, y: up(tick), "text-anchor": "end", "dominant-baseline": "middle" });
      }
      for (const tick of ticks(left, right, width / 100)) text(short(tick), { x: across(tick), y: HEIGHT - BOTTOM + 16, "text-anchor": "middle" });
      text(xLabel, { x: (LEFT + width - RIGHT) / 2, y: HEIGHT - 8, "text-anchor": "middle" });
      text(yLabel, { x: LEFT, y: 14 });
      const best = front(points, x, y);
      root.append(svg("path", { d: path(best.map(({ values }) => [across(values[x]), up(values[y])]), false), class: "front" }));
      for (const point of points) root.append(this.mark(point, { cx: across(point.values[x]), cy: up(point.values[y]), r: 7 }, `${point.title}: ${number(point.values[y])} and ${number(point.values[x])}${point.misses ? `, ${point.misses.length ? "misses" : "meets"} the target` : ""}${best.includes(point) ? ", on the line" : ""}`));
      return root;
    }

    mark({ spec, changes, misses }, place, label) {
      const views = spec.pattern?.positions.length ?? spec.rows * spec.cols;
      const here = `${Object.keys(changes).length ? "" : " here"}${misses?.length ? " misses" : ""}${Studio.otherMirrors(changes) ? " recut" : ""}`;
      const mark = svg("circle", { ...place, class: `point shade${Math.min(SHADES, Math.ceil(Math.sqrt(views)))}${here}`, role: "button", "aria-label": label }, svg("title", {}, label));
      const go = () => this.go(spec);
      mark.addEventListener("click", go);
      mark.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        go();
      });
      return mark;
    }
  };
})();
