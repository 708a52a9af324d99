"use strict";
// Answers of the studio's server.
(() => {
  const post = async (address, body, kind = "json") => {
    const answer = await fetch(address, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
    });
    if (!answer.ok) throw new Error((await answer.text()) || answer.statusText);
    return kind === "body" ? answer.body : answer[kind]();
  };
  Studio.post = post;
  Studio.source = {
    preview: (spec) => post("/preview", spec),
    design: (spec) => post("/design", spec),
    // As they are found: one a line.
    async suggestions(spec, take) {
      const lines = (await post("/suggestions", spec, "body")).pipeThrough(new TextDecoderStream()).getReader();
      let rest = "";
      for (;;) {
        const { done, value } = await lines.read();
        if (done) return;
        const parts = (rest + value).split("\n");
        rest = parts.pop();
        parts.forEach((line) => take(JSON.parse(line)));
      }
    },
    tolerance: (spec) => post("/tolerance", spec),
  };
})();
