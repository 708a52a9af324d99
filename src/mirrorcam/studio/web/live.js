"use strict";
// The live page: shows pictures of the camera, sends orders, and polls the status four times a second, less often after
// the end of the source.
(() => {
  const BINS = 32;
  const POLL_MS = 250;
  const RESTING_MS = 2000;
  const MEASURING = "Measuring … The first answer takes some seconds.";
  const start = JSON.parse(document.getElementById("start").textContent);
  const { about } = start;
  const at = (id) => document.getElementById(id);
  const UNTICKED = at("camera").textContent;
  const names = Object.keys(start.outlines);
  const overlay = new Studio.Overlay(at("overlay"), about, start.outlines);
  const sharpness = new Studio.Sharpness(at("sharpness"), names, about.grid);
  const histogram = new Studio.Histogram(at("histogram"), BINS);
  const pictures = new Studio.Pictures(about);
  let wakeStatus = () => {};

  const showError = (error) => {
    at("recorded").textContent = error.message;
  };
  const order = (action, fields) => {
    const ordered = Studio.order(action, fields).catch(showError);
    ordered.then(() => {
      pictures.wake();
      wakeStatus();
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
  const [nearest, farthest] = [Math.max(about.near_mm, about.least_focus_mm + 1), about.far_mm * 2];
  const depthOf = (value) => 1 / (1 / nearest + (value / 1000) * (1 / farthest - 1 / nearest));
  const valueOf = (depth) => (1000 * (1 / depth - 1 / nearest)) / (1 / farthest - 1 / nearest);
  const focus = at("focus");
  const focusText = () => {
    const text = `${depthOf(focus.value).toFixed(0)} mm`;
    at("focus-text").textContent = `in focus at ${text} from the camera's pupil; the slider goes from ${nearest.toFixed(0)} to ${farthest.toFixed(0)} mm`;
    focus.setAttribute("aria-valuetext", text);
  };
  focus.value = valueOf(about.reference_mm);
  focusText();
  let ordered = Promise.resolve();
  let waiting = false;
  focus.addEventListener("input", () => {
    focusText();
    if (waiting) return;
    waiting = true;
    ordered = ordered.then(() => {
      waiting = false;
      return order("focus", { depth_mm: depthOf(focus.value) });
    });
  });

  at("near").textContent = `${about.near_mm.toFixed(0)} mm`;
  at("far").textContent = `${about.far_mm.toFixed(0)} mm`;
  let pointer = null;
  let hasMoved = false;
  at("depth").addEventListener("pointermove", (event) => {
    const box = event.target.getBoundingClientRect();
    pointer = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    hasMoved = true;
    wakeStatus();
  });
  at("depth").addEventListener("pointerleave", () => { pointer = null; });
  at("depth").addEventListener("click", async (event) => {
    const box = event.target.getBoundingClientRect();
    const depth = await depthAt((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
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
      at("camera").textContent = MEASURING;
      at("tilts").replaceChildren();
    } else at("camera").textContent = at("tilts").children.length ? at("camera").textContent : UNTICKED;
    await order("align", { on: event.target.checked });
    if (tick === ticks) ticking = false;
  });
  at("reset").addEventListener("click", () => order("reset_focus"));
  at("record").addEventListener("click", () => order(at("record").classList.contains("on") ? "stop_recording" : "record"));
  at("again")?.addEventListener("click", () => order("play_again"));
  at("take")?.addEventListener("click", () => {
    taking = at("hint").textContent;
    at("hint").textContent = "Taking the next frame …";
    Studio.order("take_picture").catch((error) => {
      showError(error);
      at("hint").textContent = taking;
      taking = null;
    });
  });
  at("calibrate")?.addEventListener("click", () => order("calibrate"));

  const STATES = { running: "calibrating …", done: "calibrated", alarm: "calibrated, with an alarm", failed: "no calibration", cancelled: "cancelled" };
  let drawn = "";
  let taken = 0;
  let taking = null; // the hint before a picture that is being taken

  const showMeters = (status) => {
    sharpness.show(status.sharpness);
    if (!status.exposure) return;
    histogram.show(status.exposure.histogram);
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

  const allowButtons = (status) => {
    const { calibration, pictures_kept: kept } = status;
    const ended = status.failed ? "the session has ended" : status.over ? `${about.source} has ended: play it again first` : null;
    allow("again", status.over && !status.failed ? null : status.failed ? "the session has ended" : `${about.source} is playing`);
    allow("record", status.recording ? null : ended);
    allow("take", ended);
    const few = kept < start.least_pictures ? `${kept} calibration pictures so far, calibration needs ${start.least_pictures} or more` : null;
    allow("calibrate", calibration?.state === "running" ? "a calibration is running" : few);
  };

  const showFiles = (status) => {
    allowButtons(status);
    at("record").classList.toggle("on", status.recording !== null);
    at("record").textContent = status.recording ? "Stop recording" : "Record";
    if (status.recording) at("recorded").textContent = `recording ${status.recording[0]}: ${status.recording[1]} frames${status.recording[2] ? `, ${status.recording[2]} lost` : ""}`;
    else if (status.lines.length) at("recorded").textContent = status.lines[status.lines.length - 1];
    if (!start.board) return;
    showHint(status);
    const { calibration } = status;
    if (!calibration) return;
    const link = calibration.page ? [" ", Studio.element("a", { href: calibration.page, target: "_blank", rel: "noopener" }, "Report")] : [];
    const words = STATES[calibration.state];
    if (drawn !== `${words}${calibration.page}`) {
      drawn = `${words}${calibration.page}`;
      at("calibration").replaceChildren(words, ...link);
    }
    at("lines").textContent = calibration.lines.join("\n");
  };

  const showAlignment = (status) => {
    const { alignment, aligning } = status;
    overlay.edges(at("align").checked ? alignment : null);
    if (!alignment) {
      const ended = status.over ? `${about.source} has ended: play it again to compare the mirrors.` : MEASURING;
      if (aligning !== "off") at("camera").textContent = status.failed_parts.setup ?? (aligning === "waiting" ? ended : MEASURING);
      return;
    }
    at("camera").textContent = `By edges: ${alignment.camera}. By points: ${alignment.points} matched. A mirror tilted to the right turns its view to the right, by twice as much.`;
    Studio.drawTilts(at("tilts"), alignment);
  };

  const show = (status, ticked) => {
    const line = at("status");
    const late = status.latency_ms === null ? "" : `, ${status.latency_ms.toFixed(0)} ms late`;
    line.className = `status ${status.failed ? "failed" : status.over ? "preview" : status.frames ? "exact" : "solving"}`;
    line.textContent = status.failed ? "Ended" : status.over ? `${about.source} has ended` : status.frames ? `${status.rate_hz.toFixed(0)} pictures/s${late}` : `Waiting for ${about.source} …`;
    pictures.note(status);
    at("ended").hidden = !status.over || Boolean(status.failed);
    at("failed").hidden = !status.failed;
    at("failed").textContent = status.failed ?? "";
    const outages = status.outages ? `, disconnected ${status.outages} times` : "";
    at("counts").textContent = `frame ${status.frames}, ${status.dropped} dropped, ${status.lost} lost${outages}; ${(status.memory_mb ?? 0).toFixed(0)} MB`;
    if (!pointer) at("depth-text").textContent = depthText(status);
    showMeters(status);
    showFiles(status);
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

  // Poll less often after the end of the source or server, until the user acts.
  const rest = (resting) => new Promise((resolve) => {
    setTimeout(resolve, resting ? RESTING_MS : POLL_MS);
    if (resting) wakeStatus = resolve;
  });

  const follow = async () => {
    for (;;) {
      let resting = true;
      const touched = hasMoved;
      hasMoved = false;
      try {
        const ticked = ticking ? -1 : ticks;
        const status = await (await fetch("/status")).json();
        show(status, ticked);
        resting = pictures.rest && status.calibration?.state !== "running" && !touched;
        if (pointer && !resting) {
          const depth = await depthAt(...pointer);
          at("depth-text").textContent = depth === null ? "unknown there" : `${depth} mm there; click to focus`;
        }
      } catch {
        at("status").className = "status failed";
        at("status").textContent = "The server has ended";
      }
      await rest(resting);
      wakeStatus = () => {};
    }
  };
  follow();
})();
