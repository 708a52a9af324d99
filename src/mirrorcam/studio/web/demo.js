"use strict";
// The panels of the demo: pictures of one light field, and what the pointer does on them.
(async () => {
  const TURN_S = 6; // one orbit and one sweep of the focus after loading, until the pointer enters
  const EASE_MS = 60; // time in which a change is done but for a third, also where a picture takes long
  const NEAR_PX = 18; // distance at which a feature is chosen

  const { byId } = Studio;
  const about = JSON.parse(byId("start").textContent);
  const [width, height] = about.size_px;
  const [rows, cols] = about.grid;

  const drawing = (id, columns = 1) => {
    Object.assign(byId(id), { width: width * columns, height: height * columns });
    return byId(id).getContext("2d");
  };

  const fail = (text) => Object.assign(byId("failed"), { hidden: false, textContent: text });

  let field;
  try {
    field = await Studio.LightField.load(about);
  } catch (error) {
    fail(`The pictures cannot be drawn: ${error.message}`);
    return;
  }
  if (!field.gl) fail("This browser has no WebGL 2: refocusing and new viewpoints need it, and show the central view instead.");

  // A position on a picture, in pixels of a view.
  const pixelAt = (event) => {
    const [right, down] = Studio.placeOf(event);
    return [right * width - 0.5, down * height - 0.5];
  };
  const levelAt = ([x, y]) => {
    const column = Math.min(Math.max(Math.round(x), 0), width - 1);
    return field.levels[Math.min(Math.max(Math.round(y), 0), height - 1) * width + column];
  };
  const millimetres = (level) => `${field.depthMm(field.inverse(level)).toFixed(0)} mm`;

  const views = drawing("views", 2);
  for (let t = 0; t < rows; t++) {
    for (let s = 0; s < cols; s++) {
      const [tileWidth, tileHeight] = [(2 * width) / cols, (2 * height) / rows];
      field.drawView(views, [t, s], [s * tileWidth, t * tileHeight, tileWidth - 2, tileHeight - 2]);
    }
  }

  const colour = (level) => `#${about.colours[Math.round(level)]}`;
  const depth = drawing("depth");
  const painted = depth.createImageData(width, height);
  field.levels.forEach((level, i) => {
    const rgb = parseInt(about.colours[level], 16);
    painted.data.set([rgb >> 16, (rgb >> 8) & 255, rgb & 255, 255], 4 * i);
  });
  depth.putImageData(painted, 0, 0);
  byId("near").textContent = millimetres(255);
  byId("far").textContent = millimetres(0);
  byId("depth").addEventListener("pointermove", (event) => {
    byId("depth-text").textContent = `${millimetres(levelAt(pixelAt(event)))} from the camera`;
  });

  // Values that follow their targets, so that a jump of the pointer is a motion; drawn when they change.
  const eased = (value, draw) => {
    let [shown, target, waiting, last] = [value, value, false, performance.now()];
    const step = (now) => {
      waiting = false;
      const share = 1 - Math.exp(-Math.max(now - last, 0) / EASE_MS);
      last = now;
      const rest = Math.max(...target.map((goal, i) => Math.abs(goal - shown[i])));
      shown = rest < 2e-3 ? target : shown.map((number, i) => number + share * (target[i] - number));
      draw(shown);
      if (rest >= 2e-3) request();
    };
    const request = () => {
      if (waiting) return;
      requestAnimationFrame(step);
      waiting = true;
    };
    request();
    return (goal, jump = false) => {
      if (shown === target) last = performance.now();
      target = goal;
      if (jump) shown = goal;
      request();
    };
  };

  const refocused = drawing("refocus");
  const focusAt = eased([0.6], ([share]) => {
    field.refocus(refocused, field.inverse(255 * share));
    byId("focus-text").textContent = `Focused at ${millimetres(255 * share)}. Point at something to focus on it.`;
  });
  const focus = (level, jump) => {
    byId("focus").value = level;
    focusAt([level / 255], jump);
  };

  const [low, high] = about.viewpoint_mm;
  const seenFrom = drawing("viewpoint");
  const viewFrom = eased([0, 0], (share) => {
    const position = share.map((value, axis) => low[axis] + ((value + 1) / 2) * (high[axis] - low[axis]));
    field.viewFrom(seenFrom, position);
    const [x, y] = position.map((value) => Math.round(value));
    const sides = [x < 0 ? "left of" : "right of", y < 0 ? "above" : "below"];
    byId("viewpoint-text").textContent = `${Math.abs(x)} mm ${sides[0]} and ${Math.abs(y)} mm ${sides[1]} the central view. Point at the picture to move.`;
  });
  const look = (right, down, jump) => {
    byId("right").value = right;
    byId("down").value = down;
    viewFrom([right, down], jump);
  };

  let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
  const onPointer = (id, act) => {
    for (const kind of ["pointerdown", "pointermove"]) {
      byId(id).addEventListener(kind, (event) => {
        playing = false;
        act(pixelAt(event));
      });
    }
  };
  onPointer("refocus", (pixel) => focus(levelAt(pixel)));
  onPointer("viewpoint", ([x, y]) => look((2 * x) / width - 1, (2 * y) / height - 1));
  for (const id of ["focus", "right", "down"]) {
    byId(id).addEventListener("input", () => {
      playing = false;
      if (id === "focus") focus(Number(byId(id).value), true);
      else look(Number(byId("right").value), Number(byId("down").value), true);
    });
  }
  focus(153, true);
  look(0, 0, true);
  const started = performance.now();
  const play = () => {
    const turn = (performance.now() - started) / 1000 / TURN_S;
    if (!playing || turn > 1) return;
    const fade = Math.min(1, 8 * turn, 8 * (1 - turn));
    look(fade * Math.sin(2 * Math.PI * turn), -fade * Math.cos(2 * Math.PI * turn), true);
    focus(153 + 102 * Math.sin(2 * Math.PI * turn), true);
    requestAnimationFrame(play);
  };
  play();

  const central = drawing("features");
  central.globalAlpha = 0.55;
  field.drawView(central, about.reference, [0, 0, width, height]);
  const points = byId("points");
  const seen = byId("seen");
  points.setAttribute("viewBox", `-0.5 -0.5 ${width} ${height}`);
  seen.setAttribute("viewBox", `-0.5 -0.5 ${width * cols} ${height * rows}`);
  const levelOf = (depthMm) => {
    const [far, near] = about.inverse_mm;
    return 255 * Math.min(Math.max((1 / (depthMm - about.pupil_offset_mm) - far) / (near - far), 0), 1);
  };
  const marks = about.features.map(([depthMm, , [x, y]]) =>
    Studio.svg("circle", { cx: x, cy: y, r: 3, style: `stroke:${colour(levelOf(depthMm))}` }));
  points.append(...marks);
  points.addEventListener("pointermove", (event) => {
    const [x, y] = pixelAt(event);
    const distances = about.features.map(([, , [u, v]]) => Math.hypot(u - x, v - y));
    const nearest = distances.indexOf(Math.min(...distances));
    for (const mark of points.querySelectorAll(".chosen")) mark.classList.remove("chosen");
    seen.replaceChildren();
    if (!(distances[nearest] < NEAR_PX)) return;
    const [depthMm, sigmaMm, , pixels] = about.features[nearest];
    marks[nearest].classList.add("chosen");
    pixels.forEach((pixel, i) => {
      if (!pixel) return;
      const [left, top] = [(i % cols) * width, Math.floor(i / cols) * height];
      seen.append(Studio.svg("circle", { cx: left + pixel[0], cy: top + pixel[1], r: 24 }));
    });
    const count = pixels.filter(Boolean).length;
    byId("feature-text").textContent = `${depthMm} ± ${sigmaMm} mm, found in ${count} of ${rows * cols} views.`;
  });
  document.body.dataset.ready = "true";
})();
