// What the pages use of three.js; a new name goes here, and `make viewer` bundles it.
export {
  AlwaysDepth, Box3, BufferAttribute, BufferGeometry, CatmullRomCurve3, Color, ConeGeometry, CylinderGeometry, DepthTexture,
  DirectionalLight, DoubleSide, EqualStencilFunc, FramebufferTexture, GLSL3, GridHelper, Group, HemisphereLight, IncrementStencilOp,
  LinearFilter, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial, MeshPhongMaterial, NearestFilter, OrthographicCamera, PlaneGeometry,
  Quaternion, Raycaster, Scene, ShaderMaterial, ShadowMaterial, SphereGeometry, TorusGeometry, TubeGeometry, UnsignedIntType, Vector2,
  Vector3, WebGLRenderTarget,
} from "three";
