// WebGL 2 renderer of the canvas.

import { WebGLRenderer } from 'three';

/** True for a software renderer, where antialiasing costs more than it is worth. */
function isSoftware(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2');
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return /llvmpipe|softpipe|swiftshader|software|basic render/i.test(name);
}

/**
 * Throws if the browser lacks WebGL 2. A lost context is restored by three.js, which reloads everything from the
 * data that the page holds.
 */
export function createRenderer(canvas: HTMLCanvasElement): WebGLRenderer {
  return new WebGLRenderer({
    canvas, antialias: !isSoftware(), alpha: false, stencil: true, powerPreference: 'high-performance',
  });
}
