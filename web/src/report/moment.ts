// The moment of deepest contact of a run in 3-D, with its depth images.

import { element } from '../dom';
import { ARROW_COLORS, STATE_COLORS, THEMES } from '../scene/colors';
import { COVARIANCE } from '../scene/spread';
import { UNKNOWN } from '../scene/tool/spheres';
import type { ArrowScale, Contact, Pose, Sample, SceneView } from '../types';
import { bytes, floats, unpackDepth, type Depth } from './bytes';
import { captioned, heading, key, paragraph, warning } from './parts';
import { hello, meshOf, picture, type Choice, type PackedMesh } from './picture';
import { newtons, percent, short, TORQUE, VOLUME, withUnit } from './numbers';

/** A tool in the scene that depth cameras see, in W. */
export interface SeenTool {
  X_WT: number[]; // tx ty tz qx qy qz qw
  center_of_mass_m: number[];
  radius_m: number;
  spheres: string; // base64 of floats: x y z r in T
  states: string; // base64 of bytes: 0 outside, 1 boundary, 2 inside; plus 4: a plane cuts it
  planes: string; // base64 of floats: nx ny nz d in T, for each sphere with 4
  spheres_left_out: number;
  mesh?: PackedMesh | null; // null: too large for a page
  cameras: {
    name: string; X_WC: number[];
    width: number; height: number; fx: number; fy: number; cx: number; cy: number; unit: number;
    depth: string; // unpackDepth()
  }[];
  objects?: { X_WB: number[]; mesh: PackedMesh | null }[]; // null: mesh not in this page
}

export interface Moment extends SeenTool {
  time_s: number;
  volume_m3: number;
  objects_volume_m3: number; // the objects' share of it
  force_N: number[];
  torque_Nm: number[];
  force_covariance_N2?: number[]; // in the order of COVARIANCE; of a run with --std
}

/** Unpacks the depth image of each camera. */
export function depthsOf({ cameras }: SeenTool): Promise<Depth[]> {
  return Promise.all(cameras.map(({ depth, width, height }) => unpackDepth(depth, width, height)));
}

interface DrawnWrench { sample: Sample; scale: ArrowScale }

/** A pose of the tool, and the wrench on it in words and numbers. */
export interface ToolAt { time: number; X_WT: number[]; force_N: number[]; torque_Nm: number[] }

/** Shows the tool at another moment of the run in the picture; null: as at first. */
export type MoveTool = (at: ToolAt | null) => void;

/** Makes the 3-D picture; `wrench` is drawn as arrows if given. */
export function seenTool(
  tool: SeenTool, depths: Depth[], name: string, caption: string, wrench?: DrawnWrench,
): { root: HTMLElement; show: (contact: Partial<Contact>, wrench?: DrawnWrench) => void; float: (words: string | null) => void } {
  let view: SceneView | null = null, first: Contact;
  const drawn = picture(name, caption, [
    [['free', { view: 'free' }], ['camera', { view: 'camera' }], ['above', { view: 'bird' }], ['tool', { view: 'tool' }]],
    [...(tool.mesh ? [['solid', { toolLook: 'mesh' }] as Choice] : []), ['cut spheres', { toolLook: 'caps' }],
      ['whole spheres', { toolLook: 'spheres' }]],
    [['shaded', { cloud: true, cloudColor: 'shaded' }], ['by depth', { cloud: true, cloudColor: 'depth' }],
      ['no cloud', { cloud: false }]],
  ], (scene) => {
    const { objects = [] } = tool;
    scene.setHello(hello(tool, tool.cameras.map((camera) => ({ ...camera, rate: 0, is_moving: false })), objects.length));
    scene.options.ghost = false;
    const data = floats(tool.spheres);
    scene.setSpheres({ count: data.length / 4, data });
    if (tool.mesh) scene.setMesh(meshOf(tool.mesh));
    tool.cameras.forEach(({ X_WC, width, height, unit }, camera) => scene.setFrame({
      number: 0, time: 0, camera, X_WC: poseOf(X_WC), width, height, unit, depth: depths[camera].values,
    }));
    const shown = objects.filter(({ mesh }) => mesh);
    scene.setObjects(shown.map(({ mesh }) => meshOf(mesh!)));
    first = {
      number: 0, time: 0, X_WT: poseOf(tool.X_WT), objects: shown.map(({ X_WB }) => poseOf(X_WB)),
      states: bytes(tool.states), planes: floats(tool.planes),
    };
    view = scene;
    show({}, wrench);
    scene.resetView(); // beside the push, which is known now
  });
  function show(contact: Partial<Contact>, arrows?: DrawnWrench): void {
    if (!view) return;
    view.setContact({ ...first, ...contact });
    if (!arrows) return;
    view.setArrowScale(arrows.scale);
    view.addSamples([arrows.sample]);
  }
  return { root: drawn.root, show, float: drawn.float };
}

