"use strict";
// What the status says: meters, and the mirrors against the layout.
(() => {
  const { element, svg, path } = Studio;
  const LARGER = 5;

  Studio.Overlay = class {
    constructor(host, about, outlines) {
      this.host = host;
      host.setAttribute("viewBox", `0 0 ${about.camera_px[0]} ${about.camera_px[1]}`);
      host.setAttribute("preserveAspectRatio", "none");
      this.outlines = svg("g");
      this.seen = svg("g");
      for (const [name, points] of Object.entries(outlines)) {
        const [left, top, right, bottom] = Studio.bounds(points);
        const label = svg("text", { x: (left + right) / 2, y: (top + bottom) / 2 + 12 }, name);
        this.outlines.append(svg("path", { d: path(points), class: "outline" }), label);
      }
      host.append(this.outlines, this.seen);
    }

    show(on) {
      this.outlines.style.display = on ? "" : "none";
    }

    edges(alignment) {
      const shown = alignment ? alignment.designed_px.map(([x, y], i) => {
        const [u, v] = alignment.seen_px[i];
        const [a, b] = [x + LARGER * (u - x), y + LARGER * (v - y)];
        return [svg("line", { x1: x, y1: y, x2: a, y2: b, class: "seen" }), svg("circle", { cx: a, cy: b, r: 6 })];
      }) : [];
      this.seen.replaceChildren(...shown.flat());
    }
  };

  const tilt = (words) => {
    const sigma = words.sigma_deg.map((each) => each.toFixed(2)).join(" / ");
    return [words.words, words.words === "cannot tell" ? "" : `±${sigma}°`];
  };

  Studio.drawTilts = (host, alignment) => {
    const head = element("tr", {}, ...["Mirror", "by edges", "σ, right / down", "by points of the scene", "σ, right / down"].map((text) => element("th", {}, text)));
    const rows = alignment.names.map((name, k) => {
      const scene = alignment.scene.length ? tilt(alignment.scene[k]) : ["", ""];
      return element("tr", {}, element("th", { scope: "row" }, name), ...[...tilt(alignment.edges[k]), ...scene].map((text) => element("td", {}, text)));
    });
    host.replaceChildren(element("table", {}, element("thead", {}, head), element("tbody", {}, ...rows)));
  };

  Studio.Sharpness = class {
    constructor(host, names, grid) {
      host.style.gridTemplateColumns = `repeat(${grid[1]}, 1fr)`;
      this.cells = names.map((name) => {
        const text = element("span", {}, name);
        const bar = element("i");
        const cell = element("div", {}, bar, text);
        host.append(cell);
        return { bar, text, name };
      });
    }

    show(values) {
      values.forEach((value, k) => {
        const { bar, text, name } = this.cells[k];
        const known = value !== null;
        bar.style.transform = `scaleY(${known ? value.toFixed(3) : 0})`;
        text.textContent = known ? `${name}: ${(100 * value).toFixed(0)} %` : `${name}: –`;
      });
    }
  };

  Studio.Histogram = class {
    constructor(host, bins) {
      this.bars = Array.from({ length: bins }, () => element("i"));
      host.append(...this.bars);
    }

    show(parts) {
      const most = Math.max(...parts, 1e-6);
      parts.forEach((part, k) => {
        this.bars[k].style.transform = `scaleY(${Math.sqrt(part / most).toFixed(3)})`;
      });
    }
  };
})();
