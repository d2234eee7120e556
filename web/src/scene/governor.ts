// Keeps the page usable where drawing is slow, as without a graphics card: it draws fewer points and
// pixels when a picture takes more than a tenth of a second, and more again when there is time.
// It polls the graphics card for completion and never waits for it.

/**
 * `enabled`: tests and full-detail views switch it off; `level`: index of the reduction in LEVELS; `fine`: eye-dome
 * lighting also where a processor draws, which takes seconds a picture.
 */
export const governor = { enabled: true, level: 0, fine: false };

/** Factors of the stride and of the pixels per length. */
const LEVELS = [[1, 1], [2, 1], [2, 0.75], [3, 0.6], [4, 0.5]] as const;
const TOO_LONG = 100; // ms
const SHORT = 30;     // ms
const TOO_LONG_FOR = 4, SHORT_FOR = 40; // pictures in a row

export class Governor {
  private started = 0;
  private fence: WebGLSync | null = null;
  private slow = 0;
  private quick = 0;
  private patience = SHORT_FOR; // doubles whenever drawing gets too slow

  private readonly isSoftware: boolean;

  constructor(private readonly gl: WebGL2RenderingContext) {
    const info = gl.getExtension('WEBGL_debug_renderer_info');
    const name = String(gl.getParameter(info ? info.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
    this.isSoftware = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
  }

  /** True where there is time for eye-dome lighting. */
  get isLit(): boolean {
    return governor.fine || (!this.isSoftware && this.coarser === 1);
  }

  get coarser(): number {
    return governor.enabled ? LEVELS[governor.level][0] : 1;
  }

  get finer(): number {
    return governor.enabled ? LEVELS[governor.level][1] : 1;
  }

  /** Starts timing a picture. One is measured at a time. */
  begin(): void {
    if (!this.fence) this.started = performance.now();
  }

  end(): void {
    if (!governor.enabled || this.fence || this.gl.isContextLost()) return;
    this.fence = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
    setTimeout(this.look, 4);
  }

  private readonly look = (): void => {
    const { gl, fence } = this;
    if (!fence) return;
    if (gl.isContextLost()) {
      this.fence = null;
      return;
    }
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
      setTimeout(this.look, 4);
      return;
    }
    gl.deleteSync(fence);
    this.fence = null;
    this.judge(performance.now() - this.started);
  };

  private judge(milliseconds: number): void {
    // A very slow picture counts twice.
    this.slow = milliseconds > 3 * TOO_LONG ? this.slow + 2 : milliseconds > TOO_LONG ? this.slow + 1 : 0;
    this.quick = milliseconds < SHORT ? this.quick + 1 : 0;
    if (this.slow >= TOO_LONG_FOR && governor.level + 1 < LEVELS.length) {
      ++governor.level;
      this.patience = Math.min(2000, 2 * this.patience);
    } else if (this.quick >= this.patience && governor.level > 0) {
      --governor.level;
    } else {
      return;
    }
    this.slow = this.quick = 0;
  }
}
