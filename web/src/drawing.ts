// Draws the scene when something has changed, and only then.

/** Time of drawing after a pointer or wheel event, while the camera glides, ms. */
const GLIDE = 1000;

export class Drawing {
  /** Number of drawings so far. */
  count = 0;

  private isRequested = false;
  private picture: number | null = null;
  private isHeld = false;
  private glideEnd = 0;

  constructor(
    canvas: HTMLCanvasElement,
    private readonly draw: () => void,
    private readonly acknowledge: (picture: number) => void,
  ) {
    canvas.addEventListener('pointerdown', () => this.hold(true));
    window.addEventListener('pointerup', () => this.hold(false));
    window.addEventListener('pointercancel', () => this.hold(false));
    canvas.addEventListener('wheel', () => this.glide(), { passive: true });
  }

  requestDraw(): void {
    if (this.isRequested) return;
    this.isRequested = true;
    requestAnimationFrame(() => this.onFrame());
  }

  /** Requests a drawing of this picture, which is acknowledged once drawn. */
  askFor(picture: number): void {
    this.picture = picture;
    this.requestDraw();
  }

  /** True if a picture has arrived that is not drawn yet. */
  get isBehind(): boolean {
    return this.picture !== null;
  }

  /** Drops the pending acknowledgement, after the connection was lost. */
  forget(): void {
    this.picture = null;
  }

  /** Keeps drawing for GLIDE ms while the camera moves. */
  glide(): void {
    this.glideEnd = performance.now() + GLIDE;
    this.requestDraw();
  }

  private hold(isHeld: boolean): void {
    if (isHeld || this.isHeld) this.glide();
    this.isHeld = isHeld;
  }

  private onFrame(): void {
    this.isRequested = false;
    this.draw();
    ++this.count;
    if (this.picture !== null) this.acknowledge(this.picture);
    this.picture = null;
    if (this.isHeld || performance.now() < this.glideEnd) this.requestDraw();
  }
}
