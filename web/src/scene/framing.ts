// Where to look first: at the tool with the surface by it, else at the middle of the image.

import { Vector3 } from 'three';
import type { DepthImage } from './depth_image';

/// A ball to be seen whole, and how far the scene goes.
export interface Framing {
  centre: Vector3;
  radius: number;
  farthest: number; // m, depth of most of what is seen; 0: there is no scene
}

/// Depth below which a share of the valid pixels of a window of the image lies; 0: none are valid.
function depthShare(image: DepthImage, u: number, v: number, half: number, share: number): number {
  const depths: number[] = [];
  const step = Math.max(1, Math.floor(half / 12));
  for (let dv = -half; dv <= half; dv += step) {
    for (let du = -half; du <= half; du += step) {
      const z = image.depth(u + du, v + dv);
      if (z > 0) depths.push(z);
    }
  }
  depths.sort((a, b) => a - b);
  return depths.length ? depths[Math.floor(share * (depths.length - 1))] : 0;
}

/// `centre` of the tool in W, or null if nobody knows yet where it is.
export function framing(image: DepthImage, centre: Vector3 | null, radius: number): Framing {
  const [u, v] = [image.width >> 1, image.height >> 1];
  const half = Math.max(u, v);
  const farthest = depthShare(image, u, v, half, 0.9);
  if (!centre) {
    const z = depthShare(image, u, v, half >> 2, 0.5) || 1;
    return { centre: new Vector3(0, 0, z), radius: 0.35 * z, farthest };
  }
  if (farthest === 0) return { centre: centre.clone(), radius: 1.05 * radius, farthest };
  // The surface on the tool's ray, if it is near enough to be seen together with the tool.
  const [tool_u, tool_v] = image.pixel(centre.x, centre.y, Math.max(centre.z, 0.05));
  const below = depthShare(image, tool_u, tool_v, half >> 3, 0.5);
  const gap = below > 0 && centre.z > 0.05 ? Math.min(Math.abs(below - centre.z), 6 * radius) : 0;
  const towards = centre.clone().setLength(Math.sign(below - centre.z) * 0.5 * gap);
  return { centre: centre.clone().add(towards), radius: 2.0 * radius + 0.5 * gap, farthest };
}
