// One level of the sphere tree.

import type { SceneOptions, Tree } from '../../types';
import { OTHER_COLORS } from '../colors';
import { Shells } from './shells';

export class TreeNodes {
  private readonly shells = new Shells(OTHER_COLORS.tree, 0.03);
  private tree: Tree | null = null;
  private level = -1; // level of the shells

  get object() {
    return this.shells.object;
  }

  setTree(tree: Tree): void {
    this.tree = tree;
    this.level = -1;
  }

  update(options: SceneOptions): void {
    this.object.visible = options.treeLevel >= 0 && this.tree !== null;
    if (!this.tree || !this.object.visible || options.treeLevel === this.level) return;
    this.level = options.treeLevel;
    const { count, data, levels } = this.tree;
    const nodes: number[] = [];
    for (let i = 0; i < count; ++i) {
      if (levels[i] === this.level) nodes.push(...data.subarray(4 * i, 4 * i + 4));
    }
    this.shells.setSpheres(new Float32Array(nodes));
  }

  dispose(): void {
    this.shells.dispose();
  }
}
