// Decodes the binary messages of docs/viewer-protocol.md. Numbers are not copied: the arrays are views of
// the message, whose parts are aligned for that.
import type { Contact, Edges, Frame, Graph, Mesh, Normals, Pose, Sample, Spheres, Tree } from './types';

export const PROTOCOL = 3;

export type Message =
  | { kind: 'spheres'; spheres: Spheres }
  | { kind: 'graph'; graph: Graph }
  | { kind: 'mesh'; mesh: Mesh }
  | { kind: 'tree'; tree: Tree }
  | { kind: 'objects'; meshes: Mesh[] }
  | { kind: 'frame'; frame: Frame }
  | { kind: 'contact'; contact: Contact }
  | { kind: 'normals'; normals: Normals }
  | { kind: 'edges'; edges: Edges }
  | { kind: 'samples'; samples: Sample[] };

const HEADER = 16; // bytes

/**
 * Decodes a message; `columns` are those of hello. Returns null for an unknown kind. Throws a RangeError if
 * the message is shorter than its header says.
 */
export function decode(buffer: ArrayBuffer, columns: string[]): Message | null {
  const view = new DataView(buffer);
  const kind = view.getUint16(0, true);
  const number = view.getUint32(4, true);
  const time = view.getFloat64(8, true);
  const u16 = (offset: number) => view.getUint16(offset, true);
  const u32 = (offset: number) => view.getUint32(offset, true);

  switch (kind) {
    case 1: {
      const count = u32(HEADER);
      return { kind: 'spheres', spheres: { count, data: new Float32Array(buffer, 20, 4 * count) } };
    }
    case 2: {
      const count = u32(HEADER);
      return { kind: 'graph', graph: { count, pairs: new Uint32Array(buffer, 20, 2 * count) } };
    }
    case 3: {
      const vertices = u32(HEADER), triangles = u32(20);
      const mesh = {
        positions: new Float32Array(buffer, 24, 3 * vertices),
        triangles: new Uint32Array(buffer, 24 + 12 * vertices, 3 * triangles),
      };
      return { kind: 'mesh', mesh };
    }
    case 4: {
      const count = u32(HEADER);
      const data = new Float32Array(buffer, 20, 4 * count);
      return { kind: 'tree', tree: { count, data, levels: new Uint8Array(buffer, 20 + 16 * count, count) } };
    }
    case 5: {
      const meshes: Mesh[] = [];
      let at = 20;
      for (let i = u32(HEADER); i > 0; --i) {
        const vertices = u32(at), triangles = u32(at + 4);
        const positions = new Float32Array(buffer, at + 8, 3 * vertices);
        at += 8 + 12 * vertices;
        meshes.push({ positions, triangles: new Uint32Array(buffer, at, 3 * triangles) });
        at += 12 * triangles;
      }
      return { kind: 'objects', meshes };
    }
    case 10: {
      const width = u16(HEADER), height = u16(18), camera = u16(20);
      const unit = view.getFloat64(80, true), depth = new Uint16Array(buffer, 88, width * height);
      return { kind: 'frame', frame: { number, time, camera, X_WC: pose(view, 24), width, height, unit, depth } };
    }
    case 11: {
      const count = u32(72);
      const states = new Uint8Array(buffer, 76, count);
      const after = 76 + 4 * Math.ceil(count / 4);
      const planes = new Float32Array(buffer, after + 4, 4 * u32(after));
      const end = after + 4 + planes.byteLength;
      const objects = Array.from({ length: u32(end) }, (_, i) => pose(view, end + 4 + 56 * i));
      return { kind: 'contact', contact: { number, time, X_WT: pose(view, HEADER), objects, states, planes } };
    }
    case 12: {
      const width = u16(HEADER), height = u16(18);
      const data = new Int8Array(buffer, 20, 4 * width * height);
      return { kind: 'normals', normals: { number, width, height, data } };
    }
    case 13: {
      const count = u32(HEADER);
      return { kind: 'edges', edges: { number, count, data: new Float32Array(buffer, 20, 6 * count) } };
    }
    case 20: {
      const count = u32(HEADER), width = u32(20);
      const data = new Float32Array(buffer, 24, count * width);
      return { kind: 'samples', samples: samples(data, count, width, time, columns) };
    }
    default:
      return null;
  }
}

function pose(view: DataView, offset: number): Pose {
  const at = (i: number) => view.getFloat64(offset + 8 * i, true);
  return { position: [at(0), at(1), at(2)], quaternion: [at(3), at(4), at(5), at(6)] };
}

function samples(
  data: Float32Array, count: number, width: number, start: number, columns: string[],
): Sample[] {
  const list: Sample[] = new Array(count);
  for (let row = 0; row < count; ++row) {
    const sample: Sample = {};
    for (let i = 0; i < width; ++i) sample[columns[i] ?? `column_${i}`] = data[row * width + i];
    sample.time += start;
    list[row] = sample;
  }
  return list;
}
