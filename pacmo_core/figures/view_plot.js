"use strict";
// A quantity over time below the picture; a click seeks.

(() => {
  const DASHES = [[], [6, 3], [2, 2.5], [9, 3, 2, 3], [4, 6], [12, 4], [14, 3, 2, 3, 2, 3]];
  const LEFT = 44, RIGHT = 8, TOP = 8, BOTTOM = 14, BAR = 4, MOST = 2000;

  // The smallest round step that divides a range into at most so many parts.
  function tickStep(range, parts) {
    const rough = range / Math.max(1, parts) || 1, power = 10 ** Math.floor(Math.log10(rough));
    return [1, 2, 5, 10].map((n) => n * power).find((step) => step >= rough);
  }

  // The lines to draw: a clip, a person (null of a pair), values.
  function linesOf(clips, metric, jointName) {
    const facts = Pacmo.METRICS[metric];
    return clips.flatMap((clip, k) => {
      const joints = clip.bodies.map((body) => (facts.joint ? body.joints.indexOf(jointName) : body.root));
      if (facts.of === "pair") {
        const shown = clip.motions.length > 1 && (!facts.joint || (joints[0] >= 0 && Pacmo.namesake(clip, joints[0]) >= 0));
        return shown ? [{ clip, k, person: null, values: clip.series(metric, 0, joints[0]) }] : [];
      }
      return joints.flatMap((joint, person) => (joint < 0 ? [] : [{ clip, k, person, values: clip.series(metric, person, joint) }]));
    });
  }

  class Plot {
    constructor(canvas, length) { Object.assign(this, { canvas, length, ctx: canvas.getContext("2d"), back: document.createElement("canvas") }); }

    set(clips, metric, joint, colour) {
      Object.assign(this, { clips, metric, colour, lines: linesOf(clips, metric, joint), stale: true });
      this.pairs = clips.filter((clip) => clip.motions.length > 1);
      const finite = this.lines.flatMap(({ values }) => [values.reduce((a, b) => Math.max(a, b), 0)]);
      this.top = Math.max(...finite, 1e-3) * 1.06;
    }

    x(time) { return LEFT + (time / (this.length || 1)) * (this.width - LEFT - RIGHT); }
    get floor() { return this.height - BOTTOM - BAR * this.pairs.length; }
    y(value) { return this.floor - (value / this.top) * (this.floor - TOP); }
    timeAt(x) { return Math.min(1, Math.max(0, (x - LEFT) / (this.width - LEFT - RIGHT))) * this.length; }

    // The lines are drawn once, the cursor each frame.
    draw(time) {
      const scale = Math.min(devicePixelRatio, 2), { canvas, back } = this;
      [this.width, this.height] = [canvas.clientWidth, canvas.clientHeight];
      const [w, h] = [Math.round(this.width * scale), Math.round(this.height * scale)];
      if (canvas.width !== w || canvas.height !== h || this.stale) {
        [canvas.width, canvas.height, back.width, back.height] = [w, h, w, h];
        this.stale = false;
        const ctx = back.getContext("2d");
        ctx.scale(scale, scale);
        this.axes(ctx);
        for (const line of this.lines) this.curve(ctx, line);
      }
      if (!w || !h) return;
      this.ctx.setTransform(1, 0, 0, 1, 0, 0);
      this.ctx.clearRect(0, 0, w, h);
      this.ctx.drawImage(back, 0, 0);
      this.ctx.scale(scale, scale);
      this.cursor(time);
    }

    axes(ctx) {
      const { colour } = this, step = tickStep(this.top, this.height / 26), unit = Pacmo.METRICS[this.metric].unit;
      Object.assign(ctx, { font: "10px system-ui, sans-serif", fillStyle: colour.soft, strokeStyle: colour.rule, lineWidth: 1, textAlign: "right" });
      for (let value = 0; value <= this.top; value += step) {
        const y = Math.round(this.y(value)) + 0.5;
        ctx.beginPath();
        ctx.moveTo(LEFT, y);
        ctx.lineTo(this.width - RIGHT, y);
        ctx.stroke();
        ctx.fillText(`${+value.toPrecision(6)} ${unit}`, LEFT - 5, y + 3);
      }
      ctx.textAlign = "center";
      const second = tickStep(this.length, this.width / 64);
      for (let time = second; time < this.length - second / 3; time += second) ctx.fillText(`${+time.toPrecision(6)} s`, this.x(time), this.height - 2);
      this.touching(ctx);
    }

    // Contacts: bars below the curves, a row for each clip in their order.
    touching(ctx) {
      ctx.fillStyle = this.colour.lit;
      ctx.strokeStyle = this.colour.soft;
      this.pairs.forEach((clip, row) => {
        const gaps = clip.series("closest", 0, clip.root), y = this.floor + 2 + BAR * row;
        let from = -1;
        for (let frame = 0; frame <= gaps.length; frame += 1) {
          const touches = frame < gaps.length && gaps[frame] <= clip.contact;
          if (touches && from < 0) from = frame;
          if (!touches && from >= 0) {
            const x = this.x(clip.times[from]);
            ctx.fillRect(x, y, Math.max(1.5, this.x(clip.times[frame - 1]) - x), 3);
            from = -1;
          }
        }
      });
    }

    curve(ctx, { clip, k, person, values }) {
      Object.assign(ctx, { strokeStyle: person === null ? this.colour.ink : this.colour.people[person], lineWidth: 1.6, lineJoin: "round" });
      ctx.setLineDash(DASHES[k % DASHES.length]);
      ctx.beginPath();
      const skip = Math.max(1, Math.floor(values.length / MOST));
      for (let frame = 0; frame < values.length; frame += skip) ctx.lineTo(this.x(clip.times[frame]), this.y(values[frame]));
      ctx.stroke();
      ctx.setLineDash([]);
    }

    cursor(time) {
      const { ctx, colour } = this, x = this.x(time);
      Object.assign(ctx, { strokeStyle: colour.ink, lineWidth: 1 });
      ctx.beginPath();
      ctx.moveTo(x, TOP - 4);
      ctx.lineTo(x, this.height - BOTTOM + 2);
      ctx.stroke();
      for (const { clip, person, values } of this.lines.filter((line) => time <= line.clip.length)) {
        const value = values[clip.frameAt(time)];
        ctx.fillStyle = person === null ? colour.ink : colour.people[person];
        ctx.beginPath();
        ctx.arc(x, this.y(value), 3.2, 0, 7);
        ctx.fill();
      }
    }

    // The values at a time as text.
    said(time) {
      const unit = Pacmo.METRICS[this.metric].unit;
      return this.lines.map(({ clip, values }) => values[clip.frameAt(time)].toFixed(2)).join(" · ") + (this.lines.length ? ` ${unit}` : "");
    }
  }

  Object.assign(Pacmo, { Plot, DASHES });
})();
