// Depth range of most of a frame, for its colors. Follows slowly: colors must not flicker.

import type { Frame } from '../../types';

const SAMPLES = 2048;

export class DepthRange {
  near = 0; // m
  far = 0;
  private readonly sorted = new Uint16Array(SAMPLES);

  update(frame: Frame): void {
    const step = Math.max(1, Math.floor(frame.depth.length / SAMPLES));
    let n = 0;
    for (let i = 0; i < frame.depth.length && n < SAMPLES; i += step) {
      const raw = frame.depth[i];
      if (raw !== 0 && raw !== 65535) this.sorted[n++] = raw;
    }
    if (n < 16) return;
    const valid = this.sorted.subarray(0, n).sort();
    const near = valid[Math.floor(n * 0.02)] * frame.unit, far = valid[Math.floor(n * 0.98)] * frame.unit;
    const pace = this.far === 0 ? 1 : 0.1;
    this.near += pace * (near - this.near);
    this.far += pace * (far - this.far);
  }
}
