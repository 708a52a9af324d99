"use strict";
// The camera: shows its pictures, sends orders, and polls the status four times a second, less often after the end of
// the source.
(() => {
  const BINS = 32;
  const POLL_MS = 250;
  const RESTING_MS = 2000;
  const MEASURING = "Measuring … The first answer takes some seconds.";
  const at = Studio.byId;
  const UNTICKED = at("alignment").textContent;
  // Of the camera that is shown.
  let [number, about, names, session] = [0, null, [], null];
  let [overlay, sharpness, histogram, pictures] = [];

  const showError = (error) => {
    at("recorded").textContent = error.message;
  };
  const order = (action, fields) => {
    const ordered = Studio.order(action, fields).catch(showError);
    ordered.then(() => {
      pictures.wake();
      Studio.poll();
    });
    return ordered;
  };
  const allow = (id, reason) => {
    const button = at(id);
    if (!button) return;
    button.disabled = reason !== null;
    button.title = reason ?? "";
  };
  const fileName = (path) => path.split(/[\\/]/).pop();

  // The slider is linear in 1 / depth.
  let [nearest, farthest] = [1, 2];
  const depthOf = (value) => 1 / (1 / nearest + (value / 1000) * (1 / farthest - 1 / nearest));
  const valueOf = (depth) => (1000 * (1 / depth - 1 / nearest)) / (1 / farthest - 1 / nearest);
  const focus = at("focus");
  const focusText = () => {
    const text = `${depthOf(focus.value).toFixed(0)} mm`;
    at("focus-text").textContent = `in focus at ${text} from the camera's pupil; the slider goes from ${nearest.toFixed(0)} to ${farthest.toFixed(0)} mm`;
    focus.setAttribute("aria-valuetext", text);
  };

  // Show a camera that was opened, here or on another page.
  const showCamera = async () => {
    const { session: answer } = await (await fetch("/camera")).json();
    if (!answer || answer.number === number) return;
    pictures?.stop();
    ({ number, about } = answer);
    session = answer;
    names = Object.keys(answer.outlines);
    for (const [kind, [width, height]] of Object.entries(about.sizes_px)) at(`${kind}-shape`).style.aspectRatio = `${width} / ${height}`;
    at("session").hidden = false;
    at("opening").open = false;
    overlay = new Studio.Overlay(at("overlay"), about, answer.outlines);
    sharpness = Studio.sharpness(at("sharpness"), names, about.grid);
    histogram = Studio.histogram(at("histogram"), BINS);
    pictures = new Studio.Pictures(about);
    [nearest, farthest] = [Math.max(about.near_mm, about.least_focus_mm + 1), about.far_mm * 2];
    focus.value = valueOf(about.reference_mm);
    focusText();
    at("near").textContent = `${about.near_mm.toFixed(0)} mm`;
    at("far").textContent = `${about.far_mm.toFixed(0)} mm`;
    const [width, height] = about.sizes_px.refocus;
    at("views-text").textContent = `${about.grid[0]} × ${about.grid[1]} views of ${width} × ${height} px, upright`;
    at("ended").textContent = `${about.source} has ended: its last frame stays`;
    at("again").hidden = about.kind === "camera";
    document.querySelectorAll(".with-board").forEach((node) => (node.hidden = !answer.board));
    document.querySelectorAll(".without-board").forEach((node) => (node.hidden = answer.board));
    at("depth-text").textContent = "starting …";
    [taken, taking] = [0, null];
  };

  const refocus = Studio.newest(() => order("focus", { depth_mm: depthOf(focus.value) }));
  focus.addEventListener("input", () => {
    focusText();
    refocus();
  });

  let pointer = null;
  let [hasMoved, resting] = [false, false];
  at("depth").addEventListener("pointermove", (event) => {
    pointer = Studio.placeOf(event);
    hasMoved = true;
    if (resting) Studio.poll();
    resting = false;
  });
  at("depth").addEventListener("pointerleave", () => { pointer = null; });
  at("depth").addEventListener("click", async (event) => {
    const depth = await depthAt(...Studio.placeOf(event));
    if (depth === null) return;
    focus.value = valueOf(depth);
    focusText();
    order("focus", { depth_mm: depth });
  });
  const depthAt = async (right, down) => {
    const answer = await fetch(`/depth?right=${right.toFixed(4)}&down=${down.toFixed(4)}`);
    return answer.ok ? (await answer.json()).depth_mm : null;
  };

  at("outlines").addEventListener("change", (event) => overlay.show(event.target.checked));
  // A status from before a click on the checkbox is not shown after it.
  let ticks = 0;
  let ticking = false;
  at("align").addEventListener("change", async (event) => {
    const tick = (ticks += 1);
    ticking = true;
    if (event.target.checked) {
      at("alignment").textContent = MEASURING;
      at("tilts").replaceChildren();
    } else at("alignment").textContent = at("tilts").children.length ? at("alignment").textContent : UNTICKED;
    await order("align", { on: event.target.checked });
    if (tick === ticks) ticking = false;
  });
  at("reset-sharpness").addEventListener("click", () => order("reset_focus"));
  at("record").addEventListener("click", () => order(at("record").classList.contains("on") ? "stop_recording" : "record"));
  at("again").addEventListener("click", () => order("play_again"));
  at("take").addEventListener("click", () => {
    taking = at("hint").textContent;
    at("hint").textContent = "Taking the next frame …";
    Studio.order("take_picture").catch((error) => {
      showError(error);
      at("hint").textContent = taking;
      taking = null;
    });
  });
  at("calibrate").addEventListener("click", () => Studio.post("/calibrate", {}).then(Studio.poll, showError));

  let taken = 0;
  let taking = null; // the hint before a picture that is being taken

  const showMeters = (status) => {
    sharpness(status.sharpness);
    if (!status.exposure) return;
    histogram(status.exposure.histogram);
    at("advice").textContent = `exposure: ${status.exposure.advice}`;
  };

  // Report a saved picture at once, and the board in it when it has been found.
  const showHint = (status) => {
    if (taking !== null) {
      if (status.pictures === taken && !status.over) return;
      at("hint").textContent = taking;
      taking = null;
    }
    taken = status.pictures;
    if (!status.taken) return;
    const { hint } = status;
    const name = fileName(status.taken);
    const result = hint?.picture === name ? `${hint.views} of ${names.length} mirrors show the board; ${hint.sentence}` : status.failed_parts.setup ?? "finding the board in it …";
    const text = `Picture ${status.pictures_kept} is saved, ${name}: ${result}`;
    if (text !== at("hint").textContent) at("hint").textContent = text;
  };

  const allowButtons = (status, calibrating) => {
    const { pictures_kept: kept } = status;
    const ended = status.failed ? "the session has ended" : status.over ? `${about.source} has ended: play it again first` : null;
    allow("again", status.over && !status.failed ? null : status.failed ? "the session has ended" : `${about.source} is playing`);
    allow("record", status.recording ? null : ended);
    allow("take", ended);
    const few = kept < session.min_pictures ? `${kept} calibration pictures so far, calibration needs ${session.min_pictures} or more` : null;
    allow("calibrate", calibrating ? "a calibration is running" : few);
  };

  const showFiles = (status, calibrating) => {
    allowButtons(status, calibrating);
    at("record").classList.toggle("on", status.recording !== null);
    at("record").textContent = status.recording ? "Stop recording" : "Record";
    if (status.recording) at("recorded").textContent = `recording ${status.recording}: ${status.recorded} frames${status.not_recorded ? `, ${status.not_recorded} lost` : ""}`;
    else if (status.lines.length) at("recorded").textContent = status.lines[status.lines.length - 1];
    if (session.board) showHint(status);
  };

  const showAlignment = (status) => {
    const { alignment, aligning } = status;
    overlay.edges(at("align").checked ? alignment : null);
    if (!alignment) {
      const ended = status.over ? `${about.source} has ended: play it again to compare the mirrors.` : MEASURING;
      if (aligning !== "off") at("alignment").textContent = status.failed_parts.setup ?? (aligning === "waiting" ? ended : MEASURING);
      return;
    }
    at("alignment").textContent = `By edges: ${alignment.camera}. By points: ${alignment.points} matched. A mirror tilted to the right turns its view to the right, by twice as much.`;
    Studio.drawTilts(at("tilts"), alignment);
  };

  const slow = (status) => status.latency_ms > 300 || (status.frames > 20 && status.dropped > status.frames);

  const show = (status, ticked, calibrating) => {
    const line = at("camera-status");
    const late = status.latency_ms === null ? "" : `, ${status.latency_ms.toFixed(0)} ms late`;
    line.className = `status ${status.failed ? "failed" : status.over ? "preview" : status.frames ? (slow(status) ? "preview" : "exact") : "solving"}`;
    line.textContent = status.failed ? "Ended" : status.over ? `${about.source} has ended` : status.frames ? `${status.rate_hz.toFixed(0)} pictures/s${late}` : `Waiting for ${about.source} …`;
    pictures.note(status);
    line.title = slow(status) ? "Most frames are dropped: this computer is too slow for all panels, or busy. Recordings keep every frame." : "";
    at("ended").hidden = !status.over || Boolean(status.failed);
    at("failed").hidden = !status.failed;
    at("failed").textContent = status.failed ?? "";
    const outages = status.outages ? `, disconnected ${status.outages} times` : "";
    at("counts").textContent = `frame ${status.frames}, ${status.dropped} dropped, ${status.lost} lost${outages}; ${(status.memory_mb ?? 0).toFixed(0)} MB`;
    if (!pointer) at("depth-text").textContent = depthText(status);
    showMeters(status);
    showFiles(status, calibrating);
    if (document.activeElement !== focus && Math.abs(valueOf(status.focus_mm) - focus.value) > 1) {
      focus.value = valueOf(status.focus_mm);
      focusText();
    }
    if (!ticking && ticked === ticks) {
      at("align").checked = status.aligning !== "off";
      showAlignment(status);
    }
  };

  const depthText = (status) => {
    if (status.failed_parts.depth) return status.failed_parts.depth;
    if (!at("depth").dataset.serial) return "starting …";
    const unknown = about.layout_kind === "nominal" ? "unknown at the centre: calibrate first" : "unknown at the centre";
    const centre = status.depth_median_mm === null ? unknown : `${status.depth_median_mm.toFixed(0)} mm at the centre; click to focus there`;
    return status.over ? centre : `${status.depth_hz.toFixed(1)} a second, ${centre}`;
  };

  let ticked = 0;
  Studio.watch((state) => {
    const status = state?.camera;
    if (!state) {
      at("camera-status").className = "status failed";
      at("camera-status").textContent = "The server has ended";
    }
    if (!status) return undefined;
    if (status.number !== number) {
      showCamera().then(Studio.poll);
      return POLL_MS;
    }
    const calibrating = state.jobs.some((job) => job.kind === "calibration" && job.state === "running");
    show(status, ticked, calibrating);
    ticked = ticking ? -1 : ticks;
    resting = at("camera").hidden || (pictures.rest && !hasMoved);
    hasMoved = false;
    if (pointer && !resting) {
      depthAt(...pointer).then((depth) => {
        if (pointer) at("depth-text").textContent = depth === null ? "unknown there" : `${depth} mm there; click to focus`;
      });
    }
    return resting ? RESTING_MS : POLL_MS;
  });

  // ---- opening a camera ----------------------------------------------------------------------------------------
  const offerLayouts = async () => {
    const { layouts } = await (await fetch("/camera")).json();
    const kept = at("layout").value;
    at("layout").replaceChildren(at("layout").firstElementChild, ...layouts.map((path) => Studio.element("option", { value: path }, path)));
    at("layout").value = kept;
  };
  at("layout").addEventListener("focus", offerLayouts);
  at("open-camera").addEventListener("submit", async (event) => {
    event.preventDefault();
    const layout = at("layout").value;
    const work = Studio.working(at("open-note"), "Opening", () => Studio.cancel("/camera"));
    try {
      await Studio.postNewest("/camera", { source: at("source").value, board: at("board").value, ...(layout ? { layout } : { spec: Studio.designer.history.spec }) });
      at("open-note").textContent = `${at("source").value} is open`;
      Studio.poll();
    } catch (error) {
      at("open-note").textContent = error.message;
    } finally {
      work.end();
    }
  });
})();
