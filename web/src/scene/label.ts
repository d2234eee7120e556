// Text in the scene, of constant size on the page and legible on any ground.

import { CanvasTexture, Sprite, SpriteMaterial, SRGBColorSpace, Vector3 } from 'three';
import type { Theme } from './colors';

const TEXT = 40, MARGIN = 6; // pixels of the texture
const FONT = `600 ${0.7 * TEXT}px system-ui, sans-serif`;
const SIZE = 0.073; // height of a line, in half the shorter side of the canvas

export class Label {
  readonly object: Sprite;
  private readonly canvas = document.createElement('canvas');
  private readonly context = this.canvas.getContext('2d')!;
  private readonly texture: CanvasTexture | null = null;
  private painted: Theme | null = null;

  private shown = '';

  /** `anchor`: point of the text at its position, from 0 to 1 to the right and up. */
  constructor(words: string, anchor: [number, number], isBeforeAll = false, private readonly tone: 'text' | 'quiet' = 'text') {
    this.canvas.height = TEXT;
    this.words = words;
    const texture = this.texture = new CanvasTexture(this.canvas);
    texture.colorSpace = SRGBColorSpace;
    this.object = new Sprite(new SpriteMaterial({
      map: texture, sizeAttenuation: false, depthWrite: false, depthTest: !isBeforeAll,
    }));
    this.object.renderOrder = isBeforeAll ? 2 : 0;
    this.object.center.set(...anchor);
    // Same size in perspective and orthographic views, and whole where it would be cut off at the side.
    const place = new Vector3();
    this.object.onBeforeRender = (_, __, camera) => {
      const { elements } = camera.projectionMatrix;
      const height = SIZE / Math.max(elements[0], elements[5]);
      const width = (height * this.canvas.width) / TEXT;
      this.object.scale.set(width, height, 1);
      this.object.updateMatrixWorld();
      const { x } = place.setFromMatrixPosition(this.object.matrixWorld).project(camera);
      const share = Math.min(width * elements[0], 1.9), edge = 0.97; // of the picture's half width
      const from = x - anchor[0] * share;
      const kept = Math.abs(x) < 1.3 ? Math.min(Math.max(from, -edge), edge - share) : from;
      this.object.center.x = (x - kept) / share;
    };
  }

  set words(words: string) {
    if (words === this.shown) return;
    this.shown = words;
    this.context.font = FONT;
    this.canvas.width = Math.ceil(this.context.measureText(words).width) + 2 * MARGIN;
    this.painted = null;
    this.texture?.dispose(); // of another size; null during construction
  }

  paint(theme: Theme): void {
    if (theme === this.painted) return;
    this.painted = theme;
    const { canvas, context, shown: words } = this;
    context.clearRect(0, 0, canvas.width, canvas.height);
    context.font = FONT;
    context.textBaseline = 'middle';
    context.lineJoin = 'round';
    context.lineWidth = MARGIN;
    context.strokeStyle = theme.ground;
    context.strokeText(words, MARGIN, TEXT / 2);
    context.fillStyle = theme[this.tone];
    context.fillText(words, MARGIN, TEXT / 2);
    this.texture!.needsUpdate = true;
  }

  dispose(): void {
    this.texture?.dispose();
    this.object.material.dispose();
  }
}
