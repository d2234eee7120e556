// Depth of a point of the world behind what several cameras see, for shaders: how far it is behind the surface that a
// camera sees on the point's ray. Behind the surfaces of all cameras means inside of what they see.

import { Matrix4, Vector2, Vector4 } from 'three';
import type { Uniforms } from '../glsl';
import { NO_IMAGE, type DepthImage } from './depth_image';

/** A depth image, with the transform to its camera's frame from the frame of the shader's points. */
export type ViewOf = [image: DepthImage, X_CP: Matrix4];

/**
 * Returns shader code of `behind(p)`: the least depth in m of p behind the surfaces of up to `count` cameras, negative
 * before one of them, NOT_SEEN where no camera measures. `smooth_out` averages over neighbors of one surface, so that
 * noise does not show as speckle.
 */
export function behindGlsl(count: number, smoothOut: boolean): string {
  const numbers = Array.from({ length: count }, (_, i) => i);
  return `
const float NOT_SEEN = 1e9;
${numbers.map((i) => `
uniform usampler2D view_image_${i};
uniform ivec2 view_size_${i};
uniform vec4 view_intrinsics_${i};
uniform float view_unit_${i};  // m; 0: unused
uniform mat4 X_CP_${i};
float view_depth_${i}(ivec2 pixel) {
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, view_size_${i}))) return 0.0;
  uint raw = texelFetch(view_image_${i}, pixel, 0).r;
  return raw == 65535u ? 0.0 : float(raw) * view_unit_${i};
}
float behind_${i}(vec3 p) {
  if (view_unit_${i} == 0.0) return NOT_SEEN;
  vec3 q = (X_CP_${i} * vec4(p, 1.0)).xyz;
  if (q.z < 0.02) return NOT_SEEN;
  vec2 place = view_intrinsics_${i}.xy * q.xy / q.z + view_intrinsics_${i}.zw;
  ivec2 pixel = ivec2(floor(place + 0.5));
  float z = view_depth_${i}(pixel);
  if (z == 0.0) return NOT_SEEN;
${smoothOut ? `
  vec2 sum = vec2(0.0);
  for (int v = -2; v <= 2; ++v) {
    for (int u = -2; u <= 2; ++u) {
      float beside = view_depth_${i}(pixel + ivec2(u, v));
      vec2 off = max(vec2(0.0), 2.5 - abs(vec2(pixel + ivec2(u, v)) - place));
      if (abs(beside - z) < 0.02 * z) sum += off.x * off.y * vec2(beside, 1.0);
    }
  }
  z = sum.x / sum.y;` : ''}
  return q.z - z;
}`).join('\n')}
float behind(vec3 p) {
  return ${numbers.reduce((code, i) => (code ? `min(${code}, behind_${i}(p))` : `behind_${i}(p)`), '')};
}
`;
}

/** Returns the uniforms of behindGlsl(), of no camera at first. */
export function viewUniforms(count: number): Uniforms {
  const uniforms: Uniforms = {};
  for (let i = 0; i < count; ++i) {
    uniforms[`view_image_${i}`] = { value: NO_IMAGE };
    uniforms[`view_size_${i}`] = { value: new Vector2() };
    uniforms[`view_intrinsics_${i}`] = { value: new Vector4() };
    uniforms[`view_unit_${i}`] = { value: 0 };
    uniforms[`X_CP_${i}`] = { value: new Matrix4() };
  }
  return uniforms;
}

/** Sets the cameras, of which those without an image see nothing. */
export function setViews(uniforms: Uniforms, count: number, views: readonly ViewOf[]): void {
  const seeing = views.filter(([image]) => image.number >= 0);
  for (let i = 0; i < count; ++i) {
    const [image, X_CP] = seeing[i] ?? [];
    uniforms[`view_unit_${i}`].value = image?.uniforms.unit.value ?? 0;
    uniforms[`view_image_${i}`].value = image?.uniforms.depth_image.value ?? NO_IMAGE;
    if (!X_CP || !image) continue;
    (uniforms[`view_size_${i}`].value as Vector2).set(image.width, image.height);
    (uniforms[`view_intrinsics_${i}`].value as Vector4).copy(image.uniforms.intrinsics.value as Vector4);
    (uniforms[`X_CP_${i}`].value as Matrix4).copy(X_CP);
  }
}
