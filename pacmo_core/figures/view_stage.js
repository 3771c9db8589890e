"use strict";
// One clip in 3-D: people, ground, light, shadows, trails, and the camera.

(() => {
  const FIELD = 32; // degrees, of the camera
  const TRAIL_S = 1.2, DOT_S = 1 / 30, DOT = 0.013;
  const SUN = [1.4, 4.2, 2.1];

  function colours(element) {
    const style = getComputedStyle(element), read = (name) => style.getPropertyValue(name).trim();
    return {
      people: [read("--person-a"), read("--person-b")], sky: read("--sky"), floor: read("--floor"), grid: read("--grid"),
      shadow: Number(read("--shadow")), ink: read("--ink"), soft: read("--soft"), card: read("--card"), rule: read("--rule"),
      lit: read("--lit"), dark: read("--dark") === "1",
    };
  }

  // A disc that fades out at its edge, with a grid of half a metre.
  function paintGround(canvas, radius, colour) {
    const size = canvas.width, ctx = canvas.getContext("2d"), scale = size / 2 / radius;
    ctx.clearRect(0, 0, size, size);
    ctx.fillStyle = colour.floor;
    ctx.fillRect(0, 0, size, size);
    ctx.strokeStyle = colour.grid;
    for (let line = -Math.floor(2 * radius) / 2; line < radius; line += 0.5) {
      ctx.lineWidth = Math.abs(line % 1) < 0.01 ? 3.2 : 1.6;
      const at = size / 2 + line * scale;
      ctx.beginPath();
      ctx.moveTo(at, 0); ctx.lineTo(at, size);
      ctx.moveTo(0, at); ctx.lineTo(size, at);
      ctx.stroke();
    }
    const fade = ctx.createRadialGradient(size / 2, size / 2, size * 0.18, size / 2, size / 2, size / 2);
    fade.addColorStop(0, "#000f");
    fade.addColorStop(1, "#0000");
    ctx.globalCompositeOperation = "destination-in";
    ctx.fillStyle = fade;
    ctx.fillRect(0, 0, size, size);
    ctx.globalCompositeOperation = "source-over";
  }

  class Stage {
    constructor(clip) {
      this.clip = clip;
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(FIELD, 1, 0.05, 200);
      this.materials = clip.motions.map(() => new THREE.MeshStandardMaterial({ roughness: 0.62, metalness: 0 }));
      this.people = { solid: this.dress(Pacmo.dressed), bare: this.dress(Pacmo.bare) };
      this.trails = this.materials.map(() => this.makeTrail());
      this.light();
      this.lay();
    }

    dress(shape) {
      return this.materials.map((material, k) => {
        const person = new Pacmo.Person(shape(this.clip.bodies[k]), material);
        this.scene.add(person.mesh);
        return person;
      });
    }

    light() {
      this.sky = new THREE.HemisphereLight(0xffffff, 0x8a8f98, 1.9);
      this.sun = new THREE.DirectionalLight(0xffffff, 2.3);
      this.sun.castShadow = true;
      this.sun.shadow.mapSize.set(1024, 1024);
      Object.assign(this.sun.shadow, { bias: -0.0006, normalBias: 0.012, radius: 3 });
      const half = Math.min(6, this.clip.view.near + 0.6);
      Object.assign(this.sun.shadow.camera, { left: -half, right: half, top: half, bottom: -half, near: 0.2, far: 14 });
      this.scene.add(this.sky, this.sun, this.sun.target);
    }

    lay() {
      const { view } = this.clip, radius = Math.ceil(view.reach + 2.5);
      this.ground = document.createElement("canvas");
      this.ground.width = this.ground.height = 1024;
      this.texture = new THREE.CanvasTexture(this.ground);
      Object.assign(this.texture, { colorSpace: THREE.SRGBColorSpace, anisotropy: 8 });
      this.texture.userData = { radius };
      const disc = new THREE.CircleGeometry(radius, 64).rotateX(-Math.PI / 2);
      const floor = new THREE.Mesh(disc, new THREE.MeshBasicMaterial({ map: this.texture, transparent: true, depthWrite: false }));
      this.shade = new THREE.ShadowMaterial({ depthWrite: false });
      const shadow = new THREE.Mesh(disc, this.shade);
      shadow.receiveShadow = true;
      [floor, shadow].forEach((mesh, k) => {
        mesh.position.set(view.centre[0], view.ground, view.centre[1]);
        mesh.renderOrder = k - 2; // below everything, the shadow over the floor
        this.scene.add(mesh);
      });
    }

    makeTrail() {
      const dots = new THREE.InstancedMesh(new THREE.SphereGeometry(1, 8, 6), new THREE.MeshBasicMaterial(), 2 * Math.ceil(TRAIL_S / DOT_S) + 2);
      Object.assign(dots, { frustumCulled: false, count: 0 });
      this.scene.add(dots);
      return dots;
    }

    paint(colour) {
      paintGround(this.ground, this.texture.userData.radius, colour);
      this.texture.needsUpdate = true;
      this.shade.opacity = colour.shadow;
      this.materials.forEach((material, person) => material.color.set(colour.people[person]));
      this.trails.forEach((trail, person) => trail.material.color.set(colour.people[person]).lerp(new THREE.Color(colour.dark ? "#fff" : "#000"), 0.25));
      this.sky.groundColor.set(colour.floor);
      this.sky.intensity = colour.dark ? 1.5 : 1.9;
    }

    // The point that the camera looks at: the middle of the clip, or of the people at this time.
    target(time, follows) {
      const { view } = this.clip, [x, z] = follows ? this.clip.middleAt(time) : view.centre;
      return [x, view.ground + (view.top - view.ground) * 0.47, z];
    }

    // The distance from which all people are visible completely.
    home(aspect, follows) {
      const { view } = this.clip, slope = Math.tan((FIELD * Math.PI) / 360);
      const reach = (follows ? view.near : view.reach) + 0.12, height = ((view.top - view.ground) / 2) * 1.22;
      return Math.max(height / slope, reach / (slope * aspect)) + 0.45 * Math.min(reach, 1.5);
    }

    // look: yaw and pitch in radians, distance in metres, pan in metres to the right and up
    see(look, time, aspect) {
      const target = this.target(time, look.follows), yaw = this.clip.view.yaw + look.yaw;
      const away = [Math.sin(yaw) * Math.cos(look.pitch), Math.sin(look.pitch), Math.cos(yaw) * Math.cos(look.pitch)];
      target[0] += Math.cos(yaw) * look.pan[0];
      target[2] -= Math.sin(yaw) * look.pan[0];
      target[1] += look.pan[1];
      this.distance = look.zoom * this.home(aspect, look.follows);
      this.camera.position.set(...away.map((value, k) => target[k] + value * this.distance));
      this.camera.lookAt(...target);
      Object.assign(this.camera, { aspect });
      this.camera.updateProjectionMatrix();
      this.camera.updateMatrixWorld();
      const [x, , z] = this.target(time, true);
      this.sun.target.position.set(x, this.clip.view.ground + 0.8, z);
      this.sun.position.set(x + SUN[0], this.clip.view.ground + SUN[1] + 0.8, z + SUN[2]);
    }

    show(time, { solid, trails, marked }) {
      this.clip.moveTo(time);
      for (const [kind, people] of Object.entries(this.people)) {
        people.forEach((person, k) => {
          person.mesh.visible = (kind === "solid") === solid;
          if (person.mesh.visible) person.show(this.clip.poses[k]);
        });
      }
      this.trails.forEach((trail, person) => {
        trail.visible = trails;
        if (trails) this.drawTrail(trail, person, time, marked[person]);
      });
    }

    // Dots every thirtieth of a second: larger gaps mean higher speed.
    drawTrail(dots, person, now, joints) {
      const { clip } = this, width = clip.bodies[person].joints.length, matrix = new THREE.Matrix4(), time = Math.min(now, clip.length);
      dots.count = 0;
      const last = Math.floor(time / DOT_S);
      for (let tick = Math.max(0, last - Math.floor(TRAIL_S / DOT_S)); tick <= last; tick += 1) {
        const at = tick * DOT_S, frame = clip.frameAt(at), next = Math.min(frame + 1, clip.times.length - 1);
        const share = next > frame ? (at - clip.times[frame]) / (clip.times[next] - clip.times[frame]) : 0;
        const size = DOT * (0.25 + 0.75 * (1 - (time - at) / (TRAIL_S + DOT_S)));
        for (const joint of joints.slice(0, 2)) {
          if (joint >= width) continue;
          const p = clip.place(person, joint, frame), q = clip.place(person, joint, next);
          matrix.makeScale(size, size, size).setPosition(...[0, 1, 2].map((k) => p[k] + (q[k] - p[k]) * share));
          dots.setMatrixAt(dots.count, matrix);
          dots.count += 1;
        }
      }
      dots.instanceMatrix.needsUpdate = true;
    }
  }

  Object.assign(Pacmo, { FIELD, Stage, colours });
})();
