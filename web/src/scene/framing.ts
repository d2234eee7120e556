// Initial framing: the tool with the surface near it, else the middle of the images.

import { Vector3 } from 'three';
import type { DepthImage } from './cameras/depth_image';
import type { DepthCamera } from './cameras/depth_camera';
import { inverted, transformed } from './poses';

/** A bounding sphere to show whole, and the extent of the scene. */
export interface Framing {
  center: Vector3; // in W
  radius: number;
  hasScene: boolean;
  push: Vector3 | null; // unit vector along the force on the tool; null without contact
  // Extent of the cameras and most of their surfaces along the first camera's x and z axes, m.
  across: [number, number];
  along: [number, number];
}

/** Framing of one camera, in its frame. */
interface Look {
  center: Vector3;
  radius: number;
  farthest: number; // m, depth that holds most of the image; 0: no measurement
  below: number;    // m, depth of the surface on the tool's ray; 0: none
}

/** Returns the depth below which a share of the valid pixels of an image window lies; 0: none are valid. */
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

/** Computes the framing of one camera; `center` of the tool in its frame, null if unknown. */
function lookOf(image: DepthImage, center: Vector3 | null, radius: number): Look {
  const [u, v] = [image.width >> 1, image.height >> 1];
  const half = Math.max(u, v);
  const farthest = depthShare(image, u, v, half, 0.9);
  if (!center) {
    const z = depthShare(image, u, v, half >> 2, 0.5) || 1;
    return { center: new Vector3(0, 0, z), radius: 0.35 * z, farthest, below: 0 };
  }
  if (farthest === 0) return { center: center.clone(), radius: 1.05 * radius, farthest, below: 0 };
  // Surface on the tool's ray, limited to a distance at which both fit into the picture.
  const [tool_u, tool_v] = image.pixel(center.x, center.y, Math.max(center.z, 0.05));
  const below = center.z > 0.05 ? depthShare(image, tool_u, tool_v, half >> 3, 0.5) : 0;
  const gap = below > 0 ? Math.min(Math.abs(below - center.z), 6 * radius) : 0;
  const towards = center.clone().setLength(Math.sign(below - center.z) * 0.5 * gap);
  return { center: center.clone().add(towards), radius: 2.0 * radius + 0.5 * gap, farthest, below };
}

/**
 * Computes the framing; `center` of the tool in W, null if unknown. With a tool it shows the tool and the surface
 * of the camera that sees it nearest to the tool; without one, the middle of each image.
 */
export function framing(
  cameras: readonly DepthCamera[], center: Vector3 | null, radius: number, push: Vector3 | null = null,
): Framing {
  const [first] = cameras;
  const span: Framing = {
    center: center ?? new Vector3(0, 0, 1), radius: 1.05 * radius, hasScene: false, push, across: [0, 0], along: [0, 0],
  };
  if (!first) return span;
  const seeing = cameras.filter((camera) => camera.isSeeing);
  if (seeing.length === 0) seeing.push(first);
  const looks = seeing.map(({ image, X_WC }) => lookOf(image, center && inverted(X_WC, center), radius));
  seeing.forEach(({ X_WC }, i) => {
    if (looks[i].farthest === 0) return;
    span.hasScene = true;
    for (const depth of [0, looks[i].farthest]) {
      const { x, z } = inverted(first.X_WC, transformed(X_WC, [0, 0, depth]));
      span.across = [Math.min(span.across[0], x), Math.max(span.across[1], x)];
      span.along = [Math.min(span.along[0], z), Math.max(span.along[1], z)];
    }
  });
  const centers = looks.map((look, i) => transformed(seeing[i].X_WC, look.center.toArray()));
  if (center && push) return { ...span, radius: 2.3 * radius }; // in contact the surface is near; with the arrows
  if (center) {
    const order = looks.map((_, i) => i).sort((a, b) =>
      Number(looks[b].below > 0) - Number(looks[a].below > 0) ||
      Number(looks[b].farthest > 0) - Number(looks[a].farthest > 0) || looks[a].radius - looks[b].radius);
    return { ...span, center: centers[order[0]], radius: looks[order[0]].radius };
  }
  const middle = centers.reduce((sum, one) => sum.add(one), new Vector3()).divideScalar(centers.length);
  return { ...span, center: middle, radius: Math.max(...looks.map((look, i) => look.radius + centers[i].distanceTo(middle))) };
}
