"use strict";
// The overlay: names of joints, distances, contacts, selected joints.

(() => {
  const point = new THREE.Vector3();
  const NEAR_PX = 16;

  // A position in the world as pixels of a cell; null behind the camera.
  function projected(camera, cell, place) {
    point.set(...place).project(camera);
    if (point.z > 1) return null;
    return { x: cell.x + ((point.x + 1) / 2) * cell.width, y: cell.y + ((1 - point.y) / 2) * cell.height };
  }

  const joint = (pose, j) => [pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]];

  function seenJoints(stage, cell) {
    const { clip, camera } = stage;
    return clip.poses.map((pose, person) => clip.bodies[person].joints.map((_, j) => projected(camera, cell, joint(pose, j))));
  }

  function nearest(stage, cell, x, y) {
    let found = null, least = NEAR_PX;
    seenJoints(stage, cell).forEach((places, person) => places.forEach((at, j) => {
      const gap = at ? Math.hypot(at.x - x, at.y - y) : Infinity;
      if (gap < least) { least = gap; found = { person, joint: j }; }
    }));
    return found;
  }

  class Overlay {
    constructor(canvas) {
      this.canvas = canvas;
      this.ctx = canvas.getContext("2d");
    }

    begin(width, height, colour) {
      const scale = Math.min(devicePixelRatio, 2), { canvas, ctx } = this;
      const [w, h] = [Math.round(width * scale), Math.round(height * scale)];
      if (canvas.width !== w || canvas.height !== h) [canvas.width, canvas.height] = [w, h];
      ctx.setTransform(scale, 0, 0, scale, 0, 0);
      ctx.clearRect(0, 0, width, height);
      ctx.font = "600 11px system-ui, sans-serif";
      this.colour = colour;
    }

    draw(stage, cell, { contacts, distances, names, picks, hovered }) {
      const { ctx } = this;
      ctx.save();
      ctx.beginPath();
      ctx.rect(cell.x, cell.y, cell.width, cell.height);
      ctx.clip();
      this.taken = [];
      this.places = seenJoints(stage, cell);
      if (contacts) this.contacts(stage);
      if (distances) this.distances(stage, picks);
      for (const { person, joint: j } of [...picks, ...(hovered ? [hovered] : [])]) this.mark(person, j);
      const told = [...picks, ...(hovered ? [hovered] : [])];
      if (names) this.places.forEach((places, person) => places.forEach((_, j) => told.push({ person, joint: j })));
      for (const { person, joint: j } of told) this.tell(this.places[person]?.[j], stage.clip.bodies[person]?.joints[j], this.colour.people[person]);
      ctx.restore();
    }

    // A mark where joints of the two people are in contact.
    contacts({ clip }) {
      if (clip.poses.length < 2) return;
      const [first, second] = clip.poses, { ctx, colour } = this;
      this.places[0].forEach((a, i) => this.places[1].forEach((b, j) => {
        if (!a || !b || Pacmo.apart(joint(first, i), joint(second, j)) > clip.contact) return;
        const x = (a.x + b.x) / 2, y = (a.y + b.y) / 2, glow = ctx.createRadialGradient(x, y, 1, x, y, 20);
        glow.addColorStop(0, `${colour.lit}d0`);
        glow.addColorStop(1, `${colour.lit}00`);
        ctx.fillStyle = glow;
        ctx.fillRect(x - 20, y - 20, 40, 40);
        ctx.fillStyle = colour.lit;
        ctx.strokeStyle = "#1d2126";
        ctx.lineWidth = 1.5;
        ctx.beginPath();
        ctx.arc(x, y, 4.5, 0, 7);
        ctx.fill();
        ctx.stroke();
      }));
    }

    // Between the closest joints of the two people, or between two selected joints.
    distances({ clip }, picks) {
      const lines = [];
      if (clip.poses.length > 1) {
        const { pair } = Pacmo.closest(...clip.poses);
        lines.push([{ person: 0, joint: pair[0] }, { person: 1, joint: pair[1] }]);
      }
      if (picks.length === 2) lines.push(picks);
      for (const [p, q] of lines) {
        const [a, b] = [p, q].map(({ person, joint: j }) => this.places[person]?.[j]);
        if (!a || !b) continue;
        const metres = Pacmo.apart(...[p, q].map(({ person, joint: j }) => joint(clip.poses[person], j)));
        this.line(a, b);
        this.tell({ x: (a.x + b.x) / 2 - 22, y: Math.min(a.y, b.y) - 16 }, `${metres.toFixed(2)} m`, this.colour.ink, true);
      }
    }

    line(a, b) {
      const { ctx, colour } = this;
      for (const [stroke, width] of [[colour.card, 4], [colour.ink, 1.6]]) {
        Object.assign(ctx, { strokeStyle: stroke, lineWidth: width });
        ctx.setLineDash(width < 2 ? [5, 3] : []);
        ctx.beginPath();
        ctx.moveTo(a.x, a.y);
        ctx.lineTo(b.x, b.y);
        ctx.stroke();
      }
      ctx.setLineDash([]);
    }

    mark(person, j) {
      const at = this.places[person]?.[j], { ctx, colour } = this;
      if (!at) return;
      for (const [stroke, width] of [[colour.card, 5], [colour.people[person], 2.5]]) {
        Object.assign(ctx, { strokeStyle: stroke, lineWidth: width });
        ctx.beginPath();
        ctx.arc(at.x, at.y, 7, 0, 7);
        ctx.stroke();
      }
    }

    // A label, unless it would cover another.
    tell(at, text, ink, always = false) {
      const { ctx, colour } = this;
      if (!at || text === undefined) return;
      const box = { x: at.x + 9, y: at.y - 8, width: ctx.measureText(text).width + 8, height: 16 };
      const meets = (b) => b.x < box.x + box.width && box.x < b.x + b.width && b.y < box.y + box.height && box.y < b.y + b.height;
      if (!always && this.taken.some(meets)) return;
      this.taken.push(box);
      ctx.fillStyle = `${colour.card}d9`;
      ctx.beginPath();
      ctx.roundRect(box.x, box.y, box.width, box.height, 4);
      ctx.fill();
      ctx.fillStyle = ink;
      ctx.fillText(text, box.x + 4, box.y + 12);
    }
  }

  Object.assign(Pacmo, { Overlay, nearest, projected });
})();
