// A tool cut open, with a movable cutting plane.

import { button, element } from '../dom';
import { OTHER_COLORS, STATE_COLORS } from '../scene/colors';
import type { SceneView } from '../types';
import { floats } from './bytes';
import { key } from './parts';
import { hello, meshOf, picture, type PackedMesh } from './picture';

export interface Solid {
  low_m: number[]; high_m: number[]; // of the mesh's box
  center_of_mass_m: number[];
  radius_m: number; // about the center of mass
  spheres: string; // base64 of floats: x y z r
  mesh: PackedMesh | null;
}

/** Cut across the shortest side at first. */
export function cutOpen(solid: Solid, name: string, caption: string): { root: HTMLElement; numShown: number } {
  const shown = floats(solid.spheres);
  const { low_m: low } = solid;
  const sides = solid.high_m.map((high, i) => high - low[i]);
  let axis = sides.indexOf(Math.min(...sides)), share = 0.5;
  let scene: SceneView | null = null;
  const cut = () => {
    const n = [0, 0, 0];
    n[axis] = 1;
    scene?.setCut(n, low[axis] + share * sides[axis]);
  };
  const { root, tools, requestDraw } = picture(name, caption, [[['cut open', { toolLook: 'caps' }], ['mesh', { toolLook: 'mesh' }]]],
    (made) => {
      scene = made;
      made.setHello(hello(solid, []));
      Object.assign(made.options, { outside: false, ghost: false, arrows: false });
      made.setSpheres({ count: shown.length / 4, data: shown });
      if (solid.mesh) made.setMesh(meshOf(solid.mesh));
      cut();
    });
  const slider = element('input');
  Object.assign(slider, { type: 'range', min: '0', max: '1', step: '0.005', value: '0.5', ariaLabel: 'where it is cut' });
  slider.addEventListener('input', () => {
    share = Number(slider.value);
    cut();
    requestDraw();
  });
  const across = ['x', 'y', 'z'].map((side, i) => button('', `cut across ${side}`, () => {
    axis = i;
    press();
    cut();
    requestDraw();
  }, `across ${side}`));
  const press = () => across.forEach((one, i) => one.setAttribute('aria-pressed', String(i === axis)));
  press();
  tools.append(element('div', 'choice', ...across), slider);
  return { root, numShown: shown.length / 4 };
}

export const cutColors = () => key([[STATE_COLORS.boundary, 'cut spheres'],
  [STATE_COLORS.inside, 'whole spheres behind the cut'], [OTHER_COLORS.wall, 'wall of the mesh in the cut']]);
