"use strict";
// Solid bodies: hulls of spheres on a grid of latitudes and longitudes, each vertex bound to its
// sphere. A frame moves the spheres; the skinning of three.js moves the vertices.

(() => {
  const ROWS = 5, COLUMNS = 14;
  const arc = (from, to, steps) => Array.from({ length: steps + 1 }, (_, k) => from + ((to - from) * k) / steps);

  // One sphere, two (a limb, along y) or four (a trunk: left and right above, left and right below).
  function grid(spheres) {
    const below = arc(-Math.PI / 2, 0, ROWS), above = arc(0, Math.PI / 2, ROWS);
    const rows = spheres.length === 1 ? [...below, ...above.slice(1)].map((lat) => [lat, 0])
      : [...below.map((lat) => [lat, spheres.length / 2]), ...above.map((lat) => [lat, 0])];
    const left = arc(-Math.PI / 2, Math.PI / 2, COLUMNS / 2), right = arc(Math.PI / 2, 1.5 * Math.PI, COLUMNS / 2);
    const columns = spheres.length === 4 ? [...left.map((lon) => [lon, 0]), ...right.map((lon) => [lon, 1]), [-Math.PI / 2, 0]]
      : arc(0, 2 * Math.PI, COLUMNS).map((lon) => [lon, 0]);
    return { rows, columns };
  }

  class Flesh {
    constructor() { Object.assign(this, { places: [], normals: [], tied: [], faces: [] }); }

    // spheres: [number of the sphere, radius]
    add(spheres) {
      const { rows, columns } = grid(spheres), first = this.tied.length, width = columns.length;
      for (const [lat, down] of rows) {
        for (const [lon, side] of columns) {
          const [sphere, radius] = spheres[down + side];
          const normal = [Math.cos(lat) * Math.cos(lon), Math.sin(lat), -Math.cos(lat) * Math.sin(lon)];
          this.places.push(...normal.map((value) => value * radius));
          this.normals.push(...normal);
          this.tied.push(sphere);
        }
      }
      for (let row = 0; row + 1 < rows.length; row += 1) {
        for (let column = 0; column + 1 < width; column += 1) {
          const a = first + row * width + column, b = a + width;
          this.faces.push(a, a + 1, b, b, a + 1, b + 1);
        }
      }
    }

    geometry() {
      const made = new THREE.BufferGeometry(), count = this.tied.length;
      const index = new Uint16Array(4 * count), weight = new Float32Array(4 * count);
      this.tied.forEach((sphere, at) => { index[4 * at] = sphere; weight[4 * at] = 1; });
      made.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(this.places), 3));
      made.setAttribute("normal", new THREE.BufferAttribute(Float32Array.from(this.normals), 3));
      made.setAttribute("skinIndex", new THREE.BufferAttribute(index, 4));
      made.setAttribute("skinWeight", new THREE.BufferAttribute(weight, 4));
      made.setIndex(this.faces);
      return made;
    }
  }

  // Matrices are written where the shader reads them; there is no scene graph to update.
  class Spheres extends THREE.Skeleton {
    constructor(count) {
      const bones = Array.from({ length: count }, () => new THREE.Bone());
      super(bones, bones.map(() => new THREE.Matrix4()));
      this.computeBoneTexture();
    }

    update() { this.boneTexture.needsUpdate = true; }

    // x, y, z: the sphere's axes; p: its centre
    put(sphere, x, y, z, p) { this.boneMatrices.set([...x, 0, ...y, 0, ...z, 0, ...p, 1], 16 * sphere); }
  }

  const joint = (pose, j) => [pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]];
  const minus = (p, q) => [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
  const middle = (points) => [0, 1, 2].map((k) => points.reduce((sum, p) => sum + p[k], 0) / points.length);
  const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
  const unit = (v, otherwise) => { const length = Math.hypot(...v); return length > 1e-9 ? v.map((x) => x / length) : otherwise; };
  const X = [1, 0, 0], Y = [0, 1, 0], Z = [0, 0, 1];

  // A person as a solid body, or as bones and joints; set by a pose.
  class Person {
    constructor(body, material) {
      this.body = body;
      const flesh = new Flesh();
      body.limbs.forEach(([, , atParent, atChild], k) => flesh.add([[2 * k + 1, atChild], [2 * k, atParent]]));
      const next = 2 * body.limbs.length;
      if (body.trunk.length) flesh.add(body.trunk.map(([, radius], k) => [next + k, radius]));
      body.balls.forEach(([, radius], k) => flesh.add([[next + body.trunk.length + k, radius]]));
      this.spheres = new Spheres(next + body.trunk.length + body.balls.length);
      this.mesh = new THREE.SkinnedMesh(flesh.geometry(), material);
      this.mesh.bind(this.spheres, new THREE.Matrix4());
      Object.assign(this.mesh, { frustumCulled: false, castShadow: true, receiveShadow: true });
    }

    show(pose) {
      this.body.limbs.forEach(([parent, child], k) => {
        const p = joint(pose, parent), q = joint(pose, child), y = unit(minus(q, p), Y);
        const x = unit(cross(y, Math.abs(y[1]) < 0.9 ? Y : X), X), z = cross(x, y);
        this.spheres.put(2 * k, x, y, z, p);
        this.spheres.put(2 * k + 1, x, y, z, q);
      });
      const next = 2 * this.body.limbs.length;
      if (this.body.trunk.length) this.turnTrunk(pose, next);
      this.body.balls.forEach(([joints], k) => this.spheres.put(next + this.body.trunk.length + k, X, Y, Z, middle(joints.map((j) => joint(pose, j)))));
    }

    // Shoulders and hips rotate about their own axes; up is along the spine.
    turnTrunk(pose, first) {
      const corners = this.body.trunk.map(([j]) => joint(pose, j));
      const spine = minus(middle(corners.slice(0, 2)), middle(corners.slice(2)));
      for (const at of [0, 2]) {
        const x = unit(minus(corners[at], corners[at + 1]), X), z = unit(cross(x, spine), Z), y = cross(z, x);
        this.spheres.put(first + at, x, y, z, corners[at]);
        this.spheres.put(first + at + 1, x, y, z, corners[at + 1]);
      }
    }
  }

  // Joints as spheres, bones as rods.
  function bare({ parents, joints }) {
    const limbs = parents.flatMap((parent, child) => (parent < 0 ? [] : [[parent, child, 0.011, 0.011]]));
    return { limbs, trunk: [], balls: joints.map((_, j) => [[j], 0.023]) };
  }

  function dressed({ body }) {
    const { limbs, trunk, head, head_radius: radius } = body;
    return { limbs, trunk, balls: head.length ? [[head, radius]] : [] };
  }

  Object.assign(Pacmo, { Person, bare, dressed });
})();
