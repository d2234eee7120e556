// Eye-dome lighting (Boucheny 2009): a pixel of the cloud is the darker, the more its neighbors are nearer to the eye,
// so that one sees what is before what, and dents and edges without a light. The distances are drawn first, into a
// texture that the cloud's shader reads; a view from infinitely far and a machine that is slow do without.

import { type Camera, DepthTexture, type Scene, Vector4, type WebGLRenderer, WebGLRenderTarget } from 'three';
import { DISTANCES } from './glsl';

const REACH = 1.6; // CSS pixels, to the neighbors

/** Shader function of the share of light, 1 where it is off; needs the uniforms of Distances. */
export const EYE_DOME = `
uniform sampler2D distances;
uniform float reach;  // pixels of the canvas; 0: off
uniform mat4 projectionMatrix;

float log_distance(float depth) {
  return log2(projectionMatrix[3][2] / (2.0 * depth - 1.0 + projectionMatrix[2][2]));
}
float eye_dome() {
  if (reach == 0.0) return 1.0;
  float here = log_distance(gl_FragCoord.z), sum = 0.0;
  vec2 size = vec2(textureSize(distances, 0));
  for (int i = 0; i < 16; ++i) {
    float angle = 0.785398 * float(i);
    float depth = texture(distances, (gl_FragCoord.xy + (i < 8 ? 1.0 : 2.5) * reach * vec2(cos(angle), sin(angle))) / size).r;
    // Noise of the images is below the least step, and all of a large one would be black.
    if (depth < 1.0) sum += clamp(here - log_distance(depth) - 0.003, 0.0, 0.05);
  }
  return exp(-1.8 * sum);
}
`;

export class Distances {
  /** `plain`: a drawing of the distances is under way; `focus`: center of the tool in W, and where fading begins, m. */
  readonly uniforms = {
    distances: { value: null as DepthTexture | null }, reach: { value: 0 }, plain: { value: false },
    focus: { value: new Vector4() },
  };
  private target: WebGLRenderTarget | null = null;

  /** Draws the distances of all that is on the layer DISTANCES, or switches the lighting off. */
  draw(renderer: WebGLRenderer, scene: Scene, camera: Camera, isRequested: boolean, pixelRatio: number): void {
    const { uniforms } = this, { width, height } = renderer.domElement;
    uniforms.reach.value = 0;
    if (!isRequested) return;
    if (!this.target) this.target = new WebGLRenderTarget(width, height, { depthTexture: new DepthTexture(width, height) });
    this.target.setSize(width, height);
    uniforms.distances.value = null; // must not be read while it is drawn
    uniforms.plain.value = true;
    camera.layers.set(DISTANCES);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
    renderer.setRenderTarget(null);
    camera.layers.set(0);
    uniforms.plain.value = false;
    uniforms.distances.value = this.target.depthTexture;
    uniforms.reach.value = REACH * pixelRatio;
  }

  dispose(): void {
    this.target?.depthTexture?.dispose();
    this.target?.dispose();
  }
}
