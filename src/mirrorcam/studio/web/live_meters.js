"use strict";
// Displays of the status: meters, and the alignment of the mirrors.
(() => {
  const { element, svg, path } = Studio;
  const MAGNIFICATION = 5;
  const LETTER_PX = 14;

  Studio.Overlay = class {
    constructor(host, about, outlines) {
      this.host = host;
      host.setAttribute("viewBox", `0 0 ${about.camera_px[0]} ${about.camera_px[1]}`);
      host.setAttribute("preserveAspectRatio", "none");
      this.outlines = svg("g");
      this.labels = [];
      this.detected = svg("g");
      for (const [name, points] of Object.entries(outlines)) {
        const [left, top, right, bottom] = Studio.bounds(points);
        const label = { x: (left + right) / 2, y: (top + bottom) / 2, width: right - left, letters: name.length, plate: svg("rect"), text: svg("text", {}, name) };
        this.labels.push(label);
        this.outlines.append(svg("path", { d: path(points), class: "outline" }), label.plate, label.text);
      }
      host.replaceChildren(this.outlines, this.detected);
      new ResizeObserver(() => this.fit(about.camera_px[0] / Math.max(host.clientWidth, 1))).observe(host);
    }

    // Names have a constant size on the screen and a background, and fit into their sub-images.
    fit(scale) {
      for (const { x, y, width, letters, plate, text } of this.labels) {
        const size = Math.min(LETTER_PX * scale, (0.9 * width) / (0.6 * letters + 0.8));
        const plateWidth = (0.6 * letters + 0.8) * size;
        const box = { x: x - plateWidth / 2, y: y - 0.75 * size, width: plateWidth, height: 1.5 * size, rx: 0.35 * size };
        for (const [key, value] of Object.entries(box)) plate.setAttribute(key, value.toFixed(1));
        for (const [key, value] of Object.entries({ x, y: y + 0.35 * size, "font-size": size })) text.setAttribute(key, value.toFixed(1));
      }
    }

    show(on) {
      this.outlines.style.display = on ? "" : "none";
    }

    edges(alignment) {
      const marks = alignment ? alignment.designed_px.map(([x, y], i) => {
        const [u, v] = alignment.seen_px[i];
        const [a, b] = [x + MAGNIFICATION * (u - x), y + MAGNIFICATION * (v - y)];
        return [svg("line", { x1: x, y1: y, x2: a, y2: b, class: "seen" }), svg("circle", { cx: a, cy: b, r: 6 })];
      }) : [];
      this.detected.replaceChildren(...marks.flat());
    }
  };

  const tilt = (words) => {
    const sigma = words.sigma_deg.map((sigma) => sigma.toFixed(2)).join(" / ");
    return [words.words, words.words === "cannot tell" ? "" : `±${sigma}°`];
  };

  Studio.drawTilts = (host, alignment) => {
    const heads = ["Mirror", "by edges", "σ, right / down", "by points of the scene", "σ, right / down"];
    const rows = alignment.names.map((name, k) => {
      const scene = alignment.scene.length ? tilt(alignment.scene[k]) : ["", ""];
      return Studio.row(name, [...tilt(alignment.edges[k]), ...scene]);
    });
    host.replaceChildren(Studio.table("", heads, rows));
  };

  // Bars for the sharpness of mirrors, in a host; the function returned shows values, null if unknown.
  Studio.sharpness = (host, names, grid) => {
    host.style.gridTemplateColumns = `repeat(${grid[1]}, 1fr)`;
    const cells = names.map((name) => element("div", {}, element("i"), element("span", {}, name)));
    host.replaceChildren(...cells);
    return (values) => values.forEach((value, k) => {
      const [bar, text] = cells[k].children;
      bar.style.transform = `scaleY(${(value ?? 0).toFixed(3)})`;
      text.textContent = `${names[k]}: ${value === null ? "–" : `${(100 * value).toFixed(0)} %`}`;
    });
  };

  // Bars of a histogram in a host; the function returned shows the parts of its bins.
  Studio.histogram = (host, bins) => {
    const bars = Array.from({ length: bins }, () => element("i"));
    host.replaceChildren(...bars);
    return (parts) => {
      const max = Math.max(...parts, 1e-6);
      parts.forEach((part, k) => (bars[k].style.transform = `scaleY(${Math.sqrt(part / max).toFixed(3)})`));
    };
  };
})();
