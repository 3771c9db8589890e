// Where three.js puts the joints of a file that it loads: node load.mjs FILE TIME...
// Prints {duration, joints: [name...], places: [time][joint][x, y, z], skins: [time][vertex][x, y, z]}.
import { readFileSync } from "node:fs";
import { argv, stdout } from "node:process";
import { AnimationMixer, Vector3 } from "three";
import { BVHLoader } from "three/addons/loaders/BVHLoader.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

// The loader takes a browser for granted.
globalThis.self = globalThis;
globalThis.ProgressEvent ??= class extends Event {};

async function loaded(file) {
  if (file.endsWith(".bvh")) {
    const { skeleton, clip } = new BVHLoader().parse(readFileSync(file, "utf8"));
    return { scene: skeleton.bones[0], clip, joints: skeleton.bones.filter((bone) => bone.name !== "ENDSITE"), meshes: [] };
  }
  const bytes = readFileSync(file);
  const data = file.endsWith(".glb") ? bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length) : bytes.toString();
  const { scene, animations } = await new GLTFLoader().parseAsync(data, "");
  const [joints, meshes] = [[], []];
  scene.traverse((node) => { if (node.isBone) joints.push(node); if (node.isSkinnedMesh) meshes.push(node); });
  return { scene, clip: animations[0], joints, meshes };
}

const { scene, clip, joints, meshes } = await loaded(argv[2]);
const mixer = new AnimationMixer(scene), point = new Vector3(), places = [], skins = [];
mixer.clipAction(clip).play();
for (const time of argv.slice(3).map(Number)) {
  mixer.setTime(time);
  scene.updateMatrixWorld(true);
  places.push(joints.map((joint) => joint.getWorldPosition(point).toArray()));
  skins.push(meshes.flatMap((mesh) => Array.from({ length: mesh.geometry.attributes.position.count }, (_, at) => mesh.localToWorld(mesh.getVertexPosition(at, point)).toArray())));
}
stdout.write(JSON.stringify({ duration: clip.duration, joints: joints.map((joint) => joint.name), places, skins }));
