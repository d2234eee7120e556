// Interactive 3-D picture of a report, drawn as in the viewer, with its option buttons.

import { button, element } from '../dom';
import { Drawing } from '../drawing';
import { createScene } from '../scene/scene_view';
import type { Hello, Mesh, SceneOptions, SceneView, Stream } from '../types';
import { floats, integers } from './bytes';
import { isDark, onInk, onPaper } from './ink';

const PAPER_SIZE = [680, 420]; // CSS pixels

export type Choice = [words: string, wish: Partial<SceneOptions>];

/**
 * `fill` gives the scene its data, once; `choices` are rows of buttons, the first of each is active at first.
 * `tools` in the result takes further buttons.
 */
export function picture(
  name: string, caption: string, choices: Choice[][], fill: (scene: SceneView) => void,
): { root: HTMLElement; tools: HTMLElement; requestDraw: () => void; float: (words: string | null) => void } {
  const canvas = element('canvas', 'scene'), still = element('canvas', 'still');
  canvas.setAttribute('aria-label', name);
  const label = element('output', 'when');
  const stage = element('div', 'stage', canvas, still, label);
  const place = element('div', 'place', stage);
  const tools = element('div', 'tools');
  const root = element('figure', 'picture', place, tools, element('figcaption', '', caption));
  let scene: SceneView;
  try {
    scene = createScene(canvas);
  } catch (error) {
    root.replaceChildren(element('p', 'warning', `This browser shows no 3-D picture (${(error as Error).message}).`));
    return { root, tools, requestDraw: () => {}, float: () => {} };
  }
  const drawing = new Drawing(canvas, () => scene.render(), () => {});
  for (const row of choices) {
    const made = row.map(([words, wish]) => button('', words, () => choose(wish, words), words));
    const choose = (wish: Partial<SceneOptions>, words: string) => {
      Object.assign(scene.options, wish);
      for (const one of made) one.setAttribute('aria-pressed', String(one.textContent === words));
      drawing.glide();
    };
    choose(row[0][1], row[0][0]);
    tools.append(element('div', 'choice', ...made));
  }
  tools.append(button('', 'as at first', () => {
    scene.resetView();
    drawing.glide();
  }, 'reset view'));
  fill(scene);
  const fit = () => {
    const [width, height] = onPaper() ? PAPER_SIZE : [stage.clientWidth, stage.clientHeight];
    if (width === 0 || height === 0) return;
    scene.resize(width, height, onPaper() ? 2 : Math.min(devicePixelRatio, 2));
    drawing.requestDraw();
  };
  new ResizeObserver(fit).observe(stage);
  onInk(() => {
    scene.options.dark = isDark();
    fit();
    if (!onPaper()) return;
    // Printing loses the canvas of WebGL: a still copy is printed instead.
    scene.render();
    [still.width, still.height] = [canvas.width, canvas.height];
    still.getContext('2d')!.drawImage(canvas, 0, 0);
  });
  addEventListener('beforeunload', () => scene.dispose());
  /** Keeps the picture in view, with `words` in it, while a plot elsewhere is looked at; null: no more. */
  let pointerY = 0;
  addEventListener('pointermove', ({ clientY }) => { pointerY = clientY; }, { passive: true });
  const float = (words: string | null) => {
    const { top, bottom } = place.getBoundingClientRect();
    const isFloating = words !== null && (stage.classList.contains('floating') || bottom < 200 || top > innerHeight - 200);
    place.style.height = isFloating ? `${place.offsetHeight}px` : '';
    stage.classList.toggle('floating', isFloating);
    stage.classList.toggle('low', pointerY < 0.5 * innerHeight); // not over what is pointed at
    label.textContent = words ?? '';
    drawing.requestDraw();
  };
  return { root, tools, requestDraw: () => drawing.requestDraw(), float };
}

export interface PackedMesh { positions: string; triangles: string } // base64 of floats and of whole numbers

export const meshOf = ({ positions, triangles }: PackedMesh): Mesh =>
  ({ positions: floats(positions), triangles: integers(triangles) });

/** Returns the hello message that sets up the scene; `objects`: their number. */
export function hello(
  tool: { center_of_mass_m: number[]; radius_m: number }, streams: Stream[], objects = 0,
): Hello {
  return {
    protocol: 0, version: '', kind: streams.length > 0 ? 'recording' : 'tool', title: '', streams, objects, handle: null, columns: [], controls: [],
    tool: {
      spheres: 0, volume: 0, radius: tool.radius_m,
      center_of_mass: tool.center_of_mass_m as [number, number, number],
    },
  };
}
