"use strict";
// Requests to the studio's server.
(() => {
  // The server distinguishes simultaneously open pages by their names.
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
  // Abort the previous request to the same address (AbortError): browsers open few connections, and slow outdated
  // requests would block previews.
  const pending = {};
  const postNewest = (address, body, kind = "json") => {
    pending[address]?.abort();
    pending[address] = new AbortController();
    return post(address, body, kind, pending[address].signal);
  };
  // Answers that come one per line.
  const postStreamed = async (address, body, take) => {
    const lines = (await postNewest(address, body, "body")).pipeThrough(new TextDecoderStream()).getReader();
    let rest = "";
    for (;;) {
      const { done, value } = await lines.read();
      if (done) return;
      const parts = (rest + value).split("\n");
      rest = parts.pop();
      parts.forEach((line) => take(JSON.parse(line)));
    }
  };
  // The result of long work, undefined if it was superseded; lines before it state the progress, from 0 to 1.
  const postLong = async (address, body, advance) => {
    let result;
    await postStreamed(address, body, (line) => {
      if ("progress" in line) advance(line.progress);
      else result = line;
    });
    return result;
  };
  const cancel = (address) => pending[address]?.abort();

  // Everything that is polled: jobs, and the camera. An event stream would hold one of a browser's six connections for
  // each open page.
  const listeners = [];
  const SLOW_MS = 2000;
  let wake = () => {};
  const follow = async () => {
    for (;;) {
      let waits = [SLOW_MS];
      try {
        const state = await (await fetch("/state")).json();
        waits = listeners.map((listener) => listener(state) ?? SLOW_MS);
      } catch {
        listeners.forEach((listener) => listener(null));
      }
      await new Promise((resolve) => {
        wake = resolve;
        setTimeout(resolve, Math.min(...waits));
      });
    }
  };
  // A listener gets each state, null if the server does not respond, and returns after which time it wants the next, ms.
  const watch = (listener) => listeners.push(listener) === 1 && follow();
  Object.assign(Studio, { post, postNewest, postLong, cancel, watch, poll: () => wake() });
  Studio.source = {
    preview: (spec) => post("/preview", spec),
    design: (spec, advance) => postLong("/design", spec, advance),
    suggestions: (spec, take) => postStreamed("/suggestions", spec, take),
    nearby: (spec, terms) => post("/nearby", { spec, terms }),
    cancel: () => cancel("/design"),
    tolerance: (spec) => postNewest("/tolerance", spec),
  };
})();
