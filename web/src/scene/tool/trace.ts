// The path of the tool's center of mass over the last ten seconds, fading. A ring buffer of points;
// the point after the last repeats the first, so each point and its successor are a segment. The
// shader hides segments by their times alone.

import {
  BufferAttribute, DynamicDrawUsage, InstancedBufferGeometry, InstancedInterleavedBuffer,
  InterleavedBufferAttribute, Mesh, Vector2, type Vector3,
} from 'three';
import { OTHER_COLORS, rgb } from '../colors';
import { shaderMaterial } from '../glsl';

const DURATION = 10;  // s
const SPACING = 0.01; // s
const POINTS = DURATION / SPACING + 24;

const VERTEX = `
in vec2 corner;
in vec4 start, end;  // a point of W and its time
uniform float now, width;
uniform vec2 canvas; // pixels
out float age;

void main() {
  age = (now - start.w) / ${DURATION}.0;
  vec4 a = projectionMatrix * (viewMatrix * vec4(start.xyz, 1.0));
  vec4 b = projectionMatrix * (viewMatrix * vec4(end.xyz, 1.0));
  bool is_segment = end.w > start.w && end.w - start.w < 0.5 && age < 1.0;
  if (!is_segment || a.w <= 0.0 || b.w <= 0.0) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  vec2 direction = (b.xy / b.w - a.xy / a.w) * canvas;
  float size = length(direction);
  direction = size > 1e-4 ? direction / size : vec2(1.0, 0.0);
  vec4 p = corner.y < 0.5 ? a : b;
  p.xy += vec2(-direction.y, direction.x) * corner.x * width / canvas * p.w;
  gl_Position = p;
}
`;

const FRAGMENT = `
in float age;
uniform vec3 trace_color;
void main() { color = vec4(trace_color, 0.9 * (1.0 - age)); }
`;

export class Trace {
  readonly object: Mesh<InstancedBufferGeometry>;
  private readonly material;
  private readonly points = new Float32Array(4 * (POINTS + 1)).fill(-1e9);
  private readonly buffer = new InstancedInterleavedBuffer(this.points, 4);
  private next = 0;
  private origin = 0; // times are relative to it: single precision is short
  private last = -Infinity;

  constructor() {
    const geometry = new InstancedBufferGeometry();
    geometry.setAttribute('corner', new BufferAttribute(new Float32Array([-1, 0, 1, 0, -1, 1, 1, 1]), 2));
    geometry.setIndex([0, 1, 2, 2, 1, 3]);
    this.buffer.setUsage(DynamicDrawUsage);
    geometry.setAttribute('start', new InterleavedBufferAttribute(this.buffer, 4, 0));
    geometry.setAttribute('end', new InterleavedBufferAttribute(this.buffer, 4, 4));
    geometry.instanceCount = POINTS;
    this.material = shaderMaterial({
      now: { value: 0 }, width: { value: 1 }, canvas: { value: new Vector2(1, 1) },
      trace_color: { value: rgb(OTHER_COLORS.trace) },
    }, VERTEX, FRAGMENT, { transparent: true, depthWrite: false });
    this.object = new Mesh(geometry, this.material);
    this.object.frustumCulled = false;
  }

  /** True if a point at this time is due. */
  isDue(time: number): boolean {
    return time < this.last || time >= this.last + SPACING;
  }

  /** Adds a point; call only if isDue(). */
  add(time: number, p_W: Vector3): void {
    if (time < this.last || time > this.last + DURATION) this.clear(time); // a jump in the recording
    this.last = time;
    this.put(this.next, p_W, time);
    if (this.next === 0) this.put(POINTS, p_W, time);
    this.next = (this.next + 1) % POINTS;
    this.material.uniforms.now.value = time - this.origin;
    this.buffer.needsUpdate = true;
  }

  update(shown: boolean, width: number, height: number, pixelRatio: number): void {
    this.object.visible = shown && this.last > -Infinity;
    (this.material.uniforms.canvas.value as Vector2).set(width, height);
    this.material.uniforms.width.value = 2 * pixelRatio;
  }

  clear(origin = 0): void {
    this.points.fill(-1e9);
    this.buffer.needsUpdate = true;
    this.next = 0;
    this.origin = origin;
    this.last = -Infinity;
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.material.dispose();
  }

  private put(i: number, p: Vector3, time: number): void {
    this.points.set([p.x, p.y, p.z, time - this.origin], 4 * i);
  }
}
