"use strict";
// Responses from the atlas of solved designs in the page, without a server.
(() => {
  const { axes, designs } = JSON.parse(Studio.byId("atlas").textContent);
  const nearest = (values, value) => values.reduce((best, other) => (Math.abs(other - value) < Math.abs(best - value) ? other : best));
  const nearestValues = (spec) => Object.entries(axes).map(([name, values]) => nearest(values, spec[name]));

  const answer = (spec) => {
    const key = nearestValues(spec);
    const design = designs[key.join(",")];
    if (!design) return { status: "refused", constraint: "", finding: "A single mirror does not make a light field camera: at least two are needed." };
    if (design.finding) return { status: "refused", ...design };
    return { status: "solved", drawing: { ...design, spec } };
  };

  const names = Object.keys(axes);
  const points = (current) =>
    Object.entries(designs).filter(([, { figures }]) => figures).map(([key, design]) => {
      const own = key.split(",").map(Number);
      const changes = Object.fromEntries(names.map((name, i) => [name, own[i]]).filter((_, i) => own[i] !== current[i]));
      const values = Object.fromEntries(Studio.compared.map(({ start }) => [start, Studio.mean(design, start)]));
      return { title: `${design.title}, trade-off ${own[3]}`, changes, step: "", values };
    });

  Studio.source = {
    preview: async (spec) => ({ drawing: answer(spec).drawing ?? null }),
    design: async (spec) => answer(spec),
    suggestions: async () => {},
    tolerance: async () => null,
    nearby: async (spec) => ({ points: points(nearestValues(spec)), pending: 0 }),
    cancel() {},
  };
})();
