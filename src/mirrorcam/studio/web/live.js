"use strict";
// The live page: pictures follow the camera, controls order, and the status is shown four times a second.
(() => {
  const BINS = 32;
  const POLL_MS = 250;
  const start = JSON.parse(document.getElementById("start").textContent);
  const { about } = start;
  const at = (id) => document.getElementById(id);
  const names = Object.keys(start.outlines);
  const overlay = new Studio.Overlay(at("overlay"), about, start.outlines);
  const sharpness = new Studio.Sharpness(at("sharpness"), names, about.grid);
  const histogram = new Studio.Histogram(at("histogram"), BINS);
  new Studio.Pictures(about);

  const told = (error) => {
    at("recorded").textContent = error.message;
  };
  const order = (action, fields) => Studio.order(action, fields).catch(told);

  // The slider is even in 1 / depth, as focus is.
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
  let pointed = null;
  at("depth").addEventListener("pointermove", (event) => {
    const box = event.target.getBoundingClientRect();
    pointed = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  });
  at("depth").addEventListener("pointerleave", () => { pointed = null; });
  at("depth").addEventListener("click", async (event) => {
    const box = event.target.getBoundingClientRect();
    const found = await depthAt((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height);
    if (found === null) return;
    focus.value = valueOf(found);
    focusText();
    order("focus", { depth_mm: found });
  });
  const depthAt = async (right, down) => {
    const answer = await fetch(`/depth?right=${right.toFixed(4)}&down=${down.toFixed(4)}`);
    return answer.ok ? (await answer.json()).depth_mm : null;
  };

  at("outlines").addEventListener("change", (event) => overlay.show(event.target.checked));
  at("align").addEventListener("change", (event) => order("align", { on: event.target.checked }));
  at("reset").addEventListener("click", () => order("reset_focus"));
  at("record").addEventListener("click", () => order(at("record").classList.contains("on") ? "stop_recording" : "record"));
  at("take")?.addEventListener("click", () => order("take_picture"));
  at("calibrate")?.addEventListener("click", () => order("calibrate"));

  const STATES = { running: "calibrating …", done: "calibrated", alarm: "calibrated, with an alarm", failed: "no calibration", cancelled: "cancelled" };
  let drawn = "";
  let hinted = "";

  const showMeters = (status) => {
    sharpness.show(status.sharpness);
    if (!status.exposure) return;
    histogram.show(status.exposure.histogram);
    at("advice").textContent = `exposure: ${status.exposure.advice}`;
  };

  const showFiles = (status) => {
    at("record").classList.toggle("on", status.recording !== null);
    at("record").textContent = status.recording ? "Stop recording" : "Record";
    if (status.recording) at("recorded").textContent = `recording ${status.recording[0]}: ${status.recording[1]} frames`;
    else if (status.lines.length) at("recorded").textContent = status.lines[status.lines.length - 1];
    if (!start.board) return;
    const { hint, calibration } = status;
    const text = hint ? `${hint.picture}: ${hint.views} of ${names.length} mirrors show the board; ${hint.sentence}` : "";
    if (text && text !== hinted) at("hint").textContent = hinted = text;
    if (!calibration) return;
    const link = calibration.page ? [" ", Studio.element("a", { href: calibration.page, target: "_blank", rel: "noopener" }, "Report")] : [];
    const words = STATES[calibration.state];
    if (drawn !== `${words}${calibration.page}`) {
      drawn = `${words}${calibration.page}`;
      at("calibration").replaceChildren(words, ...link);
    }
    at("lines").textContent = calibration.lines.join("\n");
  };

  const showAlignment = (alignment) => {
    overlay.edges(at("align").checked ? alignment : null);
    if (!alignment) return;
    at("camera").textContent = `By edges: ${alignment.camera}. By points: ${alignment.points} matched. Where a tilt says right, the mirror turns its view to the right, by twice as much.`;
    Studio.drawTilts(at("tilts"), alignment);
  };

  const show = (status) => {
    const line = at("status");
    const late = status.latency_ms === null ? "" : `, ${status.latency_ms.toFixed(0)} ms late`;
    line.className = `status ${status.failed ? "failed" : status.over ? "preview" : status.frames ? "exact" : "solving"}`;
    line.textContent = status.failed ? "Ended" : status.over ? `${about.source} has ended` : status.frames ? `${status.rate_hz.toFixed(0)} pictures/s${late}` : `Waiting for ${about.source} …`;
    at("failed").hidden = !status.failed;
    at("failed").textContent = status.failed ?? "";
    const gone = status.outages ? `, gone ${status.outages} times` : "";
    at("counts").textContent = `frame ${status.frames}, ${status.dropped} dropped, ${status.lost} lost${gone}; ${(status.memory_mb ?? 0).toFixed(0)} MB`;
    const unknown = about.layout_kind === "nominal" ? ", not known in the middle: calibrate first" : ", not known in the middle";
    const middle = status.depth_median_mm === null ? unknown : `, ${status.depth_median_mm.toFixed(0)} mm in the middle; click to focus there`;
    if (!pointed) at("depth-text").textContent = `${status.depth_hz.toFixed(1)} a second${middle}`;
    showMeters(status);
    showFiles(status);
    showAlignment(status.alignment);
  };

  const follow = async () => {
    for (;;) {
      try {
        show(await (await fetch("/status")).json());
        if (pointed) {
          const found = await depthAt(...pointed);
          at("depth-text").textContent = found === null ? "not known there" : `${found} mm there; click to focus`;
        }
      } catch {
        at("status").className = "status failed";
        at("status").textContent = "The server has ended";
      }
      await Studio.pause(POLL_MS);
    }
  };
  follow();
})();
