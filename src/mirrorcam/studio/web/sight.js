"use strict";
// Simulated pictures of the design: a frame, its views, a refocused picture, and the depth estimated from them.
(() => {
  const { byId } = Studio;

  Studio.Sight = class {
    constructor(spec) {
      Object.assign(this, { spec, latest: 0 });
      const refocus = Studio.newest((depth) => this.refocus(depth));
      byId("subject").addEventListener("change", () => this.look());
      byId("sight-focus").addEventListener("input", ({ target }) => {
        this.showDepth(Math.exp(target.valueAsNumber));
        refocus(Math.exp(target.valueAsNumber));
      });
    }

    get subject() {
      return byId("subject").value;
    }

    set(id, picture) {
      const image = byId(id);
      image.src = picture;
      image.classList.remove("old");
    }

    say(text) {
      byId("sight-note").textContent = text;
    }

    // First the frame, then what is decoded from it; outdated responses are not shown.
    async look() {
      const serial = (this.latest += 1);
      const body = { spec: this.spec(), subject: this.subject };
      for (const id of ["sight-frame", "sight-views", "sight-refocused", "sight-measured"]) byId(id).classList.add("old");
      byId("sight-focus").disabled = true;
      const cancel = () => ["/frame", "/decoded"].forEach(Studio.cancel);
      this.work?.end();
      const work = (this.work = Studio.working(byId("sight-note"), "1 of 2: rendering the frame", cancel));
      try {
        const startedAt = performance.now();
        const frame = await Studio.postNewest("/frame", body);
        if (serial !== this.latest || !frame) return;
        this.set("sight-frame", frame.picture);
        performance.measure("frame", { start: startedAt, end: performance.now() });
        work.step("2 of 2: decoding views and depth", 0.5);
        const decoded = await Studio.postNewest("/decoded", body);
        if (serial !== this.latest || !decoded) return;
        this.set("sight-views", decoded.views);
        this.set("sight-refocused", decoded.refocused);
        this.set("sight-measured", decoded.depth);
        const slider = byId("sight-focus");
        slider.min = Math.log(decoded.near_mm);
        slider.max = Math.log(decoded.far_mm);
        slider.step = (slider.max - slider.min) / 200;
        slider.value = Math.log(decoded.focus_mm);
        slider.disabled = false;
        this.showDepth(decoded.focus_mm);
        const error = decoded.error_mm === null ? "" : ` Their median error over the whole scene is ${Studio.number(decoded.error_mm, 2)} mm; \u03c3 is the bound for a textured surface at a working depth.`;
        this.say(`Depth from ${Studio.number(decoded.near_mm)} mm (red) to ${Studio.number(decoded.far_mm)} mm (blue), darker where it is less sure.${error}`);
      } catch (error) {
        if (serial !== this.latest) return;
        this.say(error.name === "AbortError" ? "Cancelled. " : error.message);
        byId("sight-note").append(Studio.element("button", { type: "button", onclick: () => this.look() }, "Start again"));
      } finally {
        work.end();
      }
    }

    showDepth(depth) {
      byId("sight-focus-text").textContent = `${Studio.number(depth)} mm`;
      byId("sight-focus").setAttribute("aria-valuetext", `${Studio.number(depth)} mm`);
    }

    async refocus(depth) {
      const serial = this.latest;
      try {
        const { picture } = await Studio.post("/refocused", { spec: this.spec(), subject: this.subject, depth_mm: depth });
        if (serial === this.latest) this.set("sight-refocused", picture);
      } catch (error) {
        if (serial === this.latest) this.say(error.message);
      }
    }
  };
})();
