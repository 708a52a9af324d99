"use strict";
// Files, parts and calibration sets generated from a design.
(() => {
  const { element } = Studio;
  const TITLES = { parts: "Parts", set: "Calibration set", run: "Parts, set and blind calibration", calibration: "Calibration" };
  const STATES = { running: "running", done: "done", alarm: "done, with an alarm: see its report", failed: "failed", cancelled: "cancelled" };

  const size = (bytes) => (bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${Studio.number(bytes / 1e6, 2)} MB`);

  Studio.save = (name, text, type = "text/plain") => {
    const address = URL.createObjectURL(new Blob([text], { type }));
    const link = element("a", { href: address, download: name });
    link.click();
    URL.revokeObjectURL(address);
  };

  // The jobs of the server in two lists: those of designs, and calibrations.
  Studio.Maker = class {
    constructor(hosts, current, built) {
      Object.assign(this, { hosts, current, built, shown: new Set(), drawn: "" });
      Studio.watch((state) => state && this.draw(state.jobs));
    }

    async file(kind, name, type) {
      Studio.save(name, await Studio.post(`/${kind}`, this.current(), "text"), type);
    }

    async report(host) {
      const work = Studio.working(host, "Report, with 200 devices as built", () => Studio.cancel("/report"));
      try {
        Studio.save("design.html", await Studio.postNewest("/report", this.current(), "text"), "text/html");
      } finally {
        work.end();
      }
    }

    async start(kind, adapter) {
      await Studio.post("/jobs", { kind, adapter, spec: this.current() });
      Studio.poll();
    }

    draw(jobs) {
      const text = JSON.stringify(jobs);
      if (text !== this.drawn) {
        this.drawn = text;
        const focus = document.activeElement?.dataset?.focus;
        for (const [host, wanted] of this.hosts) {
          const open = new Set([...host.querySelectorAll("details[open]")].map((node) => node.dataset.job));
          host.replaceChildren(...jobs.filter(({ kind }) => wanted(kind)).map((job) => this.row(job, open.has(String(job.number)))));
        }
        if (focus) document.querySelector(`[data-focus="${focus}"]`)?.focus();
        for (const job of jobs) {
          if (job.kind === "parts" && job.page && !this.shown.has(job.number)) {
            this.shown.add(job.number);
            this.built(job.subject, `/files/${job.folder}/assembly.glb`);
          }
        }
      }
      return jobs.some((job) => job.state === "running") ? 700 : undefined;
    }

    row(job, open) {
      const actions = [];
      if (job.state === "running") {
        const cancel = element("button", { type: "button", "data-focus": `cancel-${job.number}` }, "Cancel");
        cancel.addEventListener("click", async () => {
          cancel.disabled = true;
          await Studio.post(`/jobs/${job.number}/cancel`, {});
        });
        actions.push(cancel);
      }
      if (job.page) {
        actions.push(element("a", { href: `/files/${job.page}`, target: "_blank", rel: "noopener" }, "Open"));
        actions.push(element("a", { href: `/zip/${job.folder}`, download: "" }, `ZIP, ${size(job.bytes)}`));
      }
      const bar = element("progress", { max: 1, "aria-label": `Progress of ${TITLES[job.kind]}`, hidden: job.state !== "running" });
      if (job.progress !== null) bar.value = job.progress;
      const lines = element("details", { "data-job": job.number, open }, element("summary", {}, job.command), element("pre", {}, job.lines.join("\n")));
      return element(
        "li", { class: `job ${job.state}` },
        element("div", { class: "line" }, element("b", {}, TITLES[job.kind]), ` of ${job.subject}: ${STATES[job.state]}, ${job.seconds.toFixed(0)} s`, bar, ...actions),
        lines,
      );
    }
  };
})();
