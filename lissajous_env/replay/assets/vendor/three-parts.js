export {
  AmbientLight, BackSide, BufferGeometry, CanvasTexture, CatmullRomCurve3, Color, DirectionalLight, DoubleSide,
  Float32BufferAttribute, InstancedMesh, Line, LineBasicMaterial, LineLoop, Matrix4, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, PerspectiveCamera, PlaneGeometry, Raycaster, RingGeometry, Scene, SphereGeometry, Sprite,
  SpriteMaterial, SRGBColorSpace, TubeGeometry, Vector2, Vector3, WebGLRenderer,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
