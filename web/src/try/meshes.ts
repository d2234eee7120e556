// Meshes that a reader gives: STL and glTF, as indexed triangles in meters.
import { LoadingManager, Mesh, Vector3 } from 'three';
import type { BufferGeometry, Object3D } from 'three';
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js';
import { STLLoader } from 'three/addons/loaders/STLLoader.js';

export interface GivenMesh { vertices: Float64Array; triangles: Uint32Array }

/** A loader of what a file has inside; nothing else is fetched. */
const inside = new LoadingManager();
inside.setURLModifier((url) => {
  if (/^(data|blob):/.test(url)) return url;
  throw new Error(`it refers to another file, ${url}`);
});

const LONGEST = 2; // m: a longer tool was certainly meant in millimeters

/** Equal corners become one vertex; coordinates beyond the size of a tool are taken as millimeters. */
function indexed(corners: number[]): GivenMesh {
  const numbers = new Map<string, number>(), vertices: number[] = [], triangles = new Uint32Array(corners.length / 3);
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < triangles.length; ++i) {
    const p = corners.slice(3 * i, 3 * i + 3), key = p.join(' ');
    let number = numbers.get(key);
    if (number === undefined) {
      number = vertices.length / 3;
      numbers.set(key, number);
      vertices.push(...p);
      for (let k = 0; k < 3; ++k) {
        low[k] = Math.min(low[k], p[k]);
        high[k] = Math.max(high[k], p[k]);
      }
    }
    triangles[i] = number;
  }
  const scale = Math.max(...high.map((h, k) => h - low[k])) > LONGEST ? 0.001 : 1;
  return { vertices: Float64Array.from(vertices, (n) => n * scale), triangles };
}

function addCorners(geometry: BufferGeometry, node: Object3D | null, corners: number[]): void {
  const plain = geometry.index ? geometry.toNonIndexed() : geometry, positions = plain.getAttribute('position');
  const p = new Vector3();
  for (let i = 0; i < positions.count; ++i) {
    p.fromBufferAttribute(positions, i);
    if (node) p.applyMatrix4(node.matrixWorld);
    corners.push(p.x, p.y, p.z);
  }
}

/** Reads a mesh by its name's ending; throws one sentence if it cannot. */
export async function readMesh(name: string, bytes: ArrayBuffer): Promise<GivenMesh> {
  const corners: number[] = [];
  try {
    if (/\.stl$/i.test(name)) {
      addCorners(new STLLoader().parse(bytes), null, corners);
    } else {
      const { scene } = await new GLTFLoader(inside).parseAsync(bytes, '');
      scene.updateMatrixWorld(true);
      scene.traverse((node) => node instanceof Mesh && addCorners(node.geometry as BufferGeometry, node, corners));
    }
  } catch (error) {
    throw new Error(`${name} cannot be read as a mesh (${(error as Error).message}); export it as binary STL or GLB.`);
  }
  if (corners.length === 0) throw new Error(`${name} has no triangles; export it as a mesh.`);
  return indexed(corners);
}
