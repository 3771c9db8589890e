"use strict";
// A participant's way through a study: agree, judge clip after clip, go on where it was left.

(() => {
  const KEY = "pacmo-study", TRIES = 5;
  const find = (name) => document.getElementById(name);
  const state = { person: null, count: 0, open: [], player: null, busy: false };
  Pacmo.study = state;

  function show(name) {
    for (const main of document.querySelectorAll("main")) main.hidden = main.id !== name;
  }

  function complain(text) {
    for (const line of document.querySelectorAll(".wrong")) { line.textContent = text; line.hidden = !text; }
  }

  // An answer may be sent again: the first to a place is the one that is kept.
  async function ask(path, content) {
    for (let attempt = 0; ; attempt += 1) {
      try {
        const options = content && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) };
        const answer = await fetch(path, options);
        if (answer.ok) return answer.json();
        if (answer.status !== 429 && answer.status < 500) return null;
      } catch { /* no network for now */ }
      if (attempt === TRIES) throw new Error("no answer");
      complain("The server does not answer; trying again …");
      await new Promise((done) => setTimeout(done, 400 * 2 ** attempt));
    }
  }

  async function guarded(job) {
    if (state.busy) return;
    state.busy = true;
    for (const button of document.querySelectorAll("button")) button.disabled = true;
    try { await job(); complain(""); } catch { complain("The server cannot be reached. Nothing is lost: try again later."); }
    for (const button of document.querySelectorAll("button")) button.disabled = false;
    state.busy = false;
  }

  // Who sees no 3-D sees no clip.
  function draws() {
    const found = document.createElement("canvas").getContext("webgl2");
    found?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(found);
  }

  async function begin() {
    if (!draws()) { show("flat"); return; }
    const begun = await ask("/begin", { consent: true });
    if (!begun) { show("full"); return; }
    localStorage.setItem(KEY, begun.person);
    await goOn(begun.person);
  }

  async function goOn(person) {
    if (!draws()) { show("flat"); return; }
    const known = await ask(`/progress/${person}`);
    if (!known) { localStorage.removeItem(KEY); show("welcome"); return; }
    Object.assign(state, { person, count: known.count, open: Array.from({ length: known.count }, (_, k) => k).filter((k) => !known.answered.includes(k)) });
    await next();
  }

  async function next() {
    state.player?.renderer && state.player.close();
    find("stage").replaceChildren();
    if (!state.open.length) { show("thanks"); return; }
    const [place] = state.open, scene = await ask(`/clip/${state.person}/${place}`);
    document.querySelector(".count").textContent = `clip ${state.count - state.open.length + 1} of ${state.count}`;
    find("stage").append(find("player").content.cloneNode(true));
    show("clips");
    state.player = new Pacmo.Player(document.querySelector("#stage .player"), scene);
    state.player.set("contacts", false);
    state.player.play(true);
  }

  async function judge(real) {
    const kept = await ask("/answer", { person: state.person, place: state.open[0], real });
    if (!kept) throw new Error("refused");
    state.open.shift();
    await next();
  }

  find("begin").addEventListener("click", () => guarded(begin));
  find("real").addEventListener("click", () => guarded(() => judge(true)));
  find("fake").addEventListener("click", () => guarded(() => judge(false)));
  document.addEventListener("keydown", (event) => {
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || find("clips").hidden) return;
    const key = event.key.toLowerCase();
    if (key === "r" || key === "g") guarded(() => judge(key === "r"));
  });
  const person = localStorage.getItem(KEY);
  if (/^[\w-]{22}$/.test(person ?? "")) guarded(() => goOn(person));
})();
