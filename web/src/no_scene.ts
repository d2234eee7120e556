import { defaultOptions } from './options';
import type { SceneView } from './types';

/// In place of the scene where the browser has no WebGL 2: plots and controls go on without it.
export function withoutScene(): SceneView {
  const nothing = () => {};
  return {
    options: defaultOptions(),
    setHello: nothing,
    setSpheres: nothing,
    setGraph: nothing,
    setMesh: nothing,
    setTree: nothing,
    setFrame: nothing,
    setContact: nothing,
    setCut: nothing,
    setNormals: nothing,
    setEdges: nothing,
    addSamples: nothing,
    resize: nothing,
    render: nothing,
    picture: () => Promise.reject(new Error('There is no 3-D picture in this browser.')),
    resetView: nothing,
    project: () => [0, 0],
    dispose: nothing,
  };
}
