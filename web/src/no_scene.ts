import { Vector3 } from 'three';
import { defaultOptions } from './options';
import type { SceneView } from './types';

/** Stands in for the scene if the browser lacks WebGL 2: plots and controls work without it. */
export function withoutScene(): SceneView {
  const nothing = () => {};
  return {
    options: defaultOptions(),
    setHello: nothing,
    setSpheres: nothing,
    setGraph: nothing,
    setMesh: nothing,
    setObjects: nothing, setTree: nothing,
    setFrame: nothing,
    setContact: nothing,
    setCut: nothing,
    setNormals: nothing,
    setEdges: nothing,
    setArrowScale: nothing,
    addSamples: nothing,
    resize: nothing,
    render: nothing,
    picture: () => Promise.reject(new Error('There is no 3-D picture in this browser.')),
    resetView: nothing,
    project: () => [0, 0],
    handPose: null,
    graspAt: () => null,
    pictureAxes: () => ({
      right: new Vector3(1, 0, 0), up: new Vector3(0, -1, 0), away: new Vector3(0, 0, 1), perPixel: 0, distance: 0,
    }),
    projectHand: () => [0, 0],
    setHeld: nothing,
    setGrasp: nothing,
    setStrain: nothing,
    dispose: nothing,
  };
}
