"use strict";
// Elements, polygons and numbers for all panels.
const Studio = {};

Studio.byId = (id) => document.getElementById(id);

Studio.element = (name, attributes = {}, ...children) => {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === undefined || value === null || value === false) continue;
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else node.setAttribute(key, value === true ? "" : value);
  }
  node.append(...children);
  return node;
};

Studio.svg = (name, attributes = {}, ...children) => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) if (value !== undefined) node.setAttribute(key, value);
  node.append(...children);
  return node;
};

// A table of rows below the texts of its heads.
Studio.table = (kind, heads, rows) => {
  const head = Studio.element("tr", {}, ...heads.map((text) => Studio.element("th", { scope: "col" }, text)));
  return Studio.element("table", { class: kind }, Studio.element("thead", {}, head), Studio.element("tbody", {}, ...rows));
};

// A row of a table: a label, then texts or nodes.
Studio.row = (label, cells, kind) =>
  Studio.element("tr", {}, Studio.element("th", { scope: "row" }, label), ...cells.map((cell) => Studio.element("td", { class: kind }, ...[cell].flat())));

// The place of the pointer on an element, as fractions of its width and height.
Studio.placeOf = ({ currentTarget, clientX, clientY }) => {
  const { left, top, width, height } = currentTarget.getBoundingClientRect();
  return [(clientX - left) / width, (clientY - top) / height];
};

Studio.path = (points, closed = true) =>
  points.length ? `M${points.map(([x, y]) => `${+x.toFixed(2)} ${+y.toFixed(2)}`).join("L")}${closed ? "Z" : ""}` : "";

// The part of a convex polygon where a x + b y + c >= 0.
const clip = (polygon, [a, b, c]) => {
  const kept = [];
  const height = ([x, y]) => a * x + b * y + c;
  polygon.forEach((point, i) => {
    const next = polygon[(i + 1) % polygon.length];
    const [start, end] = [height(point), height(next)];
    if (start >= 0) kept.push(point);
    if (start >= 0 !== end >= 0) {
      const t = start / (start - end);
      kept.push([point[0] + t * (next[0] - point[0]), point[1] + t * (next[1] - point[1])]);
    }
  });
  return kept;
};

Studio.area = (polygon) =>
  polygon.reduce((sum, [x, y], i) => {
    const [u, v] = polygon[(i + 1) % polygon.length];
    return sum + (x * v - y * u) / 2;
  }, 0);

Studio.intersection = (polygons) => {
  if (!polygons.length) return [];
  return polygons.slice(1).reduce((common, polygon) => {
    const sign = Math.sign(Studio.area(polygon));
    return polygon.reduce((clipped, [x, y], i) => {
      const [u, v] = polygon[(i + 1) % polygon.length];
      return clip(clipped, [-(v - y) * sign, (u - x) * sign, ((v - y) * x - (u - x) * y) * sign]);
    }, common);
  }, polygons[0]);
};

// The footprint of each view on the plane at a depth, by mirror; empty for a plane nearer than the mirrors.
Studio.footprints = (drawing, depth) => {
  const { mirror, points_mm: points, directions, reach_mm: reach } = drawing.rays;
  const footprints = drawing.mirrors.map(() => []);
  if (depth > reach) {
    mirror.forEach((k, i) => {
      const step = depth - points[i][2];
      footprints[k].push([points[i][0] + step * directions[i][0], points[i][1] + step * directions[i][1]]);
    });
  }
  return footprints;
};

Studio.bounds = (points) =>
  points.reduce(
    ([a, b, c, d], [x, y]) => [Math.min(a, x), Math.min(b, y), Math.max(c, x), Math.max(d, y)],
    [Infinity, Infinity, -Infinity, -Infinity],
  );

// Round numbers for the ticks of an axis, about `count` of them.
Studio.ticks = (low, high, count = 5) => {
  const step = 10 ** Math.floor(Math.log10((high - low) / count));
  const size = [1, 2, 5, 10].map((factor) => factor * step).find((spacing) => (high - low) / spacing <= count);
  const values = [];
  for (let tick = Math.ceil(low / size - 1e-9) * size; tick <= high + 1e-9 * size; tick += size) values.push(+tick.toPrecision(12));
  return values;
};

Studio.number = (value, digits = 3) => {
  if (!Number.isFinite(value)) return "";
  return Math.abs(value) >= 1000 ? value.toFixed(0) : String(+value.toPrecision(digits));
};

Studio.percent = (fraction) => `${(100 * fraction).toFixed(1)} %`;

// Shows in a host that something is computed: the step, the time, its progress from 0 to 1 if known, and a button.
Studio.working = (host, text, cancel) => {
  const startedAt = performance.now();
  const [label, bar] = [Studio.element("span"), Studio.element("progress", { max: 1, "aria-label": "Progress" })];
  const show = () => (label.textContent = `${text}, ${((performance.now() - startedAt) / 1000).toFixed(0)} s `);
  host.replaceChildren(label, bar, " ", Studio.element("button", { type: "button", onclick: cancel }, "Cancel"));
  show();
  const timer = setInterval(show, 500);
  return {
    step(next, progress) {
      text = next;
      bar.value = progress;
      show();
    },
    end: () => clearInterval(timer),
  };
};

// An asynchronous function that works on one argument at a time: of those that come meanwhile, only the newest follows.
Studio.newest = (work) => {
  let [busy, next] = [false, null];
  const call = async (...given) => {
    if (busy) {
      next = given;
      return;
    }
    busy = true;
    await work(...given).finally(() => (busy = false));
    const waiting = next;
    next = null;
    if (waiting) call(...waiting);
  };
  call.forget = () => (next = null);
  return call;
};
