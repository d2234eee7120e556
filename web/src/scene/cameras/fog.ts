// Unseen space as fog: small dots along the rays of every sixth pixel, behind the surface, except where
// another camera sees. At most three other cameras are used.

import { BufferGeometry, Points } from 'three';
import { OTHER_COLORS, rgb } from '../colors';
import { DEPTH_IMAGE, type DepthImage } from './depth_image';
import { shaderMaterial } from '../glsl';
import { behindGlsl, setViews, type ViewOf, viewUniforms } from './views';

const STEP = 6;          // pixels
const LAYERS = 14;
const SPACING = 0.035;   // m, between dots along a ray
const OTHERS = 3;
const SEEN_BEHIND = '0.02'; // m: what another camera sees reaches this far behind its surface

const VERTEX = `${DEPTH_IMAGE}
uniform int columns, rows;
uniform float dot_size;  // pixels of the canvas
${behindGlsl(OTHERS, false)}
// Random offset of a pixel, 0 to 1: dots in layers would look like surfaces.
float scatter(ivec2 pixel) {
  return fract(52.9829189 * fract(dot(vec2(pixel), vec2(0.06711056, 0.00583715))));
}

void main() {
  int i = gl_VertexID % (columns * rows), layer = gl_VertexID / (columns * rows);
  ivec2 pixel = ${STEP} * ivec2(i % columns, i / columns) + ${STEP / 2};
  float z = depth_at(pixel);
  vec3 p = point_at(pixel, z + ${SEEN_BEHIND} + ${SPACING} * (float(layer) + scatter(pixel)));
  if (z == 0.0 || behind(p) < ${SEEN_BEHIND}) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  gl_Position = projectionMatrix * modelViewMatrix * vec4(p, 1.0);
  gl_PointSize = dot_size;
}
`;

const FRAGMENT = `
uniform vec3 fog_color;
void main() { color = vec4(fog_color, 1.0); }
`;

export class Fog {
  readonly object: Points;
  private readonly geometry = new BufferGeometry();
  private readonly material;

  constructor(private readonly image: DepthImage) {
    this.material = shaderMaterial({
      ...image.uniforms, ...viewUniforms(OTHERS), columns: { value: 1 }, rows: { value: 1 }, dot_size: { value: 2 },
      fog_color: { value: rgb(OTHER_COLORS.fog) },
    }, VERTEX, FRAGMENT);
    this.object = new Points(this.geometry, this.material);
    this.object.frustumCulled = false;
  }

  /** `others`: depth images of all other cameras, with this camera's pose in them. */
  update(shown: boolean, others: ViewOf[], pixelRatio: number): void {
    this.object.visible = shown && this.image.number >= 0;
    if (!this.object.visible) return;
    const u = this.material.uniforms;
    const columns = Math.floor(this.image.width / STEP), rows = Math.floor(this.image.height / STEP);
    this.geometry.setDrawRange(0, columns * rows * LAYERS);
    u.columns.value = columns;
    u.rows.value = rows;
    u.dot_size.value = 1.5 * pixelRatio;
    setViews(u, OTHERS, others);
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
