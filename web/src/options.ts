// Options of the scene: by default, and in the page's address: ?stride=4&look=caps&view=camera&plots=0

import type { PanelName } from './panels/dock';
import type { CameraView, SceneOptions, ToolLook } from './types';

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

const LOOKS: ToolLook[] = ['spheres', 'caps', 'mesh', 'hidden'];
const VIEWS: CameraView[] = ['free', 'camera', 'bird', 'tool'];
const PANELS: PanelName[] = ['plots', 'image', 'controls'];

/** Applies the address to the options. Returns the panels that are open at first. */
export function applyAddress(address: URLSearchParams, options: SceneOptions): PanelName[] {
  const stride = Math.round(Number(address.get('stride')));
  if (stride >= 1 && stride <= 64) options.stride = stride;
  options.toolLook = LOOKS.find((look) => look === address.get('look')) ?? options.toolLook;
  options.view = VIEWS.find((view) => view === address.get('view')) ?? options.view;
  return PANELS.filter((name) => address.get(name) !== '0');
}
