// Ghost of the tool at the hand's pose, when the simulated tool lags behind or the scene holds it back: it
// shows how far the coupling is stretched.

import { Group } from 'three';
import type { Pose, Spheres } from '../../types';
import { OTHER_COLORS } from '../colors';
import { distance, rotationBetween, setPose } from '../poses';
import { Shells } from './shells';
import type { ToolMesh } from './tool_mesh';

const LEAST = 0.0005; // m: no ghost below this distance
const CLEAR = 0.004;  // m: full opacity from here on

export class Ghost {
  readonly object = new Group();
  private readonly shells = new Shells(OTHER_COLORS.ghost, 0.0);
  private apart = 0; // m
  private radius = 0.1;

  /** Draws the ghost also behind the scene's surface. */
  set throughAll(value: boolean) {
    this.mesh.ghostIsInFront = value;
  }

  constructor(private readonly mesh: ToolMesh) {
    this.object.add(mesh.ghost, this.shells.object);
  }

  /** `radius` of the tool converts rotation to distance. */
  setTool(spheres: Spheres, radius: number): void {
    this.shells.setSpheres(spheres.data);
    this.radius = radius;
  }

  setPoses(X_WT: Pose, X_WT_hand: Pose): void {
    setPose(this.object, X_WT_hand);
    this.apart = distance(X_WT, X_WT_hand) + 0.5 * this.radius * rotationBetween(X_WT, X_WT_hand);
  }

  update(shown: boolean): void {
    this.object.visible = shown && this.apart > LEAST;
    const opacity = Math.min(1, (this.apart - LEAST) / (CLEAR - LEAST));
    this.mesh.ghostOpacity = opacity;
    this.shells.opacity = 0.5 * opacity;
    this.mesh.ghost.visible = this.mesh.loaded;
    this.shells.object.visible = !this.mesh.loaded;
  }

  dispose(): void {
    this.shells.dispose();
  }
}
