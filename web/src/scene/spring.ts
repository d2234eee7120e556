// The spring between the hand and the tool: as long as their distance, in the color of its force, and
// visible through everything before it.

import { BufferAttribute, BufferGeometry, Mesh, Quaternion, type RawShaderMaterial, Vector3 } from 'three';
import { rgb } from './colors';
import { shaderMaterial } from './glsl';

const COILS = 7, PER_COIL = 20, AROUND = 8;
const LEAST = 5e-4; // m: shorter is not drawn

const VERTEX = `
in vec2 place;   // share of the wire's length, angle around it
uniform float size, coil, wire; // m: length of the spring, radii of its coils and of its wire
out vec3 view_normal;

void main() {
  // Straight at both ends.
  float open = smoothstep(0.0, 0.12, place.x) * smoothstep(1.0, 0.88, place.x);
  float angle = ${(2 * COILS).toFixed(1)} * 3.14159265 * place.x;
  vec3 outwards = vec3(cos(angle), sin(angle), 0.0);
  float rise = size / ${(2 * COILS).toFixed(1)} / 3.14159265;
  vec3 along = normalize(coil * open * vec3(-outwards.y, outwards.x, 0.0) + vec3(0.0, 0.0, rise));
  vec3 n = cos(place.y) * outwards + sin(place.y) * cross(along, outwards);
  vec3 p = coil * open * outwards + vec3(0.0, 0.0, place.x * size) + wire * n;
  view_normal = mat3(modelViewMatrix) * n;
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(p, 1.0));
  gl_Position.z = mix(gl_Position.z, -gl_Position.w, 0.999); // before everything, sorted within itself
}
`;

const FRAGMENT = `
in vec3 view_normal;
uniform vec3 spring_color;
void main() {
  float key = max(0.0, dot(normalize(view_normal), vec3(-0.35, 0.55, 0.758)));
  color = vec4(spring_color * (0.6 + 0.5 * key), 1.0);
}
`;

function wire(): BufferGeometry {
  const place: number[] = [], index: number[] = [], steps = COILS * PER_COIL;
  for (let i = 0; i <= steps; ++i) {
    for (let k = 0; k <= AROUND; ++k) {
      place.push(i / steps, (2 * Math.PI * k) / AROUND);
      if (i === steps || k === AROUND) continue;
      const a = i * (AROUND + 1) + k, b = a + AROUND + 1;
      index.push(a, a + 1, b, b, a + 1, b + 1);
    }
  }
  const geometry = new BufferGeometry();
  geometry.setAttribute('place', new BufferAttribute(new Float32Array(place), 2));
  geometry.setIndex(index);
  return geometry;
}

export class Spring {
  readonly object: Mesh<BufferGeometry, RawShaderMaterial>;

  constructor() {
    const material = shaderMaterial({
      size: { value: 0 }, coil: { value: 0 }, wire: { value: 0 }, spring_color: { value: new Vector3() },
    }, VERTEX, FRAGMENT, { transparent: true }); // drawn after the ghost
    this.object = new Mesh(wire(), material);
    this.object.frustumCulled = false;
    this.object.renderOrder = 3;
    this.object.visible = false;
  }

  /** Stretches the spring from the hand to the tool, W; `radius` of the tool. */
  set(hand: Vector3, tool: Vector3, radius: number, color: string): void {
    const way = tool.clone().sub(hand), { uniforms } = this.object.material;
    const size = way.length();
    this.object.visible = size > LEAST;
    if (!this.object.visible) return;
    this.object.position.copy(hand);
    this.object.quaternion.copy(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), way.divideScalar(size)));
    uniforms.size.value = size;
    uniforms.coil.value = 0.07 * radius;
    uniforms.wire.value = 0.014 * radius;
    uniforms.spring_color.value = rgb(color);
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.object.material.dispose();
  }
}
