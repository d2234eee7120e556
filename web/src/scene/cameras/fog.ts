// Unseen space as fog: small dots along the rays of every sixth pixel, behind the surface, except where
// another camera sees. At most three other cameras are used.

import { BufferGeometry, Matrix4, Points, Vector2, Vector4 } from 'three';
import { OTHER_COLORS, rgb } from '../colors';
import { DEPTH_IMAGE, type DepthImage } from './depth_image';
import { shaderMaterial, type Uniforms } from '../glsl';

const STEP = 6;          // pixels
const LAYERS = 14;
const SPACING = 0.035;   // m, between dots along a ray
const OTHERS = [0, 1, 2];

const VERTEX = `${DEPTH_IMAGE}
uniform int columns, rows;
uniform float dot_size;  // pixels of the canvas
${OTHERS.map((i) => `
uniform usampler2D other_image_${i};
uniform ivec2 other_size_${i};
uniform vec4 other_intrinsics_${i};
uniform float other_unit_${i};  // 0: unused
uniform mat4 X_OC_${i};         // O: the other camera

// True if the other camera sees p, or its surface is less than SEEN_BEHIND before p.
bool is_seen_${i}(vec3 p) {
  if (other_unit_${i} == 0.0) return false;
  vec3 q = (X_OC_${i} * vec4(p, 1.0)).xyz;
  if (q.z < 0.02) return false;
  ivec2 pixel = ivec2(floor(other_intrinsics_${i}.xy * q.xy / q.z + other_intrinsics_${i}.zw + 0.5));
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, other_size_${i}))) return false;
  uint raw = texelFetch(other_image_${i}, pixel, 0).r;
  return raw != 0u && q.z < float(raw) * other_unit_${i} + SEEN_BEHIND;
}`).join('\n')}

// Random offset of a pixel, 0 to 1: dots in layers would look like surfaces.
float scatter(ivec2 pixel) {
  return fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
}

void main() {
  int i = gl_VertexID % (columns * rows), layer = gl_VertexID / (columns * rows);
  ivec2 pixel = ${STEP} * ivec2(i % columns, i / columns) + ${STEP / 2};
  float z = depth_at(pixel);
  vec3 p = point_at(pixel, z + SEEN_BEHIND + ${SPACING} * (float(layer) + scatter(pixel)));
  if (z == 0.0 || ${OTHERS.map((i) => `is_seen_${i}(p)`).join(' || ')}) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  gl_Position = projectionMatrix * modelViewMatrix * vec4(p, 1.0);
  gl_PointSize = dot_size;
}
`.replaceAll('SEEN_BEHIND', '0.02');

const FRAGMENT = `
uniform vec3 fog_color;
void main() { color = vec4(fog_color, 1.0); }
`;

export class Fog {
  readonly object: Points;
  private readonly geometry = new BufferGeometry();
  private readonly material;

  constructor(private readonly image: DepthImage) {
    const others: Uniforms = {};
    for (const i of OTHERS) {
      others[`other_image_${i}`] = { value: image.uniforms.depth_image.value };
      others[`other_size_${i}`] = { value: new Vector2() };
      others[`other_intrinsics_${i}`] = { value: new Vector4() };
      others[`other_unit_${i}`] = { value: 0 };
      others[`X_OC_${i}`] = { value: new Matrix4() };
    }
    this.material = shaderMaterial({
      ...image.uniforms, ...others, columns: { value: 1 }, rows: { value: 1 }, dot_size: { value: 2 },
      fog_color: { value: rgb(OTHER_COLORS.fog) },
    }, VERTEX, FRAGMENT);
    this.object = new Points(this.geometry, this.material);
    this.object.frustumCulled = false;
  }

  /** `others`: depth images of all other cameras, with this camera's pose in them. */
  update(shown: boolean, others: [image: DepthImage, X_OC: Matrix4][], pixelRatio: number): void {
    this.object.visible = shown && this.image.number >= 0;
    if (!this.object.visible) return;
    const u = this.material.uniforms;
    const columns = Math.floor(this.image.width / STEP), rows = Math.floor(this.image.height / STEP);
    this.geometry.setDrawRange(0, columns * rows * LAYERS);
    u.columns.value = columns;
    u.rows.value = rows;
    u.dot_size.value = 1.5 * pixelRatio;
    const seeing = others.filter(([image]) => image.number >= 0);
    for (const i of OTHERS) {
      const other = seeing[i];
      u[`other_unit_${i}`].value = other ? other[0].uniforms.unit.value : 0;
      u[`other_image_${i}`].value = (other ? other[0] : this.image).uniforms.depth_image.value;
      if (!other) continue;
      (u[`other_size_${i}`].value as Vector2).set(other[0].width, other[0].height);
      (u[`other_intrinsics_${i}`].value as Vector4).copy(other[0].uniforms.intrinsics.value as Vector4);
      (u[`X_OC_${i}`].value as Matrix4).copy(other[1]);
    }
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
