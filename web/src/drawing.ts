// Draws the scene when something has changed, and only then.

/// While a hand is on the canvas the camera may glide on for so long, ms.
const GLIDE = 1000;

export class Drawing {
  /// Drawings so far.
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

  /// To draw, then acknowledge.
  askFor(picture: number): void {
    this.picture = picture;
    this.requestDraw();
  }

  /// A picture has come and is not drawn yet.
  get isBehind(): boolean {
    return this.picture !== null;
  }

  /// The connection has gone: nobody waits for an acknowledgement.
  forget(): void {
    this.picture = null;
  }

  /// The camera moves, and does so for a while.
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
