"use strict";
// The studio's page: sends changed requests, and draws their responses.
(() => {
  const { byId, element } = Studio;
  const start = JSON.parse(byId("start").textContent);
  const source = Studio.source;
  Studio.defaults = start.defaults;
  const groups = start.controls.flatMap((group) => group.controls);
  Studio.compared = start.compared;
  const units = Object.fromEntries(groups.map(({ name, unit }) => [name, unit]));
  // A field of a request in words.
  Studio.withUnit = (value, name) => {
    const text = [value].flat().map((each) => (typeof each === "number" ? Studio.number(each, 4) : (each?.name ?? String(each ?? "")).replace("stock:", "in stock: ").replaceAll(",", ", "))).join(", ");
    const unit = typeof value === "string" ? "" : (units[name] ?? "");
    return `${text}${unit === "\u00b0" ? "" : " "}${unit}`.trim();
  };
  Studio.named = Object.fromEntries(groups.filter(({ name }) => name === "camera" || name === "pattern").map(({ name, named }) => [name, named]));

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
  const state = { drawing: null, depth: null };

  const labels = Object.fromEntries(groups.map(({ name, label }) => [name, label]));
  const exact = () => (state.drawing?.kind === "exact" ? state.drawing : null);
  const showPins = () => {
    const button = byId("pin");
    const pinned = exact() && pins.has(exact());
    button.disabled = !exact() || pinned || pins.full;
    button.textContent = pinned ? "Pinned" : pins.full ? "4 pinned" : "Pin";
    button.title = pinned ? "This design is pinned: see Compare" : pins.full ? "Remove a pinned design first: see Compare" : exact() ? "Keep this design for comparison" : "Only a solved design can be pinned";
    pins.draw(exact());
    showJumps();
  };
  const pins = new Studio.Pins(byId("compare"), labels, (spec) => history.settle(spec), () => {
    if (state.drawing) drawFigures();
    showPins();
  });

  // The design to compare with: the one pinned last, else the solved one before.
  const reference = () => {
    const pin = pins.pinned.at(-1);
    if (pin && pin.drawing.identity !== state.drawing.identity) return pin;
    const last = state.solved?.identity === state.drawing.identity ? state.before : state.solved;
    return last ? { name: "the last design", drawing: last } : null;
  };

  const showJumps = () => {
    for (const button of document.querySelectorAll("[data-to]")) {
      const target = byId(button.dataset.to);
      button.hidden = !target || target.hidden;
    }
  };
  for (const button of document.querySelectorAll("[data-to]")) {
    button.addEventListener("click", () => {
      const target = byId(button.dataset.to);
      target.tabIndex = -1;
      target.focus({ preventScroll: true });
      target.scrollIntoView({ behavior: "smooth" });
    });
  }

  // ---- drawing -------------------------------------------------------------------------------------------------
  const comparison = () => (byId("beside").checked ? reference()?.drawing : null);

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
    byId("plane-text").textContent = `${Studio.number(state.depth)} mm: ${size}`;
    byId("plane").setAttribute("aria-valuetext", `${Studio.number(state.depth)} mm`);
    view?.light(drawing, state.depth);
    view?.visible();
  };

  const depthRange = (drawing) => [drawing.curves.depths_mm[0], drawing.curves.depths_mm.at(-1)];

  const placeDepth = () => {
    const [near, far] = depthRange(state.drawing);
    const slider = byId("plane");
    const depths = state.drawing.depths_mm;
    if (!Studio.same(depths, state.depths)) Object.assign(state, { depths, depth: depths.at(-1) });
    state.depth = Math.min(Math.max(state.depth, near), far);
    slider.min = Math.log(near);
    slider.max = Math.log(far);
    slider.step = (Math.log(far) - Math.log(near)) / 300;
    slider.value = Math.log(state.depth);
  };

  const drawFigures = () => {
    const [{ drawing }, other] = [state, reference()];
    Studio.drawTiles(byId("tiles"), drawing, other);
    Studio.drawFigures(byId("figures"), [["this design", drawing], ...(other ? [[other.name, other.drawing]] : [])]);
  };

  const draw = () => {
    const { drawing } = state;
    placeDepth();
    view?.show(drawing, comparison(), state.depth);
    Studio.drawSensor(byId("sensor"), drawing, comparison());
    Studio.drawCameras(byId("cameras"), drawing, comparison());
    drawCurves();
    drawDepth();
    drawFigures();
    if (drawing.kind === "exact") Studio.drawVerdict(byId("verdict"), drawing);
    byId("verdict").classList.toggle("old", drawing.kind !== "exact");
    if (byId("made")) {
      byId("made").textContent = `Build ${drawing.title}`;
      Studio.drawSensor(byId("made-drawing"), drawing);
    }
    showPins();
    if (drawing.kind === "exact") refresh(history.spec, drawing.spec);
    document.body.classList.remove("stale");
    document.body.dataset.kind = drawing.kind;
    showDevice();
  };

  // The device is shown whenever the parts of the design shown are built.
  let maker = null;
  const showDevice = () => {
    const address = document.body.dataset.kind === "exact" && maker?.device(state.drawing);
    byId("built-option").hidden = !address;
    view?.device(address, state.drawing?.view_from_rig);
  };

  const say = (kind, text) => {
    const pill = byId("status");
    pill.className = `status ${kind}`;
    pill.textContent = text;
  };

  // ---- requests ------------------------------------------------------------------------------------------------
  const requests = { exact: 0, drawn: 0, shown: null, timer: null };
  const PREVIEWS = { parabola: "Preview: the faceted parabola", preview: "Preview" };

  const showSolving = () => {
    const seconds = (performance.now() - requests.startedAt) / 1000;
    const time = seconds < 1 ? "" : ` ${seconds.toFixed(0)} s`;
    const preview = PREVIEWS[requests.shown];
    say(preview ? "preview" : "solving", preview ? `${preview}, solving \u2026${time}` : `Solving \u2026${time}`);
  };
  const solving = (on) => {
    clearInterval(requests.timer);
    requests.timer = null;
    byId("cancel").hidden = !on;
    byId("cancel").textContent = "Cancel";
    byId("progress").hidden = !on;
    if (!on) return;
    byId("progress").value = 0;
    Object.assign(requests, { startedAt: performance.now(), shown: null, timer: setInterval(showSolving, 500) });
    document.body.classList.add("stale");
    for (const id of ["verdict", "tolerance", "sight"]) byId(id)?.classList.add("old");
    Studio.drawSteps(state.drawing, [], null);
    showSolving();
  };

  // A preview that arrives after an exact design is not drawn.
  const preview = Studio.newest(async (spec, touchedAt) => {
    const drawnBefore = requests.drawn;
    try {
      const answer = await source.preview(spec);
      if (answer?.drawing && requests.drawn === drawnBefore) {
        state.drawing = answer.drawing;
        draw();
        const { kind } = answer.drawing;
        requests.shown = kind;
        if (requests.timer) showSolving();
        else say(kind === "exact" ? "exact" : "preview", PREVIEWS[kind] ?? passed(answer.drawing));
        if (touchedAt) requestAnimationFrame(() => performance.measure("preview", { start: touchedAt, end: performance.now() }));
      }
    } catch (error) {
      if (!error.refused) lost(error); // the exact design says why
    }
  });

  const lost = (error) => {
    if (error.name !== "AbortError") say("failed", `No answer from the studio: ${error.message}`);
  };

  const passed = (drawing) => {
    const failed = drawing.verdict.filter((figure) => !figure.passed).length;
    return failed ? `${failed} of ${drawing.verdict.length} checks failed` : `Exact: all ${drawing.verdict.length} checks pass`;
  };

  const solve = async (spec) => {
    const serial = (requests.exact += 1);
    solving(true);
    byId("infeasible").hidden = true;
    let answer;
    try {
      answer = await source.design(spec, (share) => serial === requests.exact && (byId("progress").value = share));
    } catch (error) {
      if (serial === requests.exact) {
        solving(false);
        lost(error);
      }
      return;
    }
    if (serial !== requests.exact) return;
    preview.forget(); // it would replace the answer
    performance.measure("solve", { start: requests.startedAt, end: performance.now() });
    solving(false);
    if (!answer) {
      lost(new Error("another request of this page came first"));
      return;
    }
    if (answer.status === "solved") {
      if (state.solved && state.solved.identity !== answer.drawing.identity) state.before = state.solved;
      Object.assign(state, { drawing: answer.drawing, solved: answer.drawing });
      requests.drawn += 1;
      draw();
      say("exact", passed(answer.drawing));
      after(spec, serial);
    } else refuse(answer, spec, serial);
    document.dispatchEvent(new CustomEvent("settled", { detail: answer }));
  };
  byId("cancel").addEventListener("click", () => {
    if (!requests.timer) {
      solve(history.spec);
      return;
    }
    requests.exact += 1;
    source.cancel();
    solving(false);
    say("preview", "Not solved");
    Object.assign(byId("cancel"), { hidden: false, textContent: "Solve" });
  });

  // Neighbours are solved ahead: show them as they come, for as long as this design is shown.
  const LONGEST_WAIT_MS = 15_000;
  const followNearby = async (spec, serial) => {
    const isShown = () => serial === requests.exact && state.drawing.kind === "exact";
    for (let wait = 1500; isShown(); wait = Math.min(1.3 * wait, LONGEST_WAIT_MS)) {
      const nearby = await source.nearby(spec, Studio.target?.terms).catch(() => null);
      if (!nearby || !isShown()) return;
      Studio.markTiles(byId("tiles"), nearby.points.find(({ changes }) => !Object.keys(changes).length)?.misses ?? []);
      map.show(nearby, spec);
      Studio.drawSteps(state.drawing, nearby.points, (next) => history.settle(next));
      if (!nearby.pending) return;
      await new Promise((resolve) => setTimeout(resolve, wait));
    }
  };

  // Slow results follow after the design.
  const after = async (spec, serial) => {
    followNearby(spec, serial);
    if (!byId("tolerance")) return;
    byId("sight").classList.remove("old");
    sight.look();
    const study = await source.tolerance(spec).catch((error) => ({ reason: error.message }));
    if (serial !== requests.exact || !study) return;
    byId("tolerance").classList.remove("old");
    Studio.drawTolerance(byId("tolerance"), study);
  };

  // A refusal in words: the label of a field instead of its name, and limits instead of the validator's phrases.
  const PHRASES = [
    [/Input should be greater than or equal to /g, "expected at least "],
    [/Input should be less than or equal to /g, "expected at most "],
    [/Input should be (?:a valid )?/g, "expected "],
    [/ \(and \d+ more\)/g, ""],
  ];
  const plain = (finding) => {
    const text = PHRASES.reduce((all, [phrase, words]) => all.replace(phrase, words), finding);
    return text.replace(/^([a-z_]+)(?=[:.] ?)/, (name) => ({ ...labels, rows: "Rows", cols: "Columns" })[name] ?? name);
  };

  const refuse = async (answer, spec, serial) => {
    requests.drawn += 1;
    document.body.classList.remove("stale");
    byId("pin").disabled = true;
    say("failed", answer.constraint ? "Not feasible" : "Invalid request");
    const note = byId("infeasible");
    note.hidden = false;
    const finding = answer.finding;
    byId("infeasible-title").textContent = answer.constraint ? "This design is not feasible" : "This is not a valid request";
    byId("finding").textContent = plain(answer.constraint ? finding.charAt(0).toUpperCase() + finding.slice(1) : finding);
    const list = byId("suggestions");
    list.replaceChildren();
    document.body.dataset.kind = answer.where ? "violated" : "refused";
    showDevice();
    if (answer.where) {
      view?.showViolation(answer.where);
      Studio.drawSensor(byId("sensor"), { ...answer.where, common_px: [] });
    }
    byId("looking").hidden = !answer.constraint;
    if (!answer.constraint) return;
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
  const tabOf = (hash) => new URLSearchParams(hash.replace(/^#/, "")).get("tab");
  const designOf = (hash) => {
    const parts = new URLSearchParams(hash.replace(/^#/, ""));
    parts.delete("tab");
    return Studio.fromAddress(parts.size ? `#${parts}` : "", Studio.defaults, start.spec);
  };
  // Shown on the tab of the camera, a design is not solved until it is looked at.
  let waits = false;
  const tab = () => byId("tabs")?.dataset.shown ?? "design";
  const address = () => {
    const shown = tab() === "design" ? "" : `tab=${tab()}&`;
    window.history.replaceState(null, "", `#${shown}${Studio.toAddress(history.spec, Studio.defaults)}`);
  };
  const history = new Studio.History(start.spec, designOf(location.hash), (settled) => {
    refresh(history.spec);
    Studio.target?.outdate(history.spec);
    byId("undo").disabled = !history.past.length;
    byId("redo").disabled = !history.future.length;
    if (settled) {
      address();
      if (tab() === "camera") {
        waits = true;
        return;
      }
      solve(history.spec);
    }
    preview(history.spec, settled ? 0 : Studio.touchedAt);
  });
  Studio.designer = { history, state };
  Studio.view = view;
  const sight = byId("subject") ? new Studio.Sight(() => history.spec) : null;
  if (byId("target")) Studio.findTargets(byId("target-form"), byId("target-note"), byId("targets"), () => history.spec, (spec) => history.settle(spec), () => exact() && followNearby(history.spec, requests.exact));
  const map = new Studio.DesignMap(byId("map"), (spec) => history.settle(spec));
  refresh = Studio.makeControls(byId("controls"), start.controls, history);
  addEventListener("hashchange", () => {
    showTab(tabOf(location.hash) ?? "design");
    history.settle(designOf(location.hash));
  });

  byId("infeasible-close").addEventListener("click", () => (byId("infeasible").hidden = true));
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

  byId("plane").addEventListener("input", (event) => {
    if (!state.drawing) return;
    const depth = Math.exp(event.target.valueAsNumber);
    state.depth = state.depths.find((working) => Math.abs(Math.log(working / depth)) < event.target.step) ?? depth;
    drawDepth();
    drawCurves();
  });
  byId("pin").addEventListener("click", () => exact() && pins.pin(exact()));
  byId("link").addEventListener("click", async () => {
    const button = byId("link");
    await navigator.clipboard.writeText(location.href).then(() => "Copied", () => "See the address").then((text) => (button.textContent = text));
    setTimeout(() => (button.textContent = "Link"), 1500);
  });
  if (byId("make")) {
    const written = byId("make-note").textContent;
    const note = (text) => (byId("make-note").textContent = text);
    const hosts = [[byId("jobs"), (kind) => kind !== "calibration"], [byId("calibrations"), (kind) => kind === "calibration"]];
    maker = new Studio.Maker(hosts, () => history.spec, showDevice);
    const names = { layout: ["layout.json", "application/json"], request: ["design.toml"] };
    for (const button of document.querySelectorAll("[data-file]")) {
      const kind = button.dataset.file;
      const save = () => (kind === "report" ? maker.report(button, byId("report-note"), state.drawing) : maker.file(kind, ...names[kind]));
      button.addEventListener("click", () => save().catch((error) => note(error.message)));
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
  }
  byId("built").addEventListener("change", (event) => {
    if (!view) return;
    view.shown.device = event.target.checked;
    view.visible();
  });
  byId("fit").addEventListener("click", () => view?.fit());
  for (const name of ["rays", "light", "scale"]) {
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

  // ---- tabs ----------------------------------------------------------------------------------------------------
  const buttons = [...document.querySelectorAll("[data-tab]")];
  const showTab = (name) => {
    if (!buttons.length) return;
    const shown = buttons.some((button) => button.dataset.tab === name) ? name : "design";
    byId("tabs").dataset.shown = shown;
    for (const button of buttons) {
      const current = button.dataset.tab === shown;
      button.setAttribute("aria-selected", current);
      button.tabIndex = current ? 0 : -1;
      byId(button.dataset.tab).hidden = !current;
    }
    document.querySelectorAll("[data-on]").forEach((node) => node.toggleAttribute("data-away", !node.dataset.on.includes(shown)));
    scrollTo(0, 0);
    document.dispatchEvent(new CustomEvent("tab"));
    Studio.poll();
    if (waits && shown !== "camera") {
      waits = false;
      preview(history.spec, 0);
      solve(history.spec);
    }
  };
  for (const button of buttons) {
    button.addEventListener("click", () => {
      showTab(button.dataset.tab);
      address();
    });
    button.addEventListener("keydown", ({ key }) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!step) return;
      const next = buttons[(buttons.indexOf(button) + step + buttons.length) % buttons.length];
      next.focus();
      next.click();
    });
  }

  refresh(history.spec);
  byId("undo").disabled = byId("redo").disabled = true;
  waits = true;
  showTab(tabOf(location.hash) ?? "design");
  showJumps();
  address();
  document.body.classList.remove("unready");
  if (!buttons.length) {
    preview(history.spec, 0);
    solve(history.spec);
  }
})();
