// Data that the page requests from the program: only what is visible is sent.

import type { Hello, SceneOptions } from './types';

export interface Subscription {
  frames: boolean;
  contacts: boolean;
  surfaces: boolean;
  samples: boolean;
}

export function pictureSubscription(hello: Hello, options: SceneOptions, hasImage: boolean): Subscription {
  if (hello.kind === 'tool') return { frames: false, contacts: false, surfaces: false, samples: false };
  const hasSurface = options.normals || options.edges || options.edgePlanes || options.cloudColor === 'normals';
  // Camera poses are sent with their images.
  const hasPoses = hello.streams.length > 1 || hello.streams.some((stream) => stream.is_moving);
  return { frames: options.cloud || hasImage || hasSurface || hasPoses, contacts: true, surfaces: hasSurface, samples: true };
}

/** Parts of the tool, and the objects; each is requested once. */
export function neededShapes(hello: Hello, options: SceneOptions): string[] {
  const shapes = ['spheres'];
  if (options.graph) shapes.push('graph');
  if (options.toolLook === 'mesh' || options.ghost) shapes.push('mesh');
  if (options.treeLevel >= 0) shapes.push('tree');
  if (hello.objects > 0) shapes.push('objects');
  return shapes;
}
