"use strict";
// The newest pictures of each kind, drawn as they come; a page that is hidden asks for none, and none are made for it.
(() => {
  const KINDS = ["frame", "views", "refocus", "depth"];

  Studio.order = (action, fields = {}) => Studio.post("/order", { action, ...fields });

  Studio.Pictures = class {
    constructor(about) {
      this.seen = document.visibilityState !== "hidden";
      for (const kind of KINDS) {
        const [width, height] = about.sizes_px[kind];
        const canvas = document.getElementById(kind);
        Object.assign(canvas, { width, height });
        this.follow(kind, canvas);
      }
      document.addEventListener("visibilitychange", () => {
        this.seen = document.visibilityState !== "hidden";
      });
    }

    async follow(kind, canvas) {
      const drawing = canvas.getContext("2d");
      let serial = 0;
      for (;;) {
        try {
          const answer = this.seen ? await fetch(`/picture/${kind}?after=${serial}`) : null;
          if (!answer || answer.status !== 200) {
            await pause(answer ? 20 : 250);
            continue;
          }
          const picture = await createImageBitmap(await answer.blob());
          drawing.drawImage(picture, 0, 0);
          picture.close();
          serial = Number(answer.headers.get("X-Serial"));
          canvas.dataset.serial = serial;
        } catch {
          await pause(1000);
        }
      }
    }
  };

  const pause = (ms) => new Promise((resolve) => setTimeout(resolve, ms));
  Studio.pause = pause;
})();
