"use strict";
// What the design would see: a frame, its views, a picture in focus at a depth, and the depth that is measured in it.
(() => {
  Studio.Sight = class {
    constructor(byId, spec) {
      Object.assign(this, { byId, spec, asked: 0, focusing: false, next: null });
      byId("subject").addEventListener("change", () => this.look());
      byId("focus").addEventListener("input", () => this.focus());
    }

    get subject() {
      return this.byId("subject").value;
    }

    set(id, picture) {
      const image = this.byId(id);
      image.src = picture;
      image.classList.remove("old");
    }

    say(text) {
      this.byId("sight-note").textContent = text;
    }

    // The frame comes first, what is decoded from it follows; an answer that is no longer asked for is not shown.
    async look() {
      const mine = (this.asked += 1);
      const wanted = { spec: this.spec(), subject: this.subject };
      for (const id of ["frame", "views", "refocused", "measured"]) this.byId(id).classList.add("old");
      this.byId("focus").disabled = true;
      try {
        const began = performance.now();
        const frame = await Studio.postNewest("/frame", wanted);
        if (mine !== this.asked || !frame) return;
        this.set("frame", frame.picture);
        performance.measure("frame", { start: began, end: performance.now() });
        const decoded = await Studio.postNewest("/decoded", wanted);
        if (mine !== this.asked || !decoded) return;
        this.set("views", decoded.views);
        this.set("refocused", decoded.refocused);
        this.set("measured", decoded.depth);
        const slider = this.byId("focus");
        slider.min = Math.log(decoded.near_mm);
        slider.max = Math.log(decoded.far_mm);
        slider.step = (slider.max - slider.min) / 200;
        slider.value = Math.log(decoded.focus_mm);
        slider.disabled = false;
        this.tell(decoded.focus_mm);
        const error = decoded.error_mm === null ? "" : `, median error ${Studio.number(decoded.error_mm, 2)} mm`;
        this.say(`Depth from ${Studio.number(decoded.near_mm)} mm (red) to ${Studio.number(decoded.far_mm)} mm (blue), darker where it is less sure${error}.`);
      } catch (error) {
        if (mine === this.asked) this.say(error.message);
      }
    }

    tell(depth) {
      this.byId("focus-text").textContent = `${Studio.number(depth)} mm`;
    }

    async focus() {
      const depth = Math.exp(this.byId("focus").valueAsNumber);
      this.tell(depth);
      if (this.focusing) {
        this.next = depth;
        return;
      }
      this.focusing = true;
      const mine = this.asked;
      try {
        const { picture } = await Studio.post("/refocused", { spec: this.spec(), subject: this.subject, depth_mm: depth });
        if (mine === this.asked) this.set("refocused", picture);
      } catch (error) {
        if (mine === this.asked) this.say(error.message);
      } finally {
        this.focusing = false;
        const waiting = this.next !== null;
        this.next = null;
        if (waiting) this.focus();
      }
    }
  };
})();
