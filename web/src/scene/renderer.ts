// The canvas's WebGL 2.

import { WebGLRenderer } from 'three';

/// Without a graphics card, smoothed edges cost more than they are worth.
function isSoftware(): boolean {
  const gl = document.createElement('canvas').getContext('webgl2');
  const info = gl?.getExtension('WEBGL_debug_renderer_info');
  const name = gl && info ? String(gl.getParameter(info.UNMASKED_RENDERER_WEBGL)) : '';
  gl?.getExtension('WEBGL_lose_context')?.loseContext();
  return /llvmpipe|softpipe|swiftshader|software|basic render/i.test(name);
}

/// Throws where the browser has no WebGL 2. A lost context comes back by itself: three.js takes the
/// event and loads everything anew from what the page holds.
export function createRenderer(canvas: HTMLCanvasElement): WebGLRenderer {
  return new WebGLRenderer({
    canvas, antialias: !isSoftware(), alpha: false, stencil: true, powerPreference: 'high-performance',
  });
}
