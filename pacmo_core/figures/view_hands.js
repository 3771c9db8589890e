"use strict";
// Mouse, pen and touch on the picture: rotate, move, zoom, select.

(() => {
  const STILL_PX = 5;

  // to: turn(x, y), move(x, y), zoom(factor), pick(x, y), hover(x, y), reset()
  function listen(area, to) {
    const fingers = new Map();
    let travelled = 0;
    const place = (event) => fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
    const gap = () => { const [a, b] = [...fingers.values()]; return Math.hypot(a.x - b.x, a.y - b.y) || 1; };
    const local = (event) => { const box = area.getBoundingClientRect(); return [event.clientX - box.x, event.clientY - box.y]; };

    area.addEventListener("pointerdown", (event) => {
      if (event.target.closest("button, input, select, a")) return;
      area.setPointerCapture(event.pointerId);
      place(event);
      travelled = fingers.size > 1 ? Infinity : 0;
    });
    area.addEventListener("pointermove", (event) => {
      const was = fingers.get(event.pointerId);
      if (!was) { if (event.pointerType === "mouse") to.hover(...local(event)); return; }
      const [x, y] = [event.clientX - was.x, event.clientY - was.y], before = fingers.size === 2 ? gap() : 0;
      travelled += Math.hypot(x, y);
      place(event);
      if (fingers.size === 2) { to.zoom(before / gap()); to.move(x / 2, y / 2); return; }
      if (event.buttons & 2 || event.shiftKey) to.move(x, y); else to.turn(x, y);
    });
    area.addEventListener("pointerup", (event) => {
      if (fingers.delete(event.pointerId) && travelled < STILL_PX && event.button === 0) to.pick(...local(event));
    });
    area.addEventListener("pointercancel", (event) => fingers.delete(event.pointerId));
    area.addEventListener("pointerleave", () => to.hover(-1, -1));
    area.addEventListener("contextmenu", (event) => event.preventDefault());
    area.addEventListener("dblclick", () => to.reset());
    area.addEventListener("wheel", (event) => {
      if (area.dataset.wheel !== "free" && !event.ctrlKey) return; // in a long page the wheel scrolls
      event.preventDefault();
      to.zoom(Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * (event.ctrlKey ? 0.01 : 0.0025)));
    }, { passive: false });
  }

  Object.assign(Pacmo, { listen });
})();
