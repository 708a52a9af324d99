"use strict";
// Answers of the studio's server.
(() => {
  const post = async (address, body, kind = "json") => {
    const answer = await fetch(address, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body),
    });
    if (!answer.ok) throw new Error((await answer.text()) || answer.statusText);
    return answer[kind]();
  };
  Studio.post = post;
  Studio.source = {
    preview: (spec) => post("/preview", spec),
    design: (spec) => post("/design", spec),
    suggestions: (spec) => post("/suggestions", spec),
    tolerance: (spec) => post("/tolerance", spec),
  };
})();
