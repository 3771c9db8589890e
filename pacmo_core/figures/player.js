"use strict";
// Plays two-person motion on canvases: solid limbs, ground, shadows; panels share clock and camera.
// World: millimetres from the clip's origin, y up, right-handed. No library, no network.

(() => {
  const LIGHT = [-0.35, 1, 0.45]; // towards the light; only its shadow depends on it
  const FIELD = 0.52; // half the picture's height at distance one
  const WHITE = [255, 255, 255], BLACK = [0, 0, 0];
  const PIECES = 3; // a limb is cut so that crossing limbs sort right

  function unpack(text, Kind) {
    return new Kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  }

  function readPanel(packed) {
    const times = Array.from(unpack(packed.ticks, Int32Array), (tick) => tick / 10000);
    const people = [packed.partner, packed.reaction].map((motion) => unpack(motion, Int16Array));
    return { joints: packed.joints, body: packed.body, times, people };
  }

  function frameAt(times, time) {
    let low = 0, high = times.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (times[middle] <= time + 1e-6) low = middle; else high = middle - 1;
    }
    return low;
  }

  function poseAt(panel, person, time) {
    const { times, joints } = panel, motion = panel.people[person];
    const frame = frameAt(times, time), next = Math.min(frame + 1, times.length - 1);
    const span = times[next] - times[frame];
    const share = span > 0 ? Math.min(1, Math.max(0, (time - times[frame]) / span)) : 0;
    const a = frame * joints * 3, b = next * joints * 3, pose = [];
    for (let j = 0; j < joints * 3; j += 3) {
      pose.push([0, 1, 2].map((k) => motion[a + j + k] * (1 - share) + motion[b + j + k] * share));
    }
    return pose;
  }

  // A body is a list of solids, each the hull of spheres [[x, y, z], radius].
  function solids(body, pose) {
    const parts = body.limbs.map(([p, c, rp, rc]) => [[pose[p], rp * 1000], [pose[c], rc * 1000]]);
    if (body.trunk.length) parts.push(body.trunk.map(([j, r]) => [pose[j], r * 1000]));
    if (body.head.length) {
      const sum = body.head.reduce((s, j) => s.map((v, k) => v + pose[j][k]), [0, 0, 0]);
      parts.push([[sum.map((v) => v / body.head.length), body.head_radius * 1000]]);
    }
    return parts;
  }

  function homeCamera(view) {
    const height = view.top - view.ground;
    return { yaw: view.yaw, pitch: 0.2, distance: Math.max(view.reach + 280, height * 0.78) / FIELD };
  }

  function projector(camera, view, width, height) {
    const cy = Math.cos(camera.yaw), sy = Math.sin(camera.yaw);
    const cp = Math.cos(camera.pitch), sp = Math.sin(camera.pitch);
    const middle = view.ground + (view.top - view.ground) * 0.47;
    const scale = Math.min(width, height) / 2 / FIELD;
    return ([x, y, z]) => {
      const up = y - middle, back = x * sy + z * cy;
      const depth = Math.max(camera.distance - (up * sp + back * cp), 50);
      const zoom = scale / depth;
      return { x: width / 2 + (x * cy - z * sy) * zoom, y: height / 2 - (up * cp - back * sp) * zoom, depth, zoom };
    };
  }

  const mixed = (rgb, other, share) => `rgb(${rgb.map((v, k) => Math.round(v + (other[k] - v) * share)).join()})`;

  function colours() {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(name).trim();
    const rgb = (name) => [1, 3, 5].map((k) => parseInt(read(name).slice(k, k + 2), 16));
    const people = [rgb("--partner"), rgb("--reaction")], sky = rgb("--sky");
    return { people, sky, floor: read("--floor"), grid: read("--grid"), shadow: read("--shadow") };
  }

  function hull(points) { // monotone chain, counter-clockwise
    points.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    const half = (list) => {
      const chain = [];
      for (const p of list) {
        while (chain.length > 1) {
          const [a, b] = chain.slice(-2);
          if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 0) break;
          chain.pop();
        }
        chain.push(p);
      }
      return chain.slice(0, -1);
    };
    return [...half(points), ...half([...points].reverse())];
  }

  function addPolygon(path, points) {
    points.forEach(([x, y], k) => (k ? path.lineTo(x, y) : path.moveTo(x, y)));
    path.closePath();
  }

  const ROUND = Array.from({ length: 24 }, (_, k) => [Math.cos((k * Math.PI) / 12), Math.sin((k * Math.PI) / 12)]);

  function drawGround(ctx, project, view, colour) {
    const radius = view.reach + 900, at = (x, z) => project([x, view.ground, z]);
    const rim = Array.from({ length: 72 }, (_, k) => at(radius * Math.cos(k * Math.PI / 36), radius * Math.sin(k * Math.PI / 36)));
    const disc = new Path2D(), lines = new Path2D();
    addPolygon(disc, rim.map((p) => [p.x, p.y]));
    // a line each half metre
    for (let line = -Math.floor(radius / 500) * 500; line < radius; line += 500) {
      const half = Math.sqrt(radius * radius - line * line);
      for (const [p, q] of [[at(line, -half), at(line, half)], [at(-half, line), at(half, line)]]) {
        lines.moveTo(p.x, p.y);
        lines.lineTo(q.x, q.y);
      }
    }
    ctx.fillStyle = colour.floor;
    ctx.fill(disc);
    ctx.strokeStyle = colour.grid;
    ctx.lineWidth = Math.max(1, devicePixelRatio * 0.75);
    ctx.stroke(lines);
  }

  function drawShadows(ctx, project, view, colour, parts) {
    const shade = new Path2D();
    for (const part of parts) {
      const rim = [];
      for (const [[x, y, z], radius] of part) {
        const fall = Math.max(0, y - view.ground) / LIGHT[1];
        for (const [c, s] of ROUND) {
          const p = project([x - LIGHT[0] * fall + radius * c, view.ground, z - LIGHT[2] * fall + radius * s]);
          rim.push([p.x, p.y]);
        }
      }
      addPolygon(shade, hull(rim));
    }
    ctx.fillStyle = `rgba(0,0,0,${colour.shadow})`;
    ctx.fill(shade); // one fill: shadows that overlap are no darker
  }

  // Cut limbs into shorter ones; leave balls and trunks whole.
  function pieces(part) {
    if (part.length !== 2) return [part];
    const [[a, ra], [b, rb]] = part;
    const between = (t) => [a.map((v, k) => v + (b[k] - v) * t), ra + (rb - ra) * t];
    return Array.from({ length: PIECES }, (_, k) => [between(k / PIECES), between((k + 1) / PIECES)]);
  }

  function outline(discs) {
    const path = new Path2D();
    if (discs.length === 1) path.arc(discs[0].x, discs[0].y, discs[0].r, 0, 7);
    else addPolygon(path, hull(discs.flatMap(({ x, y, r }) => ROUND.map(([c, s]) => [x + r * c, y + r * s]))));
    return path;
  }

  function shading(ctx, discs, tone) {
    const x = discs.reduce((s, d) => s + d.x, 0) / discs.length;
    const y = discs.reduce((s, d) => s + d.y, 0) / discs.length;
    let fill;
    if (discs.length === 2) { // a cylinder: light across its axis, its lit side up and left
      const [p, q] = discs, length = Math.hypot(q.x - p.x, q.y - p.y) || 1, r = Math.max(p.r, q.r);
      let nx = -(q.y - p.y) / length, ny = (q.x - p.x) / length;
      if (nx * 0.5 + ny * 0.87 < 0) [nx, ny] = [-nx, -ny];
      fill = ctx.createLinearGradient(x - nx * r, y - ny * r, x + nx * r, y + ny * r);
    } else {
      const r = Math.max(...discs.map((d) => Math.hypot(d.x - x, d.y - y) + d.r));
      fill = ctx.createRadialGradient(x - r * 0.3, y - r * 0.42, r * 0.05, x, y, r * 1.05);
    }
    tone.forEach((colour, k) => fill.addColorStop([0, 0.3, 1][k], colour));
    return fill;
  }

  function drawPeople(ctx, project, camera, colour, people) {
    const queue = people.flatMap((parts, person) => parts.flatMap(pieces).map((part) => {
      const discs = part.map(([point, radius]) => {
        const p = project(point);
        return { x: p.x, y: p.y, r: radius * p.zoom, depth: p.depth };
      });
      return { person, discs, depth: discs.reduce((s, d) => s + d.depth, 0) / discs.length };
    })).sort((a, b) => b.depth - a.depth);
    for (const { person, discs, depth } of queue) {
      const haze = Math.min(0.35, Math.max(0, (depth / camera.distance - 0.9) * 0.8));
      const base = colour.people[person].map((v, k) => v + (colour.sky[k] - v) * haze);
      const [edge, middle] = discs.length === 2 ? [0.12, 0.32] : [0.42, 0.2];
      ctx.fillStyle = shading(ctx, discs, [mixed(base, WHITE, edge), mixed(base, WHITE, middle), mixed(base, BLACK, 0.42)]);
      ctx.fill(outline(discs));
    }
  }

  function mount(figure, clip) {
    const find = (name) => figure.querySelector(name);
    const [play, scrub, clock, speed, loop] = [".play", ".scrub", ".clock", ".speed", ".loop"].map(find);
    const panels = clip.panels.map(readPanel), canvases = [...figure.querySelectorAll("canvas")], first = panels[0].times;
    const length = Math.max(...panels.map((panel) => panel.times.at(-1)));
    let camera = homeCamera(clip.view), time = 0, playing = false, last = 0, asked = false, seen = true;
    scrub.max = length;

    function drawPanel(canvas, panel, colour) {
      const width = Math.round(canvas.clientWidth * devicePixelRatio);
      const height = Math.round(canvas.clientHeight * devicePixelRatio);
      if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
      const ctx = canvas.getContext("2d"), project = projector(camera, clip.view, width, height);
      ctx.clearRect(0, 0, width, height);
      const people = [0, 1].map((person) => solids(panel.body, poseAt(panel, person, time)));
      drawGround(ctx, project, clip.view, colour);
      drawShadows(ctx, project, clip.view, colour, people.flat());
      drawPeople(ctx, project, camera, colour, people);
    }

    function draw(now) {
      asked = false;
      if (playing) {
        time += ((now - last) / 1000) * Number(speed.value);
        last = now;
        if (time >= length && loop.checked) time %= length || 1;
        else if (time >= length) { time = length; setPlaying(false); }
      }
      scrub.value = time;
      clock.textContent = `frame ${frameAt(first, time) + 1} of ${first.length} · ${time.toFixed(2)} s`;
      const colour = colours();
      if (seen) canvases.forEach((canvas, k) => drawPanel(canvas, panels[k], colour));
      if (playing) ask();
    }

    function ask() {
      if (!asked) requestAnimationFrame(draw);
      asked = true;
    }

    function setPlaying(on) {
      if (on && time >= length) time = 0;
      [playing, last] = [on, performance.now()];
      play.textContent = on ? "❚❚" : "▶";
      play.setAttribute("aria-label", on ? "pause" : "play");
      ask();
    }

    function seek(to) {
      time = Math.min(length, Math.max(0, to));
      ask();
    }

    function step(by) {
      setPlaying(false);
      seek(first[Math.min(first.length - 1, Math.max(0, frameAt(first, time) + by))]);
    }

    const keys = {
      " ": () => setPlaying(!playing), ArrowLeft: () => step(-1), ArrowRight: () => step(1),
      Home: () => seek(0), End: () => seek(length),
    };
    figure.addEventListener("keydown", (event) => {
      const taken = event.key === " " && event.target !== figure && event.target !== scrub;
      if (!keys[event.key] || taken || event.target === speed || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      keys[event.key]();
    });
    play.addEventListener("click", () => setPlaying(!playing));
    scrub.addEventListener("input", () => { setPlaying(false); seek(Number(scrub.value)); });
    canvases.forEach((canvas) => orbit(canvas, (turn, tilt, zoom) => {
      camera.yaw -= turn;
      camera.pitch = Math.min(1.5, Math.max(0, camera.pitch + tilt));
      camera.distance = Math.min(20000, Math.max(800, camera.distance * zoom));
      ask();
    }, () => { camera = homeCamera(clip.view); ask(); }));
    new ResizeObserver(ask).observe(figure);
    new IntersectionObserver((entries) => { seen = entries.at(-1).isIntersecting; ask(); }).observe(figure);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
    ask();
  }

  // Drag with mouse or finger to turn, two fingers or Ctrl and wheel to come closer.
  function orbit(canvas, move, reset) {
    const fingers = new Map(), place = (event) => fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const gap = ([a, b] = [...fingers.values()]) => Math.hypot(a.x - b.x, a.y - b.y);
    canvas.addEventListener("pointerdown", (event) => { canvas.setPointerCapture(event.pointerId); place(event); });
    canvas.addEventListener("pointermove", (event) => {
      const was = fingers.get(event.pointerId);
      if (!was) return;
      const before = fingers.size === 2 ? gap() : 0;
      place(event);
      if (fingers.size === 2) move(0, 0, before / (gap() || 1));
      else move((event.clientX - was.x) * 0.01, (event.clientY - was.y) * 0.006, 1);
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
    canvas.addEventListener("dblclick", reset);
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      move(0, 0, Math.exp(event.deltaY * 0.01));
    }, { passive: false });
  }

  const clips = JSON.parse(document.getElementById("motions").textContent);
  for (const figure of document.querySelectorAll(".player")) mount(figure, clips[Number(figure.dataset.clip)]);
})();
