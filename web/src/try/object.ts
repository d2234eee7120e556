// The CAD object of a run in a page: its shape, and a place for it. It rests on what the camera sees, as near to where the tip of the tool
// begins as leaves it free, and is seen as a whole. So a push beside the tip meets it, and its volume is nowhere behind the surface.
import type { Camera, Palpate, Tool } from '../../core/palpate';
import { composed, conjugate, product, rotated } from './motion';
import type { Numbers } from './motion';
import type { Image } from './packets';
import type { Value } from './settings';

export const SHAPES = ['none', 'box', 'sphere']; // besides the reader's own
export const SPHERES = 1000; // of an object

/** An object that a reader gave, as a tool file. */
export interface GivenObject { name: string; bytes: Uint8Array }

/** Image and tool that an object is placed for. */
interface Surroundings { image: Image; camera: Camera; tool: Tool; X_WT: Numbers }

const FACING = [1, 0, 0, 0]; // half a turn about x: z to the camera, y up in its image
const FREE = 0.005;  // m, least distance from the tool
const STEPS = 24;    // places along each side of the image
const SAMPLES = 8;   // pixels along the radius of a place
const MEASURED = 0.7; // least share of the pixels of a place

/** Returns the least depth in a disc of `radius` m around a pixel, m; null where too little is measured or it is not seen as a whole. */
function nearestDepth({ counts, unit }: Image, { width, height, fx }: Camera, u: number, v: number, radius: number): number | null {
  const middle = counts[v * width + u] * unit;
  if (!(middle > 0)) return null;
  const reach = (fx * radius) / middle, step = Math.max(1, Math.floor(reach / SAMPLES));
  if (u < reach || v < reach || u + reach >= width || v + reach >= height) return null;
  let least = Infinity, num = 0, measured = 0;
  for (let y = Math.ceil(v - reach); y <= v + reach; y += step)
    for (let x = Math.ceil(u - reach); x <= u + reach; x += step) {
      if ((x - u) ** 2 + (y - v) ** 2 > reach ** 2) continue;
      const count = counts[y * width + x];
      ++num;
      if (count === 0 || count === 65535) continue;
      ++measured;
      least = Math.min(least, count * unit);
    }
  return measured >= MEASURED * num ? least : null;
}

/** Returns X_WB of an object in its place; beside the tool where there is none. */
function restingPose(shape: Tool, { image, camera, tool, X_WT }: Surroundings): Numbers {
  const X_WC = Array.from(image.X_WC), q_CW = conjugate(X_WC.slice(3));
  const toCamera = (p_W: Numbers) => rotated(q_CW, p_W.map((x, i) => x - X_WC[i]));
  const balls = tool.spheres(), center = shape.info.center_of_mass, { vertices } = shape.mesh();
  let aside = 0, back = 0, front = 0; // of the object from its center: across the line of sight, along it and against it
  for (let i = 0; i < vertices.length; i += 3) {
    const [x, y, z] = rotated(FACING, [0, 1, 2].map((k) => vertices[i + k] - center[k]));
    aside = Math.max(aside, Math.hypot(x, y));
    [back, front] = [Math.max(back, z), Math.max(front, -z)];
  }
  const spheres: Numbers[] = []; // x y z r of the tool's, in C
  for (let i = 0; i < balls.length; i += 4) spheres.push([...toCamera(composed(X_WT, Array.from(balls.subarray(i, i + 3)))), balls[i + 3]]);
  const tip = spheres.reduce((a, b) => (b[2] + b[3] > a[2] + a[3] ? b : a));
  let best: Numbers | null = null, least = Infinity;
  for (let row = 1; row < STEPS; ++row)
    for (let column = 1; column < STEPS; ++column) {
      const u = Math.round((column * camera.width) / STEPS), v = Math.round((row * camera.height) / STEPS);
      const depth = nearestDepth(image, camera, u, v, aside);
      if (depth === null) continue;
      const z = depth - back;
      if (z <= front) continue; // in the camera
      const p = [((u - camera.cx) / camera.fx) * z, ((v - camera.cy) / camera.fy) * z, z];
      const distance = (q: Numbers) => Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
      if (distance(tip) >= least || spheres.some((q) => distance(q) < q[3] + shape.info.radius + FREE)) continue;
      [best, least] = [p, distance(tip)];
    }
  best ??= toCamera(composed(X_WT, tool.info.center_of_mass)).map((x, i) => (i === 0 ? x + tool.info.radius + shape.info.radius + FREE : x));
  const from = rotated(FACING, center), X_CB = [...best.map((x, i) => x - from[i]), ...FACING];
  return [...composed(X_WC, X_CB.slice(0, 3)), ...product(X_WC.slice(3), FACING)];
}

/** An object of a run. Its settings move it from where it rests. */
export class PlacedObject {
  constructor(readonly shape: Tool, private readonly X_WB: Numbers, private readonly q_WC: Numbers) {}

  pose(settings: Record<string, Value>): Numbers {
    const way = rotated(this.q_WC, ['right', 'down', 'away'].map((name) => Number(settings[`objects.${name}`])));
    return this.X_WB.map((x, i) => x + (way[i] ?? 0));
  }
}

/** Makes the object of the settings and finds its place; null for none. A shape of the core is half as long as the tool's radius. */
export function placeObject(palpate: Palpate, settings: Record<string, Value>, given: GivenObject | null, around: Surroundings): PlacedObject | null {
  const name = String(settings['objects.shape']), isGiven = name === given?.name;
  if (!isGiven && !SHAPES.includes(name)) throw new Error(`There is no object ${name}; give ${SHAPES.join(', ')}, or open a file as an object.`);
  if (name === 'none') return null;
  const shape = isGiven ? palpate.loadTool(given.bytes) : palpate.packShape(name, 0.5 * around.tool.info.radius, `packing.spheres = ${SPHERES}`);
  try {
    return new PlacedObject(shape, restingPose(shape, around), Array.from(around.image.X_WC).slice(3));
  } catch (error) {
    shape.free();
    throw error;
  }
}
