import { element } from '../dom';
import { STATE_COLORS } from '../scene/colors';
import { DepthRange } from '../scene/cameras/depth_range';
import { cameraNames } from '../scene/cameras/frustum';
import { inFrame } from '../scene/poses';
import type { Contact, Frame, Hello, Pose, Spheres, Stream } from '../types';

const WIDEST = 320; // pixels drawn across, the width of the panel
const MOST_SPHERES = 1200;
const COLORS = [STATE_COLORS.outside, STATE_COLORS.boundary, STATE_COLORS.inside];

/** Depth image of a camera, near light and far dark, with the tool drawn over it. */
export class CameraImage {
  readonly root = element('section', 'card image');
  private readonly canvas = element('canvas');
  private readonly context = this.canvas.getContext('2d', { alpha: false })!;
  private readonly choice = element('select');
  private readonly title = element('h2', '', 'Camera');
  private range = new DepthRange();
  private readonly shades = new Uint32Array(65536);
  private shadesOf = ''; // depth range of `shades`
  private pixels: ImageData | null = null;
  private streams: Stream[] = [];
  private spheres: Spheres | null = null;
  private drawn = [-1, -1];

  constructor() {
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', 'depth image with the tool');
    this.choice.setAttribute('aria-label', 'camera');
    this.choice.addEventListener('change', () => {
      this.range = new DepthRange();
      this.drawn = [-1, -1];
    });
    this.root.append(this.title, this.canvas);
  }

  setHello(hello: Hello): void {
    this.streams = hello.streams;
    this.range = new DepthRange();
    this.drawn = [-1, -1];
    this.choice.replaceChildren(...cameraNames(hello.streams).map((name) => element('option', '', name)));
    this.title.replaceChildren(hello.streams.length > 1 ? this.choice : 'Camera');
  }

  setSpheres(spheres: Spheres): void {
    this.spheres = spheres;
  }

  /** Draws the chosen camera's frame; `frames` has one per camera. */
  draw(frames: readonly (Frame | null)[], contact: Contact | null): void {
    const frame = frames[Math.max(0, this.choice.selectedIndex)];
    if (!frame) return;
    if (frame.number === this.drawn[0] && contact?.time === this.drawn[1]) return;
    this.drawn = [frame.number, contact?.time ?? -1];
    const step = Math.ceil(frame.width / WIDEST);
    this.drawDepth(frame, step);
    if (contact) this.drawTool(contact, inFrame(frame.X_WC, contact.X_WT), this.streams[frame.camera], step);
  }

  private drawDepth(frame: Frame, step: number): void {
    const width = Math.floor(frame.width / step), height = Math.floor(frame.height / step);
    if (!this.pixels || this.pixels.width !== width || this.pixels.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.pixels = this.context.createImageData(width, height);
    }
    this.range.update(frame);
    this.updateShades(frame.unit);
    const target = new Uint32Array(this.pixels.data.buffer);
    for (let v = 0, i = 0; v < height; ++v) {
      for (let u = 0, from = v * step * frame.width; u < width; ++u, from += step) {
        target[i++] = this.shades[frame.depth[from]];
      }
    }
    this.context.putImageData(this.pixels, 0, 0);
  }

  /** Computes a gray for each count of `unit` m, again when the range has moved by some percent. */
  private updateShades(unit: number): void {
    const { near, far } = this.range;
    const grain = Math.max(unit, 0.02 * (far - near));
    const key = `${unit} ${Math.round(near / grain)} ${Math.round(far / grain)}`;
    if (key === this.shadesOf) return;
    this.shadesOf = key;
    for (let raw = 1; raw < 65535; ++raw) {
      const share = Math.min(1, Math.max(0, (raw * unit - near) / Math.max(unit, far - near)));
      const gray = Math.round(235 - 190 * share);
      this.shades[raw] = 0xff000000 | (gray << 16) | (gray << 8) | gray;
    }
    this.shades[0] = this.shades[65535] = 0xff241c16; // no measurement
  }

  private drawTool(contact: Contact, X_CT: Pose, stream: Stream, step: number): void {
    const { spheres, context } = this;
    if (!spheres || spheres.count !== contact.states.length) return;
    const [px, py, pz] = X_CT.position;
    const [qx, qy, qz, qw] = X_CT.quaternion;
    const every = Math.ceil(spheres.count / MOST_SPHERES);
    context.globalAlpha = 0.75;
    for (let i = 0; i < spheres.count; i += every) {
      const x = spheres.data[4 * i], y = spheres.data[4 * i + 1], z = spheres.data[4 * i + 2];
      // p_C = p + q p_T q*
      const tx = 2 * (qy * z - qz * y), ty = 2 * (qz * x - qx * z), tz = 2 * (qx * y - qy * x);
      const cx = px + x + qw * tx + qy * tz - qz * ty;
      const cy = py + y + qw * ty + qz * tx - qx * tz;
      const cz = pz + z + qw * tz + qx * ty - qy * tx;
      if (cz <= 0.01) continue;
      const radius = Math.max(0.8, (stream.fx * spheres.data[4 * i + 3]) / cz / step);
      context.fillStyle = COLORS[contact.states[i] & 3] ?? COLORS[0];
      context.beginPath();
      const u = stream.cx + (stream.fx * cx) / cz, v = stream.cy + (stream.fy * cy) / cz;
      context.arc(u / step, v / step, radius, 0, 2 * Math.PI);
      context.fill();
    }
    context.globalAlpha = 1;
  }
}
