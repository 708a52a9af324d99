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
  const line = (points, attributes) => svg("path", { d: path(points, false), ...attributes });
  // Sizes on the screen, independent of the units of the drawing.
  const unit = (width) => width / 100;

  // A ruler of a round length at the lower left of a drawing, mm.
  const ruler = (root, [left, top, width, height]) => {
    const u = unit(width);
    const length = ticks(0, width / 3, 2).at(-1) || width / 5;
    const [x, y] = [left + u * 3, top + height - u * 3];
    const place = { x: x + length + u, y, class: "tick", "font-size": u * 3.2, "dominant-baseline": "middle" };
    root.append(line([[x, y], [x + length, y]], { class: "measure", "stroke-width": u * 0.5 }), svg("text", place, `${number(length)} mm`));
  };

  Studio.drawSensor = (host, drawing, compared) => {
    const [width, height] = drawing.sensor_px;
    const margin = width * 0.012;
    const label = `Sensor of ${width} x ${height} px with ${drawing.mirrors.length} sub-images`;
    const root = frame(host, label, [-margin, -margin, width + 2 * margin, height + 2 * margin]);
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
      root.append(svg("text", { x: (left + right) / 2, y: (top + bottom) / 2, class: "on", "font-size": size }, name));
    }
  };

  // A box of 3:2 around points, larger than them by a factor.
  const around = (points, factor) => {
    const [left, top, right, bottom] = bounds(points);
    const side = Math.max(right - left, (bottom - top) * 1.5, 1) * factor;
    return [(left + right - side) / 2, (top + bottom - side / 1.5) / 2, side, side / 1.5];
  };

  // What each view sees on the plane at a depth, and what all see.
  const seenAt = (drawing, depth) => {
    const seen = Studio.footprints(drawing, depth).filter((polygon) => polygon.length > 2);
    return [seen, seen.length === drawing.mirrors.length ? Studio.intersection(seen) : []];
  };

  Studio.drawCoverage = (host, drawing, depth, compared) => {
    const [seen, common] = seenAt(drawing, depth);
    // The scale is fixed by the farthest depth, so that the field visibly grows with depth.
    const far = 1.25 * drawing.depths_mm.at(-1);
    const all = [...Studio.footprints(drawing, far).flat(), ...seen.flat()];
    const box = around(all.length ? all : [[-1, -1], [1, 1]], 1.06);
    const root = frame(host, `What each view sees at ${number(depth)} mm, and what all see`, box);
    const u = unit(box[2]);
    for (const polygon of seen) {
      root.append(svg("path", { d: path(polygon), class: "footprint", "stroke-width": u * 0.25 }));
    }
    if (compared) {
      root.append(svg("path", { d: path(seenAt(compared, depth)[1]), class: "ghost", "stroke-width": u * 0.5 }));
    }
    root.append(svg("path", { d: path(common), class: "common solid", "stroke-width": u * 0.5 }));
    ruler(root, box);
    return common.length ? bounds(common) : null;
  };

  Studio.drawCameras = (host, drawing, compared) => {
    const flat = ([x, y]) => [x, y];
    const [centres, grid, others] = [drawing.centres_mm, drawing.grid_mm, compared?.centres_mm ?? []].map((points) => points.map(flat));
    const box = around([...centres, ...grid, ...others], 1.25);
    const root = frame(host, "Virtual cameras, seen along the views, on the grid that fits them best", box);
    const u = unit(box[2]);
    for (const [i, j] of drawing.neighbours) root.append(line([grid[i], grid[j]], { class: "grid", "stroke-width": u * 0.3 }));
    for (const [x, y] of others) {
      root.append(svg("circle", { cx: x, cy: y, r: u * 1.1, class: "ghost", "stroke-width": u * 0.35 }));
    }
    centres.forEach((centre, k) => {
      root.append(line([grid[k], centre], { class: "off", "stroke-width": u * 0.5 }));
      root.append(svg("circle", { cx: centre[0], cy: centre[1], r: u * (k === drawing.central ? 1.7 : 1.2), class: "view" }));
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
      const place = { x: left - 5, y: y(tick), class: "tick", "text-anchor": "end", "dominant-baseline": "middle" };
      root.append(line([[left, y(tick)], [width - right, y(tick)]], { class: "rule" }), svg("text", place, format(tick)));
    }
    const inside = [20, 50, 100, 200, 300, 500, 700, 1000, 2000, 5000, 10000].filter((d) => d >= depths[0] && d <= depths.at(-1));
    // From the last tick, which has the unit; ticks without room before the next are omitted.
    const round = inside.reduceRight((kept, d) => (kept.length && x(kept[0]) - x(d) < (kept.length === 1 ? 44 : 26) ? kept : [d, ...kept]), []);
    round.forEach((depth, i) => {
      const last = i === round.length - 1;
      const anchor = last && x(depth) > width - 40 ? { x: width - 2, "text-anchor": "end" } : { x: x(depth), "text-anchor": "middle" };
      root.append(svg("text", { ...anchor, y: height - 7, class: "tick" }, last ? `${depth} mm` : depth));
    });
    const upright = (depth, kind) => root.append(line([[x(depth), top], [x(depth), height - bottom]], { class: kind }));
    for (const depth of drawing.depths_mm) upright(depth, "working");
    if (at >= depths[0] && at <= depths.at(-1)) upright(at, "here");
    for (const { values: along, name, depths: own = depths } of lines) {
      const points = along.map((value, i) => (value === null ? null : [x(own[i]), y(value)]));
      const shown = points.filter((point) => point && point[0] >= left - 0.5 && point[0] <= width - right + 0.5);
      root.append(line(shown, { class: `curve ${name}` }));
    }
  };
})();
