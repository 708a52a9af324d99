"use strict";
// Responses from the atlas of solved designs in the page, without a server.
(() => {
  const { axes, designs, parabolas } = JSON.parse(document.getElementById("atlas").textContent);
  const nearest = (values, value) => values.reduce((best, each) => (Math.abs(each - value) < Math.abs(best - value) ? each : best));
  const named = (spec) => Object.entries(axes).map(([name, values]) => nearest(values, spec[name]));

  const answer = (spec) => {
    const places = named(spec);
    const found = designs[places.join(",")];
    if (!found) return { status: "refused", constraint: "", finding: "One mirror alone is no light field camera: at least two are needed." };
    if (found.finding) return { status: "refused", ...found };
    const parabola = parabolas[places.slice(0, -1).join(",")];
    return { status: "solved", drawing: { ...found, spec }, parabola: parabola ? { ...parabola, spec } : null };
  };

  Studio.source = {
    preview: async (spec) => ({ drawing: answer(spec).drawing ?? null }),
    design: async (spec) => answer(spec),
    suggestions: async () => {},
    tolerance: async () => null,
  };
})();
