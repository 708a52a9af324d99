"use strict";
// The studio's page: sends changed requests, and draws their responses.
(() => {
  const { element } = Studio;
  const byId = (id) => document.getElementById(id);
  const start = JSON.parse(byId("start").textContent);
  const source = Studio.source;

  const style = () => {
    const read = getComputedStyle(document.documentElement);
    const colour = (name) => read.getPropertyValue(`--${name}`).trim();
    return Object.fromEntries(["mirror", "view", "ray", "ink", "soft", "bad"].map((name) => [name, colour(name)]));
  };

  let view = null;
  try {
    view = new Studio.View3D(byId("stage"), style());
  } catch {
    byId("stage").classList.add("flat");
    byId("flat").hidden = false;
  }
  const state = { drawing: null, parabola: null, depth: null };

  const labels = Object.fromEntries(start.controls.flatMap((group) => group.controls).map(({ name, label }) => [name, label]));
  const canPin = () => {
    byId("pin").disabled = pins.full;
    byId("pin").title = pins.full ? "Four designs are pinned: remove one first" : "Keep this design for comparison";
  };
  const pins = new Studio.Pins(byId("compare"), labels, (spec) => history.settle(spec), canPin);

  // ---- drawing -------------------------------------------------------------------------------------------------
  const comparison = () => (byId("beside").checked ? state.parabola : null);

  const drawCurves = () => {
    const { drawing } = state;
    const other = comparison();
    const both = (name) => [
      ...(other ? [{ values: other.curves[name], depths: other.curves.depths_mm, name: "ghost" }] : []),
      { values: drawing.curves[name], name },
    ];
    const at = { at: state.depth };
    Studio.drawCurves(byId("usable"), "Usable pixels over depth", drawing, both("usable"), { ...at, format: (v) => `${Math.round(100 * v)}%` });
    Studio.drawCurves(byId("disparity"), "Disparity over depth, px per view", drawing, both("disparity_px"), at);
    const lines = [...both("resolution_mm"), ...(drawing.curves.sigma_mm.length ? [{ values: drawing.curves.sigma_mm, name: "sigma" }] : [])];
    Studio.drawCurves(byId("resolution"), "Depth resolution and standard deviation over depth, mm", drawing, lines, { ...at, scale: "log" });
  };

  const drawDepth = () => {
    const { drawing } = state;
    const shared = Studio.drawCoverage(byId("coverage"), drawing, state.depth, comparison());
    const size = shared ? `all views see ${Studio.number(shared[2] - shared[0])} x ${Studio.number(shared[3] - shared[1])} mm` : "no part is visible in all views";
    byId("depth-text").textContent = `${Studio.number(state.depth)} mm: ${size}`;
    view?.light(drawing, state.depth);
    view?.visible();
  };

  const depthRange = (drawing) => [drawing.curves.depths_mm[0], drawing.curves.depths_mm.at(-1)];

  const placeDepth = () => {
    const [near, far] = depthRange(state.drawing);
    const slider = byId("depth");
    state.depth = Math.min(Math.max(state.depth ?? state.drawing.depths_mm.at(-1), near), far);
    slider.min = Math.log(near);
    slider.max = Math.log(far);
    slider.step = (Math.log(far) - Math.log(near)) / 300;
    slider.value = Math.log(state.depth);
  };

  const draw = () => {
    const { drawing } = state;
    placeDepth();
    view?.show(drawing, comparison(), state.depth);
    Studio.drawSensor(byId("sensor"), drawing, comparison());
    Studio.drawCameras(byId("cameras"), drawing, comparison());
    drawCurves();
    drawDepth();
    Studio.drawTiles(byId("tiles"), drawing);
    const columns = [["this design", drawing], ...(state.parabola ? [["faceted parabola", state.parabola]] : [])];
    Studio.drawFigures(byId("figures"), columns);
    if (drawing.kind === "exact") Studio.drawVerdict(byId("verdict"), drawing);
    pins.draw(drawing.kind === "exact" ? drawing : null);
    canPin();
    if (drawing.kind === "exact") refresh(history.spec, drawing.spec);
    document.body.dataset.kind = drawing.kind;
  };

  const say = (kind, text) => {
    const pill = byId("status");
    pill.className = `status ${kind}`;
    pill.textContent = text;
  };

  // ---- requests ------------------------------------------------------------------------------------------------
  const requests = { exact: 0, drawn: 0, busy: false, next: null };

  // Previews are requested one at a time; of those waiting only the newest follows. A preview that arrives after an
  // exact design is not drawn.
  const preview = async (spec, touchedAt) => {
    if (requests.busy) {
      requests.next = [spec, touchedAt];
      return;
    }
    requests.busy = true;
    const drawnBefore = requests.drawn;
    try {
      const answer = await source.preview(spec);
      if (answer?.drawing && requests.drawn === drawnBefore) {
        state.drawing = answer.drawing;
        draw();
        const texts = { parabola: "Preview: the faceted parabola", preview: "Preview" };
        const { kind } = answer.drawing;
        say(kind === "exact" ? "exact" : "preview", texts[kind] ?? passed(answer.drawing));
        if (touchedAt) requestAnimationFrame(() => performance.measure("preview", { start: touchedAt, end: performance.now() }));
      }
    } catch (error) {
      if (!error.refused) lost(error); // the exact design says why
    } finally {
      requests.busy = false;
      const next = requests.next;
      requests.next = null;
      if (next) preview(...next);
    }
  };

  const lost = (error) => {
    if (error.name !== "AbortError") say("failed", `No answer from the studio: ${error.message}`);
  };

  const passed = (drawing) => {
    const failed = drawing.verdict.filter((figure) => !figure.passed).length;
    return failed ? `${failed} of ${drawing.verdict.length} checks failed` : `Exact: all ${drawing.verdict.length} checks pass`;
  };

  const solve = async (spec) => {
    const serial = (requests.exact += 1);
    const startedAt = performance.now();
    say("solving", "Solving \u2026");
    byId("infeasible").hidden = true;
    let answer;
    try {
      answer = await source.design(spec);
    } catch (error) {
      if (serial === requests.exact) lost(error);
      return;
    }
    if (serial !== requests.exact) return;
    if (answer.status === "superseded") {
      lost(new Error("another request of this page came first"));
      return;
    }
    performance.measure("solve", { start: startedAt, end: performance.now() });
    if (answer.status === "solved") {
      Object.assign(state, { drawing: answer.drawing, parabola: answer.parabola });
      requests.drawn += 1;
      draw();
      say("exact", passed(answer.drawing));
      after(spec, serial);
    } else refuse(answer, spec, serial);
    document.dispatchEvent(new CustomEvent("settled", { detail: answer }));
  };

  // Slow results follow after the design.
  const after = async (spec, serial) => {
    if (state.device !== state.drawing.identity) view?.replace("device", null);
    byId("built-option").hidden = state.device !== state.drawing.identity;
    if (!byId("tolerance")) return;
    sight.look();
    byId("tolerance").classList.add("old");
    const study = await source.tolerance(spec).catch((error) => ({ reason: error.message }));
    if (serial !== requests.exact || !study) return;
    byId("tolerance").classList.remove("old");
    Studio.drawTolerance(byId("tolerance"), study);
  };

  const refuse = async (answer, spec, serial) => {
    requests.drawn += 1;
    say("failed", answer.constraint ? "Not feasible" : "Not a request");
    const note = byId("infeasible");
    note.hidden = false;
    const finding = answer.finding;
    byId("infeasible-title").textContent = answer.constraint ? "This design is not feasible" : "This is not a valid request";
    byId("finding").textContent = answer.constraint ? finding.charAt(0).toUpperCase() + finding.slice(1) : finding;
    const list = byId("suggestions");
    list.replaceChildren();
    document.body.dataset.kind = answer.where ? "violated" : "refused";
    if (answer.where) {
      view?.showViolation(answer.where);
      Studio.drawSensor(byId("sensor"), { ...answer.where, common_px: [] });
    }
    if (!answer.constraint) return;
    byId("looking").hidden = false;
    const take = ({ text, spec: other }) => {
      if (serial !== requests.exact) return;
      const button = element("button", { type: "button" }, text);
      button.addEventListener("click", () => history.settle(other));
      list.append(element("li", {}, button));
    };
    await source.suggestions(spec, take).catch(lost);
    if (serial !== requests.exact) return;
    byId("looking").hidden = true;
    if (!list.children.length) list.append(element("li", {}, "No single change makes it feasible."));
  };

  // ---- design request ------------------------------------------------------------------------------------------
  let refresh = () => {};
  const address = () => window.history.replaceState(null, "", `#${Studio.toAddress(history.spec, start.defaults)}`);
  const history = new Studio.History(start.spec, Studio.fromAddress(location.hash, start.defaults, start.spec), (settled) => {
    refresh(history.spec);
    mark(history.spec);
    byId("undo").disabled = !history.past.length;
    byId("redo").disabled = !history.future.length;
    if (settled) {
      address();
      solve(history.spec);
    } else preview(history.spec, Studio.touchedAt);
  });
  Studio.designer = { history, state };
  Studio.view = view;
  const sight = byId("subject") ? new Studio.Sight(byId, () => history.spec) : null;
  const mark = Studio.drawSweep(byId("sweep"), start.sweep, (point) => history.settle(point.spec));
  refresh = Studio.makeControls(byId("controls"), start.controls, history);
  addEventListener("hashchange", () => history.settle(Studio.fromAddress(location.hash, start.defaults, start.spec)));

  byId("undo").addEventListener("click", () => history.undo());
  byId("redo").addEventListener("click", () => history.redo());
  byId("reset").addEventListener("click", () => history.reset());
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.target.matches("input[type=number]")) return;
    const key = event.key.toLowerCase();
    if (key === "z" && !event.shiftKey) history.undo();
    else if (key === "y" || (key === "z" && event.shiftKey)) history.redo();
    else return;
    event.preventDefault();
  });

  byId("depth").addEventListener("input", (event) => {
    if (!state.drawing) return;
    state.depth = Math.exp(event.target.valueAsNumber);
    drawDepth();
    drawCurves();
  });
  byId("pin").addEventListener("click", () => {
    if (state.drawing) pins.pin(state.drawing);
    pins.draw(state.drawing);
    canPin();
  });
  byId("link").addEventListener("click", async () => {
    const button = byId("link");
    await navigator.clipboard.writeText(location.href).then(() => "Copied", () => "See the address").then((text) => (button.textContent = text));
    setTimeout(() => (button.textContent = "Link"), 1500);
  });
  if (byId("make")) {
    const written = byId("make-note").textContent;
    const note = (text) => (byId("make-note").textContent = text);
    const built = (design, address) => {
      if (!view || !state.drawing) return;
      state.device = state.drawing.identity;
      byId("built-option").hidden = false;
      view.device(address, state.drawing.view_from_rig);
    };
    const maker = new Studio.Maker(byId("jobs"), () => history.spec, built);
    const names = { layout: ["layout.json", "application/json"], request: ["design.toml"], report: ["design.html", "text/html"] };
    for (const button of document.querySelectorAll("[data-file]")) {
      button.addEventListener("click", () => maker.file(button.dataset.file, ...names[button.dataset.file]).catch((error) => note(error.message)));
    }
    for (const button of document.querySelectorAll("[data-make]")) {
      button.addEventListener("click", () => {
        note(written);
        maker.start(button.dataset.make, byId("adapter").value).catch((error) => note(error.message));
      });
    }
    byId("open").addEventListener("change", async (event) => {
      const [file] = event.target.files;
      if (!file) return;
      try {
        history.settle(await Studio.post("/opened", { name: file.name, text: await file.text() }));
        note(`${file.name} opened`);
      } catch (error) {
        note(error.message);
      }
      event.target.value = "";
    });
    maker.watch();
  }
  byId("built").addEventListener("change", (event) => {
    if (!view) return;
    view.shown.device = event.target.checked;
    view.visible();
  });
  for (const name of ["rays", "light"]) {
    byId(name).addEventListener("change", (event) => {
      if (!view) return;
      view.shown[name] = event.target.checked;
      if (state.drawing) drawDepth();
    });
  }
  byId("beside").addEventListener("change", () => state.drawing && draw());
  for (const button of document.querySelectorAll("[data-look]")) {
    button.addEventListener("click", () => view?.home(JSON.parse(button.dataset.look)));
  }
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    view?.recolour(style());
    if (state.drawing) draw();
  });

  refresh(history.spec);
  mark(history.spec);
  address();
  byId("undo").disabled = byId("redo").disabled = true;
  preview(history.spec, 0);
  solve(history.spec);
})();
