// Code that several shaders share. All shaders write display colors (sRGB).

import {
  AlwaysStencilFunc, DoubleSide, EqualStencilFunc, GLSL3, NotEqualStencilFunc, RawShaderMaterial, ReplaceStencilOp,
  type IUniform, type ShaderMaterialParameters,
} from 'three';

const PRECISION = `
precision highp float;
precision highp int;
precision highp usampler2D;
precision highp isampler2D;
`;

/** Matrices that three.js sets; the projection tells an orthographic view. */
const VERTEX = `
uniform mat4 modelViewMatrix, projectionMatrix, modelMatrix, viewMatrix;
bool is_orthographic() { return projectionMatrix[3][3] == 1.0; }
`;

const FRAGMENT = `
out vec4 color;
`;

/**
 * Light from over the viewer's left shoulder; n is a unit vector of the view frame (x right, y up,
 * z to the eye).
 */
export const SHADE = `
vec3 shade(vec3 albedo, vec3 n) {
  float key = max(0.0, dot(n, vec3(-0.35, 0.55, 0.758)));
  return albedo * (0.38 + 0.16 * n.y + 0.55 * key);
}
`;

/** Matt Zucker's polynomial for viridis, a perceptually uniform colormap. */
export const VIRIDIS = `
vec3 viridis(float t) {
  const vec3 c0 = vec3(0.27773, 0.00541, 0.33410), c1 = vec3(0.10509, 1.40461, 1.38459);
  const vec3 c2 = vec3(-0.33086, 0.21485, 0.09510), c3 = vec3(-4.63423, -5.79910, -19.33244);
  const vec3 c4 = vec3(6.22827, 14.17993, 56.69055), c5 = vec3(4.77638, -13.74515, -65.35303);
  const vec3 c6 = vec3(-5.43546, 4.64585, 26.31244);
  return c0 + t * (c1 + t * (c2 + t * (c3 + t * (c4 + t * (c5 + t * c6)))));
}
`;

/** Layer of what casts eye-dome lighting (distances.ts). */
export const DISTANCES = 1;

export type Uniforms = Record<string, IUniform>;

/**
 * Makes a material of two shaders. The shaders place vertices themselves, so objects with it must not be culled
 * by a bounding sphere.
 */
export function shaderMaterial(
  uniforms: Uniforms, vertexShader: string, fragmentShader: string, more: ShaderMaterialParameters = {},
): RawShaderMaterial {
  return new RawShaderMaterial({
    glslVersion: GLSL3,
    uniforms,
    vertexShader: PRECISION + VERTEX + vertexShader,
    fragmentShader: PRECISION + FRAGMENT + fragmentShader,
    side: DoubleSide,
    ...more,
  });
}

// The window in the surface that shows the tool: the tool is drawn first and marks the stencil, the
// cloud tests the mark.
const MARK = { stencilWrite: true, stencilRef: 1 };

export const OPENS_WINDOW = { ...MARK, stencilFunc: AlwaysStencilFunc, stencilZPass: ReplaceStencilOp };
export const WITHIN_WINDOW = { ...MARK, stencilFunc: EqualStencilFunc };
export const OUT_OF_WINDOW = { ...MARK, stencilFunc: NotEqualStencilFunc };
