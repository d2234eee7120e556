// Options in the page's address: ?stride=4&look=caps&view=camera&plots=0

import type { PanelName } from './panels/dock';
import type { CameraView, SceneOptions, ToolLook } from './types';

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
