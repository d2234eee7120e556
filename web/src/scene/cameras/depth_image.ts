// The raw depth image on the graphics card, and shader functions for points and normals
// (thesis eq. 3.7, here by differences of neighboring pixels). One texture, updated in place.

import {
  ByteType, DataTexture, NearestFilter, RGBAIntegerFormat, RedIntegerFormat, UnsignedShortType, Vector2, Vector4,
} from 'three';
import type { Frame, Normals, Stream } from '../../types';
import type { Uniforms } from '../glsl';

/** Needs the uniforms of DepthImage. Pixel centers are at whole numbers. */
export const DEPTH_IMAGE = `
uniform usampler2D depth_image;
uniform isampler2D normal_image;
uniform ivec2 image_size;
uniform vec4 intrinsics;  // fx fy cx cy
uniform float unit;       // m
uniform bool has_normals; // normals of the server for this very frame

// 0: no measurement.
float depth_at(ivec2 pixel) {
  if (any(lessThan(pixel, ivec2(0))) || any(greaterThanEqual(pixel, image_size))) return 0.0;
  uint raw = texelFetch(depth_image, pixel, 0).r;
  return raw == 65535u ? 0.0 : float(raw) * unit;
}

vec3 point_at(ivec2 pixel, float z) {
  return vec3((vec2(pixel) - intrinsics.zw) / intrinsics.xy * z, z);
}

// Depth averaged over neighbors of the same surface, for pictures: noise would show as roughness.
float calm_depth_at(ivec2 pixel, float z) {
  vec2 sum = vec2(0.0);
  for (int v = -2; v <= 2; ++v) {
    for (int u = -2; u <= 2; ++u) {
      float beside = depth_at(pixel + ivec2(u, v));
      if (abs(beside - z) < 0.015 * z) sum += vec2(beside, 1.0);
    }
  }
  return sum.x / sum.y;
}

// Change of depth per pixel in direction e, over k pixels: mean of both sides if they agree, else of the
// side with the smaller change, so that no difference crosses an edge.
float slope_at(ivec2 pixel, float z, ivec2 e, int k) {
  float before = depth_at(pixel - k * e), after = depth_at(pixel + k * e);
  float b = before > 0.0 ? z - before : 1e3, a = after > 0.0 ? after - z : 1e3;
  float both = abs(a - b) < 0.02 * z ? 0.5 * (a + b) : abs(a) < abs(b) ? a : b;
  return abs(both) < 0.05 * z * float(k) ? both / float(k) : 0.0;
}

// Slope averaged over several distances on this row and its neighbors: per-pixel depth noise
// must not show as speckle.
float calm_slope_at(ivec2 pixel, float z, ivec2 e) {
  float sum = 0.0;
  int num = 0;
  for (int row = -1; row <= 1; ++row) {
    ivec2 beside = pixel + 3 * row * e.yx;
    float z_beside = row == 0 ? z : depth_at(beside);
    if (abs(z_beside - z) > 0.02 * z) continue;  // another surface, or no measurement
    sum += slope_at(beside, z_beside, e, 3) + slope_at(beside, z_beside, e, 7);
    num += 2;
  }
  return sum / float(num);
}

// Unit normal in C, towards the camera; 0 0 0: none.
vec3 normal_at(ivec2 pixel, float z) {
  if (has_normals) {
    vec3 n = vec3(texelFetch(normal_image, pixel, 0).xyz);
    return n == vec3(0.0) ? n : normalize(n);
  }
  float zu = calm_slope_at(pixel, z, ivec2(1, 0));
  float zv = calm_slope_at(pixel, z, ivec2(0, 1));
  // p = (a z, b z, z) with a, b the slopes of the ray: the normal is across dp/du and dp/dv.
  vec2 ray = (vec2(pixel) - intrinsics.zw) / intrinsics.xy;
  return normalize(vec3(zu * intrinsics.x, zv * intrinsics.y, -z - dot(vec2(zu, zv) * intrinsics.xy, ray)));
}
`;

