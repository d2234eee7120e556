// A headset as camera and handle, by WebXR: its depth sensing is the pushed camera, its controllers hold the tool. It vibrates and
// does not push.
import { BufferAttribute, BufferGeometry, HemisphereLight, Mesh, MeshStandardMaterial, Quaternion, Scene, Vector3, WebGLRenderer, PerspectiveCamera } from 'three';
import { button } from '../dom';
import { Vibration } from '../hand/vibration';
import type { Page } from '../page';
import { Arrow } from '../scene/arrow';
import { ARROW_COLORS, heat } from '../scene/colors';
import type { Hello, Sample } from '../types';
import type { GivenImage } from './given_image';
import type { WorkerWire } from './wire';

const MOST_PIXELS = 320 * 240;
const IMAGE_PERIOD = 100; // ms
const UNIT = 0.001;       // m of a count
const FORCE_SIZE = 0.02;  // m of arrow for a newton
const STATE_DELAY = 300;  // ms in which the state may be older than the last pull
const NAME = 'the headset';

/** Types of WebXR Depth Sensing, which those of TypeScript lack. */
interface Depth { width: number; height: number; data: ArrayBuffer; rawValueToMeters: number; normDepthBufferFromNormView: XRRigidTransform }
type DepthFrame = XRFrame & { getDepthInformation(view: XRView): Depth | null };
type DepthSession = XRSession & { depthDataFormat: string };

const numbers = ({ position: p, orientation: q }: XRRigidTransform): number[] => [p.x, p.y, p.z, q.x, q.y, q.z, q.w];

/** Returns a depth image of the view, in whose frame x is right, y down and z forward. */
function depthImage(view: XRView, depth: Depth, format: string): GivenImage {
  const P = view.projectionMatrix, shape = P[5] / P[0]; // width over height
  const num = Math.min(MOST_PIXELS, depth.width * depth.height);
  const width = Math.max(8, Math.round(Math.sqrt(num * shape))), height = Math.max(8, Math.round(width / shape));
  const camera = {
    width, height, fx: 0.5 * width * P[0], fy: 0.5 * height * P[5], cx: 0.5 * width * (1 - P[8]) - 0.5, cy: 0.5 * height * (1 + P[9]) - 0.5,
  };
  const raw = format === 'float32' ? new Float32Array(depth.data) : new Uint16Array(depth.data), counts = new Uint16Array(width * height);
  const M = depth.normDepthBufferFromNormView.matrix, scale = depth.rawValueToMeters / UNIT;
  for (let v = 0; v < height; ++v)
    for (let u = 0; u < width; ++u) {
      const x = (u + 0.5) / width, y = (v + 0.5) / height;
      const column = Math.floor(depth.width * (M[0] * x + M[4] * y + M[12])), row = Math.floor(depth.height * (M[1] * x + M[5] * y + M[13]));
      if (column < 0 || column >= depth.width || row < 0 || row >= depth.height) continue;
      const count = raw[row * depth.width + column] * scale;
      counts[v * width + u] = count > 0 ? Math.min(65535, Math.round(count)) : 0;
    }
  const { x, y, z, w } = view.transform.orientation; // times half a turn about x
  return { name: NAME, width, height, counts, camera, X_WC: [...numbers(view.transform).slice(0, 3), w, z, -y, -x] };
}

export class Headset {
  private readonly enter = button('try-headset', 'feel what the depth camera of a headset sees; its controllers vibrate and do not push', () => void this.begin(), 'headset');
  private readonly vibration = new Vibration();
  private holder: XRInputSource | null = null; // the controller that holds the tool
  private heldFrom = -Infinity; // ms
  private requested: Hello | null = null; // the run whose mesh was requested
  private lastImage = -Infinity; // ms
  private wasHeld = false;
  private hasImage = false;
  private hasHeld = false; // in this session: before, the tool is nowhere
  private space: XRReferenceSpace | null = null;

  constructor(private readonly page: Page, private readonly wire: WorkerWire, private readonly say: (text: string) => void) {
    this.enter.hidden = true;
    document.querySelector('.try-object')?.after(this.enter);
    void navigator.xr?.isSessionSupported('immersive-ar').then((can) => { this.enter.hidden = !can; }, () => {});
  }

  private async begin(): Promise<void> {
    let session: DepthSession | undefined;
    try {
      session = await navigator.xr!.requestSession('immersive-ar', {
        requiredFeatures: ['local-floor', 'depth-sensing'],
        depthSensing: { usagePreference: ['cpu-optimized'], dataFormatPreference: ['luminance-alpha', 'float32'] },
      } as XRSessionInit) as DepthSession;
      await this.show(session);
      this.say('Pull the trigger to hold the tool: the controller vibrates as the force changes.');
    } catch (error) {
      void session?.end().catch(() => {}); // it may have ended by itself
      this.say(`The headset shows no depth here (${(error as Error).message}); take one with depth sensing for pages, and allow it.`);
    }
  }

