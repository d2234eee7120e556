// Makes the binary messages of docs/viewer-protocol.md that messages.ts reads.
import type { Contact, Tool } from '../../core/palpate';
import { PROTOCOL } from '../messages';

const HEADER = 16;

export const COLUMNS = [
  'time', 'force_x', 'force_y', 'force_z', 'torque_x', 'torque_y', 'torque_z',
  'contact_force_x', 'contact_force_y', 'contact_force_z', 'contact_torque_x', 'contact_torque_y', 'contact_torque_z',
  'volume', 'compute', 'contact_age', 'sensor_age', 'stretch', 'gain', 'energy',
  'tool_x', 'tool_y', 'tool_z', 'tool_qx', 'tool_qy', 'tool_qz', 'tool_qw',
  'hand_x', 'hand_y', 'hand_z', 'hand_qx', 'hand_qy', 'hand_qz', 'hand_qw', 'objects_volume'];

function message(kind: number, number: number, time: number, bytes: number): DataView {
  const view = new DataView(new ArrayBuffer(HEADER + bytes));
  view.setUint16(0, kind, true);
  view.setUint16(2, PROTOCOL, true);
  view.setUint32(4, number, true);
  view.setFloat64(8, time, true);
  return view;
}
function putPose(view: DataView, at: number, X: ArrayLike<number>): void {
  for (let i = 0; i < 7; ++i) view.setFloat64(at + 8 * i, X[i], true);
}

export function spheresMessage(tool: Tool): ArrayBuffer {
  const spheres = tool.spheres(), view = message(1, 0, 0, 4 + spheres.byteLength);
  view.setUint32(HEADER, tool.info.spheres, true);
  new Float32Array(view.buffer, 20).set(spheres);
  return view.buffer as ArrayBuffer;
}

export const meshMessage = (tool: Tool): ArrayBuffer => meshes(3, HEADER, [tool]);
export function objectsMessage(shapes: Tool[]): ArrayBuffer {
  const buffer = meshes(5, HEADER + 4, shapes);
  new DataView(buffer).setUint32(HEADER, shapes.length, true);
  return buffer;
}
/** Makes a message whose meshes begin at `at`. */
function meshes(kind: number, at: number, shapes: Tool[]): ArrayBuffer {
  const all = shapes.map((shape) => shape.mesh());
  const { buffer } = message(kind, 0, 0, at - HEADER + all.reduce((sum, { vertices, triangles }) => sum + 8 + vertices.byteLength + triangles.byteLength, 0));
  for (const { vertices, triangles } of all) {
    new Uint32Array(buffer, at, 2).set([vertices.length / 3, triangles.length / 3]);
    new Float32Array(buffer, at + 8, vertices.length).set(vertices);
    new Uint32Array(buffer, at + 8 + vertices.byteLength, triangles.length).set(triangles);
    at += 8 + vertices.byteLength + triangles.byteLength;
  }
  return buffer as ArrayBuffer;
}

export interface Image { width: number; height: number; unit: number; counts: Uint16Array; X_WC: ArrayLike<number> }

export function frameMessage(number: number, time: number, image: Image): ArrayBuffer {
  const view = message(10, number, time, 72 + image.counts.byteLength);
  view.setUint16(HEADER, image.width, true);
  view.setUint16(18, image.height, true);
  putPose(view, 24, image.X_WC);
  view.setFloat64(80, image.unit, true);
  new Uint16Array(view.buffer, 88).set(image.counts);
  return view.buffer as ArrayBuffer;
}

/** The state of all spheres that `contact` measured last at X_WT, and the poses of the objects. */
export function contactMessage(number: number, time: number, X_WT: ArrayLike<number>, contact: Contact, objects: ArrayLike<number>[]): ArrayBuffer {
  const { states, planes } = contact, num = states.length, room = 4 * Math.ceil(num / 4);
  const marked = new Uint8Array(room), cut: number[] = [];
  for (let i = 0; i < num; ++i) {
    const hasPlane = states[i] !== 0 && (planes[4 * i] !== 0 || planes[4 * i + 1] !== 0 || planes[4 * i + 2] !== 0);
    marked[i] = states[i] + (hasPlane ? 4 : 0) + (states[i] !== 0 ? 16 : 0);
    if (hasPlane) cut.push(planes[4 * i], planes[4 * i + 1], planes[4 * i + 2], planes[4 * i + 3]);
  }
  const view = message(11, number, time, 60 + room + 4 + 4 * cut.length + 4 + 56 * objects.length), end = 80 + room + 4 * cut.length;
  putPose(view, HEADER, X_WT);
  view.setUint32(72, num, true);
  new Uint8Array(view.buffer, 76, room).set(marked);
  view.setUint32(76 + room, cut.length / 4, true);
  new Float32Array(view.buffer, 80 + room, cut.length).set(cut);
  view.setUint32(end, objects.length, true);
  objects.forEach((X_WB, i) => putPose(view, end + 4 + 56 * i, X_WB));
  return view.buffer as ArrayBuffer;
}

/** Samples of COLUMNS one after the other, times relative to `start`. */
export function samplesMessage(first: number, start: number, samples: number[][]): ArrayBuffer {
  const width = COLUMNS.length, view = message(20, first, start, 8 + 4 * width * samples.length);
  view.setUint32(HEADER, samples.length, true);
  view.setUint32(20, width, true);
  const data = new Float32Array(view.buffer, 24);
  samples.forEach((sample, i) => data.set(sample, i * width));
  return view.buffer as ArrayBuffer;
}

