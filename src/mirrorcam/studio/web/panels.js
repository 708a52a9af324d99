"use strict";
// The flat drawings of a design: sensor, coverage at a depth, virtual cameras, curves over depth.
(() => {
  const { svg, path, bounds, ticks, number } = Studio;

  const frame = (host, label, box) => {
    const [x, y, width, height] = box;
    const root = svg("svg", { viewBox: `${x} ${y} ${width} ${height}`, role: "img", "aria-label": label });
    host.replaceChildren(root);
    return root;
  };
  // Sizes on the screen, independent of the units of the drawing.
  const unit = (width) => width / 100;

  // A ruler of a round length at the lower left of a drawing, mm.
  const ruler = (root, [left, top, width, height]) => {
    const u = unit(width);
    const length = ticks(0, width / 3, 2).at(-1) || width / 5;
    const [x, y] = [left + u * 3, top + height - u * 3];
    root.append(svg("path", { d: path([[x, y], [x + length, y]], false), class: "measure", "stroke-width": u * 0.5 }));
    const text = svg("text", { x: x + length + u, y, class: "tick", "font-size": u * 3.2, "dominant-baseline": "middle" });
    text.textContent = `${number(length)} mm`;
    root.append(text);
  };

  Studio.drawSensor = (host, drawing, compared) => {
    const [width, height] = drawing.sensor_px;
    const margin = width * 0.012;
    const root = frame(host, `Sensor of ${width} x ${height} px with ${drawing.mirrors.length} sub-images`, [
      -margin,
      -margin,
      width + 2 * margin,
      height + 2 * margin,
    ]);
    const u = unit(width);
    root.append(svg("rect", { x: -0.5, y: -0.5, width, height, class: "sensor", "stroke-width": u * 0.3 }));
    for (const mirror of compared?.mirrors ?? []) {
      root.append(svg("path", { d: path(mirror.outline_px), class: "ghost", "stroke-width": u * 0.25 }));
    }
    drawing.mirrors.forEach(({ outline_px: outline, usable_px: usable }, k) => {
      const wrong = drawing.concerned?.includes(k) ? " wrong" : "";
      root.append(svg("path", { d: path(outline), class: `mirror${wrong}`, "stroke-width": u * 0.3 }));
      root.append(svg("path", { d: path(usable), class: "whole", "stroke-width": u * 0.2 }));
    });
    drawing.common_px.forEach((outlines, depth) => {
      for (const outline of outlines) {
        root.append(svg("path", { d: path(outline), class: `common depth${depth % 4}`, "stroke-width": u * 0.3 }));
      }
    });
    const size = Math.min(u * 2.6, (u * 22) / Math.sqrt(drawing.mirrors.length));
    for (const { name, outline_px: outline } of drawing.mirrors) {
      const [left, top, right, bottom] = bounds(outline);
      const text = svg("text", { x: (left + right) / 2, y: (top + bottom) / 2, class: "on", "font-size": size });
      text.textContent = name;
      root.append(text);
    }
  };

  Studio.drawCoverage = (host, drawing, depth, compared) => {
    const seen = Studio.footprints(drawing, depth).filter((polygon) => polygon.length > 2);
    const seenByAll = seen.length === drawing.mirrors.length;
    const common = seenByAll ? Studio.intersection(seen) : [];
    // The scale is fixed by the farthest depth, so that the field visibly grows with depth.
    const far = 1.25 * drawing.depths_mm.at(-1);
    const all = [...Studio.footprints(drawing, far).flat(), ...seen.flat()];
    const [left, top, right, bottom] = all.length ? bounds(all) : [-1, -1, 1, 1];
    const side = Math.max(right - left, (bottom - top) * 1.5) * 1.06;
    const box = [(left + right - side) / 2, (top + bottom - side / 1.5) / 2, side, side / 1.5];
    const root = frame(host, `What each view sees at ${number(depth)} mm, and what all see`, box);
    const u = unit(side);
    for (const polygon of seen) {
      root.append(svg("path", { d: path(polygon), class: "footprint", "stroke-width": u * 0.25 }));
    }
    if (compared) {
      const theirs = Studio.footprints(compared, depth).filter((polygon) => polygon.length > 2);
      const shared = theirs.length === compared.mirrors.length ? Studio.intersection(theirs) : [];
      root.append(svg("path", { d: path(shared), class: "ghost", "stroke-width": u * 0.5 }));
    }
    root.append(svg("path", { d: path(common), class: "common solid", "stroke-width": u * 0.5 }));
    ruler(root, box);
    return common.length ? bounds(common) : null;
  };

  Studio.drawCameras = (host, drawing, compared) => {
    const flat = ([x, y]) => [x, y];
    const [centres, grid] = [drawing.centres_mm.map(flat), drawing.grid_mm.map(flat)];
    const [left, top, right, bottom] = bounds([...centres, ...grid, ...(compared?.centres_mm ?? []).map(flat)]);
    const side = Math.max(right - left, (bottom - top) * 1.5, 1) * 1.25;
    const box = [(left + right - side) / 2, (top + bottom - side / 1.5) / 2, side, side / 1.5];
    const root = frame(host, "Virtual cameras, seen along the views, on the grid that fits them best", box);
    const u = unit(side);
    for (const [i, j] of drawing.neighbours) {
      root.append(svg("path", { d: path([grid[i], grid[j]], false), class: "grid", "stroke-width": u * 0.3 }));
    }
    for (const [x, y] of (compared?.centres_mm ?? []).map(flat)) {
      root.append(svg("circle", { cx: x, cy: y, r: u * 1.1, class: "ghost", "stroke-width": u * 0.35 }));
    }
    centres.forEach((centre, k) => {
      root.append(svg("path", { d: path([grid[k], centre], false), class: "off", "stroke-width": u * 0.5 }));
      const circle = { cx: centre[0], cy: centre[1], r: u * (k === drawing.central ? 1.7 : 1.2), class: "view" };
      root.append(svg("circle", circle));
    });
    ruler(root, box);
  };

  // The ticks of a logarithmic axis: 1, 2 and 5 times each power of ten, or the powers alone where they are many.
  const roundNumbers = (min, max) => {
    const powers = Array.from({ length: 8 }, (_, i) => 10 ** (i - 4));
    const inside = (factors) => powers.flatMap((power) => factors.map((factor) => +(factor * power).toPrecision(1))).filter((v) => v >= min && v <= max);
    return inside(max > 300 * min ? [1] : [1, 2, 5]);
  };

  // Curves over depth: `lines` are {values, name}; the depth axis is logarithmic, the other starts at 0.
  Studio.drawCurves = (host, label, drawing, lines, { at, format = number, scale = "linear" } = {}) => {
    const [width, height, left, bottom, top, right] = [300, 150, 40, 22, 8, 8];
    const depths = drawing.curves.depths_mm;
    const root = frame(host, label, [0, 0, width, height]);
    const [near, far] = [Math.log(depths[0]), Math.log(depths.at(-1))];
    const x = (depth) => left + ((Math.log(depth) - near) / (far - near)) * (width - left - right);
    const values = lines.flatMap((line) => line.values).filter((value) => value !== null && value > 0);
    if (!values.length) return;
    const max = Math.max(...values);
    const min = scale === "log" ? Math.max(Math.min(...values), max / 1e4) : 0;
    const level = (value) => (scale === "log" ? Math.log(Math.max(value, min) / min) / Math.log(max / min || 1) : value / max);
    const y = (value) => height - bottom - (level(value) / 1.05) * (height - bottom - top);
    const marks = scale === "log" ? roundNumbers(min, max) : ticks(0, max, 4);
    for (const tick of marks) {
      root.append(svg("path", { d: path([[left, y(tick)], [width - right, y(tick)]], false), class: "rule" }));
      const text = svg("text", { x: left - 5, y: y(tick), class: "tick", "text-anchor": "end", "dominant-baseline": "middle" });
      text.textContent = format(tick);
      root.append(text);
    }
    const inside = [20, 50, 100, 200, 300, 500, 700, 1000, 2000, 5000, 10000].filter((d) => d >= depths[0] && d <= depths.at(-1));
    // From the last tick, which has the unit; ticks without room before the next are omitted.
    const round = inside.reduceRight((kept, d) => (kept.length && x(kept[0]) - x(d) < (kept.length === 1 ? 44 : 26) ? kept : [d, ...kept]), []);
    round.forEach((depth, i) => {
      const last = i === round.length - 1;
      const anchor = last && x(depth) > width - 40 ? { x: width - 2, "text-anchor": "end" } : { x: x(depth), "text-anchor": "middle" };
      const text = svg("text", { ...anchor, y: height - 7, class: "tick" });
      text.textContent = last ? `${depth} mm` : depth;
      root.append(text);
    });
    for (const depth of drawing.depths_mm) {
      root.append(svg("path", { d: path([[x(depth), top], [x(depth), height - bottom]], false), class: "working" }));
    }
    if (at >= depths[0] && at <= depths.at(-1)) {
      root.append(svg("path", { d: path([[x(at), top], [x(at), height - bottom]], false), class: "here" }));
    }
    for (const { values: along, name, depths: own = depths } of lines) {
      const points = along.map((value, i) => (value === null ? null : [x(own[i]), y(value)]));
      const shown = points.filter((point) => point && point[0] >= left - 0.5 && point[0] <= width - right + 0.5);
      root.append(svg("path", { d: path(shown, false), class: `curve ${name}` }));
    }
  };
})();
