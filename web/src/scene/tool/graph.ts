// The leaf graph: lines between the centers of neighboring spheres, colored by their states, which
// shows how far the inside has spread. Drawn over the spheres, which would hide it.

import {
  BufferAttribute, BufferGeometry, DynamicDrawUsage, InterleavedBuffer, InterleavedBufferAttribute,
  LineSegments,
} from 'three';
import type { Graph, SceneOptions, Spheres } from '../../types';
import { rgb, STATE_COLORS } from '../colors';
import { shaderMaterial } from '../glsl';

const VERTEX = `
in vec3 position;
in float state;
uniform vec3 state_colors[4];
out vec3 line_color;

void main() {
  line_color = state_colors[int(state) & 3];
  gl_Position = projectionMatrix * (modelViewMatrix * vec4(position, 1.0));
}
`;

const FRAGMENT = `
in vec3 line_color;
uniform float opacity;
void main() { color = vec4(mix(line_color, vec3(1.0), 0.25), opacity); }
`;

export class LeafGraph {
  readonly object: LineSegments;
  private readonly geometry = new BufferGeometry();
  private readonly material;

  constructor() {
    this.material = shaderMaterial({
      state_colors: {
        value: [STATE_COLORS.outside, STATE_COLORS.boundary, STATE_COLORS.inside, STATE_COLORS.unknown].map(rgb),
      },
      opacity: { value: 1 },
    }, VERTEX, FRAGMENT, { transparent: true, depthTest: false, depthWrite: false });
    this.object = new LineSegments(this.geometry, this.material);
    this.object.frustumCulled = false;
    this.object.renderOrder = 1;
  }

  /** `states` of the spheres, shared; call statesChanged() after they change. */
  setSpheres(spheres: Spheres, states: Uint8Array): void {
    this.geometry.dispose();
    const data = new InterleavedBuffer(spheres.data, 4);
    this.geometry.setAttribute('position', new InterleavedBufferAttribute(data, 3, 0));
    this.geometry.setAttribute('state', new BufferAttribute(states, 1).setUsage(DynamicDrawUsage));
  }

  setGraph(graph: Graph): void {
    this.geometry.setIndex(new BufferAttribute(graph.pairs, 1));
    // Fainter the more lines there are, so that they do not cover everything.
    this.material.uniforms.opacity.value = Math.min(0.8, Math.max(0.12, Math.sqrt(600 / Math.max(1, graph.count))));
  }

  statesChanged(): void {
    if (this.geometry.attributes.state) this.geometry.attributes.state.needsUpdate = true;
  }

  update(options: SceneOptions): void {
    this.object.visible = options.graph && this.geometry.index !== null &&
      this.geometry.attributes.position !== undefined;
  }

  dispose(): void {
    this.geometry.dispose();
    this.material.dispose();
  }
}