export const STATE_KEY: [string, string][] = [
  [STATE_COLORS.inside, 'inside: behind the surface'], [STATE_COLORS.boundary, 'boundary: at the surface'],
  [STATE_COLORS.outside, 'spheres outside: free'],
];

/** Returns the words for the share of a volume that is in objects; empty if there is none. */
export function inObjects(volume: number, objectsVolume: number): string {
  const share = objectsVolume / volume;
  return !(share > 0) ? '' : share > 0.995 ? ', in objects' : `, ${percent(share, 2)} of it in objects`;
}

/** `peaks`: largest force and torque of the run, N and N m; `nearest` in words, of a run without contact. */
export function momentSection(
  moment: Moment, depths: Depth[], peaks: { force: number; torque: number }, nearest: string,
): { parts: HTMLElement[]; moveTool: MoveTool } {
  const touches = moment.volume_m3 > 0, { objects = [] } = moment;
  const where = inObjects(moment.volume_m3, moment.objects_volume_m3);
  const parts: HTMLElement[] = [heading(touches ?
    `The deepest moment, at ${short(moment.time_s)} s${where}` : 'The tool never touched the surface')];
  if (!touches) parts.push(paragraph(`${nearest}The picture shows the start.`));
  if (!moment.X_WT.every((x) => typeof x === 'number')) {
    return { parts: [...parts, warning('The pose of the tool was no pose.')], moveTool: () => {} };
  }
  const force = newtons(Math.hypot(...moment.force_N)), torque = withUnit(Math.hypot(...moment.torque_Nm), TORQUE);
  const turning = 'Drag to turn, scroll or pinch to zoom. Point at a plot below to see where the tool was at that time.';
  const caption = touches ?
    `${withUnit(moment.volume_m3, VOLUME)} of the tool${where || ' behind the surface'}, pushed out with ${force}. ` +
    `Arrow and arc are full at the largest of the run: ${newtons(peaks.force)} and ${withUnit(peaks.torque, TORQUE)}. ` +
    `${turning} What of the tool is behind the surface glows through it.` : turning;
  const wrenchOf = (of: { force_N: number[]; torque_Nm: number[] }): DrawnWrench => ({
    sample: sampleOf(of),
    scale: peaks,
  });
  const made = seenTool(moment, depths, 'the deepest moment in 3-D', caption, touches ? wrenchOf(moment) : undefined);
  const unknown = { states: new Uint8Array(bytes(moment.states).length).fill(UNKNOWN), planes: new Float32Array(0) };
  const moveTool: MoveTool = (at) => {
    made.show(at ? { ...unknown, X_WT: poseOf(at.X_WT) } : {}, touches ? wrenchOf(at ?? moment) : undefined);
    made.float(at && `the tool at ${short(at.time)} s, in the depth image of ${short(moment.time_s)} s`);
  };
  parts.push(made.root, key([
    ...STATE_KEY,
    ...(objects.length > 0 ? [[THEMES.light.wood, 'objects; spheres in them are not marked']] : []),
    ...(touches ? [[ARROW_COLORS.force, `force on the tool: ${force}${moment.force_covariance_N2 ? ', and one standard deviation of it' : ''}`], [ARROW_COLORS.torque, `torque on the tool: ${torque}`]] : []),
  ] as [string, string][]));
  const numHidden = objects.filter(({ mesh }) => !mesh).length;
  if (numHidden > 0) parts.push(paragraph(`${numHidden} of ${objects.length} objects are not in this page: their meshes are too large.`));
  if (moment.spheres_left_out > 0) {
    parts.push(paragraph(`The ${moment.spheres_left_out} smallest spheres are not in this page.`));
  }
  return { parts, moveTool };
}

