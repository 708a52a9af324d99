"use strict";
// Searches designs that meet a target: terms such as 0.3 mm at 400 mm, over 150 x 120 mm, at most 130 EUR.
(() => {
  const { element } = Studio;

  // The terms of the form's fields; those left empty are none.
  const terms = (form) => {
    const value = (name) => form.elements[name].value;
    const at = `@${value("distance")}mm`;
    const limits = ["size", "price", "mass", "print"].map((name) => [value(name), `${value(name)}${form.elements[name].dataset.unit}`]);
    return [
      [value("sigma"), `${value("sigma")}mm${at}`],
      [value("width") && value("height"), `${value("width")}x${value("height")}mm${at}`],
      ...limits,
    ].filter(([given]) => given).map(([, text]) => text).join(" ");
  };

  const card = ({ title, spec, terms: reached }, go) => {
    const texts = reached.map(({ label, text, passed }) => element("span", { class: "reached" }, element("b", { class: passed ? "better" : "worse" }, text), ` for ${label}`));
    return element("li", {}, element("button", { type: "button", onclick: () => go(spec) }, element("b", {}, title), ...texts));
  };

  Studio.findTargets = (form, note, list, spec, go) => {
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      list.replaceChildren();
      const work = Studio.working(note, "Searching", () => Studio.cancel("/target"));
      try {
        const found = await Studio.postLong("/target", { terms: terms(form), spec: spec() }, (share) => work.step("Searching", share));
        const meets = ({ terms: reached }) => reached.every(({ passed }) => passed);
        note.textContent = found?.refusal || (found?.designs.some(meets) ? "These designs meet the target; click one to open it." : "No design meets it. These come nearest, and give way in red.");
        list.replaceChildren(...(found?.designs ?? []).map((design) => card(design, go)));
      } catch (error) {
        if (error.name !== "AbortError") note.textContent = error.message;
        else if (!form.contains(document.activeElement) || !note.querySelector("progress")) note.textContent = "Cancelled";
      } finally {
        work.end();
      }
    });
  };
})();
