"use strict";
// The page of a participant: consent, one clip after another, continuation after an interruption.

(() => {
  const KEY = "pacmo-study", ATTEMPTS = 5;
  const find = (name) => document.getElementById(name);
  const state = { person: null, count: 0, open: [], player: null, busy: false };
  Pacmo.study = state;

  function show(name) {
    for (const main of document.querySelectorAll("main")) main.hidden = main.id !== name;
  }

  function showError(text) {
    for (const line of document.querySelectorAll(".wrong")) { line.textContent = text; line.hidden = !text; }
  }

  // An answer may be sent again: the server stores the first one for a place.
  async function ask(path, content) {
    for (let attempt = 0; ; attempt += 1) {
      try {
        const options = content && { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(content) };
        const response = await fetch(path, options);
        if (response.ok) return response.json();
        if (response.status !== 429 && response.status < 500) return null;
      } catch { /* no network for now */ }
      if (attempt === ATTEMPTS) throw new Error("no response");
      showError("The server does not respond; trying again …");
      await new Promise((done) => setTimeout(done, 400 * 2 ** attempt));
    }
  }

  async function guarded(job) {
    if (state.busy) return;
    state.busy = true;
    for (const button of document.querySelectorAll("button")) button.disabled = true;
    try { await job(); showError(""); } catch { showError("The server cannot be reached. Your answers are saved: try again later."); }
    for (const button of document.querySelectorAll("button")) button.disabled = false;
    state.busy = false;
  }

  function hasWebGL() {
    const context = document.createElement("canvas").getContext("webgl2");
    context?.getExtension("WEBGL_lose_context")?.loseContext();
    return Boolean(context);
  }

  async function begin() {
    if (!hasWebGL()) { show("flat"); return; }
    const started = await ask("/begin", { consent: true });
    if (!started) { show("full"); return; }
    localStorage.setItem(KEY, started.person);
    await resume(started.person);
  }

  async function resume(person) {
    if (!hasWebGL()) { show("flat"); return; }
    const progress = await ask(`/progress/${person}`);
    if (!progress) { localStorage.removeItem(KEY); show("welcome"); return; }
    Object.assign(state, { person, count: progress.count, open: Array.from({ length: progress.count }, (_, k) => k).filter((k) => !progress.answered.includes(k)) });
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
    const saved = await ask("/answer", { person: state.person, place: state.open[0], real });
    if (!saved) throw new Error("refused");
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
  if (/^[\w-]{22}$/.test(person ?? "")) guarded(() => resume(person));
})();
