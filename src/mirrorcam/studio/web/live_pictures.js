"use strict";
// Draws the newest pictures of each kind. A hidden page requests none, so that none are computed for it. After the end of
// the source, the page requests only pending ones, such as another focus.
(() => {
  const KINDS = ["frame", "views", "refocus", "depth"];
  const RETRY_MS = 1000; // shortest time between requests if the first gave no picture
  const EXPECTED_MS = 4000;

  Studio.order = (action, fields = {}) => Studio.post("/order", { action, ...fields });

  Studio.Pictures = class {
    constructor(about) {
      this.stopped = false;
      this.see();
      this.ended = false;
      this.failed = false;
      for (const kind of KINDS) {
        const [width, height] = about.sizes_px[kind];
        const canvas = Studio.byId(kind);
        Object.assign(canvas, { width, height });
        this.follow(kind, canvas);
      }
      document.addEventListener("visibilitychange", () => this.see());
      document.addEventListener("tab", () => this.see());
    }

    // Pictures are requested only while the tab is shown.
    see() {
      this.visible = document.visibilityState !== "hidden" && !Studio.byId("camera").hidden;
      this.wake();
    }

    stop() {
      this.stopped = true;
      this.wake();
    }

    // Note from the status whether the source has ended, or was restarted.
    note({ over, failed, frames }) {
      const [ended, dead] = [over || failed !== null, failed !== null];
      if (ended === this.ended && dead === this.failed && !(ended && frames !== this.frames)) return;
      [this.ended, this.failed, this.frames] = [ended, dead, frames];
      this.wake();
    }

    // Whether the source has ended and no more pictures are expected.
    get rest() {
      return this.ended && performance.now() > this.until;
    }

    // Resume requests, because new pictures are expected.
    wake() {
      this.until = performance.now() + EXPECTED_MS;
      this.woken?.();
      this.waking = new Promise((resolve) => { this.woken = resolve; });
    }

    requests(serial) {
      if (!this.visible) return false;
      return !this.rest || (serial === 0 && !this.failed);
    }

    async follow(kind, canvas) {
      const drawing = canvas.getContext("2d");
      delete canvas.dataset.serial;
      let serial = 0;
      while (!this.stopped) {
        if (!this.requests(serial)) {
          await this.waking;
          continue;
        }
        const requestedAt = performance.now();
        try {
          const answer = await fetch(`/picture/${kind}?after=${serial}`);
          if (this.stopped) return;
          if (answer.status !== 200) {
            await pause(requestedAt + RETRY_MS - performance.now());
            continue;
          }
          const picture = await createImageBitmap(await answer.blob());
          drawing.drawImage(picture, 0, 0);
          picture.close();
          serial = Number(answer.headers.get("X-Serial"));
          canvas.dataset.serial = serial;
        } catch {
          await pause(RETRY_MS);
        }
      }
    }
  };

  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
})();
