// Depth images that the run in a page is given: a reader's own, or those of a camera that moves.
import type { Camera } from '../../core/palpate';
import type { Image } from './packets';

const SAME = 1e-3; // pixels between two reports of the same camera

/** A depth image that a reader has dropped on the page, or one of the stream of a camera that is known and moves. */
export interface GivenImage { name: string; width: number; height: number; counts: Uint16Array; camera?: Camera; X_WC?: number[] }

export const imageOf = ({ width, height, counts, X_WC }: GivenImage): Image => ({ width, height, unit: 0.001, counts, X_WC: X_WC ?? [0, 0, 0, 0, 0, 0, 1] });

/** Returns the camera of an image; where it is unknown, one with an angle of view as most have. */
export function cameraOf({ width, height, camera }: GivenImage): Camera {
  const focal = 0.85 * width;
  return camera ?? { width, height, fx: focal, fy: focal, cx: (width - 1) / 2, cy: (height - 1) / 2 };
}
/** Returns the depth that a twentieth of the image is nearer than, m. */
export function nearestOf({ counts, unit }: Image): number {
  const seen = Array.from(counts).filter((count) => count > 0 && count < 65535).sort((a, b) => a - b);
  return seen.length > 0 ? seen[Math.floor(seen.length / 20)] * unit : 0.5;
}

export function isSameCamera(a: Camera | undefined, b: Camera | undefined): boolean {
  return !!a && !!b && a.width === b.width && a.height === b.height && (['fx', 'fy', 'cx', 'cy'] as const).every((key) => Math.abs(a[key] - b[key]) < SAME);
}

/** Returns what the page says of an image that it begins to show. */
export function noteOf(image: GivenImage | null): string | null {
  if (image === null) return null;
  return image.camera ? `The camera is ${image.name}.` : `${image.name}: counts are taken as millimeters.`;
}
