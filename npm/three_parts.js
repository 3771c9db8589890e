// The parts of three.js that the viewer uses; all else is shaken off.
export {
  Bone, BufferAttribute, BufferGeometry, CanvasTexture, CircleGeometry, Color, DirectionalLight,
  HemisphereLight, InstancedMesh, Matrix4, Mesh, MeshBasicMaterial, MeshStandardMaterial,
  PCFShadowMap, PerspectiveCamera, SRGBColorSpace, Scene, ShadowMaterial, Skeleton, SkinnedMesh,
  SphereGeometry, Vector3, WebGLRenderer,
} from "three";
