// The tool as its spheres: whole, or only the part inside the scene, cut exactly by the collision
// planes (thesis section 4.4). A cut sphere is the intersection of the ball and the half-space
// n . x <= d; the shader intersects the ray with both, so no mesh of a cap (Alg. 4.1) is ever
// made.

import { DynamicDrawUsage, InstancedBufferAttribute, type InstancedBufferGeometry, Mesh, Vector3 } from 'three';
import type { Contact, SceneOptions, Spheres } from '../../types';
import { cameraColor, rgb, STATE_COLORS } from '../colors';
import { OPENS_WINDOW, SHADE, shaderMaterial } from '../glsl';
import { BALL_FRAGMENT, BALL_VERTEX, ballGeometry } from './sphere_shader';

export const UNKNOWN = 3; // state of a sphere without measurement

const VERTEX = `${BALL_VERTEX}
in float state;
in vec4 plane;  // n and d in T
uniform bool caps, outside, by_camera;
uniform vec3 state_colors[4], camera_colors[16];  // the latter: of no camera, and of each camera
flat out vec3 ball_color, veil_color;
flat out vec4 cut;   // n in the view frame, d from the center of the sphere
flat out int style;  // 0: whole, 1: cut, 2: veil only

void main() {
  int bits = int(state), number = bits & 3;
  bool has_plane = (bits & 4) != 0, is_unseen = (bits & 8) != 0;
  ball_color = state_colors[number];
  veil_color = state_colors[0];
  if (by_camera) {
    if (number == 1 || number == 2) ball_color = camera_colors[bits >> 4];
    if (is_unseen) ball_color = veil_color = camera_colors[0];
  }
  cut = vec4(mat3(modelViewMatrix) * plane.xyz, plane.w - dot(plane.xyz, sphere.xyz));
  style = !caps ? 0 : has_plane ? 1 : number == 0 ? 2 : 0;
  if (number == 0 && !outside && style != 1) hide_ball(); else place_ball();
}
`;

const FRAGMENT = `${BALL_FRAGMENT}${SHADE}
uniform bool outside;
flat in vec3 ball_color, veil_color;
flat in vec4 cut;
flat in int style;

void main() {
  meet_ball();
  if (half_chord2 < 0.0) discard;
  // Interval of the ray in the solid; enters_flat, leaves_flat: its end is on the flat side.
  float enter = -half_chord, leave = half_chord;
  bool enters_flat = false, leaves_flat = false;
  if (style == 1) {
    float along = dot(cut.xyz, ray), room = cut.w - dot(cut.xyz, nearest);
    float t = room / along;
    if (along < 0.0 && t > enter) { enter = t; enters_flat = true; }
    if (along > 0.0 && t < leave) { leave = t; leaves_flat = true; }
    if (along == 0.0 && room < 0.0) leave = enter - 1.0;
  }
  vec3 albedo = ball_color;
  if (style == 2 || leave < enter) {
    // The outside is a veil of every fourth pixel: depths stay right without sorting.
    if (!outside || ((int(gl_FragCoord.x) | int(gl_FragCoord.y)) & 1) == 1) discard;
    albedo = veil_color;
    enter = -half_chord;
    leave = half_chord;
    enters_flat = leaves_flat = false;
  }
  bool from_within = !in_front(closest + enter);
  float t = from_within ? leave : enter;
  if (!in_front(closest + t)) discard;
  bool on_flat = from_within ? leaves_flat : enters_flat;
  vec3 n = on_flat ? cut.xyz : (nearest + t * ray) / ball.w;
  if (from_within) n = -n;
  if (on_flat) albedo = mix(albedo, vec3(1.0), 0.28);
  color = vec4(shade(albedo, n), 1.0);
  gl_FragDepth = depth_of(closest + t);
}
`;

export class ToolSpheres {
  readonly object: Mesh<InstancedBufferGeometry>;
  private readonly material;
  private states = new Uint8Array(0);
  private planes = new Float32Array(0);

