"use strict";
// The controls of a player, and the actions of controls, keys and pointers.

(() => {
  const SWITCHES = ["loop", "follow", "trails", "contacts", "distances", "names", "bare"];
  const KEYS = {
    " ": "play", ArrowLeft: "back", ArrowRight: "on", Home: "start", End: "end", "[": "slower", "]": "faster",
    l: "loop", f: "follow", t: "trails", c: "contacts", d: "distances", n: "names", b: "bare",
    1: "side", 2: "front", 3: "top", "?": "help",
  };

  // The camera follows from the start if people would otherwise be small.
  const roams = ({ view }) => view.reach > 1.8 && view.reach > 1.35 * view.near;

  function fill(player) {
    const { metric, joint, scrub } = player.parts, alone = player.clips.every((clip) => clip.motions.length < 2);
    for (const [name, { label, of }] of Object.entries(Pacmo.METRICS)) if (of !== "pair" || !alone) metric.add(new Option(label, name));
    const joints = player.clips.flatMap((clip) => clip.bodies.flatMap((body) => body.joints));
    new Set(joints).forEach((name) => joint.add(new Option(name, name)));
    joint.value = player.clips[0].joints[player.clips[0].root];
    scrub.max = player.length;
    const first = { loop: true, contacts: true, follow: player.clips.some(roams) };
    for (const name of SWITCHES) player.set(name, first[name] ?? false);
  }

  function bind(player) {
    const { play, scrub, speed, metric, joint, chart } = player.parts;
    play.addEventListener("click", () => player.do("play"));
    scrub.addEventListener("input", () => { player.play(false); player.seek(Number(scrub.value)); });
    speed.addEventListener("change", () => player.ask());
    metric.addEventListener("change", () => player.choose());
    joint.addEventListener("change", () => player.choose());
    const go = (event) => { player.play(false); player.seek(player.plot.timeAt(event.offsetX)); };
    chart.addEventListener("pointerdown", (event) => { chart.setPointerCapture(event.pointerId); go(event); });
    chart.addEventListener("pointermove", (event) => { if (event.buttons) go(event); });
    for (const button of player.root.querySelectorAll("[data-do]")) button.addEventListener("click", () => player.do(button.dataset.do));
    player.root.addEventListener("keydown", (event) => press(player, event));
    Pacmo.listen(player.parts.panels, hands(player));
  }

  function hands(player) {
    const { look } = player;
    return {
      turn: (x, y) => { look.yaw -= x * 0.008; look.pitch = Math.min(1.55, Math.max(-0.1, look.pitch + y * 0.006)); player.ask(); },
      move: (x, y) => { const metres = player.metresPerPixel(); look.pan[0] -= x * metres; look.pan[1] += y * metres; player.ask(); },
      zoom: (by) => { look.zoom = Math.min(6, Math.max(0.12, look.zoom * by)); player.ask(); },
      pick: (x, y) => pick(player, under(player, x, y)),
      hover: (x, y) => hover(player, under(player, x, y)),
      reset: () => player.do("side"),
    };
  }

  function press(player, event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    if (event.key === " " && event.target.tagName === "BUTTON") return; // it presses the button
    const job = KEYS[event.key] ?? KEYS[event.key.toLowerCase()];
    if (!job) return;
    event.preventDefault();
    player.do(job);
  }

  function under(player, x, y) {
    const inside = (box) => x >= box.x && x < box.x + box.width && y >= box.y && y < box.y + box.height;
    const k = player.boxes?.findIndex(inside) ?? -1;
    return k < 0 || !player.stages ? null : Pacmo.nearest(player.stages[k], player.boxes[k], x, y);
  }

  const same = (a, b) => a?.person === b?.person && a?.joint === b?.joint;

  function hover(player, found) {
    if (same(found, player.hovered)) return;
    player.hovered = found;
    player.ask();
  }

  // At most two joints: a third replaces the first.
  function pick(player, found) {
    player.root.focus({ preventScroll: true });
    if (!found) player.picks = [];
    else if (player.picks.some((other) => same(other, found))) player.picks = player.picks.filter((other) => !same(other, found));
    else player.picks = [...player.picks, found].slice(-2);
    if (player.picks.length === 2) player.set("distances", true);
    if (found) {
      player.parts.joint.value = player.clips[0].bodies[found.person]?.joints[found.joint] ?? player.parts.joint.value;
      player.choose();
    }
    player.ask();
  }

  Object.assign(Pacmo, { bind, fill });
})();