function poseOf(n: number[]): Pose {
  return { position: [n[0], n[1], n[2]], quaternion: [n[3], n[4], n[5], n[6]] };
}

function sampleOf(moment: { force_N: number[]; torque_Nm: number[]; force_covariance_N2?: number[] }): Sample {
  const sample: Sample = { time: 0 };
  'xyz'.split('').forEach((axis, i) => {
    sample[`contact_force_${axis}`] = moment.force_N[i];
    sample[`contact_torque_${axis}`] = moment.torque_Nm[i];
    sample[`force_${axis}`] = 0;
  });
  moment.force_covariance_N2?.forEach((value, i) => { sample[`contact_force_${COVARIANCE[i]}`] = value; });
  return sample;
}

export interface Probe {
  pixel: number[]; point: number[]; time: number; why_place: string; tip: number[]; why_tip: string;
  note: string; how_to_aim: string;
}

/** Describes the automatic path of a run without one; `scale`: pixels of the camera per pixel of `depth`. */
export function probeSection(probe: Probe, depth: Depth | null, scale: number): HTMLElement[] {
  const at = (values: number[], digits: number) => values.map((value) => value.toFixed(digits)).join(', ');
  const parts: HTMLElement[] = [heading('Where it probes')];
  if (probe.note) parts.push(warning(`${probe.note}.`));
  parts.push(paragraph(
    `No path was given, so Palpate chose one. It probes the pixel ${at(probe.pixel, 0)}, where the surface is at ` +
    `${at(probe.point, 3)} m when the tool arrives after ${short(probe.time, 3)} s: ${probe.why_place}. It leads with ` +
    `the tool's point ${at(probe.tip, 4)} m: ${probe.why_tip}. To choose otherwise, ${probe.how_to_aim}.`));
  if (depth) {
    parts.push(captioned(depthPicture(depth, probe.pixel, scale),
      'The depth image at the deepest moment, near is bright, with the probed pixel. The numbers in the corners are ' +
      'pixels u, v for --probe.'));
  }
  return parts;
}

function depthPicture(depth: Depth, pixel: number[], scale: number): HTMLElement {
  const { width, height, values } = depth;
  const canvas = element('canvas', 'depth');
  [canvas.width, canvas.height] = [width, height];
  const context = canvas.getContext('2d')!;
  const image = context.createImageData(width, height);
  const measured = values.filter((value) => value > 0 && value < 65535).sort();
  const low = measured[Math.floor(0.01 * (measured.length - 1))] ?? 0;
  const high = Math.max(measured[Math.floor(0.95 * (measured.length - 1))] ?? 1, low + 1);
  values.forEach((value, i) => {
    const far = Math.min(1, Math.max(0, (value - low) / (high - low)));
    image.data.fill(60 + 180 * (1 - far), 4 * i, 4 * i + 3);
    image.data[4 * i + 3] = value > 0 && value < 65535 ? 255 : 0;
  });
  context.putImageData(image, 0, 0);
  const [u, v] = pixel.map((x) => x / scale + 0.5), unit = width / 40;
  for (const [color, thick] of [['#000', 0.5], ['#ffb000', 0.22]] as const) {
    context.strokeStyle = color;
    context.lineWidth = thick * unit;
    context.beginPath();
    context.arc(u, v, unit, 0, 2 * Math.PI);
    context.stroke();
  }
  context.font = `${0.9 * unit}px system-ui, sans-serif`;
  const write = (words: string, x: number, y: number, align: CanvasTextAlign) => {
    context.textAlign = align;
    context.lineWidth = 0.25 * unit;
    context.strokeStyle = '#000';
    context.strokeText(words, x, y);
    context.fillStyle = '#fff';
    context.fillText(words, x, y);
  };
  const atRight = u > 0.7 * width;
  write(pixel.map((x) => x.toFixed(0)).join(', '), u + (atRight ? -1.6 : 1.6) * unit, v, atRight ? 'right' : 'left');
  write('0, 0', 0.3 * unit, unit, 'left');
  write(`${Math.round(width * scale) - 1}, ${Math.round(height * scale) - 1}`, width - 0.3 * unit, height - 0.4 * unit, 'right');
  return canvas;
}
