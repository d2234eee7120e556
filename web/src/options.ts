import type { SceneOptions } from './types';

/** Default options: the point cloud, and the tool colored by the state of its spheres. */
export function defaultOptions(): SceneOptions {
  return {
    cloud: true,
    cloudColor: 'shaded',
    pointSize: 2,
    stride: 1,
    toolLook: 'caps',
    outside: true,
    sphereColor: 'state',
    graph: false,
    treeLevel: -1,
    normals: false,
    fog: false,
    edges: false,
    edgePlanes: false,
    arrows: true,
    ghost: true,
    trace: false,
    view: 'free',
    dark: true,
  };
}
