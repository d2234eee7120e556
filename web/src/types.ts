// What the server's messages decode to (docs/viewer-protocol.md), and what the parts of the page
// say to each other.

import type { Vector3 } from 'three';

export interface Pose {
  position: [number, number, number];
  quaternion: [number, number, number, number]; // x y z w
}

export interface Stream {
  name: string;
  width: number; height: number; fx: number; fy: number; cx: number; cy: number; rate: number;
  is_moving: boolean;
}

export interface Hello {
  protocol: number;
  version: string;
  kind: 'live' | 'recording' | 'tool';
  title: string;
  tool: { spheres: number; centre_of_mass: [number, number, number]; radius: number; volume: number };
  streams: Stream[]; // of each camera; none: there is no scene
  objects: number; // beside what they see
  /// How hard a page is pushed at most that holds the tool, N; null: none can.
  handle: { max_force: number } | null;
  columns: string[];
  controls: Control[];
}

export type Value = string | number | boolean;

export interface Control {
  key: string; // section.key of a settings file
  words: string;
  unit?: string; // of a number
  kind: 'choice' | 'number' | 'switch';
  choices?: string[]; // of a number: words that it can be instead
  low?: number;
  high?: number;
  whole?: boolean; // whole numbers only
  value: Value;
}

export interface Stage {
  name: string;
  num: number;
  p50: number; p99: number; p999: number; max: number; // microseconds
  histogram: [number, number][]; // lower end in microseconds, count
}

export interface State {
  time: number;
  running: boolean;
  fault: string | null;
  note: string | null;
  force?: string; // live: waiting, engaged, fading, off, held_off, ended
  handle?: 'free' | 'held'; // of runs whose tool a page holds
  paused: boolean;
  revision: number;
  settings: Record<string, Value>;
  frame_number: number;
  pages: number;
  ticks?: number; missed?: number; lost?: number; frames?: number; contacts?: number;
  sensor_age?: number;
  stages?: Stage[];
  duration?: number; speed?: number;
  num_marks?: number; // that can be got
}

export interface Mark { time: number; text: string }

/// n x (x y z r), tool frame.
export interface Spheres { count: number; data: Float32Array }
export interface Graph { count: number; pairs: Uint32Array }
export interface Mesh { positions: Float32Array; triangles: Uint32Array }
export interface Tree { count: number; data: Float32Array; levels: Uint8Array }
export interface Frame {
  number: number; time: number;
  camera: number; X_WC: Pose; // which one, and where it was
  width: number; height: number; unit: number; depth: Uint16Array; // counts of `unit` m
}
export interface Contact {
  number: number; time: number; X_WT: Pose;
  /// 0 outside, 1 boundary, 2 inside; plus 4: a plane cuts it; plus 8: where no camera sees; plus 16
  /// times 1 + the number of the camera that decided how deep it is.
  states: Uint8Array;
  objects: Pose[]; // X_WB of each
  planes: Float32Array; // nx ny nz d for each sphere with 4, in order, tool frame
}
/// Of the first camera, in its frame.
export interface Normals { number: number; width: number; height: number; data: Int8Array }
export interface Edges { number: number; count: number; data: Float32Array } // x y z dx dy dz

/// One tick; columns by name.
export type Sample = Record<string, number>;

export type ToolLook = 'spheres' | 'caps' | 'mesh' | 'hidden';
export type CameraView = 'free' | 'camera' | 'bird' | 'tool';

/// What the scene draws. The page's panels change it, the scene reads it at each drawing.
export interface SceneOptions {
  cloud: boolean;
  cloudColour: 'shaded' | 'depth' | 'normals';
  pointSize: number; // pixels
  stride: number; // every n-th pixel in both directions
  toolLook: ToolLook; // caps: inside parts cut exactly by their planes
  outside: boolean; // spheres outside too
  sphereColour: 'state' | 'camera'; // how they are, or who decided that
  graph: boolean;
  treeLevel: number; // -1: none
  normals: boolean; // as lines
  fog: boolean; // where no camera sees
  edges: boolean; // depth-change vectors
  edgePlanes: boolean;
  arrows: boolean; // force and torque at tool and hand
  ghost: boolean; // where the hand holds the tool
  trace: boolean; // path of the tool
  view: CameraView;
  dark: boolean;
}

/// What of a tool lies at a pixel; `turn` is any of it, with another button.
export type Grasp =
  | { kind: 'tool' | 'turn' }
  | { kind: 'ring'; number: number; axis: Vector3; perRadian: [number, number] }; // W, pixels

/// How the picture lies in W where the hand is: unit vectors, and what a pixel and the way from the
/// eye are there, m. The caller's own.
export interface PictureAxes { right: Vector3; up: Vector3; away: Vector3; perPixel: number; distance: number }

/// Force and torque of arrows of full length, N and N m, and the words beside them.
export interface ArrowScale { force: number; torque: number; forceWords: string; torqueWords: string }

/// The 3-D part, as the page sees it (scene/scene_view.ts).
export interface SceneView {
  readonly options: SceneOptions;
  setHello(hello: Hello): void;
  setSpheres(spheres: Spheres): void;
  setGraph(graph: Graph): void;
  setMesh(mesh: Mesh): void;
  setObjects(meshes: Mesh[]): void;
  setTree(tree: Tree): void;
  setFrame(frame: Frame): void;
  setContact(contact: Contact): void;
  /// Cuts a tool alone open: what lies where n . p <= d in T stays. After its spheres and mesh.
  setCut(n: readonly number[], d: number): void;
  setNormals(normals: Normals): void;
  setEdges(edges: Edges): void;
  /// Holds for all samples from now on. Until then the scale follows them, and nothing is written.
  setArrowScale(scale: ArrowScale): void;
  addSamples(samples: Sample[]): void;
  resize(width: number, height: number, pixelRatio: number): void;
  render(): void;
  picture(): Promise<Blob>; // PNG
  /// To look at the whole, the tool or from the sensor.
  resetView(): void;
  /// Where a point of W is on the canvas, CSS pixels; for tests.
  project(x: number, y: number, z: number): [number, number];
  /// Where the hand has the tool; null until it is known.
  readonly handPose: Pose | null;
  /// What of the tool or its rings is nearest to a pixel, within `reach` pixels; null: none.
  graspAt(x: number, y: number, reach: number): Grasp | null;
  pictureAxes(): PictureAxes;
  /// The hand, on the canvas.
  projectHand(): [number, number];
  /// This page holds the tool: it can be turned by rings.
  setHeld(isHeld: boolean): void;
  /// What is pointed at.
  setGrasp(grasp: Grasp | null): void;
  /// Force on the hand, as a share of the largest one: the spring to the hand, and the colour of the tool.
  setStrain(share: number): void;
  dispose(): void;
}
