// Depth edges before a farther surface (thesis section 3.5): the depth-change vectors as needles,
// green at the point and purple at the tip as in Fig. 3.13, and the edge planes as small panes. A
// pane contains the viewing ray and stands across the vector, so neighboring panes line up as a
// curtain from the edge into the shadow behind it.

import {
  BufferAttribute, DynamicDrawUsage, InstancedBufferGeometry, InstancedInterleavedBuffer,
  InterleavedBufferAttribute, Mesh, type RawShaderMaterial,
} from 'three';
import type { Edges, SceneOptions, Stream } from '../../types';
import { EDGE_COLORS, rgb } from '../colors';
import { shaderMaterial } from '../glsl';

/**
 * Depth steps over eight neighbors sum to meters: the needle's length grows with the sum but is limited to
 * 4 cm.
 */
const NEEDLE_VERTEX = `
in vec3 point, change;
in vec2 corner;
out float along;

void main() {
  float size = length(change);
  vec4 base = modelViewMatrix * vec4(point, 1.0);
  vec3 direction = mat3(modelViewMatrix) * (change / max(size, 1e-9));
  along = corner.y;
  vec3 across = normalize(cross(direction, is_orthographic() ? vec3(0.0, 0.0, 1.0) : base.xyz));
  float width = max(0.0006, 0.0012 * abs(base.z) / projectionMatrix[1][1]);
  base.xyz += direction * corner.y * 0.04 * (1.0 - exp(-3.0 * size)) + across * corner.x * width;
  gl_Position = projectionMatrix * base;
}
`;

const NEEDLE_FRAGMENT = `
in float along;
uniform vec3 start_color, end_color;
void main() { color = vec4(mix(start_color, end_color, along), 1.0); }
`;

const PANE_VERTEX = `
in vec3 point, change;
in vec2 corner;
uniform float pane_angle;  // half the width of a pane, seen from the depth camera
out float along;

void main() {
  vec3 ray = normalize(point);
  vec3 across = normalize(cross(ray, change)) * length(point) * pane_angle;
  along = corner.y;
  vec3 p = point + ray * corner.y * 0.12 + across * corner.x;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(p, 1.0));
}
`;

const PANE_FRAGMENT = `
in float along;
uniform vec3 end_color;
void main() { color = vec4(end_color, 0.3 * (1.0 - along) * (1.0 - along)); }
`;

/** Makes a geometry of instances; a corner is (across, along). */
function instanced(corners: number[], index: number[]): InstancedBufferGeometry {
  const geometry = new InstancedBufferGeometry();
  geometry.setAttribute('corner', new BufferAttribute(new Float32Array(corners), 2));
  geometry.setIndex(index);
  geometry.instanceCount = 0;
  return geometry;
}

/** Depth edges in the frame of the first camera. */
export class EdgeMarks {
  readonly needles: Mesh<InstancedBufferGeometry>;
  readonly panes: Mesh<InstancedBufferGeometry>;
  private readonly materials: RawShaderMaterial[];
  private buffer = new InstancedInterleavedBuffer(new Float32Array(0), 6);

  constructor() {
    const colors = {
      start_color: { value: rgb(EDGE_COLORS.start) }, end_color: { value: rgb(EDGE_COLORS.end) },
    };
    this.materials = [
      shaderMaterial(colors, NEEDLE_VERTEX, NEEDLE_FRAGMENT),
      shaderMaterial({ ...colors, pane_angle: { value: 0.003 } }, PANE_VERTEX, PANE_FRAGMENT,
        { transparent: true, depthWrite: false }),
    ];
    this.needles = new Mesh(instanced([-1, 0, 1, 0, 0, 1], [0, 1, 2]), this.materials[0]);
    this.panes = new Mesh(instanced([-1, 0, 1, 0, -1, 1, 1, 1], [0, 1, 2, 2, 1, 3]), this.materials[1]);
    this.needles.frustumCulled = this.panes.frustumCulled = false;
  }

  setStream(stream: Stream | null): void {
    this.needles.geometry.instanceCount = this.panes.geometry.instanceCount = 0;
    // A little more than half a pixel: panes of neighboring pixels touch.
    if (stream) this.materials[1].uniforms.pane_angle.value = 0.8 / stream.fx;
  }

  setEdges(edges: Edges): void {
    if (edges.count > this.buffer.count) this.grow(edges.count);
    (this.buffer.array as Float32Array).set(edges.data.subarray(0, 6 * edges.count));
    this.buffer.clearUpdateRanges();
    this.buffer.addUpdateRange(0, 6 * edges.count);
    this.buffer.needsUpdate = true;
    this.needles.geometry.instanceCount = this.panes.geometry.instanceCount = edges.count;
  }

  update(options: SceneOptions): void {
    const some = this.needles.geometry.instanceCount > 0;
    this.needles.visible = some && options.edges;
    this.panes.visible = some && options.edgePlanes;
  }

  dispose(): void {
    this.needles.geometry.dispose();
    this.panes.geometry.dispose();
    for (const material of this.materials) material.dispose();
  }

  /** Reallocates for twice as many, which keeps it rare. */
  private grow(count: number): void {
    this.buffer = new InstancedInterleavedBuffer(new Float32Array(12 * count), 6);
    this.buffer.setUsage(DynamicDrawUsage);
    for (const { geometry } of [this.needles, this.panes]) {
      geometry.dispose();
      geometry.setAttribute('point', new InterleavedBufferAttribute(this.buffer, 3, 0));
      geometry.setAttribute('change', new InterleavedBufferAttribute(this.buffer, 3, 3));
    }
  }
}
