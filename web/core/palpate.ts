// Palpate in JavaScript: the functions of palpate/c/palpate.h as classes, over one WebAssembly module that needs neither
// threads nor cross-origin isolation.
//
//   const palpate = await load(await (await fetch('palpate.wasm')).arrayBuffer());
//   const tool = palpate.packShape('stylus', 0.12, 'packing.spheres = 1000');
//
// SI units; poses are x y z qx qy qz qw and map coordinates, X_WT from the tool to the world. What fails throws an Error with
// one sentence. Objects are freed by free(), or all together when the Palpate and they are dropped.

import { Host, Owned } from './host.js';
import type { Exports, Progress } from './host.js';

export type PoseNumbers = ArrayLike<number>; // x y z, qx qy qz qw

export interface Camera { width: number; height: number; fx: number; fy: number; cx: number; cy: number }
export interface ToolInfo {
  spheres: number; vertices: number; triangles: number;
  volume: number; center_of_mass: [number, number, number]; radius: number; // m3, m
}
export interface Measure {
  status: number; boundary: number; inside: number;
  volume: number; potential: number; // m3, m4
  bodiesVolume: number; // m3, the bodies' share of the volume
  force: number[]; torque: number[]; // m3, m4: times N/m3 a wrench about the center of mass, in W
  stiffness: Float64Array; // 6 x 6; zeros if it was not asked for
}
export interface Device {
  max_force: number; max_torque: number; max_stiffness: number; max_angular_stiffness: number; max_damping: number;
  workspace_radius: number; damping: number; angular_damping: number; rate: number;
}
export interface Handle {
  time: number; X_BH: PoseNumbers; linear?: ArrayLike<number>; angular?: ArrayLike<number>; buttons?: number;
  isValid?: boolean; wantsForce?: boolean; isReleased?: boolean; isStopping?: boolean;
}
export interface Tick {
  state: number; fault: number; faults: number;
  force: number[]; torque: number[]; contactForce: number[]; contactTorque: number[]; // N, N m
  X_WT: number[]; X_WT_hand: number[]; stretch: number; energy: number; gain: number;
}
export interface SimulationInfo {
  camera: Camera; unit: number; rate: number; duration: number; tool_size: number; tool_shape: string; title: string;
}
export interface Frame { counts: Uint16Array; time: number; X_WC: number[] }
export type { Progress };

const NO_SIMD = 'This browser cannot run Palpate: it needs WebAssembly with vector instructions (SIMD); update the browser, or take Chrome 91, Firefox 113 or Safari 16.4 or newer.';

