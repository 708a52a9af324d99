"use strict";
// Searches designs that meet a target: terms such as 0.3 mm at 400 mm, over 150 x 120 mm, at most 130 EUR.
(() => {
  const { element } = Studio;
  const LIMITS = ["size", "price", "mass", "print"];

  // The terms of the form's fields; those left empty are none.
  const terms = (form) => {
    const value = (name) => form.elements[name].value;
    const at = `@${value("distance")}mm`;
    const limits = LIMITS.map((name) => [value(name), `${value(name)}${form.elements[name].dataset.unit}`]);
    return [
      [value("sigma"), `${value("sigma")}mm${at}`],
      [value("width"), `${value("width")}x${value("height")}mm${at}`],
      ...limits,
    ].filter(([given]) => given).map(([, text]) => text).join(" ");
  };

  // The fields that are wrong, each with the reason.
  const faults = (form) => {
    const given = (name) => form.elements[name].value !== "";
    const fields = [...form.elements].filter(({ type }) => type === "number");
    const outside = ({ validity, valueAsNumber, value, min, max }) => {
      if (validity.badInput) return "expected a number";
      if (validity.rangeUnderflow) return `expected at least ${min}`;
      if (validity.rangeOverflow) return `expected at most ${max}`;
      return value !== "" && valueAsNumber <= 0 && "expected more than 0";
    };
    const missing = [
      ["sigma", !["sigma", "width", "height", ...LIMITS].some(given), "expected, or another limit"],
      ["distance", (given("sigma") || given("width")) && !given("distance"), "expected, since \u03c3 and field depend on it"],
      ["width", given("height") && !given("width"), "expected with the height"],
      ["height", given("width") && !given("height"), "expected with the width"],
    ];
    const wrong = fields.filter(outside).map((field) => [field, outside(field)]);
    const isWrong = (name) => wrong.some(([field]) => field.name === name);
    return [...wrong, ...missing.filter(([name, is]) => is && !isWrong(name)).map(([name, , text]) => [form.elements[name], text])];
  };

  const card = ({ title, mirrors, device, spec, terms: reached }, go) => {
    const texts = reached.map(({ label, text, passed }) => element("span", { class: "reached" }, element("b", { class: passed ? "better" : "worse" }, text), ` for ${label}`));
    const device_ = [mirrors, device].map((text) => element("span", { class: "reached" }, text));
    return element("li", {}, element("button", { type: "button", onclick: () => go(spec) }, element("b", {}, `${title}, fold ${spec.fold_deg}\u00b0`), ...texts, ...device_));
  };

  const meets = ({ terms: reached }) => reached.every(({ passed }) => passed);
  const summary = (designs, spec) => {
    const own = ({ spec: other }) => !Object.keys(Studio.differing(spec, other)).length;
    const nearest = designs.find(own);
    if (!designs.some(meets)) return "No design meets the target. These come nearest, and give way in red.";
    if (designs.filter(meets).some(own)) return "These designs meet the target, the smallest first; click one to open it.";
    const without = nearest ? `With ${nearest.mirrors}, no design meets the target; the last one comes nearest, and gives way in red.` : "With the mirrors below, there is no design.";
    return `${without} With other mirrors, the target is met; click a design to open it.`;
  };

  // `found` is called after each search; `Studio.target` is the last target that was searched.
  Studio.findTargets = (form, note, list, spec, go, found) => {
    const mark = (wrong) => {
      for (const field of form.elements) field.removeAttribute("aria-invalid");
      for (const [field] of wrong) field.setAttribute("aria-invalid", "true");
      note.textContent = wrong.map(([field, text]) => `${field.getAttribute("aria-label")}: ${text}.`).join(" ");
      wrong[0]?.[0].focus({ preventScroll: true });
      if (wrong.length) note.scrollIntoView({ block: "nearest" });
    };
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      list.replaceChildren();
      const wrong = faults(form);
      mark(wrong);
      if (wrong.length) return;
      const work = Studio.working(note, "Searching", () => Studio.cancel("/target"));
      const request = { terms: terms(form), spec: spec() };
      try {
        const answer = await Studio.postLong("/target", request, (share) => work.step("Searching", share));
        const designs = answer?.designs ?? [];
        note.textContent = !answer ? "The search was ended by another one." : answer.refusal || summary(designs, request.spec);
        list.replaceChildren(...designs.map((design) => card(design, go)));
        list.classList.remove("old");
        const text = note.textContent;
        const outdate = (now) => {
          const isOld = [request, ...designs].every((known) => Object.keys(Studio.differing(known.spec, now)).length);
          list.classList.toggle("old", isOld && designs.length > 0);
          if (designs.length) note.textContent = isOld ? "These designs were found for another camera or other mirrors: find again." : text;
        };
        if (designs.length) Studio.target = { terms: request.terms, outdate };
        found();
      } catch (error) {
        if (error.name !== "AbortError") note.textContent = error.message;
        else if (!form.contains(document.activeElement) || !note.querySelector("progress")) note.textContent = "Cancelled";
      } finally {
        work.end();
      }
    });
  };
})();
