// One arrow, straight or bent to an arc. The mesh is made once: rings of vertices with their share of the
// shaft and of the head; the vertex shader places them. Where something is before it, it shines through.

import {
  BufferAttribute, BufferGeometry, FrontSide, GreaterDepth, Mesh, Quaternion, type RawShaderMaterial, Vector3,
} from 'three';
import { rgb } from './colors';
import { shaderMaterial } from './glsl';

const AROUND = 12;
const BENDS = 32; // pieces of the shaft

const VERTEX = `
in vec4 ring;  // share of the shaft, share of the head, width, and angle around
in vec2 slant; // surface normal: outwards and forwards
uniform float size, head, width; // m
uniform float bend;              // m, radius of the arc; 0: straight
out vec3 view_normal;

void main() {
  float along = ring.x * (size - head) + ring.y * head;
  vec3 out_there = vec3(cos(ring.w), sin(ring.w), 0.0);
  vec3 p = ring.z * width * out_there, n = slant.x * out_there + vec3(0.0, 0.0, slant.y);
  if (bend > 0.0) {
    // About z, starting on x.
    float angle = along / bend;
    vec3 outwards = vec3(cos(angle), sin(angle), 0.0), forwards = vec3(-outwards.y, outwards.x, 0.0);
    p = outwards * (bend + p.x) + vec3(0.0, 0.0, p.y);
    n = outwards * n.x + vec3(0.0, 0.0, n.y) + forwards * n.z;
  } else {
    p.z += along;
  }
  view_normal = mat3(modelViewMatrix) * n;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(p, 1.0));
}
`;

const FRAGMENT = `
in vec3 view_normal;
uniform vec3 arrow_color;
uniform float opacity;
void main() {
  float key = max(0.0, dot(normalize(view_normal), vec3(-0.35, 0.55, 0.758)));
  color = vec4(arrow_color * (0.72 + 0.4 * key), opacity);
}
`;

/** Profile along the arrow: share of shaft, share of head, width, slant outwards and forwards. */
function profile(): number[][] {
  const rows = [[0, 0, 0, 0, -1], [0, 0, 1, 0, -1]];
  for (let i = 0; i <= BENDS; ++i) rows.push([i / BENDS, 0, 1, 1, 0]);
  rows.push([1, 0, 1, 0, -1], [1, 0, 2.6, 0, -1]);
  for (let i = 0; i <= 6; ++i) rows.push([1, i / 6, 2.6 * (1 - i / 6), 0.92, 0.39]);
  return rows;
}

function arrowGeometry(): BufferGeometry {
  const rows = profile();
  const ring: number[] = [], slant: number[] = [], index: number[] = [];
  rows.forEach(([shaft, head, width, outwards, forwards], i) => {
    for (let k = 0; k <= AROUND; ++k) {
      ring.push(shaft, head, width, (2 * Math.PI * k) / AROUND);
      slant.push(outwards, forwards);
      if (i + 1 === rows.length || k === AROUND) continue;
      const a = i * (AROUND + 1) + k, b = a + AROUND + 1;
      index.push(a, a + 1, b, b, a + 1, b + 1);
    }
  });
  const geometry = new BufferGeometry();
  geometry.setAttribute('ring', new BufferAttribute(new Float32Array(ring), 4));
  geometry.setAttribute('slant', new BufferAttribute(new Float32Array(slant), 2));
  geometry.setIndex(index);
  return geometry;
}

export class Arrow {
  readonly object: Mesh<BufferGeometry, RawShaderMaterial>;
  private readonly shine: Mesh<BufferGeometry, RawShaderMaterial>;

  constructor(color: string) {
    const uniforms = {
      size: { value: 0 }, head: { value: 0 }, width: { value: 0 }, bend: { value: 0 }, arrow_color: { value: rgb(color) },
    };
    this.object = new Mesh(arrowGeometry(), shaderMaterial({ ...uniforms, opacity: { value: 1 } }, VERTEX, FRAGMENT));
    this.shine = new Mesh(this.object.geometry, shaderMaterial({ ...uniforms, opacity: { value: 0.4 } }, VERTEX, FRAGMENT,
      { transparent: true, depthWrite: false, depthFunc: GreaterDepth, side: FrontSide }));
    this.shine.renderOrder = 1;
    this.object.add(this.shine);
    this.object.frustumCulled = this.shine.frustumCulled = false;
    this.object.visible = false;
  }

  straight(origin: Vector3, vector: Vector3, width: number): void {
    this.place(origin, vector, vector.length(), width, 0);
  }

  /** Places a bent arrow about `axis`, `angle` rad long. */
  bent(center: Vector3, axis: Vector3, radius: number, angle: number, width: number): void {
    this.place(center, axis, radius * angle, width, radius);
  }

  /** Returns the position of the tip. */
  get tip(): Vector3 {
    const { size, bend } = this.object.material.uniforms;
    const angle = size.value / bend.value;
    const end = bend.value > 0 ? new Vector3(Math.cos(angle), Math.sin(angle), 0).multiplyScalar(bend.value) :
      new Vector3(0, 0, size.value);
    return end.applyQuaternion(this.object.quaternion).add(this.object.position);
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.object.material.dispose();
    this.shine.material.dispose();
  }

  private place(origin: Vector3, z: Vector3, size: number, width: number, bend: number): void {
    this.object.visible = size > 0.5 * width;
    if (!this.object.visible) return;
    this.object.position.copy(origin);
    this.object.quaternion.copy(turnZTo(z));
    const u = this.object.material.uniforms;
    u.size.value = size;
    // Short arrows are scaled down as a whole.
    u.head.value = Math.min(6 * width, 0.6 * size);
    u.width.value = Math.min(width, 0.1 * size);
    u.bend.value = bend;
  }
}

function turnZTo(direction: Vector3): Quaternion {
  return new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), direction.clone().normalize());
}
