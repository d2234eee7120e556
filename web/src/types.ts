// Types of the decoded server messages (docs/viewer-protocol.md) and of the interfaces between the
// parts of the page.

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
  tool: { spheres: number; center_of_mass: [number, number, number]; radius: number; volume: number };
  streams: Stream[]; // one per camera; empty: no scene
  objects: number; // rigid objects of the scene
  /** Largest force on a page that holds the tool, N; null: no page can hold it. */
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
  handle?: 'free' | 'held'; // only if pages can hold the tool
  paused: boolean;
  revision: number;
  settings: Record<string, Value>;
  frame_number: number;
  pages: number;
  ticks?: number; missed?: number; lost?: number; frames?: number; contacts?: number;
  sensor_age?: number;
  stages?: Stage[];
  duration?: number; speed?: number;
  num_marks?: number; // marks available
}

export interface Mark { time: number; text: string }

/** Packed x y z r per sphere, tool frame. */
export interface Spheres { count: number; data: Float32Array }
export interface Graph { count: number; pairs: Uint32Array }
export interface Mesh { positions: Float32Array; triangles: Uint32Array }
export interface Tree { count: number; data: Float32Array; levels: Uint8Array }
export interface Frame {
  number: number; time: number;
  camera: number; X_WC: Pose; // its index, and its pose
  width: number; height: number; unit: number; depth: Uint16Array; // counts of `unit` m
}
export interface Contact {
  number: number; time: number; X_WT: Pose;
  /**
   * Per sphere 0 outside, 1 boundary, 2 inside; plus 4: a plane cuts it; plus 8: no camera sees it; plus 16
   * times 1 + the index of the camera that decided its depth.
   */
  states: Uint8Array;
  objects: Pose[]; // X_WB of each
  planes: Float32Array; // nx ny nz d for each sphere with 4, in order, tool frame
}
/** Normals of the first camera, in its frame. */
export interface Normals { number: number; width: number; height: number; data: Int8Array }
export interface Edges { number: number; count: number; data: Float32Array } // x y z dx dy dz

/** One tick; values by column name. */
export type Sample = Record<string, number>;

export type ToolLook = 'spheres' | 'caps' | 'mesh' | 'hidden';
export type CameraView = 'free' | 'camera' | 'bird' | 'tool';

/** Options of the scene. The page's panels change them, the scene reads them at each drawing. */
export interface SceneOptions {
  cloud: boolean;
  cloudColor: 'shaded' | 'depth' | 'normals';
  pointSize: number; // pixels
  stride: number; // every n-th pixel in both directions
  toolLook: ToolLook; // caps: inside parts cut exactly by their planes
  outside: boolean; // outside spheres too
  sphereColor: 'state' | 'camera'; // by state, or by deciding camera
  graph: boolean;
  treeLevel: number; // -1: none
  normals: boolean; // as needles
  fog: boolean; // space that no camera sees
  edges: boolean; // depth-change vectors
  edgePlanes: boolean;
  arrows: boolean; // force and torque at tool and hand
  ghost: boolean; // hand's pose of the tool
  trace: boolean; // path of the tool
  view: CameraView;
  dark: boolean;
}

/** Part of a tool at a pixel; `turn`: grasped with another button. */
export type Grasp =
  | { kind: 'tool' | 'turn' }
  | { kind: 'ring'; number: number; axis: Vector3; perRadian: [number, number] }; // W, pixels

/**
 * Axes of the picture in W at the hand: unit vectors, size of a pixel, and distance from the eye, m. A copy
 * that the caller may change.
 */
export interface PictureAxes { right: Vector3; up: Vector3; away: Vector3; perPixel: number; distance: number }

/** Force and torque of arrows of full length, N and N m. */
export interface ArrowScale { force: number; torque: number }

/** The 3-D part, as the page sees it (scene/scene_view.ts). */
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
  /** Cuts a tool alone open: the part with n . p <= d in T stays. Call after its spheres and mesh. */
  setCut(n: readonly number[], d: number): void;
  setNormals(normals: Normals): void;
  setEdges(edges: Edges): void;
  /** Fixes the scale for all later samples. Without it the scale follows them. */
  setArrowScale(scale: ArrowScale): void;
  addSamples(samples: Sample[]): void;
  resize(width: number, height: number, pixelRatio: number): void;
  render(): void;
  picture(): Promise<Blob>; // PNG
  /** Frames the tool, or the scene while the tool's pose is unknown. */
  resetView(): void;
  /** Projects a point of W to the canvas, CSS pixels; for tests. */
  project(x: number, y: number, z: number): [number, number];
  /** Hand pose of the tool; null until it is known. */
  readonly handPose: Pose | null;
  /** Returns the nearest ring, else the tool, within `reach` pixels of a point of the canvas; null: none. */
  graspAt(x: number, y: number, reach: number): Grasp | null;
  pictureAxes(): PictureAxes;
  /** Projects the hand to the canvas, CSS pixels. */
  projectHand(): [number, number];
  /** Shows the rings while this page holds the tool. */
  setHeld(isHeld: boolean): void;
  /** Highlights the grasped part. */
  setGrasp(grasp: Grasp | null): void;
  /** Sets the force on the hand as a share of the largest: color of the spring and of the tool. */
  setStrain(share: number): void;
  dispose(): void;
}
