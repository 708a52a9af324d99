"use strict";
// The design request: current value, history, and encoding in the address.
(() => {
  const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
  Studio.same = same;

  class History {
    constructor(start, first, changed) {
      Object.assign(this, { start: Studio.whole(start), changed, past: [], future: [], spec: Studio.whole(first) });
    }
    // A settled change is an undo step; a change while a slider moves is not.
    set(change, settled = true) {
      const next = { ...this.spec, ...change };
      if (settled) this.settle(next);
      else {
        this.before ??= this.spec;
        this.spec = next;
        this.changed(false);
      }
    }
    settle(next = this.spec) {
      const before = this.before ?? this.spec;
      this.before = null;
      this.spec = Studio.whole(next);
      if (!same(before, this.spec)) {
        this.past.push(before);
        this.future = [];
      }
      this.changed(true);
    }
    step(from, to) {
      if (!from.length) return;
      to.push(this.spec);
      this.before = null;
      this.spec = from.pop();
      this.changed(true);
    }
    undo() {
      this.step(this.past, this.future);
    }
    redo() {
      this.step(this.future, this.past);
    }
    reset() {
      this.settle({ ...this.start });
    }
  }
  Studio.History = History;

  // A request with all fields, in one order; JSON of the server omits some at their defaults.
  Studio.whole = (spec) => {
    const whole = { ...Studio.defaults, ...spec };
    for (const name of whole.pattern ? ["rows", "cols"] : ["pattern"]) delete whole[name];
    return whole;
  };

  const MIRRORS = ["surface", "thickness_mm", "refractive_index", "shape"];
  // Whether changes of a request concern its mirrors.
  Studio.otherMirrors = (changes) => MIRRORS.some((name) => name in changes);
  // The fields of a request that differ in another, apart from those that a search for a target chooses first.
  const CHOSEN = ["rows", "cols", "scale_mm", "fold_deg", "depths_mm"];
  Studio.differing = (spec, other) => Object.fromEntries(Object.entries(Studio.whole(other)).filter(([name, value]) => !CHOSEN.includes(name) && !same(value, Studio.whole(spec)[name])));

  // Encode differences from the defaults, so that the address is short and gives the same design in any studio:
  // #pattern=hex7&scale_mm=60&depths_mm=200,400&camera=d435
  Studio.toAddress = (spec, defaults) => {
    const parts = new URLSearchParams();
    for (const [name, value] of Object.entries(spec)) {
      if (same(value, defaults[name])) continue;
      const known = Studio.named[name]?.find(({ key, fields }) => key && same(fields[name], value));
      parts.set(name, known ? known.key : typeof value === "object" && !Array.isArray(value) ? JSON.stringify(value) : String(value));
    }
    return parts.toString().replaceAll("%2C", ",") || "default";
  };

  // Decode the request of an address; `start` without one.
  Studio.fromAddress = (hash, defaults, start) => {
    if (hash.length < 2) return { ...start };
    const spec = { ...defaults };
    for (const [name, text] of new URLSearchParams(hash.replace(/^#/, ""))) {
      if (!(name in defaults) && name !== "pattern") continue;
      if (Studio.named[name] && !text.startsWith("{")) spec[name] = Studio.named[name].find(({ key }) => key === text)?.fields[name] ?? text;
      else if (typeof defaults[name] === "boolean") spec[name] = text === "true";
      else if (Array.isArray(defaults[name])) spec[name] = text.split(",").map(Number);
      else if (text.startsWith("{")) {
        try {
          spec[name] = JSON.parse(text);
        } catch {
          continue;
        }
      } else spec[name] = text === "" || Number.isNaN(Number(text)) ? text : Number(text);
    }
    return Studio.whole(spec);
  };
})();