  constructor() {
    this.material = shaderMaterial({
      caps: { value: true }, outside: { value: true }, by_camera: { value: false },
      camera_colors: { value: Array.from({ length: 16 }, (_, i) => rgb(cameraColor(i - 1, 0))) },
      state_colors: {
        value: [STATE_COLORS.outside, STATE_COLORS.boundary, STATE_COLORS.inside, STATE_COLORS.unknown].map(rgb),
      },
    }, VERTEX, FRAGMENT, OPENS_WINDOW);
    this.object = new Mesh(ballGeometry(new Float32Array(0)), this.material);
    this.object.frustumCulled = false;
    this.object.renderOrder = -2; // drawn before the cloud
  }

  get count(): number {
    return this.states.length;
  }

  /** States of the spheres, those of the last contact; setContact() updates them in place. */
  get stateArray(): Uint8Array {
    return this.states;
  }

  setCameras(count: number): void {
    this.material.uniforms.camera_colors.value =
      Array.from({ length: 16 }, (_, i) => rgb(cameraColor(i - 1, count)));
  }

  setSpheres(spheres: Spheres): void {
    this.states = new Uint8Array(spheres.count).fill(UNKNOWN);
    this.planes = new Float32Array(4 * spheres.count);
    const geometry = ballGeometry(spheres.data);
    geometry.setAttribute('state', new InstancedBufferAttribute(this.states, 1).setUsage(DynamicDrawUsage));
    geometry.setAttribute('plane', new InstancedBufferAttribute(this.planes, 4).setUsage(DynamicDrawUsage));
    this.object.geometry.dispose();
    this.object.geometry = geometry;
  }

  /** Takes over states and planes. Returns false if the contact is not of these spheres. */
  setContact(contact: Contact): boolean {
    const { states, planes } = contact;
    if (states.length !== this.count) return false;
    this.states.set(states);
    let from = 0;
    for (let i = 0; i < states.length; ++i) {
      if ((states[i] & 4) === 0) continue;
      for (let k = 0; k < 4; ++k) this.planes[4 * i + k] = planes[from++];
    }
    this.object.geometry.attributes.state.needsUpdate = true;
    this.object.geometry.attributes.plane.needsUpdate = true;
    return true;
  }

  /** True if a ray in T passes a sphere within `margin`, m. The direction is a unit vector. */
  isMet(origin: Vector3, direction: Vector3, margin: number): boolean {
    if (this.count === 0) return false;
    const spheres = this.object.geometry.attributes.sphere.array, between = new Vector3();
    for (let i = 0; i < this.count; ++i) {
      between.fromArray(spheres, 4 * i).sub(origin);
      const ahead = between.dot(direction), reach = spheres[4 * i + 3] + margin;
      if (ahead > 0 && between.lengthSq() - ahead * ahead < reach * reach) return true;
    }
    return false;
  }

  /** Cuts the tool open: the part with n . p <= d in T counts as inside, the rest as outside. */
  cut(n: readonly number[], d: number): void {
    const spheres = this.object.geometry.attributes.sphere.array;
    for (let i = 0; i < this.count; ++i) {
      const height = n[0] * spheres[4 * i] + n[1] * spheres[4 * i + 1] + n[2] * spheres[4 * i + 2] - d;
      const r = spheres[4 * i + 3];
      this.states[i] = height >= r ? 0 : height <= -r ? 2 : 1 + 4;
      this.planes.set([n[0], n[1], n[2], d], 4 * i);
    }
    this.object.geometry.attributes.state.needsUpdate = true;
    this.object.geometry.attributes.plane.needsUpdate = true;
  }

  update(options: SceneOptions): void {
    this.object.visible = this.count > 0 && (options.toolLook === 'spheres' || options.toolLook === 'caps');
    this.material.uniforms.caps.value = options.toolLook === 'caps';
    this.material.uniforms.outside.value = options.outside;
    this.material.uniforms.by_camera.value = options.sphereColor === 'camera';
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.material.dispose();
  }
}