  private async show(session: DepthSession): Promise<void> {
    const renderer = new WebGLRenderer({ alpha: true, antialias: true }), scene = new Scene(), camera = new PerspectiveCamera();
    renderer.xr.enabled = true;
    renderer.xr.setReferenceSpaceType('local-floor');
    const material = new MeshStandardMaterial({ color: '#9aa7b4' }), tool = new Mesh(new BufferGeometry(), material), arrow = new Arrow(ARROW_COLORS.force);
    scene.add(tool, arrow.object, new HemisphereLight('#ffffff', '#556677', 3));
    let drawn: Float32Array | null = null; // vertices of the drawn mesh
    const begun = renderer.xr.setSession(session); // its listeners come first
    session.addEventListener('selectstart', (event) => this.hold(event));
    session.addEventListener('selectend', (event) => event.inputSource === this.holder && this.letGo());
    session.addEventListener('visibilitychange', () => session.visibilityState !== 'visible' && this.letGo());
    session.addEventListener('end', () => {
      this.letGo();
      renderer.setAnimationLoop(null);
      for (const part of [tool.geometry, material, arrow, renderer]) part.dispose();
      renderer.forceContextLoss();
      if (this.hasImage) this.wire.order({ kind: 'image', image: null });
      this.hasImage = this.hasHeld = false;
      this.space = null;
    });
    await begun;
    renderer.xr.getReferenceSpace()?.addEventListener('reset', () => this.letGo());
    renderer.setAnimationLoop((_, frame) => {
      const { hello, sample, mesh } = this.page;
      this.space = renderer.xr.getReferenceSpace();
      if (frame && this.space) this.follow(frame as DepthFrame, session, this.space);
      if (!mesh && this.requested !== hello) {
        this.requested = hello;
        void this.page.command({ command: 'get', what: 'mesh' });
      }
      if (mesh && mesh.positions !== drawn) {
        drawn = mesh.positions;
        tool.geometry.dispose();
        tool.geometry = new BufferGeometry().setIndex(new BufferAttribute(mesh.triangles, 1)).setAttribute('position', new BufferAttribute(mesh.positions, 3));
        tool.geometry.computeVertexNormals();
      }
      tool.visible = this.hasHeld && sample !== null && mesh !== null;
      if (sample) this.place(sample, tool, material, arrow);
      renderer.render(scene, camera);
    });
  }

  private place(sample: Sample, tool: Mesh, material: MeshStandardMaterial, arrow: Arrow): void {
    const { hello } = this.page, force = new Vector3(sample.force_x, sample.force_y, sample.force_z), most = hello?.handle?.max_force ?? 1;
    tool.position.set(sample.tool_x, sample.tool_y, sample.tool_z);
    tool.quaternion.copy(new Quaternion(sample.tool_qx, sample.tool_qy, sample.tool_qz, sample.tool_qw));
    material.emissive.set(heat(force.length() / most)).multiplyScalar(Math.min(1, force.length() / most));
    const center = new Vector3(...(hello?.tool.center_of_mass ?? [0, 0, 0])).applyQuaternion(tool.quaternion).add(tool.position);
    arrow.straight(center, force.clone().multiplyScalar(FORCE_SIZE), 0.004);
    if (this.holder) this.vibration.follow([force.x / most, force.y / most, force.z / most], this.holder.gamepad ?? null);
    else this.vibration.stop();
  }

  /** Sends the newest depth image and the pose of the controller that holds the tool, and requests the next sample. */
  private follow(frame: DepthFrame, session: DepthSession, space: XRReferenceSpace): void {
    const now = performance.now();
    this.wire.send(JSON.stringify({ ack: this.page.counters.pictures })); // the window draws nothing meanwhile
    if (now - this.heldFrom > STATE_DELAY) {
      const isHeld = this.page.state?.handle === 'held';
      if (this.wasHeld && !isHeld) this.holder = null; // it was silent for too long: the next pull takes hold again
      this.wasHeld = isHeld;
    }
    const X_WT = this.holder && this.toolAt(frame, this.holder, space);
    if (X_WT) this.wire.send(JSON.stringify({ hand: X_WT }));
    if (now - this.lastImage < IMAGE_PERIOD) return;
    const view = frame.getViewerPose(space)?.views[0], depth = view && frame.getDepthInformation(view);
    if (!depth) return;
    this.lastImage = now;
    this.hasImage = true;
    this.wire.order({ kind: 'image', image: depthImage(view, depth, session.depthDataFormat) });
  }

  /** Returns the pose of a tool whose tip is ahead of the controller; null if that is not tracked. */
  private toolAt(frame: XRFrame, source: XRInputSource, space: XRReferenceSpace): number[] | null {
    const pose = frame.getPose(source.targetRaySpace, space);
    if (!pose || !this.page.hello) return null;
    const [x, y, z, ...q] = numbers(pose.transform), { center_of_mass: [a, b, c], radius } = this.page.hello.tool;
    const shift = new Vector3(-a, -b, -c - radius).applyQuaternion(new Quaternion(...(q as [number, number, number, number])));
    return [x + shift.x, y + shift.y, z + shift.z, ...q];
  }

  private hold({ frame, inputSource }: XRInputSourceEvent): void {
    const at = this.space && this.toolAt(frame, inputSource, this.space);
    if (!at || this.holder) return;
    if (!this.hasImage) return this.say('The headset has given no depth yet; look at what is near, and pull again.');
    this.holder = inputSource;
    this.heldFrom = performance.now();
    this.hasHeld = true;
    this.wasHeld = false;
    this.wire.send(JSON.stringify({ id: 0, command: 'hold', at }));
  }
  private letGo(): void {
    if (!this.holder) return;
    this.holder = null;
    this.wire.send(JSON.stringify({ id: 0, command: 'release' }));
  }
}
