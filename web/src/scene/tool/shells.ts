// Spheres as translucent shells: clear in the middle, opaque at the rim. For the nodes of the sphere
// tree and for the ghost of a tool without mesh.

import { type InstancedBufferGeometry, Mesh } from 'three';
import { rgb } from '../colors';
import { shaderMaterial } from '../glsl';
import { BALL_FRAGMENT, BALL_VERTEX, ballGeometry } from './sphere_shader';

const VERTEX = `${BALL_VERTEX}
void main() { place_ball(); }
`;

const FRAGMENT = `${BALL_FRAGMENT}
uniform vec3 shell_color;
uniform float opacity, fill;

void main() {
  meet_ball();
  if (half_chord2 < 0.0) discard;
  float t = closest - half_chord;
  if (!in_front(t)) t = closest + half_chord;
  if (!in_front(t)) discard;
  float rim = 1.0 - sqrt(half_chord2);
  color = vec4(shell_color, opacity * (fill + rim * rim));
  gl_FragDepth = depth_of(t);
}
`;

export class Shells {
  readonly object: Mesh<InstancedBufferGeometry>;
  private readonly material;

  /** `fill`: opacity in the middle. */
  constructor(color: string, fill: number) {
    this.material = shaderMaterial({
      shell_color: { value: rgb(color) }, opacity: { value: 1 }, fill: { value: fill },
    }, VERTEX, FRAGMENT, { transparent: true, depthWrite: false });
    this.object = new Mesh(ballGeometry(new Float32Array(0)), this.material);
    this.object.frustumCulled = false;
  }

  set opacity(value: number) {
    this.material.uniforms.opacity.value = value;
  }

  setSpheres(spheres: Float32Array): void {
    this.object.geometry.dispose();
    this.object.geometry = ballGeometry(spheres);
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.material.dispose();
  }
}
