// The tool as its mesh, metallic; and the same mesh as a ghost. Objects look like wood.

import { BufferAttribute, BufferGeometry, Float32BufferAttribute, Mesh as DrawnMesh, Vector4 } from 'three';
import { toCreasedNormals } from 'three/addons/utils/BufferGeometryUtils.js';
import type { Mesh, SceneOptions } from '../../types';
import { heat, OTHER_COLORS, rgb, THEMES } from '../colors';
import { OPENS_WINDOW, shaderMaterial } from '../glsl';

const CREASE = 0.55; // rad: larger angles between triangles are sharp edges
/** Units per meter for three.js, which merges vertices within a hundredth of a unit: here 1 µm. */
const PER_METER = 1e4;

const VERTEX = `
in vec3 position, normal;
out vec3 smooth_normal; // view frame

void main() {
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

const METAL = `${NORMAL}
uniform vec3 metal_color;
uniform vec4 glow; // color and share

void main() {
  vec3 n = surface_normal();
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
  readonly object: DrawnMesh;
  /** Shares the geometry of the mesh. */
  readonly ghost: DrawnMesh;
  private readonly metal = shaderMaterial({
    metal_color: { value: rgb(THEMES.dark.metal) }, glow: { value: new Vector4() },
  }, VERTEX, METAL, OPENS_WINDOW);
  private readonly glass = shaderMaterial({
    ghost_color: { value: rgb(OTHER_COLORS.ghost) }, opacity: { value: 1 },
  }, VERTEX, GHOST, { transparent: true, depthWrite: false });

  constructor(private readonly stuff: 'metal' | 'wood' = 'metal') {
    this.object = new DrawnMesh(new BufferGeometry(), this.metal);
    this.ghost = new DrawnMesh(this.object.geometry, this.glass);
    this.object.frustumCulled = this.ghost.frustumCulled = false;
    this.object.renderOrder = -2; // drawn before the cloud
  }

  get loaded(): boolean {
    return this.object.geometry.hasAttribute('position');
  }

  set ghostIsInFront(value: boolean) {
    this.glass.depthTest = !value;
    this.ghost.renderOrder = value ? 1 : 0;
  }

  /** Sets the force on the tool as a share of the largest: the metal glows. */
  set strain(share: number) {
    this.metal.uniforms.glow.value.set(...rgb(heat(share)).toArray(), Math.min(0.75, 3 * Math.max(0, share - 0.01)));
  }

  set ghostOpacity(value: number) {
    this.glass.uniforms.opacity.value = value;
  }

  setMesh(mesh: Mesh): void {
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(mesh.positions, 3)); // a copy
    geometry.setIndex(new BufferAttribute(mesh.triangles, 1));
    geometry.scale(PER_METER, PER_METER, PER_METER);
    this.object.geometry.dispose();
    this.object.geometry = this.ghost.geometry =
      toCreasedNormals(geometry, CREASE).scale(1 / PER_METER, 1 / PER_METER, 1 / PER_METER);
  }

  update(options: SceneOptions): void {
    this.object.visible = (this.stuff === 'wood' || options.toolLook === 'mesh') && this.loaded;
    this.metal.uniforms.metal_color.value = rgb(THEMES[options.dark ? 'dark' : 'light'][this.stuff]);
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.metal.dispose();
    this.glass.dispose();
  }
}
