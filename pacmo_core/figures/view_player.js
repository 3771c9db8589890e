"use strict";
// A player: clips side by side at the same time, with one camera.

(() => {
  const HOME = () => ({ yaw: 0, pitch: 0.2, zoom: 1, pan: [0, 0] });
  const VIEWS = { side: [0, 0.2], front: [Math.PI / 2, 0.2], top: [0, 1.5] };
  const SPEEDS = ["0.1", "0.25", "0.5", "1", "2", "4"];

  // The joints with trails until a joint is selected.
  function hands(joints) {
    const found = joints.flatMap((name, j) => (/hand|wrist/i.test(name) && !/tip|thumb|index|end/i.test(name) ? [j] : []));
    const wrists = found.filter((j) => /wrist/i.test(joints[j]));
    return wrists.length > 1 ? wrists : found.length ? found : [0];
  }

  class Player {
    constructor(root, packed) {
      const find = (name) => root.querySelector(name);
      this.root = root;
      this.clips = packed.map((clip) => new Pacmo.Clip(clip));
      this.length = Math.max(...this.clips.map((clip) => clip.length));
      this.finest = this.clips.reduce((a, b) => (b.length / b.times.length < a.length / a.times.length ? b : a));
      Object.assign(this, { time: 0, playing: false, picks: [], hovered: null, costs: [], look: HOME(), on: {} });
      this.parts = Object.fromEntries(["panels", "scene", "over", "play", "scrub", "clock", "speed", "metric", "joint", "chart", "said"].map((name) => [name, find(`.${name}`)]));
      this.cells = [...root.querySelectorAll(".cell")];
      this.overlay = new Pacmo.Overlay(this.parts.over);
      this.plot = new Pacmo.Plot(this.parts.chart, this.length);
      Pacmo.fill(this);
      Pacmo.bind(this);
      new ResizeObserver(() => this.ask()).observe(this.parts.panels);
      new IntersectionObserver((entries) => this.meet(entries.at(-1).isIntersecting), { rootMargin: "50%" }).observe(root);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.paint());
    }

    do(job) {
      const jobs = {
        play: () => this.play(!this.playing), back: () => this.step(-1), on: () => this.step(1),
        start: () => this.seek(0), end: () => this.seek(this.length), slower: () => this.pace(-1), faster: () => this.pace(1),
        help: () => this.root.ownerDocument.querySelector("dialog.help")?.showModal(),
      };
      if (jobs[job]) jobs[job]();
      else if (VIEWS[job]) { Object.assign(this.look, HOME(), { yaw: VIEWS[job][0], pitch: VIEWS[job][1] }); this.ask(); }
      else this.set(job, !this.on[job]);
    }

    set(name, on) {
      this.on[name] = on;
      this.root.querySelector(`[data-do="${name}"]`)?.setAttribute("aria-pressed", on);
      this.ask();
    }

    pace(by) {
      const { speed } = this.parts;
      speed.value = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, SPEEDS.indexOf(speed.value) + by))];
    }

    play(on) {
      if (on && this.time >= this.length) this.time = 0;
      [this.playing, this.last] = [on, performance.now()];
      this.parts.play.textContent = on ? "❚❚" : "▶";
      this.parts.play.setAttribute("aria-label", on ? "pause" : "play");
      this.ask();
    }

    seek(time) {
      this.time = Math.min(this.length, Math.max(0, time));
      this.ask();
    }

    // A frame of the clip with the highest frame rate.
    step(by) {
      this.play(false);
      const { times } = this.finest;
      this.seek(times[Math.min(times.length - 1, Math.max(0, this.finest.frameAt(this.time) + by))]);
    }

    choose() {
      const { metric, joint } = this.parts;
      joint.disabled = !Pacmo.METRICS[metric.value].joint;
      this.plot.set(this.clips, metric.value, joint.value, this.colour);
      this.ask();
    }

    // Metres per pixel at the distance of the people.
    metresPerPixel() {
      return (2 * Math.tan((Pacmo.FIELD * Math.PI) / 360) * this.stages[0].distance) / this.boxes[0].height;
    }

    paint() {
      this.colour = Pacmo.colours(this.root);
      this.stages?.forEach((stage) => stage.paint(this.colour));
      this.choose();
    }

    // Browsers allow about a dozen WebGL contexts per page: only visible players have one.
    meet(seen) {
      if (seen && !this.renderer) this.open();
      else if (!seen && this.renderer) this.close();
    }

    open() {
      try {
        this.renderer = new THREE.WebGLRenderer({ canvas: this.parts.scene, antialias: true, alpha: true });
      } catch {
        this.root.classList.add("flat");
        this.paint();
        return;
      }
      Object.assign(this.renderer.shadowMap, { enabled: true, type: THREE.PCFShadowMap });
      this.renderer.setClearColor(0, 0);
      this.renderer.setScissorTest(true);
      this.stages = this.clips.map((clip) => new Pacmo.Stage(clip));
      this.paint();
    }

    close() {
      this.play(false);
      this.renderer.dispose();
      this.renderer.forceContextLoss();
      const fresh = this.parts.scene.cloneNode(); // a canvas whose context is lost gives no other
      this.parts.scene.replaceWith(fresh);
      this.parts.scene = fresh;
      [this.renderer, this.stages] = [null, null];
    }

    ask() {
      if (!this.asked) requestAnimationFrame((now) => this.frame(now));
      this.asked = true;
    }

    frame(now) {
      this.asked = false;
      if (this.playing) this.advance(now);
      const began = performance.now();
      if (this.renderer) this.draw();
      this.say();
      this.costs.push(performance.now() - began);
      if (this.costs.length > 240) this.costs.shift();
      if (this.playing) this.ask();
    }

    advance(now) {
      this.time += (Math.max(0, now - this.last) / 1000) * Number(this.parts.speed.value);
      this.last = now;
      if (this.time < this.length) return;
      if (this.on.loop) this.time %= this.length || 1;
      else { this.time = this.length; this.play(false); }
    }

    say() {
      const { scrub, clock, said } = this.parts, { times } = this.finest;
      scrub.value = this.time;
      clock.textContent = `${this.time.toFixed(2)} s · frame ${this.finest.frameAt(this.time)} of ${times.length - 1}`;
      if (!this.colour) return;
      this.plot.draw(this.time);
      said.textContent = this.plot.said(this.time);
    }

    draw() {
      const { panels, over } = this.parts, { width, height, x, y } = panels.getBoundingClientRect();
      if (!width || !height) return;
      const scale = Math.min(devicePixelRatio, 2), size = `${width},${height},${scale}`;
      if (this.size !== size || this.sized !== this.renderer) {
        [this.size, this.sized] = [size, this.renderer];
        this.renderer.setPixelRatio(scale);
        this.renderer.setSize(width, height, false);
      }
      this.boxes = this.cells.map((cell) => { const box = cell.getBoundingClientRect(); return { x: box.x - x, y: box.y - y, width: box.width, height: box.height }; });
      this.overlay.begin(width, height, this.colour);
      this.stages.forEach((stage, k) => this.drawCell(stage, this.boxes[k], height));
      over.hidden = false;
    }

    drawCell(stage, box, height) {
      const area = [box.x, height - box.y - box.height, box.width, box.height];
      const picked = this.picks.map(({ joint }) => joint).sort((a, b) => a - b);
      const marked = stage.clip.bodies.map(({ joints }) => (picked.length ? [...new Set(picked)] : hands(joints)));
      stage.show(this.time, { solid: !this.on.bare, trails: this.on.trails, marked });
      stage.see({ ...this.look, follows: this.on.follow }, this.time, box.width / box.height);
      this.renderer.setViewport(...area);
      this.renderer.setScissor(...area);
      this.renderer.render(stage.scene, stage.camera);
      this.overlay.draw(stage, box, { ...this.on, picks: this.picks, hovered: this.hovered });
    }

    // The position of a joint in pixels of the page, for tests.
    where(panel, person, joint) {
      const { clip, camera } = this.stages[panel], at = clip.poses[person].slice(3 * joint, 3 * joint + 3);
      const { x, y } = this.parts.panels.getBoundingClientRect(), seen = Pacmo.projected(camera, this.boxes[panel], at);
      return [seen.x + x, seen.y + y];
    }
  }

  Pacmo.Player = Player;
  const scenes = JSON.parse(document.getElementById("motions").textContent);
  for (const root of document.querySelectorAll(".player")) Pacmo.players.push(new Player(root, scenes[Number(root.dataset.clip)]));
  document.querySelector("[data-help]")?.addEventListener("click", () => Pacmo.players[0].do("help"));
  if (document.body.dataset.focus) Pacmo.players[0].root.focus();
})();