// A module whose only function uses a vector: valid only where there are vector instructions.
const SIMD_PROBE = new Uint8Array([
  0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);

/** Returns null, or the sentence that says why this browser cannot. */
export function whyNot(): string | null {
  return typeof WebAssembly === 'object' && WebAssembly.validate(SIMD_PROBE) ? null : NO_SIMD;
}

/** Starts the core from the bytes of palpate.wasm, or from the compiled module. */
export async function load(source: BufferSource | WebAssembly.Module): Promise<Palpate> {
  const refusal = whyNot();
  if (refusal !== null) throw new Error(refusal);
  const module = source instanceof WebAssembly.Module ? source : await WebAssembly.compile(source);
  const host = new Host();
  const instance = await WebAssembly.instantiate(module, host.imports(module));
  host.exports = instance.exports as unknown as Exports;
  host.exports._initialize?.();
  return new Palpate(host);
}

export class Palpate {
  constructor(private readonly host: Host) {}

  get version(): string { return this.host.readText(this.host.exports.palpate_version()); }
  /** Bytes of memory in use, which never shrinks. */
  get memory(): number { return this.host.exports.memory.buffer.byteLength; }

  /** Packs a closed mesh, vertices in m. `progress` returns false to cancel. */
  pack(vertices: ArrayLike<number>, triangles: ArrayLike<number>, options = '', progress?: Progress): Tool {
    const { host } = this;
    host.progress = progress ?? (() => true);
    return host.with(8 * vertices.length, (at) => host.with(4 * triangles.length, (faces) => {
      host.doubles(at, vertices.length).set(vertices);
      new Uint32Array(host.exports.memory.buffer, faces, triangles.length).set(triangles);
      return host.text(options, (words) => new Tool(host, host.make((error) => host.exports.palpate_tool_pack(
        at, vertices.length / 3, faces, triangles.length / 3, words, host.exports.palpate_page_progress_function(), 0, error))));
    }));
  }
  packShape(shape: string, size: number, options = ''): Tool {
    const { host } = this;
    return host.text(shape, (name) => host.text(options, (words) =>
      new Tool(host, host.make((error) => host.exports.palpate_tool_pack_shape(name, size, words, error)))));
  }
  loadTool(bytes: Uint8Array): Tool {
    const { host } = this;
    return host.with(bytes.length, (at) => {
      new Uint8Array(host.exports.memory.buffer).set(bytes, at);
      return new Tool(host, host.make((error) => host.exports.palpate_tool_load(at, bytes.length, error)));
    });
  }
  sensor(camera: Camera, options = ''): Sensor { return new Sensor(this.host, camera, options); }
  scene(): Scene { return new Scene(this.host); }
  contact(tool: Tool, options = ''): Contact {
    const { host } = this;
    return new Contact(host, tool, host.text(options, (words) =>
      host.make((error) => host.exports.palpate_contact_create(tool.handle, words, 1, error))));
  }
  hand(tool: Tool, device: Device, options = ''): Hand { return new Hand(this.host, tool, device, options); }
  get simulations(): string[] { return this.host.readText(this.host.exports.palpate_simulation_names()).split(','); }
  simulation(scene: string, width: number, height: number, noise = 1, seed = 1): Simulation {
    const { host } = this;
    return new Simulation(host, host.text(scene, (name) => host.make((error) =>
      host.exports.palpate_simulation_create(name, width, height, noise, BigInt(seed), error))));
  }
  faultText(fault: number): string { return this.host.readText(this.host.exports.palpate_fault_text(fault)); }
}

export class Tool extends Owned {
  readonly info: ToolInfo;

  constructor(host: Host, handle: number) {
    super(host, handle, 'tool');
    this.info = host.with(104, (at) => {
      host.view.setUint32(at, 104, true);
      host.exports.palpate_tool_describe(handle, at);
      const { view } = host, int = (offset: number) => view.getInt32(at + offset, true);
      const [volume, x, y, z, radius] = host.doubles(at + 16, 5);
      return { spheres: int(4), vertices: int(8), triangles: int(12), volume, center_of_mass: [x, y, z], radius };
    });
  }
  /** Returns x y z r of each sphere, in the frame of the tool. */
  spheres(): Float32Array {
    const num = 4 * this.info.spheres;
    return this.host.with(4 * num, (at) => {
      this.host.exports.palpate_tool_spheres(this.handle, at);
      return new Float32Array(this.host.exports.memory.buffer, at, num).slice();
    });
  }
  mesh(): { vertices: Float32Array; triangles: Uint32Array } {
    const { host } = this, [num, faces] = [3 * this.info.vertices, 3 * this.info.triangles];
    return host.with(4 * (num + faces), (at) => {
      host.exports.palpate_tool_mesh(this.handle, at, at + 4 * num);
      const { buffer } = host.exports.memory;
      return { vertices: new Float32Array(buffer, at, num).slice(), triangles: new Uint32Array(buffer, at + 4 * num, faces).slice() };
    });
  }
  prefix(spheres: number): Tool {
    return new Tool(this.host, this.host.make((error) => this.host.exports.palpate_tool_prefix(this.handle, spheres, error)));
  }
  /** Returns the bytes of a tool file (.palp). */
  save(): Uint8Array {
    const { host } = this;
    const size = host.make((error) => host.exports.palpate_tool_save(this.handle, 0, 0, error));
    return host.with(size, (at) => {
      host.make((error) => host.exports.palpate_tool_save(this.handle, at, size, error));
      return new Uint8Array(host.exports.memory.buffer, at, size).slice();
    });
  }
}

export class Sensor extends Owned {
  private readonly image: number;

  constructor(host: Host, readonly camera: Camera, options: string) {
    super(host, host.with(112, (at) => {
      const { view } = host;
      new Uint8Array(view.buffer, at, 112).fill(0);
      [112, camera.width, camera.height].forEach((number, i) => view.setUint32(at + 4 * i, number, true));
      host.doubles(at + 16, 4).set([camera.fx, camera.fy, camera.cx, camera.cy]);
      return host.text(options, (words) => host.make((error) => host.exports.palpate_sensor_create(at, words, 1, error)));
    }), 'sensor');
    this.image = this.allocate(4 * camera.width * camera.height);
  }
  /** Computes the surface of an image: counts of `unit` m, or meters. */
  update(image: Uint16Array | Float32Array, unit = 0.001, X_WC?: PoseNumbers): void {
    const { host, handle, image: at } = this;
    if (image.length !== this.camera.width * this.camera.height)
      throw new Error(`The depth image has ${image.length} values, and the camera ${this.camera.width} x ${this.camera.height} pixels; give an image of that size.`);
    new (image instanceof Uint16Array ? Uint16Array : Float32Array)(host.exports.memory.buffer, at, image.length).set(image);
    host.with(56, (pose) => {
      if (X_WC) host.put(pose, X_WC);
      const place = X_WC ? pose : 0;
      host.do((error) => image instanceof Uint16Array
        ? host.exports.palpate_sensor_update_counts(handle, at, unit, place, error)
        : host.exports.palpate_sensor_update_meters(handle, at, place, error));
    });
  }
}

export class Scene extends Owned {
  constructor(host: Host) {
    super(host, host.make((error) => host.exports.palpate_scene_create(error)), 'scene');
  }
  addSensor(sensor: Sensor): void {
    this.host.do((error) => this.host.exports.palpate_scene_add_sensor(this.handle, sensor.handle, error));
  }
  /** Adds a fixed body; returns its number. */
  addBody(shape: Tool, X_WB: PoseNumbers): number {
    return this.host.with(56, (at) => {
      this.host.put(at, X_WB);
      return this.host.do((error) => this.host.exports.palpate_scene_add_body(this.handle, shape.handle, at, error));
    });
  }
  moveBody(body: number, X_WB: PoseNumbers): void {
    this.host.with(56, (at) => {
      this.host.put(at, X_WB);
      this.host.do((error) => this.host.exports.palpate_scene_move_body(this.handle, body, at, error));
    });
  }
}

const MEASURE = 536; // bytes of palpate_measure

export class Contact extends Owned {
  private readonly at: number; // palpate_measure
  readonly states: Uint8Array;
  readonly planes: Float32Array;
  private readonly memory: number; // pose, states, planes

  constructor(host: Host, tool: Tool, handle: number) {
    super(host, handle, 'contact');
    const num = tool.info.spheres, room = 4 * Math.ceil(num / 4);
    this.at = this.allocate(MEASURE);
    this.memory = this.allocate(56 + room + 16 * num);
    this.states = new Uint8Array(num);
    this.planes = new Float32Array(4 * num);
  }
  /** Measures at a pose. With `spheres`, `states` and `planes` hold them afterwards. */
  measure(scene: Scene, X_WT: PoseNumbers, { progress = 1, stiffness = false, spheres = false } = {}): Measure {
    const { host, handle, at, memory } = this, num = this.states.length;
    const states = memory + 56, planes = states + 4 * Math.ceil(num / 4);
    let { view } = host;
    view.setUint32(at, MEASURE, true);
    view.setUint32(at + 4, stiffness ? 1 : 0, true);
    view.setFloat64(at + 8, progress, true);
    view.setUint32(at + 16, spheres ? states : 0, true);
    view.setUint32(at + 20, spheres ? planes : 0, true);
    host.put(memory, X_WT);
    host.do((error) => host.exports.palpate_contact_measure(handle, scene.handle, memory, at, error));
    if (spheres) {
      const { buffer } = host.exports.memory;
      this.states.set(new Uint8Array(buffer, states, num));
      this.planes.set(new Float32Array(buffer, planes, 4 * num));
    }
    ({ view } = host);
    return {
      status: view.getUint32(at + 24, true), boundary: view.getInt32(at + 28, true), inside: view.getInt32(at + 32, true),
      volume: view.getFloat64(at + 40, true), potential: view.getFloat64(at + 48, true), bodiesVolume: view.getFloat64(at + 528, true),
      force: host.numbers(at + 56, 3), torque: host.numbers(at + 80, 3), stiffness: stiffness ? host.doubles(at + 104, 36).slice() : new Float64Array(36),
    };
  }
  /** Returns the address of the palpate_measure that was measured last. */
  get measured(): number { return this.handle && this.at; }
  /** Returns the volume that was measured last, and the bodies' share of it, m3. */
  volume(): number {
    return this.host.view.getFloat64(this.measured + 40, true);
  }
  bodiesVolume(): number {
    return this.host.view.getFloat64(this.measured + 528, true);
  }
}

const STILL = [0, 0, 0];

export class Hand extends Owned {
  private readonly memory: number; // pose, palpate_handle, palpate_tick

  constructor(host: Host, tool: Tool, device: Device, options: string) {
    super(host, host.with(80, (at) => {
      host.view.setUint32(at, 80, true);
      host.doubles(at + 8, 9).set([
        device.max_force, device.max_torque, device.max_stiffness, device.max_angular_stiffness, device.max_damping,
        device.workspace_radius, device.damping, device.angular_damping, device.rate]);
      return host.text(options, (words) => host.make((error) => host.exports.palpate_hand_create(tool.handle, at, words, error)));
    }), 'hand');
    this.memory = this.allocate(56 + 136 + 248);
  }
  change(options: string): void {
    this.host.text(options, (words) => this.host.do((error) => this.host.exports.palpate_hand_change(this.handle, words, error)));
  }
  /** Takes what `contact` measured last, at X_WT; times in s. */
  contact(contact: Contact, X_WT: PoseNumbers, time: number, captured: number): void {
    const { host, handle, memory } = this;
    host.put(memory, X_WT);
    host.exports.palpate_hand_contact(handle, contact.measured, memory, time, captured);
  }
  handleAt(X_WT: PoseNumbers): number[] {
    const { host, handle, memory } = this;
    host.put(memory, X_WT);
    host.exports.palpate_hand_handle_at(handle, memory, memory + 56);
    return host.numbers(memory + 56, 7);
  }
  tick(handle: Handle): Tick {
    const { host, handle: hand } = this, at = this.memory + 56, to = at + 136, { view } = host;
    view.setUint32(at, 136, true);
    view.setUint32(at + 4, handle.buttons ?? 0, true);
    view.setFloat64(at + 8, handle.time, true);
    host.put(at + 16, handle.X_BH);
    host.put(at + 72, handle.linear ?? STILL);
    host.put(at + 96, handle.angular ?? STILL);
    [handle.isValid ?? true, handle.wantsForce ?? false, handle.isReleased ?? false, handle.isStopping ?? false]
      .forEach((flag, i) => view.setInt32(at + 120 + 4 * i, Number(flag), true));
    view.setUint32(to, 248, true);
    host.exports.palpate_hand_tick(hand, at, to);
    const [stretch, energy, gain] = host.numbers(to + 216, 3);
    return {
      state: view.getInt32(to + 4, true), fault: view.getInt32(to + 240, true), faults: view.getInt32(to + 244, true),
      force: host.numbers(to + 8, 3), torque: host.numbers(to + 32, 3),
      contactForce: host.numbers(to + 56, 3), contactTorque: host.numbers(to + 80, 3),
      X_WT: host.numbers(to + 104, 7), X_WT_hand: host.numbers(to + 160, 7), stretch, energy, gain,
    };
  }
}

export class Simulation extends Owned {
  readonly info: SimulationInfo;

  constructor(host: Host, handle: number) {
    super(host, handle, 'simulation');
    this.info = host.with(376, (at) => {
      host.view.setUint32(at, 376, true);
      host.exports.palpate_simulation_describe(handle, at);
      const [fx, fy, cx, cy] = host.doubles(at + 24, 4), [unit, rate, duration, tool_size] = host.doubles(at + 120, 4);
      const camera = { width: host.view.getInt32(at + 12, true), height: host.view.getInt32(at + 16, true), fx, fy, cx, cy };
      return { camera, unit, rate, duration, tool_size, tool_shape: host.readText(at + 152), title: host.readText(at + 176) };
    });
  }
  /** Returns the next frame; begins anew after the last. */
  next(): Frame {
    const { host } = this, num = this.info.camera.width * this.info.camera.height, room = 8 * Math.ceil(num / 4);
    return host.with(room + 64, (at) => {
      host.do((error) => host.exports.palpate_simulation_next(this.handle, at, at + room, at + room + 8, error));
      const counts = new Uint16Array(host.exports.memory.buffer, at, num).slice();
      return { counts, time: host.doubles(at + room, 1)[0], X_WC: host.numbers(at + room + 8, 7) };
    });
  }
  toolAt(time: number): number[] {
    return this.host.with(56, (at) => {
      this.host.exports.palpate_simulation_tool_at(this.handle, time, at);
      return this.host.numbers(at, 7);
    });
  }
}
