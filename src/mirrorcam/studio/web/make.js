"use strict";
// Files, parts and calibration sets generated from a design.
(() => {
  const { element } = Studio;
  const TITLES = { parts: "Parts", set: "Calibration set", run: "Everything" };
  const STATES = { running: "running", done: "done", failed: "failed", cancelled: "cancelled" };

  const size = (bytes) => (bytes < 1e6 ? `${Math.ceil(bytes / 1e3)} kB` : `${Studio.number(bytes / 1e6, 2)} MB`);

  Studio.save = (name, text, type = "text/plain") => {
    const address = URL.createObjectURL(new Blob([text], { type }));
    const link = element("a", { href: address, download: name });
    link.click();
    URL.revokeObjectURL(address);
  };

  Studio.Maker = class {
    constructor(host, current, built) {
      Object.assign(this, { host, current, built, shown: new Set(), watching: false });
    }

    async file(kind, name, type) {
      const text = await Studio.post(`/${kind}`, this.current(), "text");
      Studio.save(name, text, type);
    }

    async start(kind, adapter) {
      await Studio.post("/jobs", { kind, adapter, spec: this.current() });
      this.watch();
    }

    async watch() {
      if (this.watching) return;
      this.watching = true;
      try {
        for (;;) {
          const jobs = await (await fetch("/jobs")).json();
          this.draw(jobs);
          if (!jobs.some((job) => job.state === "running")) break;
          await new Promise((resolve) => setTimeout(resolve, 700));
        }
      } finally {
        this.watching = false;
      }
    }

    draw(jobs) {
      const open = new Set([...this.host.querySelectorAll("details[open]")].map((node) => node.dataset.job));
      this.host.replaceChildren(...jobs.map((job) => this.row(job, open.has(String(job.number)))));
      for (const job of jobs) {
        if (job.kind === "parts" && job.page && !this.shown.has(job.number)) {
          this.shown.add(job.number);
          this.built(job.design, `/files/${job.folder}/assembly.glb`);
        }
      }
    }

    row(job, open) {
      const actions = [];
      if (job.state === "running") {
        const cancel = element("button", { type: "button" }, "Cancel");
        cancel.addEventListener("click", async () => {
          cancel.disabled = true;
          await Studio.post(`/jobs/${job.number}/cancel`, {});
        });
        actions.push(cancel);
      }
      if (job.page) {
        actions.push(element("a", { href: `/files/${job.page}`, target: "_blank", rel: "noopener" }, "Open"));
        actions.push(element("a", { href: `/zip/${job.folder}`, download: "" }, `ZIP (of ${size(job.bytes)})`));
      }
      const bar = element("progress", { max: 1, "aria-label": `Progress of ${TITLES[job.kind]}`, hidden: job.state !== "running" });
      if (job.progress !== null) bar.value = job.progress;
      const lines = element("details", { "data-job": job.number, open }, element("summary", {}, job.command), element("pre", {}, job.lines.join("\n")));
      return element(
        "li", { class: `job ${job.state}` },
        element("div", { class: "line" }, element("b", {}, TITLES[job.kind]), ` of ${job.design}: ${STATES[job.state]}, ${job.seconds.toFixed(0)} s`, bar, ...actions),
        lines,
      );
    }
  };
})();
