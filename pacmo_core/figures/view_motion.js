"use strict";
// Motions of the page: decoding, joint positions at any time, and the plotted quantities.
// World: metres, y up, right-handed, seconds.

const Pacmo = { players: [] };

(() => {
  const bytes = (text) => Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0)).buffer;

  // Integer steps from an origin, as pacmo_core/figures/viewer.py writes them.
  function unpack(text, origin, step) {
    return Float32Array.from(new Int16Array(bytes(text)), (value, at) => origin[at % 3] + value * step);
  }

  class Clip {
    constructor(packed) {
      Object.assign(this, packed);
      this.times = new Float64Array(bytes(packed.times));
      this.motions = packed.motions.map((text) => unpack(text, packed.origin, packed.step));
      // The skeleton of each person: joints, parents, root, body.
      this.bodies = this.motions.map((_, person) => (person && packed.other) || this);
      this.poses = this.bodies.map(({ joints }) => new Float32Array(3 * joints.length));
      this.length = this.times.at(-1);
      this.found = new Map(); // series that were asked for
    }

    // The last frame at or before a time, within a microsecond.
    frameAt(time) {
      let low = 0, high = this.times.length - 1;
      while (low < high) {
        const middle = (low + high + 1) >> 1;
        if (this.times[middle] <= time + 1e-6) low = middle; else high = middle - 1;
      }
      return low;
    }

    // Positions are linear between frames and constant before the first and after the last.
    moveTo(time) {
      const frame = this.frameAt(time), next = Math.min(frame + 1, this.times.length - 1);
      const span = this.times[next] - this.times[frame];
      const share = span > 0 ? Math.min(1, Math.max(0, (time - this.times[frame]) / span)) : 0;
      this.motions.forEach((motion, person) => {
        const pose = this.poses[person], a = frame * pose.length, b = next * pose.length;
        for (let k = 0; k < pose.length; k += 1) pose[k] = motion[a + k] + (motion[b + k] - motion[a + k]) * share;
      });
    }

    place(person, joint, frame) {
      const at = 3 * (frame * this.bodies[person].joints.length + joint);
      return this.motions[person].subarray(at, at + 3);
    }

    rootAt(person, frame) { return this.place(person, this.bodies[person].root, frame); }

    // The mean of all roots, averaged over half a second before and after: the target of the camera.
    middleAt(time) {
      this.path ??= smoothed(this);
      const frame = this.frameAt(time), next = Math.min(frame + 1, this.times.length - 1);
      const span = this.times[next] - this.times[frame];
      const share = span > 0 ? Math.min(1, Math.max(0, (time - this.times[frame]) / span)) : 0;
      return this.path[frame].map((value, k) => value + (this.path[next][k] - value) * share);
    }

    series(metric, person, joint) {
      const key = [metric, person, joint].join();
      if (!this.found.has(key)) {
        const measure = METRICS[metric].measure(this, person, joint);
        this.found.set(key, Float32Array.from(this.times, (_, frame) => measure(frame)));
      }
      return this.found.get(key);
    }
  }

  function smoothed(clip) {
    const sums = [[0, 0]]; // of x and z up to each frame
    clip.times.forEach((_, frame) => {
      const roots = clip.motions.map((_, person) => clip.rootAt(person, frame));
      sums.push([0, 2].map((axis, k) => sums.at(-1)[k] + roots.reduce((s, root) => s + root[axis], 0) / roots.length));
    });
    return Array.from(clip.times, (time) => {
      const first = clip.frameAt(time - 0.5), last = clip.frameAt(time + 0.5) + 1;
      return [0, 1].map((k) => (sums[last][k] - sums[first][k]) / (last - first));
    });
  }

  const apart = (p, q) => Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);

  // The closest joints of two people and their distance.
  function closest(first, second) {
    let least = Infinity, pair = [0, 0];
    for (let i = 0; i < first.length; i += 3) {
      for (let j = 0; j < second.length; j += 3) {
        const x = first[i] - second[j], y = first[i + 1] - second[j + 1], z = first[i + 2] - second[j + 2];
        const squared = x * x + y * y + z * z;
        if (squared < least) { least = squared; pair = [i / 3, j / 3]; }
      }
    }
    return { distance: Math.sqrt(least), pair };
  }

  function speed(clip, person, joint) {
    const last = clip.times.length - 1;
    return (frame) => {
      const a = Math.max(0, frame - 1), b = Math.min(last, frame + 1);
      return apart(clip.place(person, joint, a), clip.place(person, joint, b)) / (clip.times[b] - clip.times[a]);
    };
  }

  // The largest relative change of a bone from its median length.
  function stretch(clip, person) {
    const bones = clip.bodies[person].parents.flatMap((parent, child) => (parent < 0 ? [] : [[parent, child]]));
    const length = ([p, c], frame) => apart(clip.place(person, p, frame), clip.place(person, c, frame));
    const usual = bones.map((bone) => Array.from(clip.times, (_, frame) => length(bone, frame)).sort((a, b) => a - b)[clip.times.length >> 1]);
    return (frame) => Math.max(...bones.map((bone, k) => (usual[k] > 0.01 ? 100 * Math.abs(length(bone, frame) / usual[k] - 1) : 0)));
  }

  const pose = (clip, person, frame) => {
    const size = clip.poses[person].length;
    return clip.motions[person].subarray(frame * size, (frame + 1) * size);
  };

  // The joint of the second person that has the name of a joint of the first; -1 if there is none.
  const namesake = (clip, joint) => clip.bodies[1].joints.indexOf(clip.joints[joint]);

  // of: pair (one series per clip) or person (one per person); joint: of the selected joint.
  const METRICS = {
    closest: { label: "distance between the bodies", unit: "m", of: "pair", measure: (clip) => (frame) => closest(pose(clip, 0, frame), pose(clip, 1, frame)).distance },
    roots: { label: "distance of the roots", unit: "m", of: "pair", measure: (clip) => (frame) => apart(clip.rootAt(0, frame), clip.rootAt(1, frame)) },
    same: { label: "distance of the same joint of both", unit: "m", of: "pair", joint: true, measure: (clip, _, joint) => (frame) => apart(clip.place(0, joint, frame), clip.place(1, namesake(clip, joint), frame)) },
    speed: { label: "speed of the joint", unit: "m/s", of: "person", joint: true, measure: speed },
    height: { label: "height of the joint", unit: "m", of: "person", joint: true, measure: (clip, person, joint) => (frame) => clip.place(person, joint, frame)[1] - clip.view.ground },
    stretch: { label: "change of bone length, the most", unit: "%", of: "person", measure: stretch },
  };

  Object.assign(Pacmo, { Clip, METRICS, apart, closest, namesake });
})();
