// Rigid objects of the scene at their current poses.

import { Group } from 'three';
import type { Mesh, Pose, SceneOptions } from '../types';
import { setPose } from './poses';
import { ToolMesh } from './tool/tool_mesh';

export class Objects {
  readonly object = new Group();
  private meshes: ToolMesh[] = [];
  private poses: Pose[] = [];

  setMeshes(meshes: Mesh[]): void {
    this.dispose();
    this.meshes = meshes.map((mesh) => {
      const drawn = new ToolMesh('wood');
      drawn.setMesh(mesh);
      drawn.strain = 0;
      return drawn;
    });
    for (const { object } of this.meshes) this.object.add(object);
    this.setPoses(this.poses);
  }

  setPoses(poses: Pose[]): void {
    this.poses = poses;
    this.meshes.forEach(({ object }, i) => poses[i] && setPose(object, poses[i]));
  }

  /** Poses arrive with the first contact. */
  update(options: SceneOptions): void {
    this.meshes.forEach((mesh, i) => {
      mesh.update(options);
      mesh.object.visible &&= i < this.poses.length;
    });
  }

  dispose(): void {
    this.object.clear();
    for (const mesh of this.meshes) mesh.dispose();
    this.meshes = [];
  }
}
