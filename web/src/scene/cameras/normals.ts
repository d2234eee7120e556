// Normals as short needles at every eighth pixel: the server's if it sends them, else those that
// shade the cloud.

import { BufferGeometry, Mesh } from 'three';
import { OTHER_COLORS, rgb } from '../colors';
import { DEPTH_IMAGE, type DepthImage } from './depth_image';
import { shaderMaterial } from '../glsl';

const STEP = 8; // pixels

const VERTEX = `${DEPTH_IMAGE}
uniform int columns;
out float along;

void main() {
  int i = gl_VertexID / 3, corner = gl_VertexID % 3; // left, right, tip
  along = corner == 2 ? 1.0 : 0.0;
  ivec2 pixel = ${STEP} * ivec2(i % columns, i / columns) + ${STEP / 2};
  float z = depth_at(pixel);
  vec3 n = z == 0.0 ? vec3(0.0) : normal_at(pixel, z);
  if (n == vec3(0.0)) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  // As long as their distance: constant density in the picture.
  float size = ${STEP}.0 * z / intrinsics.x;
  vec4 p = modelViewMatrix * vec4(point_at(pixel, z), 1.0);
  vec3 direction = mat3(modelViewMatrix) * n;
  vec3 across = normalize(cross(direction, is_orthographic() ? vec3(0.0, 0.0, 1.0) : p.xyz));
  p.xyz += size * ((along + 0.05) * direction + (corner == 2 ? 0.0 : 0.1 * float(2 * corner - 1)) * across);
  gl_Position = projectionMatrix * p;
}
`;

const FRAGMENT = `
uniform vec3 needle_color;
in float along;
void main() { color = vec4(needle_color * (0.7 + 0.4 * along), 1.0); }
`;

export class NormalNeedles {
  readonly object: Mesh;
  private readonly geometry = new BufferGeometry();
  private readonly material;

  constructor(private readonly image: DepthImage) {
    this.material = shaderMaterial({
      ...image.uniforms, columns: { value: 1 }, needle_color: { value: rgb(OTHER_COLORS.normal) },
    }, VERTEX, FRAGMENT);
    this.object = new Mesh(this.geometry, this.material);
    this.object.frustumCulled = false;
  }

  update(shown: boolean): void {
    this.object.visible = shown && this.image.number >= 0;
    const columns = Math.floor(this.image.width / STEP), rows = Math.floor(this.image.height / STEP);
    this.geometry.setDrawRange(0, 3 * columns * rows);
    this.material.uniforms.columns.value = columns;
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