function imageTexture(width: number, height: number, signed: boolean): DataTexture {
  const texture = signed
    ? new DataTexture(new Int8Array(width * height * 4), width, height, RGBAIntegerFormat, ByteType)
    : new DataTexture(new Uint16Array(width * height), width, height, RedIntegerFormat, UnsignedShortType);
  texture.internalFormat = signed ? 'RGBA8I' : 'R16UI';
  texture.minFilter = texture.magFilter = NearestFilter;
  texture.unpackAlignment = 1;
  texture.needsUpdate = true;
  return texture;
}

/** Texture of no image, for shaders that sample one less. */
export const NO_IMAGE = imageTexture(1, 1, false);

export class DepthImage {
  width = 0;
  height = 0;
  number = -1; // of the frame; -1: none yet
  readonly uniforms: Uniforms = {
    depth_image: { value: imageTexture(1, 1, false) },
    normal_image: { value: imageTexture(1, 1, true) },
    image_size: { value: new Vector2(1, 1) },
    intrinsics: { value: new Vector4(1, 1, 0, 0) },
    unit: { value: 0.001 },
    has_normals: { value: false },
  };
  private normalsNumber = -1;

  /** `numCameras`: frames of the other cameras may come between two frames of this one. */
  constructor(stream: Stream, private readonly numCameras: number) {
    (this.uniforms.intrinsics.value as Vector4).set(stream.fx, stream.fy, stream.cx, stream.cy);
  }

  setFrame(frame: Frame): void {
    const { width, height } = frame;
    if (width !== this.width || height !== this.height) {
      this.replace('depth_image', imageTexture(width, height, false));
      (this.uniforms.image_size.value as Vector2).set(width, height);
      this.width = width;
      this.height = height;
    }
    this.fill('depth_image', frame.depth);
    this.uniforms.unit.value = frame.unit;
    this.number = frame.number;
    this.updateHasNormals();
  }

  setNormals(normals: Normals): void {
    const { width, height } = (this.uniforms.normal_image.value as DataTexture).image;
    if (normals.width !== width || normals.height !== height) {
      this.replace('normal_image', imageTexture(normals.width, normals.height, true));
    }
    this.fill('normal_image', normals.data);
    this.normalsNumber = normals.number;
    this.updateHasNormals();
  }

  /** Returns the depth of a pixel in m, 0: none. Slow: for framing only. */
  depth(u: number, v: number): number {
    if (this.number < 0 || u < 0 || v < 0 || u >= this.width || v >= this.height) return 0;
    const data = (this.uniforms.depth_image.value as DataTexture).image.data as Uint16Array;
    const raw = data[v * this.width + u];
    return raw === 65535 ? 0 : raw * this.uniforms.unit.value;
  }

  /** Projects a point of C to the image, in pixels. */
  pixel(x: number, y: number, z: number): [number, number] {
    const k = this.uniforms.intrinsics.value as Vector4;
    return [Math.round(k.z + (k.x * x) / z), Math.round(k.w + (k.y * y) / z)];
  }

  dispose(): void {
    this.uniforms.depth_image.value.dispose();
    this.uniforms.normal_image.value.dispose();
  }

  private fill(name: string, data: Uint16Array | Int8Array): void {
    const texture = this.uniforms[name].value as DataTexture;
    (texture.image.data as Uint16Array | Int8Array).set(data);
    texture.needsUpdate = true;
  }

  private replace(name: string, texture: DataTexture): void {
    this.uniforms[name].value.dispose();
    this.uniforms[name].value = texture;
  }

  /** Normals are valid for the frame of their estimate; up to two newer frames may arrive before them. */
  private updateHasNormals(): void {
    const { width, height } = (this.uniforms.normal_image.value as DataTexture).image;
    this.uniforms.has_normals.value = width === this.width && height === this.height &&
      this.normalsNumber >= 0 && Math.abs(this.number - this.normalsNumber) <= 2 * this.numCameras;
  }
}
