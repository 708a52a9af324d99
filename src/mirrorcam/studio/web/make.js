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

  // The address of the assembled device in the folder of a job of its kind.
  const MODELS = { parts: "assembly.glb", run: "cad/assembly.glb" };
  const nameOf = ({ title, identity }) => `${title.split(",")[0].replaceAll(" ", "")}-${identity.slice(0, 8)}`;

  // The jobs of the server in two lists: those of designs, and calibrations; `changed` is called when they do.
  Studio.Maker = class {
    constructor(hosts, current, changed) {
      Object.assign(this, { hosts, current, changed, jobs: [] });
      Studio.watch((state) => state && this.draw(state.jobs));
    }

    // The device of a design, if its parts are built.
    device(drawing) {
      const job = this.jobs.find(({ kind, subject, page }) => page && MODELS[kind] && subject === nameOf(drawing));
      return job && `/files/${job.folder}/${MODELS[job.kind]}?${job.number}`;
    }

    async file(kind, name, type) {
      Studio.save(name, await Studio.post(`/${kind}`, this.current(), "text"), type);
    }

    async report(button, host, drawing) {
      const name = `${nameOf(drawing)}.html`;
      const work = Studio.working(host, "Report, with 200 devices as built", () => Studio.cancel("/report"));
      button.disabled = true;
      try {
        Studio.save(name, await Studio.postNewest("/report", this.current(), "text"), "text/html");
        host.textContent = `${name} saved`;
      } catch (error) {
        host.textContent = error.name === "AbortError" ? "Report cancelled" : error.message;
      } finally {
        work.end();
        button.disabled = false;
      }
    }

    async start(kind, adapter) {
      await Studio.post("/jobs", { kind, adapter, spec: this.current() });
      Studio.poll();
    }

    draw(jobs) {
      if (!Studio.same(jobs, this.jobs)) {
        this.jobs = jobs;
        const focus = document.activeElement?.dataset?.focus;
        for (const [host, wanted] of this.hosts) {
          // An open log stays as far from its last line as it was: at it, it follows.
          const below = ({ scrollHeight, clientHeight, scrollTop }) => scrollHeight - clientHeight - scrollTop;
          const open = new Map([...host.querySelectorAll("details[open]")].map((node) => [node.dataset.job, below(node.lastChild)]));
          host.replaceChildren(...jobs.filter(({ kind }) => wanted(kind)).map((job) => this.row(job, open.has(String(job.number)))));
          for (const log of host.querySelectorAll("details[open] pre")) log.scrollTop += below(log) - open.get(log.parentElement.dataset.job);
        }
        if (focus) document.querySelector(`[data-focus="${focus}"]`)?.focus();
        this.changed();
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
      const complete = job.state === "done" || job.state === "alarm";
      if (job.page) actions.push(element("a", { href: `/files/${job.page}`, target: "_blank", rel: "noopener" }, complete ? "Open" : `Open ${job.page.slice(job.folder.length + 1)}`));
      if (job.bytes) actions.push(element("a", { href: `/zip/${job.folder}`, download: "" }, `ZIP${complete ? "" : " of the files so far"}, ${size(job.bytes)}`));
      const bar = element("progress", { max: 1, "aria-label": `Progress of ${TITLES[job.kind]}`, hidden: job.state !== "running" });
      if (job.progress !== null) bar.value = job.progress;
      const log = element("pre", {}, job.lines.join("\n"));
      const toLast = () => requestAnimationFrame(() => (log.scrollTop = log.scrollHeight));
      const lines = element("details", { "data-job": job.number, open }, element("summary", { onclick: toLast }, job.command), log);
      return element(
        "li", { class: `job ${job.state}` },
        element("div", { class: "line" }, element("b", {}, TITLES[job.kind]), ` of ${job.subject}: ${STATES[job.state]}, ${job.seconds.toFixed(0)} s${complete || !job.step ? "" : `, ${job.step}`}`, ...actions, bar),
        lines,
      );
    }
  };
})();
