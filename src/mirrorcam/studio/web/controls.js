"use strict";
// The controls of a request, from the server's list: each with its unit, range and effect.
(() => {
  const { element } = Studio;

  // The position of a snapping slider is the index of its value.
  const closest = (values, value) => values.reduce((best, other, i) => (Math.abs(other - value) < Math.abs(values[best] - value) ? i : best), 0);
  const toSlider = (control, value) => {
    if (control.values.length) return closest(control.values, value);
    return control.log ? Math.log(value) : value;
  };
  const fromSlider = (control, position) => {
    if (control.values.length) return control.values[position];
    const value = control.log ? Math.exp(position) : position;
    return +(Math.round(value / control.step) * control.step).toPrecision(10);
  };
  const ends = (control) =>
    control.values.length ? [0, control.values.length - 1] : [toSlider(control, control.least), toSlider(control, control.most)];

  // Controls below which the effect of one step is shown.
  const STEPPED = ["rows", "scale_mm", "fold_deg", "tradeoff"];

  const row = (control, ...parts) => {
    const help = element("p", { class: "help", id: `${control.name}-help` }, control.help);
    const next = STEPPED.includes(control.name) && Studio.byId("tabs") ? [element("div", { class: "next", id: `${control.name}-next` })] : [];
    return element("div", { class: `control ${control.kind}`, "data-name": control.name }, ...parts, help, ...next);
  };

  const unit = (text) => element("span", { class: "unit" }, text);
  // The line above a control: its name and, at the right, its value.
  const head = (label, ...value) =>
    element("div", { class: "head" }, element("span", { class: "name" }, label), ...(value.length ? [element("span", { class: "value" }, ...value)] : []));

  const slider = (control, label, history, read, write) => {
    const [low, high] = ends(control);
    const range = element("input", {
      type: "range", min: low, max: high, step: control.values.length ? 1 : control.log ? (high - low) / 400 : control.step, "aria-label": label,
      "aria-describedby": `${control.name}-help`,
    });
    range.addEventListener("input", () => {
      Studio.touchedAt = performance.now();
      history.set(write(fromSlider(control, range.valueAsNumber)), false);
    });
    range.addEventListener("change", () => history.settle());
    const refresh = (spec) => {
      const value = read(spec);
      if (typeof value === "number") range.value = toSlider(control, value);
      range.setAttribute("aria-valuetext", `${value} ${control.unit}`);
    };
    return [range, refresh];
  };

  const box = (control, label, history, read, write) => {
    const field = element("input", {
      type: "number", min: control.allowed[0], max: control.allowed[1], step: control.kind === "counts" ? 1 : "any",
      "aria-label": `${label}, number`, readonly: control.values.length > 0,
    });
    field.addEventListener("change", () => {
      if (field.value === "" || !Number.isFinite(field.valueAsNumber)) refresh(history.spec);
      else if (field.reportValidity()) history.set(write(field.valueAsNumber));
    });
    const refresh = (spec, exact) => {
      const value = read(spec);
      field.value = typeof value === "number" ? value : "";
      field.placeholder = typeof value === "number" ? "" : String(exact?.[control.name] ?? value);
    };
    return [field, refresh];
  };

  // A slider, a box for its number, and the function that sets both to a request.
  const number = (control, label, history, read, write) => {
    const [range, first] = slider(control, label, history, read, write);
    const [field, second] = box(control, label, history, read, write);
    return [range, field, (spec, exact) => [first, second].forEach((update) => update(spec, exact))];
  };

  const SIZE = "[1-9]\\d*(\\.\\d+)?x[1-9]\\d*(\\.\\d+)?";

  const makers = {
    slider(control, history) {
      const [read, write] = [(spec) => spec[control.name], (value) => ({ [control.name]: value })];
      const [range, field, update] = number(control, control.label, history, read, write);
      const parts = [head(control.label, field, unit(control.unit)), range];
      let auto = null;
      if (control.auto) {
        auto = element("input", { type: "checkbox" });
        auto.addEventListener("change", () => history.set({ [control.name]: auto.checked ? "auto" : control.preset }));
        parts.push(element("label", { class: "check" }, auto, control.auto));
      }
      const refresh = (spec, exact) => {
        update(spec, exact);
        if (auto) {
          auto.checked = spec[control.name] === "auto";
          range.disabled = auto.checked;
        }
      };
      return [row(control, ...parts), refresh];
    },

    counts(control, history) {
      const refreshes = [];
      const lines = [["rows", "Rows"], ["cols", "Columns"]].map(([name, label]) => {
        const [read, write] = [(spec) => spec[name], (value) => ({ [name]: value })];
        const [range, field, update] = number(control, label, history, read, write);
        refreshes.push(update);
        return [head(label, field, unit("")), range];
      });
      const node = row(control, ...lines.flat());
      const refresh = (spec) => {
        node.hidden = Boolean(spec.pattern);
        if (!spec.pattern) refreshes.forEach((update) => update(spec));
      };
      return [node, refresh];
    },

    depths(control, history) {
      const near = (spec) => Math.min(...spec.depths_mm);
      const far = (spec) => Math.max(...spec.depths_mm);
      // The handles do not pass each other; depths between them keep their relative positions.
      const inner = (spec, low, high) => spec.depths_mm.filter((d) => d > low && d < high && d !== near(spec) && d !== far(spec));
      const unique = (depths) => [...new Set(depths)].sort((a, b) => a - b);
      const writeNear = (value) => {
        const low = Math.min(value, far(history.spec));
        return { depths_mm: unique([low, ...inner(history.spec, low, far(history.spec)), far(history.spec)]) };
      };
      const writeFar = (value) => {
        const high = Math.max(value, near(history.spec));
        return { depths_mm: unique([near(history.spec), ...inner(history.spec, near(history.spec), high), high]) };
      };
      const [first, nearBox, refreshNear] = number(control, "Nearest working depth", history, near, writeNear);
      const [second, farBox, refreshFar] = number(control, "Farthest working depth", history, far, writeFar);
      const span = element("div", { class: "span" });
      const axis = element("div", { class: "axis" }, span, first, second);
      const refresh = (spec) => {
        [refreshNear, refreshFar].forEach((update) => update(spec));
        const [low, high] = ends(control);
        const fraction = (depth) => Math.max(0, Math.min(1, (toSlider(control, depth) - low) / (high - low)));
        span.style.left = `${100 * fraction(near(spec))}%`;
        span.style.right = `${100 * (1 - fraction(far(spec)))}%`;
        const between = inner(spec, low, high);
        note.textContent = between.length ? `and ${between.map((depth) => Studio.number(depth, 4)).join(", ")} mm between` : "";
        note.hidden = !between.length;
      };
      const note = element("p", { class: "help", hidden: true });
      return [row(control, head(control.label, nearBox, unit("to"), farBox, unit(control.unit)), axis, note), refresh];
    },

    choice(control, history) {
      const name = control.name;
      const buttons = control.choices.map(([value, text]) => {
        const radio = element("input", { type: "radio", name, value });
        radio.addEventListener("change", () => history.set({ [name]: typeof control.preset === "string" ? value : JSON.parse(value) }));
        return [radio, element("label", { class: "pick" }, radio, element("span", {}, text))];
      });
      const group = element("div", { class: "picks", role: "radiogroup", "aria-label": control.label, "aria-describedby": `${name}-help` }, ...buttons.map(([, label]) => label));
      const refresh = (spec) => {
        for (const [radio] of buttons) radio.checked = String(spec[name]) === radio.value;
      };
      return [row(control, head(control.label), group), refresh];
    },

    shape(control, history) {
      const select = element("select", { "aria-label": control.label, "aria-describedby": "shape-help" }, ...control.choices.map(([value, text]) => element("option", { value }, text)));
      const sizes = element("input", { class: "text", "aria-label": "Sizes in stock, mm", "aria-describedby": "shape-help", title: "Width x height in mm, separated by commas: 25x15, 30x20", pattern: `${SIZE}( *, *${SIZE})*` });
      const of = (spec) => (spec.shape.startsWith("stock:") ? "stock:" : spec.shape);
      select.addEventListener("change", () => {
        const shape = select.value === "stock:" ? control.preset : select.value;
        history.set({ shape, ...(shape === "free" ? { same_size: false } : { sides: 4 }) });
      });
      sizes.addEventListener("change", () => sizes.reportValidity() && history.set({ shape: `stock:${sizes.value.replaceAll(" ", "")}` }));
      const refresh = (spec) => {
        select.value = of(spec);
        sizes.hidden = of(spec) !== "stock:";
        sizes.value = sizes.hidden ? "" : spec.shape.slice(6);
        document.querySelector("[data-name=size_step_mm]").hidden = of(spec) !== "rectangles";
        document.querySelector("[data-name=same_size]").hidden = of(spec) === "free";
        document.querySelector("[data-name=sides]").hidden = of(spec) !== "free";
      };
      return [row(control, head(control.label), select, sizes), refresh];
    },

    // Values by name, each of which sets some fields; a camera has numbers of its own, too.
    named(control, history) {
      const select = element("select", { "aria-label": control.label, "aria-describedby": `${control.name}-help` }, ...control.named.map(({ text }, i) => element("option", { value: i }, text)), element("option", { value: "own" }, "Your own numbers"));
      const fields = control.numbers.map(({ name, label, unit: symbol, allowed, preset }) => {
        const field = element("input", { type: "number", step: "any", min: allowed[0], max: allowed[1], "aria-label": `${label}${symbol ? `, ${symbol}` : ""}` });
        field.addEventListener("change", () => {
          if (!Number.isFinite(field.valueAsNumber)) return refresh(history.spec);
          if (!field.reportValidity()) return;
          const size = name === "width_px" || name === "height_px";
          history.set({ camera: { ...history.spec.camera, name: "own camera", [name]: size ? Math.round(field.valueAsNumber) : field.valueAsNumber } });
        });
        return [name, preset, field, element("label", { class: "number" }, element("span", {}, label), field, unit(symbol))];
      });
      const own = element("details", { class: "own", hidden: !fields.length }, element("summary", {}, "Its numbers"), ...fields.map(([, , , label]) => label));
      select.addEventListener("change", () => {
        if (select.value === "own") own.open = true;
        else history.set(control.named[select.value].fields);
      });
      const refresh = (spec) => {
        const index = control.named.findIndex(({ fields: set }) => Object.entries(set).every(([name, value]) => Studio.same(spec[name] ?? null, value)));
        select.value = index < 0 ? "own" : String(index);
        select.lastChild.hidden = index >= 0 && !fields.length;
        for (const [name, preset, field] of fields) field.value = spec.camera[name] ?? preset;
      };
      return [row(control, head(control.label), select, own), refresh];
    },
  };

  // Add all controls to a host; return the function that sets them to a request.
  Studio.makeControls = (host, groups, history) => {
    const refreshes = [];
    for (const { title, open, controls } of groups) {
      const rows = controls.map((control) => {
        const [node, refresh] = makers[control.kind](control, history);
        refreshes.push(refresh);
        return node;
      });
      const group = element("details", { class: "group", open }, element("summary", {}, title), ...rows);
      host.append(group);
    }
    return (spec, exact) => refreshes.forEach((update) => update(spec, exact));
  };
})();
