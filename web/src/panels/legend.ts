import { element } from '../dom';
import { ARROW_COLORS, cameraColor, EDGE_COLORS, heat, OTHER_COLORS, STATE_COLORS, THEMES } from '../scene/colors';
import type { Hello, SceneOptions } from '../types';

type Entry = [color: string, word: string, meaning: string];

/** Legend of the colors in the scene. */
export class Legend {
  readonly root = element('section', 'card legend');
  private shown = '';

  constructor() {
    this.root.setAttribute('aria-label', 'what the colors mean');
  }

  /** `hasHand`: the run has a hand. */
  update(hello: Hello, options: SceneOptions, hasHand: boolean): void {
    const list = entries(hello, options, hasHand);
    const key = JSON.stringify(list);
    if (key === this.shown) return;
    this.shown = key;
    this.root.hidden = list.length === 0;
    this.root.replaceChildren(
      ...list.map(([color, word, meaning]) => {
        const dot = element('i');
        dot.style.background = color;
        return element('p', '', dot, element('b', '', word), element('span', '', meaning));
      }),
    );
  }
}

function entries(hello: Hello, options: SceneOptions, hasHand: boolean): Entry[] {
  const list: Entry[] = [];
  const hasStates = options.toolLook === 'spheres' || options.toolLook === 'caps';
  if (hello.kind !== 'tool') {
    if (hasStates && options.sphereColor === 'camera') {
      const { streams } = hello;
      streams.forEach(({ name }, i) =>
        list.push([cameraColor(i, streams.length), name || `camera ${i + 1}`, 'determined the depth']));
      list.push([OTHER_COLORS.remembered, 'brown', 'remembered from earlier frames']);
      list.push([OTHER_COLORS.fog, 'gray', 'where no camera sees']);
      if (options.outside) list.push([STATE_COLORS.outside, 'red', 'outside']);
    } else if (hasStates) {
      list.push([STATE_COLORS.inside, 'blue', 'inside the scene']);
      list.push([STATE_COLORS.boundary, 'purple', 'cut by the surface']);
      if (options.outside) list.push([STATE_COLORS.outside, 'red', 'outside']);
    } else if (options.toolLook === 'mesh') {
      list.push([STATE_COLORS.inside, 'blue', 'of the tool, inside the scene']);
      list.push([STATE_COLORS.boundary, 'purple line', 'where it is cut by the surface']);
      list.push([THEMES[options.dark ? 'dark' : 'light'].metal, 'gray', 'of the tool, outside']);
    }
    if (hello.objects > 0) list.push([THEMES[options.dark ? 'dark' : 'light'].wood, 'wood', 'CAD object']);
    if (options.arrows) {
      list.push([ARROW_COLORS.force, 'yellow arrow', 'force on the tool']);
      list.push([ARROW_COLORS.torque, 'green arc', 'torque on the tool']);
      if (hasHand && !hello.handle) list.push([ARROW_COLORS.hand, 'red arrow', 'force on the hand']);
    }
    if (hasHand && options.ghost) list.push([OTHER_COLORS.ghost, 'ghost', 'where the hand is']);
    if (hello.handle) list.push([heat(0.5), 'spring', 'hand to tool: its force']);
    if (options.trace) list.push([OTHER_COLORS.trace, 'line', 'path of the tool']);
    if (options.fog) list.push([OTHER_COLORS.fog, 'fog', 'where no camera sees']);
    if (options.normals) list.push([OTHER_COLORS.normal, 'lines', 'normals of the surface']);
    if (options.edges) list.push([EDGE_COLORS.start, 'green to purple', 'where the depth jumps']);
  }
  if (options.treeLevel >= 0) list.push([OTHER_COLORS.tree, 'shells', `level ${options.treeLevel} of the tree`]);
  return list;
}
