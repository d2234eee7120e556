// The tool as its mesh, metallic; and the same mesh as a ghost. Objects look like wood. The part behind the
// surfaces that the cameras see glows: each pixel of the tool is compared with the depth images. It is drawn apart,
// since it opens a window in the cloud before it.

import {
  BufferAttribute, BufferGeometry, Float32BufferAttribute, Group, Mesh as DrawnMesh, type RawShaderMaterial, Vector4,
} from 'three';
import { toCreasedNormals } from 'three/addons/utils/BufferGeometryUtils.js';
import type { Mesh, SceneOptions } from '../../types';
import { behindGlsl, setViews, type ViewOf, viewUniforms } from '../cameras/views';
import { heat, OTHER_COLORS, rgb, STATE_COLORS, THEMES } from '../colors';
import { DISTANCES, OPENS_WINDOW, shaderMaterial } from '../glsl';

const CAMERAS = 4; // whose depth images the tool is compared with
const CREASE = 0.55; // rad: larger angles between triangles are sharp edges
/** Units per meter for three.js, which merges vertices within a hundredth of a unit: here 1 µm. */
const PER_METER = 1e4;

const VERTEX = `
in vec3 position, normal;
out vec3 smooth_normal; // view frame
out vec3 p_W;

void main() {
  p_W = (modelMatrix * vec4(position, 1.0)).xyz;
  smooth_normal = mat3(modelViewMatrix) * normal;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
}
`;

const NORMAL = `
in vec3 smooth_normal;
vec3 surface_normal() {
  vec3 n = normalize(smooth_normal);
  return gl_FrontFacing ? n : -n;
}
`;

const METAL = `${NORMAL}${behindGlsl(CAMERAS, true)}
in vec3 p_W;
uniform vec3 metal_color, inside_color, cut_color;
uniform vec4 glow; // color and share
uniform float cut_width; // m, of the line around the cut
uniform bool draws_inside;

void main() {
  float deep = behind(p_W);
  bool is_inside = deep > 0.0 && deep < NOT_SEEN;
  if (is_inside != draws_inside) discard;
  vec3 n = surface_normal();
  if (is_inside) {
    float rim = 1.0 - abs(n.z);
    color = vec4(deep < cut_width ? cut_color : inside_color * (0.85 + 0.3 * n.y) + 0.25 * rim * rim, 1.0);
    return;
  }
  vec3 light = vec3(-0.35, 0.55, 0.758);
  float key = max(0.0, dot(n, light));
  // A dark horizon under a bright sky looks metallic; then the light itself.
  float sky = smoothstep(-0.6, 0.9, reflect(vec3(0.0, 0.0, -1.0), n).y);
  float glint = pow(max(0.0, dot(n, normalize(light + vec3(0.0, 0.0, 1.0)))), 40.0);
  color = vec4(mix(metal_color, glow.rgb, glow.a) * (0.3 + 0.4 * key + 0.45 * sky) + 0.35 * glint, 1.0);
}
`;

const GHOST = `${NORMAL}
uniform vec3 ghost_color;
uniform float opacity;

void main() {
  float rim = 1.0 - abs(surface_normal().z);
  color = vec4(ghost_color, opacity * (0.12 + 0.75 * rim * rim));
}
`;

export class ToolMesh {
  readonly object = new Group();
  /** Shares the geometry of the mesh. */
  readonly ghost: DrawnMesh;
  private readonly uniforms = {
    ...viewUniforms(CAMERAS), metal_color: { value: rgb(THEMES.dark.metal) }, glow: { value: new Vector4() },
    inside_color: { value: rgb(STATE_COLORS.inside) }, cut_color: { value: rgb(STATE_COLORS.boundary) },
    cut_width: { value: 0 },
  };
  private readonly metal: RawShaderMaterial;
  private readonly inside = shaderMaterial({ ...this.uniforms, draws_inside: { value: true } }, VERTEX, METAL, OPENS_WINDOW);
  private readonly solids: DrawnMesh[];
  private readonly glass = shaderMaterial({
    ghost_color: { value: rgb(OTHER_COLORS.ghost) }, opacity: { value: 1 },
  }, VERTEX, GHOST, { transparent: true, depthWrite: false });

  constructor(private readonly stuff: 'metal' | 'wood' = 'metal') {
    // Objects show through the cloud as a whole: they are in no depth image.
    this.metal = shaderMaterial({ ...this.uniforms, draws_inside: { value: false } }, VERTEX, METAL,
      stuff === 'wood' ? OPENS_WINDOW : {});
    this.ghost = new DrawnMesh(new BufferGeometry(), this.glass);
    this.solids = [this.metal, this.inside].map((material) => new DrawnMesh(this.ghost.geometry, material));
    this.object.add(...this.solids);
    for (const mesh of [...this.solids, this.ghost]) mesh.frustumCulled = false;
    for (const mesh of this.solids) {
      mesh.renderOrder = -2; // drawn before the cloud
      mesh.layers.enable(DISTANCES);
    }
  }

  get loaded(): boolean {
    return this.ghost.geometry.hasAttribute('position');
  }

  /** Sets the depth cameras, with the world's pose in them, and the radius of the tool. */
  setViews(views: readonly ViewOf[], radius: number): void {
    setViews(this.uniforms, CAMERAS, views);
    this.uniforms.cut_width.value = 0.014 * radius;
  }

  set ghostIsInFront(value: boolean) {
    this.glass.depthTest = !value;
    this.ghost.renderOrder = value ? 1 : 0;
  }

  /** Sets the force on the tool as a share of the largest: the metal glows. */
  set strain(share: number) {
    this.uniforms.glow.value.set(...rgb(heat(share)).toArray(), Math.min(0.75, 3 * Math.max(0, share - 0.01)));
  }

  set ghostOpacity(value: number) {
    this.glass.uniforms.opacity.value = value;
  }

  setMesh(mesh: Mesh): void {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(mesh.positions, 3)); // a copy
    geometry.setIndex(new BufferAttribute(mesh.triangles, 1));
    geometry.scale(PER_METER, PER_METER, PER_METER);
    this.ghost.geometry.dispose();
    const drawn = toCreasedNormals(geometry, CREASE).scale(1 / PER_METER, 1 / PER_METER, 1 / PER_METER);
    for (const mesh of [...this.solids, this.ghost]) mesh.geometry = drawn;
  }

  update(options: SceneOptions): void {
    this.object.visible = (this.stuff === 'wood' || options.toolLook === 'mesh') && this.loaded;
    this.uniforms.metal_color.value = rgb(THEMES[options.dark ? 'dark' : 'light'][this.stuff]);
  }

  dispose(): void {
    this.ghost.geometry.dispose();
    for (const material of [this.metal, this.inside, this.glass]) material.dispose();
  }
}
