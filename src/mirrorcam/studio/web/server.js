"use strict";
// Answers of the studio's server.
(() => {
  // Pages that are open at the same time have names, by which the server tells their requests apart.
  const page = crypto.randomUUID();
  const post = async (address, body, kind = "json", signal = undefined) => {
    const answer = await fetch(address, {
      method: "POST", headers: { "Content-Type": "application/json", "X-Page": page }, body: JSON.stringify(body), signal,
    });
    if (!answer.ok) {
      const refused = answer.status >= 400 && answer.status < 500;
      throw Object.assign(new Error((await answer.text()) || answer.statusText), { refused });
    }
    return kind === "body" ? answer.body : answer[kind]();
  };
  // Gives up the earlier request of the same address, which fails with AbortError: browsers keep few connections open,
  // and what is slow and no longer wanted would hold them while previews wait.
  const underWay = {};
  const postNewest = (address, body, kind = "json") => {
    underWay[address]?.abort();
    underWay[address] = new AbortController();
    return post(address, body, kind, underWay[address].signal);
  };
  Object.assign(Studio, { post, postNewest });
  Studio.source = {
    preview: (spec) => post("/preview", spec),
    design: (spec) => postNewest("/design", spec),
    // As they are found: one a line.
    async suggestions(spec, take) {
      const lines = (await postNewest("/suggestions", spec, "body")).pipeThrough(new TextDecoderStream()).getReader();
      let rest = "";
      for (;;) {
        const { done, value } = await lines.read();
        if (done) return;
        const parts = (rest + value).split("\n");
        rest = parts.pop();
        parts.forEach((line) => take(JSON.parse(line)));
      }
    },
    tolerance: (spec) => postNewest("/tolerance", spec),
  };
})();
